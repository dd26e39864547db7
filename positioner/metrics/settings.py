"""The `[metrics]` table of a configuration. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path  # noqa: TC003 - pydantic reads this hint at run time
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricsSettings(SettingsTable):
    """The `[metrics]` table: where the metrics go, as OpenMetrics text.

    Without a place there are none.

    file: a text file, such as one for node_exporter's textfile collector; a relative one lies beside the configuration.
    socket: a Unix socket that answers HTTP, relative as `file`.
    every_s: time between two hand-overs.
    """

    file: Path | None = None
    socket: Path | None = None
    every_s: Annotated[float, Interval(ge=0.5, le=3600.0)] = 5.0

    def __post_init__(self) -> None:
        """Refuse one place for both, where one of them would find the other's."""
        if self.file is not None and self.file == self.socket:
            raise ValueError("file and socket must be two places")

    @property
    def is_on(self) -> bool:
        """Whether there are metrics."""
        return self.file is not None or self.socket is not None

    def in_words(self) -> str:
        """Return where they go, in one line."""
        places = ", ".join(str(each) for each in (self.file, self.socket) if each is not None)
        return f"{places}, every {self.every_s:g} s"
