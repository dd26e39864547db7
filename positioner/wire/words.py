"""The words of an enumeration's member, for people. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from enum import Enum


def in_words(member: Enum) -> str:
    """Return the name of the member in small letters, with spaces."""
    return member.name.lower().replace("_", " ")
