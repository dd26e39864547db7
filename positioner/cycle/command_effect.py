"""Whether our commands act on the valve: by the quality of its readings, and by the command that they name. Pure.

STEM_POSITION names the command that acted. As long as it names newer ones, however late, the loop is closed. A node
that reports FAIL_POSITION obeys no command. A node whose echo stays the same, or names a command that was never sent,
obeys somebody else or nobody. Nothing may be learned then, because the valve did not answer our commands. The loss of a
few frames looks the same at first: learning stops at once, the fault is reported after some cycles and some time. A
node whose frames have no echo is believed to obey.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.wire.messages import Cause

if TYPE_CHECKING:
    from positioner.cycle.link import Reading
    from positioner.cycle.sent import SentCommands
    from positioner.wire.formats import FrameFormat

_FEW_CYCLES = 3
"""After so many cycles in a row without a newer command nothing is learned."""
_FAILED_S = 0.02
_IGNORED_CYCLES, _IGNORED_S = 5, 0.1
_DOUBT_S = 0.1
"""For so long after the last doubt nothing is learned: the effect of each current has ended by then."""


@dataclass(frozen=True, slots=True)
class CommandEffect:
    """What is known of the effect of our commands.

    named: the counter in the last reading. echo, echo_ma: counter and current of the newest command ever named.
    current_ma: the current that acted before the last reading, None before the first command.
    idle_cycles, idle_s: number and time of the readings in a row that named no newer command, or that came from a node
        that obeys none. failed: the node reports that it obeys no command. doubt_s: time until the table learns again.
    """

    named: int | None = None
    echo: int | None = None
    echo_ma: float = 0.0
    current_ma: float | None = None
    idle_cycles: int = 0
    idle_s: float = 0.0
    failed: bool = False
    doubt_s: float = 0.0

    @property
    def fault(self) -> Cause | None:
        """Why commands do not act, None while they do."""
        if self.failed and self.idle_cycles >= _FEW_CYCLES and self.idle_s >= _FAILED_S:
            return Cause.ACTUATOR_FAILED
        if self.idle_cycles >= _IGNORED_CYCLES and self.idle_s >= _IGNORED_S:
            return Cause.COMMAND_IGNORED
        return None

    @property
    def teaches(self) -> bool:
        """Whether the valve's motion is an answer to our commands, from which the table may learn."""
        return self.doubt_s <= 0.0


EFFECT_UNKNOWN = CommandEffect()


def track_effect(
    before: CommandEffect, sent: SentCommands, reading: Reading, form: FrameFormat, elapsed_s: float
) -> CommandEffect:
    """Return the effect after a reading, `elapsed_s` after the last one; `sent` are the newest commands, in `form`.

    Before the first command nothing can act, and nothing changes.
    """
    last = sent.last
    if last is None:
        return before
    named = reading.command_counter if form.counter is not None else None
    if named is None:
        newer, current_ma = True, last.current_ma
    else:
        newer, current_ma = _named(before, sent, named, form.counter_modulus) or (False, last.current_ma)
    failed = not reading.obeys
    idle = failed or not newer
    idle_cycles = before.idle_cycles + 1 if idle else 0
    in_doubt = failed or idle_cycles >= _FEW_CYCLES
    return CommandEffect(
        named=named,
        echo=named if newer else before.echo,
        echo_ma=current_ma if newer else before.echo_ma,
        current_ma=current_ma,
        idle_cycles=idle_cycles,
        idle_s=before.idle_s + elapsed_s if idle else 0.0,
        failed=failed,
        doubt_s=_DOUBT_S if in_doubt else max(before.doubt_s - elapsed_s, 0.0),
    )


def _named(before: CommandEffect, sent: SentCommands, echo: int, modulus: int) -> tuple[bool, float] | None:
    """Return whether `echo` names a newer command than any before, and its current, None if it was never sent.

    The echo of a command that was never sent is no information: the last command is then the best guess. An echo that
    stays the same means the same command, however often the counter has wrapped since.
    """
    if echo == before.echo:
        return False, before.echo_ma
    command = sent.named(echo, modulus)
    if command is None:
        return None
    is_ahead = before.echo is None or 2 * ((echo - before.echo) % modulus) <= modulus
    return is_ahead and echo != before.named, command.current_ma
