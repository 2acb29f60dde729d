"""What the companion's core needs of the world: plans to fly, and somebody who delivers its reports."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from gcs.core.replanning import ReplanReport
    from gcs.mavlink.dialect import Message
    from gcs.services.companion.flyable_plan import FlyablePlan


class PlanSource(Protocol):
    """Where plans come from."""

    def get(self, plan_hash: str, offboard_timeout_s: float) -> FlyablePlan | None:
        """A plan by its hash, ready to be flown; None while it is being got.

        Args:
            plan_hash: SHA-256 of its plan.json, 64 hex digits.
            offboard_timeout_s: for how long the vehicle flies on when setpoints stop.

        Raises:
            GcsError: it cannot be had, and why.
        """
        ...


class Outbox(Protocol):
    """Delivers reports, however long that takes (`gcs.mavlink.report_outbox`)."""

    @property
    def boot_id(self) -> int:
        """Of this start of the companion."""
        ...

    @property
    def pending(self) -> int:
        """Reports that are not acknowledged."""
        ...

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        ...

    def add(self, report: ReplanReport) -> None:
        """Take a report to be delivered."""
        ...

    def handle(self, message: Message) -> None:
        """Take a message; acknowledgements are of interest."""
        ...

    def on_time(self) -> None:
        """Send what is due."""
        ...
