"""The daemon's side for the health of the valve: the newest sections, and when they go to the table writer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.store.health_messages import HealthReplaced, KeepHealth

if TYPE_CHECKING:
    from positioner.store.channel import Channel


class HealthClient:
    """The sections that the daemon has; `generation` counts the resets before them."""

    def __init__(self, found: HealthReplaced) -> None:
        self.found = found
        self._newest: KeepHealth | None = None

    def keep(self, sections: dict[str, Any], channel: Channel) -> None:
        """Hand the sections over, unless the table writer is slow or gone: then the next ones, nothing piles up."""
        self._newest = KeepHealth(self.found.generation, sections)
        if not channel.pending and not channel.ended:
            self.resend(channel)
            channel.flush()

    def resend(self, channel: Channel) -> None:
        """Hand over the newest sections, to a table writer that starts again or is to end."""
        if self._newest is not None:
            channel.send(self._newest)

    def replaced(self, found: HealthReplaced) -> tuple[HealthReplaced, ...]:
        """Take sections from outside, and return them, where they are of a later generation than ours."""
        if found.generation <= self.found.generation:
            return ()
        self.found, self._newest = found, None
        return (found,)
