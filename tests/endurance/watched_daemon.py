"""`positioner` with a log of the samples that it learns.

python -m endurance.watched_daemon SAMPLE_LOG run --config valve.toml
"""

from __future__ import annotations

import logging
import sys
from pathlib import Path

from endurance.sample_log import SampleLogWriter
from positioner.cli.main import main
from positioner.cycle.events import Learned
from positioner.machine.journal import logger


class Watch(logging.Filter):
    """Writes each learned sample to the sample log, before the store receives it; keeps it out of the daemon's log."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._sample_log = SampleLogWriter(path)

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the record belongs in the daemon's log, too."""
        event = record.args[0] if isinstance(record.args, tuple) and record.args else None
        if isinstance(event, Learned):
            self._sample_log.write(event.sequence, event.sample)
        return record.levelno > logging.DEBUG


if __name__ == "__main__":
    logger.addFilter(Watch(Path(sys.argv[1])))
    sys.exit(main([*sys.argv[2:], "--verbose"]))
