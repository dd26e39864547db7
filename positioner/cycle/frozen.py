"""Whether a noisy sensor has frozen: the noise that it has shown, and for how long its reading repeats. Pure.

A sensor whose noise is far above its resolution hardly ever repeats a reading, whether the stem moves or not. Where it
repeats one for far longer than ever before, it has frozen, under any current and during any push.

The sensor must have shown its noise first. A change back counts for noise, a change onwards against it, so that a clean
sensor that follows a moving stem shows none. Changes count for noise only while the stem rests, by the command and the
believed stick band, or while nothing is commanded. The noise must be `NOISE_OF_RESOLUTION` times the smallest change: a
quantised sensor repeats its readings where the stem rests between two steps, and has not frozen.

Probability of a false alarm: white noise of mean absolute change d and resolution q repeats a reading with
p = q / (pi d) < 2 %, and `REPEATS` times in a row with 0.02^100. If the noise is proportional to the reading, it is up
to 50 times smaller near the closed stop than at full stroke, and p < 0.93 at worst: 100 repeats in a row then have a
probability of 1e-3, 500 of them (`SILENCE_S` at 1 kHz) 1e-16; a long series that ends makes the limit ten times as
long. A sensor that holds each value for some time repeats it for that time, which `longest_s` covers.
"""

from __future__ import annotations

from positioner.values import dataclass, replace

CHANGES_SHOWN = 100
"""After so many changes at rest, two thirds of them back (as with white noise), the sensor is noisy."""
NOISE_OF_RESOLUTION = 16.0
"""Mean absolute change, at rest, over the smallest change ever seen."""
LONGEST_REPEATS = 10.0
"""A repeat is silence when it is so many times the longest repeat that the sensor has shown."""
REPEATS = 100
"""Fewer identical readings are never silence."""
SILENCE_S = 0.5
"""A shorter time is never silence."""
_LEARNED_OF_LIMIT = 1.0 / 3.0
"""A repeat beyond this part of the limit was no chance, and does not count as the longest one."""


@dataclass(frozen=True, slots=True)
class Noise:
    """The noise that a sensor has shown since the start.

    position_m: the last reading; change_m: its last change that was not 0.
    shown: twice the changes back at rest, less the changes onwards; from `CHANGES_SHOWN` on it stays as it is.
    count, sum_m: number and sum of the absolute changes at rest; smallest_m: the smallest change of all.
    repeat_s: for how long the reading has been the same; longest_s: the longest repeat that was chance.
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
        """Return the time in s after which a noisy sensor, with a reading every `period_s`, is silent."""
        return max(LONGEST_REPEATS * self.longest_s, REPEATS * period_s, SILENCE_S)

    def is_silent(self, period_s: float) -> bool:
        """Return whether it is noisy and has not changed for longer than its noise allows."""
        return self.repeat_s > SILENCE_S and self.is_noisy and self.repeat_s > self.limit_s(period_s)

    def add(self, position_m: float, period_s: float, elapsed_s: float, *, at_rest: bool, counts: bool) -> Noise:
        """Return the noise after one more reading, `elapsed_s` after the last; a repeat adds up if it `counts`."""
        if self.position_m is None:
            return Noise(position_m)
        change_m = position_m - self.position_m
        if change_m == 0.0:
            return replace(self, repeat_s=self.repeat_s + elapsed_s if counts else 0.0)
        returns = change_m * self.change_m < 0.0
        shown = self.shown
        if shown < CHANGES_SHOWN:
            shown = shown + 2 * at_rest if returns else max(shown - 1, 0)
        return Noise(
            position_m=position_m,
            change_m=change_m,
            shown=shown,
            count=self.count + at_rest,
            sum_m=self.sum_m + abs(change_m) * at_rest,
            smallest_m=min(self.smallest_m, abs(change_m)),
            longest_s=self._longest_s(period_s),
        )

    def _longest_s(self, period_s: float) -> float:
        """Return the longest repeat after the present one has ended."""
        if self.shown == 0:
            return self.repeat_s  # no noise so far: the repeats before were not repeats of noise
        if self.repeat_s <= self.longest_s:
            return self.longest_s
        if self.is_noisy and self.repeat_s > _LEARNED_OF_LIMIT * self.limit_s(period_s):
            return self.longest_s
        return self.repeat_s
