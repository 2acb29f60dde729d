"""The vehicle's side of replanning reports: numbered, chained, and sent until the station has them, in order.

One report is under way at a time, so that they come in order. All of its messages are sent again until the
acknowledgement comes: soon at first, so that a link that loses one message in ten delivers within a second, then ever
more rarely, so that a broken link is not flooded. Until it comes no more messages go out than a radio's buffer takes
and a radio of 57,600 baud carries meanwhile; when it comes, the link has carried them, and as many may follow.
"""

from __future__ import annotations

import logging
import math
import secrets
from collections import deque
from dataclasses import replace
from typing import Protocol

from gcs.core.replanning import ReplanReport
from gcs.mavlink.dialect import Message
from gcs.mavlink.replan_messages import hash_after, report_messages, thinned
from gcs.mavlink.report_assembler import ReportStatus
from gcs.mavlink.transaction import Clock, Send
from gcs.mavlink.tunnel_carrier import carried, tunnelled

log = logging.getLogger(__name__)

MOST_PENDING = 1000
BURST = 12
"""Messages sent at once; a radio's buffer takes them, and the largest report of one departure is shorter."""
RATE_HZ = 40.0
"""So many more follow in a second: with TUNNEL about it, a message has some 140 bytes."""
ROUNDING = 1e-6
FIRST_RETRY_S = 0.15
RETRY_GROWTH = 1.3
LONGEST_RETRY_S = 2.0


class ReportStore(Protocol):
    """Keeps what is not delivered over a restart of the companion.

    It never raises nor waits for a disk: what cannot be kept is delivered all the same.
    """

    def load(self) -> list[ReplanReport]:
        """What is kept, in the order in which it was added."""
        ...

    def keep(self, report: ReplanReport) -> None:
        """Add a report."""
        ...

    def remove(self, report: ReplanReport) -> None:
        """A report was delivered."""
        ...

    def set_aside(self, report: ReplanReport) -> None:
        """The station refused a report: it is not sent again, but people may want to see it."""
        ...


class ReportOutbox:
    """Delivers reports, across lost messages, breaks of the link and restarts.

    Args:
        store: keeps what is not delivered; what it holds from before is delivered first.
        send: puts a message on the link; it may be lost.
        clock: monotonic seconds.
        boot_id: of this start; drawn when not given.
        target: system and component of the station; 0 is everybody.
    """

    def __init__(
        self,
        store: ReportStore,
        send: Send,
        clock: Clock,
        *,
        boot_id: int | None = None,
        target: tuple[int, int] = (0, 0),
    ) -> None:
        self.boot_id = secrets.randbits(32) if boot_id is None else boot_id
        self._store = store
        self._send = send
        self._clock = clock
        self._target = target
        self._waiting = deque(store.load())
        self._number = 0
        self._flown = ("", "")
        self._round: deque[Message] = deque()
        self._allowed, self._counted_at = float(BURST), clock()
        self._retry_s = FIRST_RETRY_S
        self._deadline = clock() if self._waiting else math.inf

    @property
    def pending(self) -> int:
        """Reports that are not acknowledged."""
        return len(self._waiting)

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next; infinite when there is nothing to do."""
        return self._deadline

    def add(self, report: ReplanReport) -> None:
        """Take a report to be delivered.

        It gets this boot's id, the next number and the hash after it; its plan hash is that of the plan, and becomes
        the hash after the report before while that was of the same plan. A path that does not fit on the wire is
        thinned. When 1000 reports wait already it is not kept, which the gap in the numbers and hashes shows.

        Raises:
            InputError: it changes more viewpoints than fit on the wire.
        """
        numbered = self._numbered(thinned(report))
        report_messages(numbered)
        self._number = numbered.number
        self._flown = (report.plan_hash, numbered.plan_hash_after)
        if len(self._waiting) >= MOST_PENDING:
            log.error("report %d is lost: %d wait for the station already", numbered.number, MOST_PENDING)
            return
        self._store.keep(numbered)
        self._waiting.append(numbered)
        if len(self._waiting) == 1:
            self._begin()

    def handle(self, message: Message) -> None:
        """Take a message; only the acknowledgement of the report under way is of interest."""
        answer = carried(message)
        if answer is None or answer.get_type() != "REPLAN_ACK" or not self._waiting:
            return
        report = self._waiting[0]
        if (answer.boot_id, answer.number) != (report.boot_id, report.number):
            return
        if answer.status == ReportStatus.STORED:
            self._store.remove(report)
        elif answer.status == ReportStatus.REFUSED:
            log.warning("the station refused report %d (%s)", report.number, report.reason.words)
            self._store.set_aside(report)
        else:
            return
        self._waiting.popleft()
        self._allowed = float(BURST)
        if self._waiting:
            self._begin()
        else:
            self._deadline = math.inf

    def on_time(self) -> None:
        """Send what is due."""
        if not self._waiting or self._clock() < self._deadline:
            return
        now = self._clock()
        self._allowed = min(self._allowed + RATE_HZ * (now - self._counted_at), float(BURST))
        self._counted_at = now
        if not self._round:
            self._round.extend(report_messages(self._waiting[0]))
        while self._round and self._allowed > 1.0 - ROUNDING:
            self._send(tunnelled(self._round.popleft(), *self._target))
            self._allowed -= 1.0
        if self._round:
            self._deadline = now + (1.0 - self._allowed) / RATE_HZ
        else:
            self._deadline = now + self._retry_s
            self._retry_s = min(self._retry_s * RETRY_GROWTH, LONGEST_RETRY_S)

    def _begin(self) -> None:
        self._round.clear()
        self._retry_s = FIRST_RETRY_S
        self._deadline = self._clock()
        self.on_time()

    def _numbered(self, report: ReplanReport) -> ReplanReport:
        plan_hash, flown_hash = self._flown
        before = flown_hash if report.plan_hash == plan_hash else report.plan_hash
        after = hash_after(before, report.path, report.viewpoints)
        return replace(report, boot_id=self.boot_id, number=self._number + 1, plan_hash=before, plan_hash_after=after)
