"""Whether a correction pays for itself: what it gains while the setpoint stays, against what it costs on its way. Pure.

A stem that rests nearer to its setpoint than its slip jump cannot be moved there: it is taken away first, and brought
back. Away it is wrong by this excursion for as long as a move lasts. A correction pays where the error that it removes,
over the time for which setpoints are expected to stay, is more than that. The second one to a setpoint must pay twice,
the third one three times: those before did not do what was expected of them.
"""

from __future__ import annotations

LEFT = 0.0085
"""Of the span: a larger error is corrected at any price. From 1 % on a dwell is lost (docs/robustness.md), and a place
is seen to 0.15 % after some readings. On all valves of the robustness test 0.7, 0.85 and 1 % lose 298, 260 and 249
dwells; with 1 % a valve that is told exactly, behind a lag of 100 ms and read with 2 % noise, is left up to 0.81 % off.
"""
STAYS_S = 2.5
"""How long a setpoint is expected to stay. Chosen by the robustness test and the league of real valves: with 4 s more
dwells are lost, with 1.5 s a valve that is told exactly, behind a lag of 100 ms and read with 2 % noise, is left 0.22
instead of 0.17 % of span off (DESIGN.md, "What a correction must pay")."""


def pays(error_m: float, excursion_m: float, lasts_s: float, number: int) -> bool:
    """Return whether a correction pays.

    Args:
        error_m: distance to the setpoint.
        excursion_m: how far from the setpoint the stem is taken first; 0 where it is moved straight there.
        lasts_s: how long a move lasts.
        number: which correction to this setpoint it is, 1 for the first one.
    """
    return error_m * STAYS_S >= excursion_m * lasts_s * max(number, 1)
