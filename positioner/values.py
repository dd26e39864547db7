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
        """Return the method `__replace__` of `cls`; it fills a new object, by `__init__` only where that computes."""
        names = [field.name for field in dataclasses.fields(cls) if field.init]
        computes = hasattr(cls, "__post_init__") or len(names) < len(dataclasses.fields(cls))
        old = ", ".join(f"{name}=_OLD" for name in names)
        new = [f"{name} = self.{name} if {name} is _OLD else {name}" for name in names]
        made = [f"return self.__class__({', '.join(f'{name}={name}' for name in names)})"]
        if not computes:
            new, made = ["new = _NEW(self.__class__)", *(f"new.{each}" for each in new)], ["return new"]
        space: dict[str, Any] = {"_OLD": _OLD, "_NEW": object.__new__}
        exec(f"def __replace__(self{', *, ' if names else ''}{old}):\n " + "\n ".join([*new, *made]), space)  # noqa: S102
        return space["__replace__"]

    def replace(value: Any, /, **changes: Any) -> Any:
        """Return `value` with other fields, as `dataclasses.replace` does."""
        try:
            method = value.__replace__
        except AttributeError:
            return dataclasses.replace(value, **changes)
        return method(**changes)


__all__ = ["dataclass", "replace"]
