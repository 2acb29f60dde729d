"""What must not be lost when the companion ends in mid-flight: which lease it had, and how far its plan was flown."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from gcs.storage.lease_file import KeptLease

EVERY_S = 1.0
"""Progress along the plan is worth writing down after so much of the plan's time."""


class LeaseStore(Protocol):
    """Keeps the last lease (`gcs.storage.lease_file`)."""

    def load(self) -> KeptLease | None:
        """What was kept last; None when nothing was."""
        ...

    def keep(self, lease: KeptLease) -> None:
        """Keep this one instead."""
        ...


class LeaseMemory:
    """Has what changes kept.

    Args:
        store: where; None to keep nothing.

    Attributes:
        before: what was kept when the companion started.
    """

    def __init__(self, store: LeaseStore | None) -> None:
        self._store = store
        self.before = self._last = None if store is None else store.load()

    def remember(self, lease: KeptLease) -> None:
        """Keep what this says, if that is worth it; it may be told as often as one likes."""
        last = self._last
        if self._store is None or lease == last:
            return
        if last is not None and lease.plan_s is not None and last.plan_s is not None:
            same = replace(last, plan_s=lease.plan_s) == lease
            if same and abs(lease.plan_s - last.plan_s) < EVERY_S:
                return
        self._last = lease
        self._store.keep(lease)
