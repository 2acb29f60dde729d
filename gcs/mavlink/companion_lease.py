"""The lease by which a companion flies a plan: the station's orders, resent until answered, and the companion's state.

A lease has a random number, drawn for each order to fly. The companion tells the state of the last one twice a second
and at each change; that is the answer to every order, so orders may be lost, repeated, or come late.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from gcs.core.errors import LinkError, OperationCancelled, RefusedError
from gcs.core.replanning import ReplanReason
from gcs.mavlink.command_protocol import Target
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.transaction import Clock, Send, Transaction
from gcs.mavlink.tunnel_carrier import carried, replanning, text_of, tunnelled

COMPANION = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
"""The companion's component id; its system id is the vehicle's."""

RESEND_S = 0.7
UNHEARD_S = 10.0
"""Without any state for so long there is no companion."""

PREPARING_S = 120.0
"""A companion that says that it prepares the plan is given so long."""

TEXT_BYTES = 40
NO_HASH = "0" * 64


class OrderKind(IntEnum):
    """What a station orders."""

    FLY = 1
    PAUSE = 2
    RESUME = 3
    END = 4


class LeaseState(IntEnum):
    """Where a lease stands."""

    IDLE = 0
    REFUSED = 1
    LEADING = 2
    PAUSED = 3
    FINISHED = 4
    ENDED = 5
    TAKEN_OVER = 6
    """By somebody else, a pilot or the autopilot's failsafe, and not by the companion's own command."""


OVER = frozenset({LeaseState.REFUSED, LeaseState.FINISHED, LeaseState.ENDED, LeaseState.TAKEN_OVER})
"""States of a lease that will not change any more."""

ANSWERS = {
    OrderKind.FLY: OVER | {LeaseState.LEADING, LeaseState.PAUSED},
    OrderKind.PAUSE: OVER | {LeaseState.PAUSED},
    OrderKind.RESUME: OVER | {LeaseState.LEADING},
    OrderKind.END: OVER,
}


@dataclass(frozen=True)
class LeaseOrder:
    """One order of a station.

    Attributes:
        lease: number of the lease, from 1.
        kind: what to do.
        plan_hash: SHA-256 of plan.json, 64 hex digits.
    """

    lease: int
    kind: OrderKind
    plan_hash: str


@dataclass(frozen=True)
class LeaseStatus:
    """What the companion tells of its lease.

    Attributes:
        lease: of the last order; 0 when there was none.
        state: where it stands.
        away: the `ReplanReason` number for which the plan is left at the moment; 0 while it is flown.
        plan_hash: of the plan, 64 hex digits; zeros when there is none.
        plan_time_s: how far it is flown, in its own time.
        vehicle_s: the autopilot's clock, as the companion estimates it.
        reports_pending: reports that are not acknowledged.
        lidar_age_s: since the last good scan; None when there was none.
        odometry_quality: percent, -1 when it failed or there is none.
        text: for people.
    """

    lease: int = 0
    state: LeaseState = LeaseState.IDLE
    away: int = 0
    plan_hash: str = NO_HASH
    plan_time_s: float = 0.0
    vehicle_s: float = 0.0
    reports_pending: int = 0
    lidar_age_s: float | None = None
    odometry_quality: int = -1
    text: str = ""

    @property
    def away_words(self) -> str | None:
        """Why the plan is left at the moment, for people; None while it is flown."""
        if self.away == 0:
            return None
        try:
            return ReplanReason(self.away).words
        except ValueError:
            return f"a reason that this station does not know ({self.away})"


def lease_order(message: Message) -> LeaseOrder | None:
    """The order in a TUNNEL; None when it is something else or impossible."""
    inner = carried(message)
    if inner is None or inner.get_type() != "LEASE_ORDER" or inner.lease == 0:
        return None
    try:
        return LeaseOrder(int(inner.lease), OrderKind(inner.order), bytes(inner.plan_hash).hex())
    except ValueError:
        return None


def lease_status(message: Message) -> LeaseStatus | None:
    """The companion's state in a TUNNEL; None when it is something else or impossible."""
    inner = carried(message)
    if inner is None or inner.get_type() != "LEASE_STATE":
        return None
    try:
        state = LeaseState(inner.state)
    except ValueError:
        return None
    return LeaseStatus(
        lease=int(inner.lease),
        state=state,
        away=int(inner.reason),
        plan_hash=bytes(inner.plan_hash).hex(),
        plan_time_s=float(inner.plan_time) if math.isfinite(inner.plan_time) else 0.0,
        vehicle_s=inner.time_boot_ms * 1e-3,
        reports_pending=int(inner.reports_pending),
        lidar_age_s=float(inner.lidar_age) if math.isfinite(inner.lidar_age) else None,
        odometry_quality=int(inner.odometry_quality),
        text=text_of(inner.text),
    )


def lease_status_message(status: LeaseStatus) -> Message:
    """The TUNNEL that tells a state to everybody."""
    inner = replanning.MAVLink_lease_state_message(
        status.lease,
        status.state,
        status.away,
        list(bytes.fromhex(status.plan_hash)),
        status.plan_time_s,
        int(status.vehicle_s * 1e3) & 0xFFFFFFFF,
        min(status.reports_pending, 0xFFFF),
        math.nan if status.lidar_age_s is None else status.lidar_age_s,
        status.odometry_quality,
        status.text.encode("ascii", "replace")[:TEXT_BYTES],
    )
    return tunnelled(inner, 0, 0)


class LeaseOrdering(Transaction[LeaseStatus]):
    """Gives an order until a state of the companion answers it.

    Ends with that state. A companion that is still preparing (idle, with this lease's number) is waited for.

    Args:
        order: to be given.
        system_id: of the vehicle.
        send: puts a message on the link.
        clock: monotonic seconds.

    Raises:
        LinkError: there is no companion, or it does not come to an end with its preparations.
        RefusedError: it refuses, in its own words.
    """

    def __init__(self, order: LeaseOrder, system_id: int, send: Send, clock: Clock) -> None:
        super().__init__(send, clock)
        self._order = order
        self._target: Target = (system_id, COMPANION)
        self._resend_at = 0.0
        self._give_up_at = clock() + UNHEARD_S
        self._preparing_until = clock() + PREPARING_S
        self._text = ""

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return min(self._resend_at, self._give_up_at)

    def start(self) -> None:
        """See Transaction."""
        inner = replanning.MAVLink_lease_order_message(
            self._order.lease, self._order.kind, list(bytes.fromhex(self._order.plan_hash))
        )
        self._send(tunnelled(inner, *self._target))
        self._resend_at = self._clock() + RESEND_S

    def handle(self, message: Message) -> None:
        """See Transaction."""
        if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
            return
        status = lease_status(message)
        if status is None or status.lease != self._order.lease:
            return
        self._text = status.text
        if status.state is LeaseState.REFUSED:
            self._fail(RefusedError(f"the companion refuses: {status.text}"))
        elif status.state in ANSWERS[self._order.kind]:
            self._succeed(status)
        elif status.state is LeaseState.IDLE:
            self._give_up_at = min(self._clock() + UNHEARD_S, self._preparing_until)

    def on_time(self) -> None:
        """See Transaction."""
        if self._clock() < self._give_up_at:
            self.start()
        elif self._text:
            self._fail(LinkError(f"the companion does not follow the order; it last said: {self._text}"))
        else:
            self._fail(LinkError("no companion answers; start `gcs companion` beside the autopilot"))

    def cancel(self) -> None:
        """See Transaction."""
        self._fail(OperationCancelled("the order to the companion was cancelled"))
