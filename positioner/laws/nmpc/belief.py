"""What the law believes of the valve: spring, offset and friction as currents, and what each rest teaches. Pure.

A stem that slid in the direction s and came to rest at x under the pressure p has stopped at their balance,

    p = k x + c + s f_c,    k = K/B,  c = F_0/B,  f_c = F_c/B,

however the pressure came there: lags, dead time and the speed of the stem do not enter. A stem that did not move under
p has s (p - k x - c) < f_s = F_s/B. These two lines are all that is measured.

c holds the bench set and every force that the process adds; a landing far from what was expected is such a force for
the most part, since spring and friction change slowly, and friction for the rest. Where friction differs from place to
place, the landings there say so (`local_ma`).

Two hypotheses are held side by side: that the valve is one of those that a configuration may stand for, and that it is
the configured one. Each observation is a measurement of both, and says how likely it was for either (Bayes factor, Kass
and Raftery 1995). The first one is believed until the second one is by far more likely.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.move_reason import Believed, MoveReason
from positioner.values import dataclass, replace
from positioner.valve.gaussian import Gaussian, gaussian_of

if TYPE_CHECKING:
    from positioner.valve.parameters import ValveParameters

SPRING, OFFSET, SLIDING, STATIC, LAG, VISCOUS, DEAD_TIME = 0, 1, 2, 3, 4, 5, 6
"""Places of k, c, f_c, f_s, ln τ, ln ν and T_d in the Gaussian: τ is the lag of the rising pressure and a millisecond,
ν viscous friction over the configured one, T_d the dead time in s."""
_FORCES = 4
"""The first four are those of a balance; only the whole way of a move shows the others."""
LEAST_LAG_S = 1e-3
"""What τ is more than the lag, so that a lag of 0 has a logarithm, and σ of a lag where none is configured: no valve
follows at once."""
_DOUBT_LAG, _DOUBT_SEEN_LAG, _DOUBT_VISCOUS = 0.12, 0.3, 0.3
"""σ of a lag over itself: a configured one is as sure as a spring; one that the area of a move has shown is up to 20 %
wrong, and 10 % by noise (`lag`). σ of ln ν: viscous friction is seldom measured."""
_DOUBT_OTHER_LAG = 0.35
"""σ of ln τ where the lag is another one than configured: half of it and twice are 2 σ."""
_DOUBT_DEAD_TIME = 0.05
"""σ of T_d over the lag, beside 12 % of a configured one: what is not configured of converter, volumes and sensor acts
so much later. Where it was not doubted, stops of braked moves behind 100 ms and a dead time of 5 ms that nobody has
told were all 0.3 to 1 % of span too far (DESIGN.md, "A dead time that is not configured")."""
_LAG_SURE, _ROUNDING = 0.1, 1e-9
"""σ over itself of a lag that is sure; of an exponential and a logarithm, less than any lag in s."""
_MOST_LOG = 0.7
"""Of ln τ from one belief to the next, where two σ are not more, and of ln ν: half or twice."""

_DOUBT_SPRING = 0.12
"""σ of k over k: a configured spring rate and a configured area are each within 20 %, evenly: 0.2/√3 = 0.115 each."""
_DOUBT_OFFSET_MA = 0.7
"""σ of c: a tenth of the signal is the largest force that a process is likely to add: 1.6 mA / √3, and bench sets."""
_DOUBT_FRICTION, _FRICTION_MA = 0.15, 0.03
"""σ of F_s and F_c over each, and the smallest one, of 0.2 % of the signal."""
_DRIFT, _DRIFT_MA, _OFFSET_DRIFT_MA = 0.01, 0.003, 0.02
"""σ of what a move changes: 1 % of the friction (it scatters so much from stop to stop), and 0.02 mA of the offset."""
_COMMON = 0.5
"""Of the variance of such changes, what F_s and F_c have in common: packing wears for both, and each scatters."""
_SCATTER, _SCATTER_MA = 0.005, 0.01
"""σ of a landing on the best packing: 0.5 % of F_c and a hundredth of a mA."""
_SURPRISE, _IS_FRICTION = 6.0, 0.1
"""Squared innovation over its variance, that one landing in 70 exceeds by chance. More is a force that has come, or
friction that differs by direction: a tenth of its variance is given to F_c, so that a landing the other way tells the
two apart. On all valves of the robustness test 0.1 and 0.3 lose 350 and 357 dwells (DESIGN.md, "The law
`quasi-static`")."""
_FORGOTTEN = 0.15
"""Weight of the newest landing in the scatter: the mean of about the last six."""
_MOST_SCATTER = 5.0
"""A landing counts at most so many times the known scatter: single ones are forces."""
_LEAST_SPRING, _MOST_SPRING = 0.5, 2.0
"""Of the configured k: no configuration is further off."""
_LEAST_RATIO, _LEAST_GAP_MA = 1.01, 0.005
"""F_s is at least so much above F_c, or nothing would stick."""
_BOUND_OF_STATIC, _BOUND_MA = 0.02, 0.01
"""σ of the force at which a stem that has not moved was pushed, over F_s, and its least."""
_BELIEVED = 1.0
"""σ by which what a push shows was believed anyway. It is the same each time, so it must not be counted again."""
_NEAR_M = 0.004
"""Friction of packings varies over some millimetres of travel: landings nearer than that have much in common."""
_PLAIN = 0.3
"""How many landings at the same place the friction of the whole valve is worth there."""
_AGED = 0.95
"""What each later move leaves of the weight of one."""
_OTHER, _OTHER_MA, _CERTAINLY = 0.3, 1.0, 2.0
"""A valve with other parameters than configured: by 30 %, the offset by 1 mA, and two σ more than that."""
_LANDINGS_KEPT = 60
"""The newest ones: two in a way to a setpoint, so the oldest weighs at most 0.95^30, a fifth."""
_CONFIGURED = 6.0
"""What σ of each number but c and T_d is over, where the valve is the configured one: spring known to 2 %, friction to
2.5 %, and what a move changes likewise. A force, and what is small beside the lag, are in no configuration."""
_STRONG, _DECISIVE = 3.0, 5.0
"""Logarithms of the odds, 20 and 150 to 1, from which on the other hypothesis is believed, and beyond which odds do not
grow; one of a configured valve is then given up. "Strong" and "very strong" evidence of Kass and Raftery."""
_OUTLIER, _OUTLIER_MA = 1.0 / 70.0, 0.7
"""Probability of a surprise, for both hypotheses, and the width of its distribution, that of c: so a single one decides
nothing."""


@dataclass(frozen=True, slots=True)
class Landing:
    """Where a stem came to rest after it slid in a direction (±1), and the pressure in mA that held it there.

    weight: what later moves have left of it, since friction changes.
    """

    position_m: float
    direction: float
    pressure_ma: float
    weight: float = 1.0


@dataclass(frozen=True, slots=True)
class ValveBelief:
    """The Gaussian over k, c, f_c, f_s (mA/m and mA), ln τ, ln ν and T_d; variance and last ones of landings.

    scatter_ma2: variance of a landing; least_scatter_ma2: of one on the best packing. configured: the mean by what the
    configuration says. drift: σ of what a move changes, over that of a valve that may differ from the configured one;
    less than 1 for the hypothesis that it is that one. other: the other hypothesis, None where it was given up.
    log_odds: logarithm of its probability over this one's.
    """

    numbers: Gaussian
    scatter_ma2: float
    configured: tuple[float, ...]
    least_scatter_ma2: float
    landings: tuple[Landing, ...] = ()
    drift: float = 1.0
    other: ValveBelief | None = None
    log_odds: float = 0.0

    @property
    def spring_ma_per_m(self) -> float:
        """K/B."""
        return self.numbers.mean[SPRING]

    @property
    def offset_ma(self) -> float:
        """F_0/B."""
        return self.numbers.mean[OFFSET]

    @property
    def sliding_ma(self) -> float:
        """F_c/B."""
        return self.numbers.mean[SLIDING]

    @property
    def static_ma(self) -> float:
        """F_s/B."""
        return self.numbers.mean[STATIC]

    @property
    def lag_s(self) -> float:
        """Lag of the rising pressure, τ_c + τ_f."""
        return lag_s_of(self.numbers.mean)

    @property
    def dead_time_s(self) -> float:
        """T_d: how long the pressure waits for a command."""
        return self.numbers.mean[DEAD_TIME]

    @property
    def is_lag_sure(self) -> bool:
        """Whether a lag that looks longer is a force that came late."""
        return math.sqrt(self.numbers.variances[LAG]) < _log_sigma(self.lag_s, _LAG_SURE) + _ROUNDING

    @property
    def jump_m(self) -> float:
        """The slip jump (F_s - F_c)/K: how far a stem slides at least once it is free."""
        return (self.static_ma - self.sliding_ma) / self.spring_ma_per_m

    @property
    def jump_doubt_m(self) -> float:
        """σ of the slip jump, at most half of F_s/K, and a fiftieth of a mA of what is not known."""
        variances = self.numbers.variances
        doubt_ma = min(math.sqrt(variances[SLIDING] + variances[STATIC]), 0.5 * self.static_ma)
        return (doubt_ma + 0.02) / self.spring_ma_per_m

    @property
    def as_configured(self) -> ValveBelief:
        """The configured valve, of which nothing was seen."""
        return replace(self, numbers=self.numbers.with_mean(self.configured), landings=(), other=None)

    @property
    def differs(self) -> bool:
        """Whether the valve is certainly another one than the configured one."""
        forces = (self.numbers.mean[:_FORCES], self.configured[:_FORCES], self.numbers.variances[:_FORCES])
        numbers = zip(*forces, strict=True)
        for place, (now, told, variance) in enumerate(numbers):
            doubt = _CERTAINLY * math.sqrt(variance)
            if abs(now - told) > (_OTHER_MA if place == OFFSET else _OTHER * told + _FRICTION_MA) + doubt:
                return True
        told_s = lag_s_of(self.configured)
        return abs(self.lag_s - told_s) > _OTHER * told_s + _CERTAINLY * LEAST_LAG_S

    def balance_ma(self, position_m: float) -> float:
        """Return k x + c: the middle of the stick band."""
        return self.spring_ma_per_m * position_m + self.offset_ma

    def freeing_ma(self, position_m: float, direction: float) -> float:
        """Return the pressure under which a stem that rests at a place is freed in `direction`."""
        return self.balance_ma(position_m) + direction * self.static_ma

    def at_least_freeing_ma(self, level_ma: float, position_m: float, direction: float) -> float:
        """Return a level that frees a stem, as far as friction is known; this one, where it does so anyway.

        Near the end of the travel a move away has no room for a stronger push: then the stop ends it.
        """
        frees_ma = direction * self.freeing_ma(position_m, direction) + self.spring_ma_per_m * self.jump_doubt_m
        return direction * max(direction * level_ma, frees_ma)

    def reachable_m(self, position_m: float, low_ma: float, high_ma: float) -> float:
        """Return the nearest place to which the lowest and the highest current let a stem slide."""
        low_m, high_m = self.slides_to_m(low_ma, -1.0), self.slides_to_m(high_ma, 1.0)
        return min(max(position_m, low_m), max(high_m, low_m))

    def slides_to_m(self, pressure_ma: float, direction: float) -> float:
        """Return where a stem that slides in `direction` stops under a pressure."""
        return (pressure_ma - self.offset_ma - direction * self.sliding_ma) / self.spring_ma_per_m

    def nearest_m(self, setpoint_m: float, here_m: float, low_ma: float, high_ma: float, left_m: float) -> float:
        """Return the place nearest to a setpoint where a stem can be that is here.

        That is a place to which slides both ways lead, one to which the next slide leads, or here, where the others are
        farther away, and certainly so if here is farther away than `left_m`.
        """
        found = self.reachable_m(setpoint_m, low_ma, high_ma)
        if found == setpoint_m:
            return found
        direction = 1.0 if setpoint_m > here_m else -1.0
        next_m = min(max(setpoint_m, self.slides_to_m(low_ma, direction)), self.slides_to_m(high_ma, direction))
        if direction * (next_m - here_m) > self.jump_m and abs(next_m - setpoint_m) < abs(found - setpoint_m):
            found = next_m
        error_m = abs(here_m - setpoint_m)
        doubt_m = 0.0 if error_m < left_m else _CERTAINLY * self.landing_sigma_m(found, direction)
        return here_m if error_m + doubt_m < abs(found - setpoint_m) else found

    def landing_ma(self, position_m: float, direction: float) -> float:
        """Return the pressure under which a stem that slides in `direction` stops at a place."""
        return self.plain_ma(position_m, direction) + self.local_ma(position_m, direction)

    def plain_ma(self, position_m: float, direction: float) -> float:
        """Return that pressure where friction is the same all along the travel."""
        return self.balance_ma(position_m) + direction * self.sliding_ma

    def local_ma(self, position_m: float, direction: float) -> float:
        """Return how much more pressure the last landings near a place took than the whole valve does."""
        weights, more_ma = 0.0, 0.0
        for landing in reversed(self.landings):
            if landing.direction != direction:
                continue
            apart = (landing.position_m - position_m) / _NEAR_M
            weight = landing.weight * math.exp(-0.5 * apart * apart)
            weights += weight
            more_ma += weight * (landing.pressure_ma - self.plain_ma(landing.position_m, direction))
        return more_ma / (weights + _PLAIN)

    def landing_sigma_m(self, position_m: float, direction: float) -> float:
        """Return σ of the place where the next move to a place will end."""
        variance_ma2 = self.numbers.variance((position_m, 1.0, direction, 0.0)) + self.scatter_ma2
        return math.sqrt(variance_ma2) / self.spring_ma_per_m

    @property
    def scatter_m(self) -> float:
        """σ of the place where a move ends on a valve that is known: what no further move teaches."""
        return math.sqrt(self.scatter_ma2) / self.spring_ma_per_m

    def reason(self, start_m: float, target_m: float, direction: float, gain_n_per_ma: float) -> MoveReason:
        """Return why a move from one place to another begins, with what is believed of the valve, as forces."""
        spring, offset, sliding, static = (
            (gain_n_per_ma * mean, gain_n_per_ma * math.sqrt(variance))
            for mean, variance in zip(self.numbers.mean[:_FORCES], self.numbers.variances[:_FORCES], strict=True)
        )
        believed = Believed(spring, offset, static, sliding, self.landing_sigma_m(target_m, direction))
        return MoveReason(target_m - start_m, self.freeing_ma(start_m, direction), target_m, believed)

    def after_move(self, changes: float = 1.0) -> ValveBelief:
        """Return the belief before another move: friction and forces may have changed a little.

        changes: what the variance of that was found to be, over what is expected.
        """
        offset_ma, sliding_ma, static_ma = (math.sqrt(changes) * sigma_ma for sigma_ma in self._changes_ma())
        common, own = math.sqrt(_COMMON), 1.0 - _COMMON
        numbers = self.numbers.widened(OFFSET, offset_ma * offset_ma)
        numbers = numbers.changed((0.0, 0.0, common * sliding_ma, common * static_ma, 0.0, 0.0, 0.0))
        numbers = numbers.widened(SLIDING, own * sliding_ma * sliding_ma).widened(STATIC, own * static_ma * static_ma)
        landings = tuple([replace(landing, weight=_AGED * landing.weight) for landing in self.landings])
        other = None if self.other is None else self.other.after_move(changes)
        return replace(self, numbers=numbers, landings=landings, other=other)

    def weighed(self, other: ValveBelief, log_factor: float) -> ValveBelief:
        """Return the hypothesis that is believed after an observation.

        Args:
            other: the other hypothesis, after that observation.
            log_factor: logarithm of how likely the observation was for the other one, over how likely for this one.
        """
        log_odds, is_general = self.log_odds + log_factor, self.drift == 1.0
        if log_odds > _STRONG:
            return replace(other, other=replace(self, other=None), log_odds=max(-log_odds, -_DECISIVE))
        if is_general and log_odds < -_DECISIVE:
            return replace(self, other=None)
        return replace(self, other=other, log_odds=max(log_odds, -_DECISIVE))

    def change_m2(self, line: tuple[float, ...]) -> float:
        """Return the variance of a stop by what a move is expected to change; line: its derivatives."""
        offset_m, sliding_m, static_m = (
            slope * sigma_ma for slope, sigma_ma in zip(line[1:4], self._changes_ma(), strict=True)
        )
        together_m, own_m2 = sliding_m + static_m, sliding_m * sliding_m + static_m * static_m
        return offset_m * offset_m + _COMMON * together_m * together_m + (1.0 - _COMMON) * own_m2

    @property
    def roams_ma2_per_m(self) -> float:
        """How fast friction is expected to change on the way: a first-order process over the travel (`_NEAR_M`)."""
        sliding_ma = self._changes_ma()[1]
        return 2.0 * sliding_ma * sliding_ma / _NEAR_M

    def _changes_ma(self) -> tuple[float, float, float]:
        """Return σ of what a move is expected to change of c, f_c and f_s."""
        offset_ma = self.drift * (_OFFSET_DRIFT_MA + _DRIFT * self.sliding_ma)
        frictions_ma = (self.sliding_ma, self.static_ma)
        sliding_ma, static_ma = (self.drift * (_DRIFT * friction_ma + _DRIFT_MA) for friction_ma in frictions_ma)
        return offset_ma, sliding_ma, static_ma

    def with_lag(self, lag_s: float) -> ValveBelief:
        """Return the belief in another lag, which a move has shown, with the configured dead time."""
        mean, sigma = math.log(lag_s + LEAST_LAG_S), _log_sigma(lag_s, _DOUBT_SEEN_LAG)
        dead_time_s = self.configured[DEAD_TIME]
        doubt_s = _dead_time_sigma_s(dead_time_s, lag_s)
        numbers = self.numbers.renewed(LAG, mean, sigma * sigma).renewed(DEAD_TIME, dead_time_s, doubt_s * doubt_s)
        return replace(self, numbers=numbers, other=None if self.other is None else self.other.with_lag(lag_s))

    def of_any_lag(self) -> ValveBelief:
        """Return the belief in a lag that may be another one than configured."""
        numbers = self.numbers.widened(LAG, _DOUBT_OTHER_LAG * _DOUBT_OTHER_LAG)
        return replace(self, numbers=numbers, other=None, drift=1.0)

    def measured(self, line: tuple[float, ...], value: float, variance: float) -> ValveBelief:
        """Return the belief after a sum of its numbers, weighted by `line`, was measured with this variance."""
        numbers = self.numbers.updated(line, value - self.numbers.expected(line), variance)
        other = None if self.other is None else self.other.measured(line, value, variance)
        return replace(self, numbers=self.within(numbers), other=other)

    def landed(self, landing: Landing, reading_m2: float, doubt_ma2: float, *, is_force: bool = False) -> ValveBelief:
        """Return the belief after a landing.

        Args:
            landing: where the stem rests, and the pressure.
            reading_m2: variance of the place.
            doubt_ma2: variance of the pressure, beside the scatter of landings.
            is_force: whether nothing but a force can have moved the stem.
        """
        if self.other is not None:
            alone = replace(self, other=None).landed(landing, reading_m2, doubt_ma2, is_force=is_force)
            other = self.other.landed(landing, reading_m2, doubt_ma2, is_force=is_force)
            log_likelihood, its = (
                belief.landing_log_likelihood(landing, reading_m2, doubt_ma2) for belief in (self, self.other)
            )
            return alone.weighed(other, its - log_likelihood)
        line, innovation_ma, noise_ma2 = self._innovation(landing, reading_m2)
        numbers, scatter_ma2, landings = self.numbers, self.scatter_ma2, (*self.landings, landing)[-_LANDINGS_KEPT:]
        known_ma2 = numbers.variance(line) + noise_ma2
        square_ma2, total_ma2 = innovation_ma * innovation_ma, known_ma2 + scatter_ma2 + doubt_ma2
        if square_ma2 > _SURPRISE * total_ma2:  # what was learned of places held with another force
            more_ma2, part = 0.5 * square_ma2 - total_ma2, 0.0 if is_force else _IS_FRICTION
            numbers, landings = numbers.widened(OFFSET, (1.0 - part) * more_ma2), ()
            numbers = numbers.widened(SLIDING, part * more_ma2)
        else:
            seen_ma2 = min(max(square_ma2 - known_ma2, 0.0), _MOST_SCATTER * scatter_ma2)
            scatter_ma2 = max(scatter_ma2 + _FORGOTTEN * (seen_ma2 - scatter_ma2), self.least_scatter_ma2)
        numbers = numbers.updated(line, innovation_ma, noise_ma2 + self.scatter_ma2 + doubt_ma2)
        return replace(self, numbers=self.within(numbers), scatter_ma2=scatter_ma2, landings=landings)

    def landing_log_likelihood(self, landing: Landing, reading_m2: float, doubt_ma2: float) -> float:
        """Return the logarithm of how likely a landing is; arguments as for `landed`."""
        line, innovation_ma, noise_ma2 = self._innovation(landing, reading_m2)
        total_ma2 = self.numbers.variance(line) + noise_ma2 + self.scatter_ma2 + doubt_ma2
        density = math.exp(-0.5 * innovation_ma * innovation_ma / total_ma2) / math.sqrt(total_ma2)
        return math.log(density + _OUTLIER / _OUTLIER_MA)

    def _innovation(self, landing: Landing, reading_m2: float) -> tuple[tuple[float, ...], float, float]:
        """Return the line of a landing, by how much its pressure exceeds it, and the variance of that by its place."""
        spring, line = self.spring_ma_per_m, (landing.position_m, 1.0, landing.direction, 0.0)
        return line, landing.pressure_ma - self.numbers.expected(line), spring * spring * reading_m2

    def ran_on(self, landing: Landing) -> ValveBelief:
        """Return the belief after a stem that slid was held by a stop: it would have landed there or beyond."""
        direction = landing.direction
        line = (-direction * landing.position_m, -direction, -1.0, 0.0)
        return self.above(line, -direction * landing.pressure_ma)

    def held(self, position_m: float, direction: float, pressure_ma: float) -> ValveBelief:
        """Return the belief after a stem has not moved under a pressure that pushed in `direction`.

        Where it should have moved by far, a force has come, or friction has grown: as likely the one as the other. Then
        what was learned of places no longer holds.
        """
        line, bound_ma = (direction * position_m, direction, 0.0, 1.0), direction * pressure_ma
        short_ma, known_ma2 = self.numbers.expected(line) - bound_ma, self.numbers.variance(line) + self.scatter_ma2
        numbers, landings, more_ma2 = self.numbers, self.landings, 0.5 * (short_ma * short_ma - known_ma2)
        if short_ma < 0.0 and short_ma * short_ma > _SURPRISE * known_ma2:
            numbers, landings = numbers.widened(OFFSET, more_ma2).widened(STATIC, more_ma2), ()
        alone = replace(self, numbers=self._pushed(numbers, line, bound_ma), landings=landings)
        if self.other is None:
            return alone
        factor = self.other.bound_log_likelihood(line, bound_ma) - self.bound_log_likelihood(line, bound_ma)
        return alone.weighed(self.other.held(position_m, direction, pressure_ma), factor)

    def freed(self, position_m: float, direction: float, pressure_ma: float) -> ValveBelief:
        """Return the belief after a stem that rested was moved by a pressure that pushed in `direction`."""
        return self.above((-direction * position_m, -direction, 0.0, -1.0), -direction * pressure_ma)

    def above(self, line: tuple[float, ...], bound_ma: float) -> ValveBelief:
        """Return the belief after a sum of its numbers, weighted by `line`, was seen to be above a bound."""
        alone = replace(self, numbers=self._pushed(self.numbers, line, bound_ma))
        if self.other is None:
            return alone
        factor = self.other.bound_log_likelihood(line, bound_ma) - self.bound_log_likelihood(line, bound_ma)
        return alone.weighed(self.other.above(line, bound_ma), factor)

    def bound_log_likelihood(self, line: tuple[float, ...], bound_ma: float) -> float:
        """Return the logarithm of how likely it is that a line is above a bound."""
        doubt_ma = _BOUND_OF_STATIC * self.static_ma + _BOUND_MA
        sigma_ma = math.sqrt(self.numbers.variance(line) + self.scatter_ma2 + doubt_ma * doubt_ma)
        below = (bound_ma - self.numbers.expected(line)) / sigma_ma
        return math.log(0.5 * math.erfc(below / math.sqrt(2.0)) + _OUTLIER)

    def _pushed(self, numbers: Gaussian, line: tuple[float, ...], bound_ma: float) -> Gaussian:
        """Return the numbers after a move has shown that the line is above a bound, where that was not known."""
        if numbers.expected(line) - bound_ma > _BELIEVED * math.sqrt(numbers.variance(line)):
            return numbers
        doubt_ma = _BOUND_OF_STATIC * self.static_ma + _BOUND_MA
        return self.within(numbers.bounded(line, bound_ma, doubt_ma * doubt_ma))

    def within(self, numbers: Gaussian) -> Gaussian:
        """Return the numbers with a mean that a valve may have."""
        spring, offset, sliding, static, lag, viscous, dead_time_s = numbers.mean
        before, viscous = self.numbers.mean[LAG], min(max(viscous, -_MOST_LOG), _MOST_LOG)
        most = max(_MOST_LOG, _CERTAINLY * math.sqrt(self.numbers.variances[LAG]))
        lag = min(max(lag, before - most, math.log(LEAST_LAG_S)), before + most)
        configured = self.configured[SPRING]
        spring = min(max(spring, _LEAST_SPRING * configured), _MOST_SPRING * configured)
        sliding = max(sliding, 0.0)
        static = max(static, sliding * _LEAST_RATIO + _LEAST_GAP_MA)
        return numbers.with_mean((spring, offset, sliding, static, lag, viscous, max(dead_time_s, 0.0)))


def lag_s_of(theta: tuple[float, ...]) -> float:
    """Return the lag of the rising pressure, of k, c, f_c, f_s, ln τ, ln ν and T_d."""
    lag_s = math.exp(theta[LAG]) - LEAST_LAG_S
    return lag_s if lag_s > _ROUNDING else 0.0


def _log_sigma(lag_s: float, part: float) -> float:
    """Return σ of ln τ, where that of the lag is a part of it, and what is never known."""
    return math.hypot(part * lag_s, LEAST_LAG_S) / (lag_s + LEAST_LAG_S)


def _dead_time_sigma_s(dead_time_s: float, lag_s: float) -> float:
    """Return σ of a configured dead time behind a lag."""
    return _DOUBT_LAG * dead_time_s + _DOUBT_DEAD_TIME * lag_s


def belief_of(valve: ValveParameters) -> ValveBelief:
    """Return what a configuration says, and how far it may be off, with the hypothesis that it is right beside it."""
    gain = valve.force_gain_n_per_ma
    spring, offset = valve.spring_rate_n_per_m / gain, valve.bench_set_n / gain
    sliding, static = valve.coulomb_friction_n / gain, valve.static_friction_n / gain
    lag_s, dead_time_s = valve.actuator.lag_s(fills=True), valve.actuator.dead_time_s
    sigmas = (
        _DOUBT_SPRING * spring,
        _DOUBT_OFFSET_MA,
        _DOUBT_FRICTION * sliding + _FRICTION_MA,
        _DOUBT_FRICTION * static + _FRICTION_MA,
        _log_sigma(lag_s, _DOUBT_LAG),
        _DOUBT_VISCOUS,
        _dead_time_sigma_s(dead_time_s, lag_s),
    )
    scatter_ma = _SCATTER * sliding + _SCATTER_MA
    static = max(static, sliding * _LEAST_RATIO + _LEAST_GAP_MA)
    mean = (spring, offset, sliding, static, math.log(lag_s + LEAST_LAG_S), 0.0, dead_time_s)
    surer = tuple(
        [sigma if place in (OFFSET, DEAD_TIME) else sigma / _CONFIGURED for place, sigma in enumerate(sigmas)]
    )
    belief = ValveBelief(gaussian_of(mean, sigmas), scatter_ma * scatter_ma, mean, scatter_ma * scatter_ma)
    return replace(belief, other=replace(belief, numbers=gaussian_of(mean, surer), drift=1.0 / _CONFIGURED))
