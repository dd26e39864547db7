"""What a native class lacks of the dataclass that it was. The compiled wheel has it as `positioner/native`."""

from __future__ import annotations

import dataclasses
from typing import Any

_COPIED = frozenset({"__annotations__", "__dataclass_fields__", "__dataclass_params__", "__doc__", "__match_args__"})

_twins: dict[type[Any], type[Any]] = {}
"""By native class: the interpreted dataclass with the same fields."""


def complete(cls: Any, source: str, names: dict[str, Any]) -> None:
    """Give `cls` what `dataclasses`, `match`, `pickle` and `print` need; `source` is its dataclass, without methods."""
    space = {**names, "dataclass": _dataclass, "KW_ONLY": dataclasses.KW_ONLY, "field": dataclasses.field}
    space |= {base.__name__: _twins[base] for base in cls.__mro__[1:] if base in _twins}
    exec(f"from __future__ import annotations\n{source}", space)  # noqa: S102 - our own source
    twin = _twins[cls] = space[cls.__name__]
    for name, value in vars(twin).items():
        if name in _COPIED or (name == "__repr__" and name not in vars(cls)) or (name == "__hash__" and value is None):
            setattr(cls, name, value)
    if hasattr(twin, "__pydantic_config__"):  # settings: pydantic makes them by setting their slots
        cls.__pydantic_config__ = twin.__pydantic_config__
        cls.__slots__ = tuple(twin.__annotations__)
    cls.__reduce__ = _reduce


def _dataclass(cls: Any = None, /, **options: Any) -> Any:
    """Return the class as a dataclass; slots would be made by a second class."""
    return dataclasses.dataclass(**{**options, "slots": False})(cls) if cls else lambda cls: _dataclass(cls, **options)


def _reduce(self: Any) -> tuple[Any, ...]:
    """Return what a pickle holds."""
    fields = [(each.init, each.name, getattr(self, each.name)) for each in dataclasses.fields(self)]
    given = {name: value for init, name, value in fields if init}
    return _made, (self.__class__, given, {name: value for init, name, value in fields if not init})


def _made(cls: type[Any], given: dict[str, Any], rest: dict[str, Any]) -> Any:
    made = cls(**given)
    for name, value in rest.items():
        setattr(made, name, value)
    return made
