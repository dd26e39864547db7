"""What every table of settings in a TOML file has in common. Pure."""

from __future__ import annotations

from typing import Any, ClassVar


class SettingsTable:
    """The base of a dataclass that a table of a file becomes: no unknown key, and neither NaN nor infinity."""

    __slots__ = ()
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": False}
