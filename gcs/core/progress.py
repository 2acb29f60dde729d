"""How long work tells how far it is, and learns that it is to stop."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Given to every long loop; called at least every 0.2 s of work."""

    def report(self, stage: str, fraction: float) -> None:
        """Tell how far a stage is.

        Args:
            stage: name of the stage, as in `stages_s` of the report.
            fraction: share of the stage that is done, 0 to 1.

        Raises:
            OperationCancelled: the caller wants the work to stop.
        """
        ...


class SilentProgress:
    """Tells nobody and is never cancelled."""

    def report(self, stage: str, fraction: float) -> None:
        """Take the report and forget it."""
        del stage, fraction
