"""Immutable values that are cheap to make: what the pure rooms hand from one function to the next. Pure.

For a type checker, `dataclass` and `replace` are those of the standard library: a change of a field is an error. At run
time a value is not frozen, since a frozen dataclass takes more than twice as long to make, and a cycle makes about a
hundred of them; `replace` is a function made for each class. The compiled build turns these classes into native ones.

The type checker holds that no field of a value is ever changed, not the interpreter. A class that is declared without
`frozen=True` is for a function that changes its own copy, which it makes by `replace(value)`.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass, replace
else:
    _OLD = object()

    def dataclass(cls: Any = None, /, *, slots: bool, frozen: bool = False, eq: bool = True, **options: bool) -> Any:
        """Return the decorator of `dataclasses.dataclass`, with values that are hashable, and a fast `replace`."""
        if not slots:
            raise TypeError("a value has slots")

        def made(bare: Any) -> Any:
            value = dataclasses.dataclass(slots=True, eq=eq, unsafe_hash=eq and frozen, **options)(bare)
            value.__replace__ = _replacement(value)
            return value

        return made if cls is None else made(cls)

    def _replacement(cls: Any) -> Any:
        """Return the method `__replace__` of `cls`, which makes another value in one call of its class."""
        names = sorted(
            ((field.name, field.kw_only) for field in dataclasses.fields(cls) if field.init), key=lambda name: name[1]
        )
        old = ", ".join(f"{name}=_OLD" for name, _ in names)
        new = ", ".join(
            f"{f'{name}=' if kw_only else ''}self.{name} if {name} is _OLD else {name}" for name, kw_only in names
        )
        space: dict[str, Any] = {"_OLD": _OLD}
        exec(f"def __replace__(self, *, {old}):\n return self.__class__({new})" if names else _EMPTY, space)  # noqa: S102
        return space["__replace__"]

    _EMPTY = "def __replace__(self):\n return self.__class__()"

    def replace(value: Any, /, **changes: Any) -> Any:
        """Return `value` with other fields, as `dataclasses.replace` does."""
        try:
            method = value.__replace__
        except AttributeError:
            return dataclasses.replace(value, **changes)
        return method(**changes)


__all__ = ["dataclass", "replace"]
