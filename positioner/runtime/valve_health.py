"""The health of one valve in the daemon: computed after each cycle has sent its frames. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.health.monitor import begin_health, observe
from positioner.health.observed import observed_cycle

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.cycle.events import Event
    from positioner.cycle.input import CycleInput
    from positioner.cycle.state import CycleState
    from positioner.wire.messages import CanFrame


class ValveHealth:
    """The health of the valve; `state` is it after the last cycle."""

    def __init__(self, configuration: Configuration) -> None:
        self._settings = configuration.health_settings
        self.state = begin_health(self._settings, {})

    def cycle(
        self,
        cycle_input: CycleInput,
        before: CycleState,
        after: CycleState,
        outbox: tuple[CanFrame, ...],
        events: tuple[Event, ...],
    ) -> None:
        """Add one cycle."""
        observed = observed_cycle(cycle_input, before, after, outbox, events)
        if observed is not None:
            self.state = observe(self._settings, self.state, observed)
