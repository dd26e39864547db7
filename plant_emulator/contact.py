"""A stem on an elastic contact, in short steps of time: what LuGre's and the Maxwell-slip model share. Pure.

The equation of motion is m·v' = f(t) - F_0 - K·x - F - F_v·v, F the dry friction. In each step F is known as a linear
function of the step's velocity (the model's own equation, solved exactly for a constant velocity), so the step is
implicit in the velocity, without iteration: a midpoint rule, of second order. The friction along the Stribeck curve is
taken at the step's velocity by a second pass.

The length of the shortest step follows from the fastest motion there is, the stem on the springs of the contact:
h = 0.2/√((σ_0 + K)/m), about a thirtieth of its period. Longer ones, up to 1 ms, are tried, and taken where the change
of velocity differs from that of the trapezoidal rule, whose error is another one, by no more than 1 nm in the time of
the step. A rate λ > 2/h, of damping or in a long step of springs that stick, gives the end of the step the weight
θ = 1 - 1/(λ·h) in place of ½, so that the velocity does not alternate.

A stem on such a contact never rests in the strict sense. Its counters follow the stick velocity DV of `[valve]`: it
slips when its speed rises above DV, and stops when its speed falls below half of DV. A push that deflects the contact
quickly counts as a slip, too, as any sensor of the speed would see it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.feedback import after_motion, after_rest
from plant_emulator.friction import CELL_WIDTH_M, after_crossing, after_stop
from plant_emulator.path import Uniform
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from plant_emulator.constants import Constants
    from plant_emulator.feedback import Feedback
    from plant_emulator.force import PushingForce
    from plant_emulator.friction import Packing
    from plant_emulator.stem import Stem

_STEP = 0.2
"""Of the time constant of the stem on the contact's springs."""
_LONGEST_S = 1e-4
_PART_S = 1e-3
"""The longest step, of a motion that is even: of a stem that sticks under a slow force, or glides."""
_EVEN_M = 1e-9
"""By so little at most the velocities of two rules, times the duration of the step, may differ after a longer one."""
_TURNING_M = 1e-11
"""The same of a step in which the stem turns: there elements of the contact cease to slip."""
_LONGER = 3.0
"""By this factor a step becomes longer after one that was taken, and shorter after one that was not."""
_AT_ONCE = 4
"""So many shortest steps are taken before a longer one is tried again."""
_ROUNDING = 1e-6
"""Of a step: less time than this is left by rounding alone."""
_SETTLED_M = 1e-12
"""A stem that has this way left at most is settled: a hundredth of an atom."""


@dataclass(frozen=True, slots=True)
class Contact:
    """The forces in N in the elements of the contact, positive against opening; and whether each slips, -1, 0 or 1.

    LuGre's model has one element, whose force is σ_0·z.
    """

    forces_n: tuple[float, ...]
    slipping: tuple[int, ...]


class ContactStem:
    """A stem, its packing, its contact and its feedback while one step is computed; mutable.

    A model is a subclass that says what the contact does in a short time.
    """

    def __init__(
        self, constants: Constants, stem: Stem, packing: Packing, time_s: float, feedback: Feedback | None
    ) -> None:
        """Begin at `stem`; `time_s` is the plant time."""
        self.constants = constants
        self.stem = stem
        self.packing = packing
        self.time_s = time_s
        self.feedback = feedback
        self.mass_kg: float = constants.settings.valve.mass_kg
        self.viscous: float = constants.settings.valve.viscous_friction_n_s_per_m
        self.stribeck: float = constants.settings.valve.stribeck_velocity_m_per_s
        self.stiffness: float = constants.settings.friction.stiffness_n_per_m
        self.damping: float = 0.0
        self.base_n: float = 0.0
        self.slope: float = 0.0

    def spring_n(self) -> float:
        """Return the force of the contact's springs in N, positive against opening."""
        raise NotImplementedError

    def resist(self, velocity: float, step_s: float, weight: float) -> None:
        """Set `base_n` and `slope`: in this step the contact resists by base_n + slope·(velocity of the step).

        velocity: where to take the Stribeck curve; weight: of the step's end, in the force.
        """
        raise NotImplementedError

    def resistance_n(self, velocity: float) -> float:
        """Return the dry friction in N at this velocity, positive against opening, as the contact is now."""
        raise NotImplementedError

    def restore(self) -> None:
        """Go back to before the last `slide`."""
        raise NotImplementedError

    def slide(self, velocity: float) -> None:
        """Take the contact to the end of the step that `resist` was told last, which had this velocity."""
        raise NotImplementedError

    def contact(self) -> Contact:
        """Return the contact as it is now."""
        raise NotImplementedError

    def limit_n(self, speed: float) -> float:
        """Return the dry friction in N of steady sliding at `speed`, Stribeck's curve."""
        ratio = speed / self.stribeck
        packing = self.packing
        if ratio < 1e-4:  # noqa: PLR2004 - e^(-1e-8) is 1 but for rounding errors that no friction is known to
            return packing.static_n
        if ratio > 6.0:  # noqa: PLR2004 - e^(-36) is 2e-16
            return packing.coulomb_n
        return packing.coulomb_n + (packing.static_n - packing.coulomb_n) * math.exp(-ratio * ratio)

    def advance(self, force: PushingForce, duration_s: float) -> None:
        """Move for `duration_s` under `force`."""
        if self._is_settled(force, duration_s):
            if self.feedback is not None:
                self.feedback = after_rest(self.constants.settings.sensor, self.feedback, duration_s)
            self.time_s += duration_s
            return
        springs = self.stiffness + self.constants.spring_n_per_m
        short_s: float = min(_STEP * math.sqrt(self.mass_kg / springs), _LONGEST_S)
        begin_s: float = 0.0
        longest_s: float = _PART_S
        while begin_s < duration_s:
            left_s = duration_s - begin_s
            step_s = left_s / math.ceil(left_s / longest_s)
            if step_s <= short_s:
                count = min(round(left_s / step_s), _AT_ONCE)
                self._steps(force, begin_s, step_s, count)
                longest_s = _AT_ONCE * short_s
            elif self._tried(force, begin_s, step_s):
                count = 1
                longest_s = min(_LONGER * step_s, _PART_S)
            else:
                longest_s = max(step_s / _LONGER, short_s)
                continue
            begin_s = duration_s if left_s <= step_s * (count + _ROUNDING) else begin_s + count * step_s

    def _is_settled(self, force: PushingForce, duration_s: float) -> bool:
        """Return whether nothing moves the stem for `duration_s`, or only against the stop at which it is."""
        stem, constants, valve = self.stem, self.constants, self.constants.settings.valve
        springs = self.stiffness + constants.spring_n_per_m
        slowest_s = math.sqrt(self.mass_kg / springs) + (self.damping + self.viscous) / springs
        if abs(stem.velocity_m_per_s) * slowest_s > _SETTLED_M:
            return False
        held_n = self._load_n() + constants.spring_n_per_m * stem.position_m + self.spring_n()
        low_n, high_n = force.range_n(duration_s)
        near_n = _SETTLED_M * springs
        above = low_n - held_n >= -near_n or stem.position_m == valve.travel_min_m
        below = high_n - held_n <= near_n or stem.position_m == valve.travel_max_m
        return above and below

    def _tried(self, force: PushingForce, begin_s: float, step_s: float) -> bool:
        """Take one longer step under `force` from `begin_s` on, if the motion is even; return whether it was taken."""
        valve = self.constants.settings.valve
        x: float = self.stem.position_m
        v: float = self.stem.velocity_m_per_s
        h: float = step_s
        spring: float = self.constants.spring_n_per_m
        load: float = self._load_n()
        before = force.at(begin_s) - load - spring * x - self.resistance_n(v) - self.viscous * v
        self.resist(v, h, 0.5)
        # how stiff the contact is: springs that stick, or bristles that slide
        stiff = (self.slope + self.viscous) / self.mass_kg
        sticks = max((self.damping + self.viscous) / self.mass_kg, math.sqrt((self.stiffness + spring) / self.mass_kg))
        rate = min(stiff, sticks) * h
        weight: float = 0.5 if rate <= 2.0 else 1.0 - 1.0 / rate  # noqa: PLR2004 - see above
        inertia = self.mass_kg / (weight * h)
        known = inertia + weight * h * spring + self.viscous
        drive = inertia * v + force.at(begin_s + weight * h) - load - spring * x
        if weight != 0.5:  # noqa: PLR2004 - the two weights
            self.resist(v, h, weight)
        mean = (drive - self.base_n) / (known + self.slope)
        self.resist(mean, h, weight)
        mean = (drive - self.base_n) / (known + self.slope)
        next_x: float = x + h * mean
        next_v: float = v + (mean - v) / weight
        is_at_stop = next_x >= valve.travel_max_m or next_x <= valve.travel_min_m
        if is_at_stop:
            next_x = valve.travel_max_m if next_x >= valve.travel_max_m else valve.travel_min_m
            if next_x != x or v != 0.0:
                return False  # it arrives there
            mean, next_v = 0.0, 0.0
        self.slide(mean)
        if not is_at_stop:
            after = force.at(begin_s + h) - load - spring * next_x - self.resistance_n(next_v) - self.viscous * next_v
            apart = abs(next_v - v - 0.5 * h * (before + after) / self.mass_kg)
            # of a linear motion, where both rules agree, h³·v'''/12 by its rates
            rates_n = stiff * abs(after - before) + h * spring / self.mass_kg * abs(after)
            apart += h * h / 12.0 * rates_n / self.mass_kg
            # and what a stiff contact leaves of it
            allowed_m = _EVEN_M if v * next_v >= 0.0 else _TURNING_M
            if apart * h * inertia > allowed_m * (known + self.slope):
                self.restore()
                return False
        if self.feedback is not None:
            path = Uniform(x, mean)
            self.feedback = after_motion(self.constants.settings.sensor, self.feedback, path, next_x, h)
        self._observe(next_x, next_v, self.time_s + h)
        self.time_s += h
        travel = self.stem.travel_m + abs(next_x - x)
        self.stem = replace(self.stem, position_m=next_x, velocity_m_per_s=next_v, travel_m=travel)
        return True

    def _steps(self, force: PushingForce, begin_s: float, step_s: float, count: int) -> None:
        """Take `count` short steps under `force` from `begin_s` on."""
        valve = self.constants.settings.valve
        x: float = self.stem.position_m
        v: float = self.stem.velocity_m_per_s
        travel: float = self.stem.travel_m
        low: float = valve.travel_min_m
        high: float = valve.travel_max_m
        spring: float = self.constants.spring_n_per_m
        h: float = step_s
        rate: float = (self.damping + self.viscous) / self.mass_kg * h
        weight: float = 0.5 if rate <= 2.0 else 1.0 - 1.0 / rate  # noqa: PLR2004 - see above
        inertia: float = self.mass_kg / (weight * h)
        known: float = inertia + weight * h * spring + self.viscous
        is_constant = not force.decays and force.ramp_n_per_s == 0.0
        push: float = force.final_n
        begun_s: float = self.time_s
        for number in range(count):
            if not is_constant:
                push = force.at(begin_s + (number + weight) * h)
            drive = inertia * v + push - self._load_n() - spring * x
            self.resist(v, h, weight)
            mean = (drive - self.base_n) / (known + self.slope)
            self.resist(mean, h, weight)
            mean = (drive - self.base_n) / (known + self.slope)
            next_x = x + h * mean
            next_v = v + (mean - v) / weight
            if next_x >= high or next_x <= low:
                next_x = high if next_x >= high else low
                mean = (next_x - x) / h
                next_v = 0.0
            self.slide(mean)
            if self.feedback is not None:
                path = Uniform(x, mean)
                self.feedback = after_motion(self.constants.settings.sensor, self.feedback, path, next_x, h)
            travel += abs(next_x - x)
            x, v = next_x, next_v
            self._observe(x, v, begun_s + (number + 1) * h)
        self.time_s = begun_s + count * h
        self.stem = replace(self.stem, position_m=x, velocity_m_per_s=v, travel_m=travel)

    def _load_n(self) -> float:
        return self.constants.preload_n + self.packing.one_way_n

    def _observe(self, x: float, v: float, time_s: float) -> None:
        """Count a slip, a reversal or a stop, and follow the packing from cell to cell."""
        stem, settings = self.stem, self.constants.settings
        band: float = settings.valve.stick_velocity_m_per_s
        speed = abs(v)
        if speed > band:
            way = 1 if v > 0.0 else -1
            if way != stem.direction:
                self.stem = replace(
                    stem,
                    direction=way,
                    last_direction=way,
                    slips=stem.slips + (stem.direction == 0),
                    reversals=stem.reversals + (stem.last_direction == -way),
                )
        elif stem.direction != 0 and speed < 0.5 * band:
            self.stem = replace(stem, direction=0, stops=stem.stops + 1)
            self.packing = after_stop(settings, self.packing, stem.stops + 1, time_s)
        if self.constants.varies_by_place:
            cell = math.floor(x / CELL_WIDTH_M)
            if cell != self.packing.cell:
                self.packing = after_crossing(settings, self.packing, cell - self.packing.cell)
