"""The health of one valve as one JSON object, which a digest guards. Pure.

    {"format": "positioner-health", "schema": 1, "valve": "FV-101", "generation": 0, "started": "2026-05-09T07:35:25Z",
     "saved": "2026-05-10T07:35:25Z", "sections": {"counters": {…}}, "sha256": "…"}

Each section is one part of health, in its own form; the store only keeps them. `generation` counts resets, `started` is
the date of the first start or of the last reset of the counters.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from positioner.health.monitor import check_sections

FORMAT, SCHEMA = "positioner-health", 1
_KEYS = {"format", "schema", "valve", "generation", "started", "saved", "sections", "sha256"}
_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")


@dataclass(frozen=True, slots=True)
class HealthDocument:
    """The sections of a valve, and their dates in UTC; `saved` is empty before the first save."""

    valve_id: str
    started: str
    generation: int = 0
    saved: str = ""
    sections: dict[str, Any] = field(default_factory=dict)


def to_plain(document: HealthDocument) -> dict[str, Any]:
    """Return the object of the document.

    Raises:
        ValueError: a section holds what JSON cannot, like NaN.
    """
    content = {
        "format": FORMAT,
        "schema": SCHEMA,
        "valve": document.valve_id,
        "generation": document.generation,
        "started": document.started,
        "saved": document.saved,
        "sections": document.sections,
    }
    return {**content, "sha256": _digest(content)}


def from_plain(plain: Any) -> HealthDocument:
    """Return the document in an object that `json.loads` has read.

    Raises:
        ValueError: it is none, or not as it was written, or a section of it cannot be used.
    """
    if not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise ValueError("is no health of a valve")
    if plain.get("schema") != SCHEMA:
        raise ValueError(f"has schema {plain.get('schema')!r}, this version knows {SCHEMA}: another version wrote it")
    content = {key: value for key, value in plain.items() if key != "sha256"}
    if set(plain) != _KEYS or plain["sha256"] != _digest(content):
        raise ValueError("is damaged: its content does not fit its digest")
    valve, generation, sections = plain["valve"], plain["generation"], plain["sections"]
    if not isinstance(valve, str) or type(generation) is not int or generation < 0 or not isinstance(sections, dict):
        raise ValueError("has an impossible valve, generation or sections")
    for date in (plain["started"], *filter(None, (plain["saved"],))):
        if not isinstance(date, str) or not _DATE.fullmatch(date):
            raise ValueError("has an impossible date")
        datetime.fromisoformat(date)
    check_sections(sections)
    return HealthDocument(valve, plain["started"], generation, plain["saved"], sections)


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, allow_nan=False).encode()).hexdigest()
