"""Whether our commands act on the valve, by what its node says and by which command its readings name. Pure.

STEM_POSITION names the command that acted. As long as it names newer ones, however late, the loop is closed. A node
that says FAIL_POSITION obeys none; one whose echo stays where it is, or names what was never sent, obeys somebody else
or nobody. Then nothing may be learned: it would be of a valve that was not asked. A loss of a few frames is no such
thing, so both are told only after some cycles and some time, while lessons stop at once. A node whose frames have no
echo is believed to obey.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.wire.messages import Cause

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.cycle.link import Reading
    from positioner.wire.formats import FrameFormat

_FEW_CYCLES = 3
"""So many in a row without a newer command, and lessons stop."""
_FAILED_S = 0.02
_IGNORED_CYCLES, _IGNORED_S = 5, 0.1
_DOUBT_S = 0.1
"""What was pushed while commands did not act is judged by then."""


@dataclass(frozen=True, slots=True)
class SentCommand:
    """A command that left: its frame's counter (modulo 256) and its current."""

    counter: int
    current_ma: float


@dataclass(frozen=True, slots=True)
class CommandEffect:
    """What is known of it.

    heard: the counter that was named last. echo, echo_ma: counter and current of the newest command that was named.
    current_ma: what acted before the last reading, None before the first command.
    idle_cycles, idle_s: readings in a row that named no newer command, and how long. failed: the node says that it
        obeys none. doubt_s: how long nothing is learned yet.
    """

    heard: int | None = None
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
        """Whether what the valve does is an answer to our commands."""
        return self.doubt_s <= 0.0


EFFECT_UNKNOWN = CommandEffect()


def track_effect(
    before: CommandEffect, sent: Sequence[SentCommand], reading: Reading, form: FrameFormat, elapsed_s: float
) -> CommandEffect:
    """Return what is known after a reading, `elapsed_s` after the last; `sent` are the newest commands, of that form.

    Before the first of them nothing can act, and nothing is said.
    """
    if not sent:
        return before
    named = reading.command_counter if form.counter is not None else None
    newer, current_ma = (True, sent[-1].current_ma) if named is None else _named(before, sent, named, form)
    failed = not reading.obeys
    idle = failed or not newer
    cycles, idle_s = (before.idle_cycles + 1, before.idle_s + elapsed_s) if idle else (0, 0.0)
    doubt_s = _DOUBT_S if failed or cycles >= _FEW_CYCLES else max(before.doubt_s - elapsed_s, 0.0)
    echo, echo_ma = (named, current_ma) if newer else (before.echo, before.echo_ma)
    return CommandEffect(named, echo, echo_ma, current_ma, cycles, idle_s, failed, doubt_s)


def _named(before: CommandEffect, sent: Sequence[SentCommand], echo: int, form: FrameFormat) -> tuple[bool, float]:
    """Return whether `echo` names a newer command than any before, and the current of the command that it names.

    What was never sent tells nothing: the last command is then the best guess. An echo that stays the same means the
    same command, however often the counter has gone round since.
    """
    if echo == before.echo:
        return False, before.echo_ma
    current_ma = next((each.current_ma for each in reversed(sent) if each.counter == echo), None)
    if current_ma is None:
        return False, sent[-1].current_ma
    ahead = before.echo is None or (echo - before.echo) % form.counter_modulus <= form.counter_modulus // 2
    return ahead and echo != before.heard, current_ma
