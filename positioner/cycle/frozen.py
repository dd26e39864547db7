"""Whether a noisy sensor has fallen silent: what it has shown of its noise, and how long it repeats itself. Pure.

A sensor whose noise is far above its resolution hardly ever says the same twice, whatever the stem does. One that does
so for far longer than it ever did has frozen, also where the stem may rest: under any current, and through any push.

It must have shown its noise first. Changes to and fro count for it, and changes onwards against it, so that a clean
sensor that follows a moving stem shows none; changes count for it only while the stem rests, by the command and the
believed stick band, or while nothing is commanded. The noise must be `NOISE_OF_RESOLUTION` times the smallest change,
so that a quantised sensor, whose readings repeat where the stem happens to rest between two steps, is left alone.

How sure is it? White noise of mean absolute change d and resolution q repeats a reading with p = q / (pi d) < 2 %:
`REPEATS` in a row have a probability of 0.02^100 where it was seen. Where the noise is proportional to the reading and
50 times smaller (the lowest place that is judged, against the full stroke), p < 0.93 at worst: 100 in a row have
1e-3, 500 (`SILENCE_S` at 1 kHz) 1e-16, and a long row that ends makes the limit ten times as long. A sensor that holds
its draws repeats for the time that it holds them, which `longest_s` knows.
"""

from __future__ import annotations

from dataclasses import dataclass

CHANGES_SHOWN = 100
"""So many changes at rest, of which two thirds (white noise) go to and fro, are noise."""
NOISE_OF_RESOLUTION = 16.0
"""Mean absolute change, at rest, over the smallest change ever seen."""
LONGEST_REPEATS = 10.0
"""How many times the longest repeat that the sensor has shown is silence."""
REPEATS = 100
"""Fewer readings than that, the same to the bit, are never silence."""
SILENCE_S = 0.5
"""Nor is a shorter time."""
_LEARNED_OF_LIMIT = 1.0 / 3.0
"""A longer part of what is silence was no repeat by chance, and teaches nothing."""


@dataclass(frozen=True, slots=True)
class Noise:
    """What a sensor has shown of its noise since the start.

    position_m: the last reading; change_m: the last change of it that was none of 0.
    shown: changes to and fro at rest, doubled, less those onwards; from `CHANGES_SHOWN` on it is not counted any more.
    count, sum_m: number and sum of the absolute changes at rest; smallest_m: the smallest change at all.
    repeat_s: for how long the reading has been the same; longest_s: its longest repeat that taught something.
    """

    position_m: float | None = None
    change_m: float = 0.0
    shown: int = 0
    count: int = 0
    sum_m: float = 0.0
    smallest_m: float = float("inf")
    repeat_s: float = 0.0
    longest_s: float = 0.0

    @property
    def is_noisy(self) -> bool:
        """Whether its noise is far above its resolution and has been seen often enough."""
        often = self.shown >= CHANGES_SHOWN and self.count >= CHANGES_SHOWN
        return often and self.sum_m >= NOISE_OF_RESOLUTION * self.smallest_m * self.count

    def limit_s(self, period_s: float) -> float:
        """Return after which time of the same reading a noisy sensor that speaks every `period_s` is silent, in s."""
        return max(LONGEST_REPEATS * self.longest_s, REPEATS * period_s, SILENCE_S)

    def is_silent(self, period_s: float) -> bool:
        """Return whether it is noisy and has not changed for longer than its noise allows."""
        return self.is_noisy and self.repeat_s > self.limit_s(period_s)

    def add(self, position_m: float, period_s: float, elapsed_s: float, *, at_rest: bool, judged: bool) -> Noise:
        """Return what is known after one more reading, `elapsed_s` behind the one before; repeats count if `judged`."""
        if self.position_m is None:
            return Noise(position_m)
        change_m = position_m - self.position_m
        if change_m == 0.0:
            return Noise(
                position_m,
                self.change_m,
                self.shown,
                self.count,
                self.sum_m,
                self.smallest_m,
                self.repeat_s + elapsed_s if judged else 0.0,
                self.longest_s,
            )
        returns = change_m * self.change_m < 0.0
        shown = self.shown
        if shown < CHANGES_SHOWN:
            shown = shown + 2 * at_rest if returns else max(shown - 1, 0)
        return Noise(
            position_m,
            change_m,
            shown,
            self.count + at_rest,
            self.sum_m + abs(change_m) * at_rest,
            min(self.smallest_m, abs(change_m)),
            0.0,
            self._longest_s(period_s),
        )

    def _longest_s(self, period_s: float) -> float:
        """Return the longest repeat after the present one has ended."""
        if self.shown == 0:
            return self.repeat_s  # nothing shown yet: no repeat before was one of noise
        if self.is_noisy and self.repeat_s > _LEARNED_OF_LIMIT * self.limit_s(period_s):
            return self.longest_s
        return max(self.longest_s, self.repeat_s)
