"""A vehicle's outbox and a station's assembler with a bad link between them, on fake time."""

from __future__ import annotations

import heapq
import itertools
import math
import random
from collections.abc import Callable
from typing import TYPE_CHECKING

from gcs.core.frames import GeoPoint
from gcs.core.replanning import ReplanReason, ReplanReport, SeenObstacle, ViewpointChange, ViewpointFate
from gcs.mavlink.report_assembler import AnsweredReport, MalformedReport, ReportAssembler, ReportStatus, report_ack
from gcs.mavlink.report_outbox import ReportOutbox, ReportStore
from gcs.mavlink.tunnel_carrier import carried

if TYPE_CHECKING:
    from gcs.mavlink.dialect import Message

PLAN_HASH = "ab" * 32


def sample_report(points: int = 30, viewpoints: int = 3, plan_hash: str = PLAN_HASH) -> ReplanReport:
    """A report as the companion hands it to its outbox."""
    path = tuple(GeoPoint(31.3622 + k * 1e-6, 121.6155, 12.0 + k / 8) for k in range(points))
    skipped = tuple(ViewpointChange(k, ViewpointFate.SKIPPED, None) for k in range(viewpoints))
    obstacle = SeenObstacle(GeoPoint(31.3623, 121.6155, 12.0), 0.75, (-1.5, 0.25))
    return ReplanReport(0, 0, plan_hash, "", ReplanReason.STANDING_OBSTACLE, -1, 12.5, 20.25, obstacle, path, skipped)


class ReportsInMemory:
    """Keeps reports as the companion's disk does."""

    def __init__(self) -> None:
        self.kept: list[ReplanReport] = []
        self.aside: list[ReplanReport] = []

    def load(self) -> list[ReplanReport]:
        """What is kept."""
        return list(self.kept)

    def keep(self, report: ReplanReport) -> None:
        """Add a report."""
        self.kept.append(report)

    def remove(self, report: ReplanReport) -> None:
        """It was delivered."""
        self.kept.remove(report)

    def set_aside(self, report: ReplanReport) -> None:
        """It was refused."""
        self.kept.remove(report)
        self.aside.append(report)


class ReportWorld:
    """Both ends and the link.

    Args:
        seed: of what the link loses; also the boot id.
        loss: share of the messages that get lost, each way.
        one_way_s: how long a message takes.
        store: the companion's disk.
    """

    def __init__(
        self, seed: int, *, loss: float = 0.0, one_way_s: float = 0.025, store: ReportStore | None = None
    ) -> None:
        self.now_s = 0.0
        self.loss = loss
        self.one_way_s = one_way_s
        self.broken = False
        self.rng = random.Random(seed)
        self.sent = 0
        """Messages of the vehicle."""
        self.stored: list[tuple[float, ReplanReport]] = []
        """What the station was given, and when."""
        self.refused: list[tuple[int, int]] = []
        self.assembler = ReportAssembler()
        self._under_way: list[tuple[float, int, Callable[[Message], None], Message]] = []
        self._order = itertools.count()
        self._store = ReportsInMemory() if store is None else store
        self.start_companion(boot_id=seed)

    def start_companion(self, boot_id: int) -> None:
        """Start it, again."""
        self.outbox = ReportOutbox(self._store, self._up, lambda: self.now_s, boot_id=boot_id)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end_s = self.now_s + seconds
        while True:
            at_s = min(self._under_way[0][0] if self._under_way else math.inf, self.outbox.deadline)
            if at_s > end_s:
                break
            self.now_s = max(self.now_s, at_s)
            while self._under_way and self._under_way[0][0] <= self.now_s:
                _, _, take, message = heapq.heappop(self._under_way)
                take(message)
            self.outbox.on_time()
        self.now_s = end_s

    def acknowledge(self, boot_id: int, number: int, status: ReportStatus) -> None:
        """The station answers a report."""
        self.assembler.answered(boot_id, number, status)
        self.carry(self._companion, report_ack(boot_id, number, status, 1))

    def carry(self, take: Callable[[Message], None], message: Message) -> None:
        """Put a message on the link."""
        if not self.broken and self.rng.random() >= self.loss:
            heapq.heappush(self._under_way, (self.now_s + self.one_way_s, next(self._order), take, message))

    def _up(self, message: Message) -> None:
        self.sent += 1
        self.carry(self._station, message)

    def _companion(self, message: Message) -> None:
        self.outbox.handle(message)

    def _station(self, message: Message) -> None:
        got = self.assembler.take(carried(message))
        if got is None:
            return
        key = got.boot_id, got.number
        if isinstance(got, MalformedReport):
            self.refused.append(key)
            self.acknowledge(*key, ReportStatus.REFUSED)
        elif isinstance(got, AnsweredReport):
            self.acknowledge(*key, got.status)
        else:
            self.stored.append((self.now_s, got))
            self.acknowledge(*key, ReportStatus.STORED)
