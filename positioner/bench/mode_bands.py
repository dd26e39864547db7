"""The positioner's modes over a run as the bands of a trend. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.bench.modes import cause_in_words, name_of
from positioner.pictures.bands import Band
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.bench.modes import ModeSpan


def bands_of(spans: Iterable[ModeSpan]) -> list[Band]:
    """Return every span that is not normal; those before the first ACTIVE are usual, and named where they have room."""
    bands: list[Band] = []
    begun = False
    for span in spans:
        begun = begun or span.mode is Mode.ACTIVE
        if not span.is_normal:
            words = f"{name_of(span.mode)}: {cause_in_words(span.cause)}"
            bands.append(Band(span.begin_s, span.end_s, name_of(span.mode), words, notable=begun))
    return bands
