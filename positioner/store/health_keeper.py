"""The table writer's part for the health of the valve: it keeps what the daemon hands over, and saves it now and then.

The daemon hands over whole sections, never increments: what comes twice counts once. The newest ones are in this
process, which outlives the daemon; so a daemon that is killed loses what it has not yet handed over, and a power cut
what was not yet saved.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from positioner.errors import StateError
from positioner.store.document import utc_text
from positioner.store.health_document import HealthDocument, to_plain
from positioner.store.health_file import FAILED
from positioner.store.health_messages import HealthDumped, HealthReplaced, HealthRequest
from positioner.store.table_directory import remedy

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from positioner.store.health_file import HealthFile
    from positioner.store.health_messages import HealthResetRequest, KeepHealth

SAVE_AFTER_S = 600.0
"""A document of a few kilobytes in this interval wears no disk."""
_RETRY_S = 30.0


class HealthKeeper:
    """The newest document and its way to the disk; `problem` says why saving fails. `now_s` is monotonic."""

    def __init__(self, file: HealthFile, document: HealthDocument) -> None:
        self.document = document
        self.problem: str | None = None
        self._file = file
        self._is_saved = True
        self._save_at_s = -math.inf

    @property
    def present(self) -> HealthReplaced:
        """What the daemon goes on from."""
        return HealthReplaced(self.document.generation, self.document.sections)

    def take(self, message: KeepHealth) -> None:
        """Take sections of the daemon; those of another generation are from before a reset."""
        if message.generation == self.document.generation:
            self.document = replace(self.document, sections=message.sections)
            self._is_saved = False

    def due_in(self, now_s: float) -> float | None:
        """Return the seconds until `work` has something to do, or None."""
        return None if self._is_saved else max(0.0, self._save_at_s - now_s)

    def work(self, now_s: float) -> tuple[str, ...]:
        """Save the document if that is due; return lines for the log."""
        if self._is_saved or now_s < self._save_at_s:
            return ()
        before, self.problem = self.problem, None
        try:
            self._save()
        except FAILED as error:
            self._save_at_s = now_s + _RETRY_S
            self.problem = f"the health of the valve cannot be saved: {remedy(error)}"
            return () if self.problem == before else (self.problem,)
        self._save_at_s = now_s + SAVE_AFTER_S
        again = ("the health of the valve is saved again",) if before else ()
        return (*self._file.take_notices(), *again)

    def finish(self) -> tuple[str, ...]:
        """Save what is not saved yet; return lines for the log."""
        self._save_at_s = -math.inf
        return self.work(0.0)

    def reset(self, sections: tuple[str, ...], given: Mapping[str, Any]) -> str:
        """Begin these sections anew, or with what is `given`, which is then on the disk; return the path of the backup.

        Raises:
            StateError: nothing was changed; the message says why.
        """
        document, former = self.document, self.document
        left = {name: section for name, section in document.sections.items() if name not in sections}
        left |= given
        started = document.started if given else utc_text(int(time.time()))
        try:
            backup = self._file.back_up(document)
            self.document = replace(document, generation=document.generation + 1, started=started, sections=left)
            self._save()
        except FAILED as error:
            self.document = former
            raise StateError(f"nothing was changed, since the health cannot be saved: {remedy(error)}") from error
        return str(backup)

    def answer(
        self, request: HealthRequest | HealthResetRequest, tell: Callable[[HealthReplaced], None]
    ) -> HealthDumped | str:
        """Return the document, or after a reset, of which the daemon is told, the path of the backup.

        Raises:
            StateError: as `reset`.
        """
        if isinstance(request, HealthRequest):
            return HealthDumped(to_plain(self.document))
        backup = self.reset(request.sections, request.given)
        tell(self.present)
        return backup

    def _save(self) -> None:
        self.document = self._file.save(self.document)
        self._is_saved = True
