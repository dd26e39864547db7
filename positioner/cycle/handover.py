"""From manual to automatic mode without a bump. Pure.

While a person gives the current, the position is averaged. Back in automatic mode the law begins with that position as
its setpoint, and the host's setpoint does not count until it changes. The first current is that of manual mode; it
approaches the law's current within `BLEND_S`, or changes to it at once where the law moves the stem.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.guard.state import CONTROLLING
from positioner.values import dataclass, replace
from positioner.wire.messages import Mode, Motion

if TYPE_CHECKING:
    from positioner.laws.law import Decision

BLEND_S = 1.0
"""Time within which the difference to the current of manual mode fades."""
_READINGS_AVERAGED = 100
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Handover:
    """What control takes over from manual mode.

    position_m: mean of the newest `readings` readings under the current `current_ma`.
    begun: whether control has taken over; passed_m: the host's setpoint at that time, ignored until it changes.
    offset_ma: the current of manual mode less the law's first current, at `offset_ns`.
    """

    position_m: float = 0.0
    readings: int = 0
    current_ma: float | None = None
    begun: bool = False
    passed_m: float | None = None
    offset_ma: float | None = None
    offset_ns: int = 0


def update_handover(
    handover: Handover | None, mode: Mode, measured_m: float | None, setpoint_m: float | None, last_ma: float | None
) -> Handover | None:
    """Return what control takes over, None where it takes over nothing.

    mode and setpoint_m are those of this cycle, `measured_m` its reading, None without one; last_ma acted before it.
    """
    if mode is Mode.MANUAL:
        return _track(handover, measured_m, last_ma)
    if handover is None or mode not in CONTROLLING:
        return None
    if not handover.begun:
        return replace(handover, begun=True, passed_m=setpoint_m)
    return handover if setpoint_m == handover.passed_m else None


def start_m(handover: Handover | None, measured_m: float) -> float:
    """Return the position in m that control begins with."""
    return handover.position_m if handover is not None and handover.readings else measured_m


def _track(handover: Handover | None, measured_m: float | None, last_ma: float | None) -> Handover:
    """Return the mean with one more reading; each new current starts a new mean."""
    if handover is None or handover.begun or handover.current_ma != last_ma:
        handover = Handover(current_ma=last_ma)
    if measured_m is None:
        return handover
    readings = min(handover.readings + 1, _READINGS_AVERAGED)
    mean_m = handover.position_m + (measured_m - handover.position_m) / readings
    return Handover(position_m=mean_m, readings=readings, current_ma=last_ma)


def blend(handover: Handover, decision: Decision, last_ma: float, now_ns: int) -> tuple[Handover, Decision]:
    """Return the handover after this cycle, and the decision with its current blended from that of manual mode."""
    if decision.motion is Motion.MOVE:  # a move needs exactly the current that the law asks for
        return replace(handover, offset_ma=0.0), decision
    if handover.offset_ma is None:
        handover = replace(handover, offset_ma=last_ma - decision.current_ma, offset_ns=now_ns)
    share = 1.0 - (now_ns - handover.offset_ns) / (BLEND_S * _NS)
    if not handover.offset_ma or share <= 0.0:
        return handover, decision
    return handover, replace(decision, current_ma=decision.current_ma + share * handover.offset_ma)
