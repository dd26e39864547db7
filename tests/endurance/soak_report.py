"""The findings of a soak, in lines, and whether it failed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from array import array
    from collections.abc import Sequence

    from endurance.pulse import Pulse
    from endurance.soak_host import SoakHost


def report(
    host: SoakHost, pulses: Sequence[Pulse], violations: Sequence[str], learned: int, growth_limit: float
) -> tuple[list[str], bool]:
    """Return the lines and whether it failed; timing is reported, never a failure."""
    found = [*violations]
    lines = [
        _timing("period of the commands", host.periods_s),
        _timing("latency, position frame to command", host.latencies_s),
        f"modes entered: {', '.join(f'{mode.name} {count}×' for mode, count in sorted(host.modes.items()))}",
        f"failed safe {host.modes.get(Mode.FAILSAFE, 0)}×, and was armed again each time",
        f"statuses with a table that is not saved: {host.unsaved}",
        f"learned samples: {learned}",
        "process   looks  hours MiB at the end  growth % descriptors leaked",
    ]
    for pulse in pulses:
        if not pulse.is_long:
            found.append(f"{pulse.name} {pulse.process} was measured {len(pulse.times_s)} times only")
            continue
        hours = (pulse.times_s[-1] - pulse.times_s[0]) / 3600.0
        size, growth = pulse.memory_bytes[-1] / 2**20, pulse.growth
        numbers = f"{hours:6.3f} {size:14.2f} {100 * growth:+9.3f} {min(pulse.descriptors):11d} {pulse.leaked:+6d}"
        lines.append(f"{pulse.name:8} {len(pulse.times_s):6d} {numbers}")
        if growth >= growth_limit:
            found.append(f"{pulse.name} grew by {100 * growth:.2f} %, the limit is {100 * growth_limit:g} %")
        if pulse.leaked > 0:
            found.append(f"{pulse.name} has {pulse.leaked} more descriptors open than before")
    found += [f"{count} statuses with the false cause {cause.name}" for cause, count in (+host.false_alarms).items()]
    lines += [f"violation: {violation}" for violation in found]
    lines.append(f"violations: {len(found)}")
    return lines, bool(found)


def _timing(name: str, values_s: array[float]) -> str:
    if not values_s:
        return f"{name}: none received"
    ordered = sorted(values_s)
    median, high, most = (1e3 * ordered[min(int(q * len(ordered)), len(ordered) - 1)] for q in (0.5, 0.99, 1.0))
    return f"{name}: median {median:.2f} ms, 99 % {high:.2f} ms, max {most:.2f} ms, of {len(ordered)}"
