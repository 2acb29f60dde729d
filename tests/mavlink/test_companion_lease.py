"""The lease protocol: states on the wire, and orders that are given until a state answers them."""

from __future__ import annotations

import pytest

from gcs.core.errors import LinkError, RefusedError
from gcs.mavlink.companion_lease import (
    COMPANION,
    LeaseOrder,
    LeaseOrdering,
    LeaseState,
    LeaseStatus,
    OrderKind,
    lease_order,
    lease_status,
    lease_status_message,
)
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.tunnel_carrier import replanning, tunnelled

HASH = "c3" * 32


def heard(message, sender=(1, COMPANION)):
    """A message as it comes out of a link."""
    (received,) = FrameParser().feed(FramePacker(*sender).pack(message))
    return received


class Exchange:
    """A station that gives one order, on fake time."""

    def __init__(self, kind=OrderKind.FLY):
        self.now, self.sent = 0.0, []
        self.ordering = LeaseOrdering(LeaseOrder(9, kind, HASH), 1, self.sent.append, lambda: self.now)
        self.ordering.start()

    def pass_time(self, seconds):
        end = self.now + seconds
        while not self.ordering.finished and self.ordering.deadline <= end:
            self.now = self.ordering.deadline
            self.ordering.on_time()
        self.now = end

    def tell(self, state, lease=9, text="", sender=(1, COMPANION)):
        self.ordering.handle(heard(lease_status_message(LeaseStatus(lease, state, plan_hash=HASH, text=text)), sender))


def test_a_state_comes_back_as_it_was_told():
    status = LeaseStatus(
        lease=0xDEADBEEF,
        state=LeaseState.PAUSED,
        away=2,
        plan_hash=HASH,
        plan_time_s=12.5,
        vehicle_s=4000.25,
        reports_pending=3,
        lidar_age_s=0.125,
        odometry_quality=87,
        text="paused by order",
    )
    assert lease_status(heard(lease_status_message(status))) == status


def test_a_long_text_is_cut_and_nothing_known_stays_nothing():
    status = lease_status(heard(lease_status_message(LeaseStatus(text="x" * 60))))
    assert status.text == "x" * 40
    assert status.lidar_age_s is None


@pytest.mark.parametrize(("lease", "order"), [(0, 1), (9, 0), (9, 77)])
def test_impossible_orders_are_none(lease, order):
    message = replanning.MAVLink_lease_order_message(lease, order, list(bytes(32)))
    assert lease_order(heard(tunnelled(message, 1, COMPANION))) is None


def test_an_order_is_repeated_until_it_is_answered():
    exchange = Exchange()
    exchange.pass_time(3.0)
    assert len(exchange.sent) == 5
    assert lease_order(heard(exchange.sent[-1], (255, 190))) == LeaseOrder(9, OrderKind.FLY, HASH)
    exchange.tell(LeaseState.LEADING)
    assert exchange.ordering.result().state is LeaseState.LEADING


def test_states_of_other_leases_and_of_others_are_no_answer():
    exchange = Exchange()
    exchange.tell(LeaseState.LEADING, lease=8)
    exchange.tell(LeaseState.LEADING, sender=(2, COMPANION))
    exchange.tell(LeaseState.LEADING, sender=(1, 1))
    assert not exchange.ordering.finished


def test_one_that_prepares_is_waited_for_but_not_forever():
    exchange = Exchange()
    for _ in range(20):
        exchange.pass_time(2.0)
        exchange.tell(LeaseState.IDLE, text="gets the plan")
    assert not exchange.ordering.finished
    exchange.pass_time(30.0)
    with pytest.raises(LinkError, match="gets the plan"):
        exchange.ordering.result()


def test_a_refusal_has_its_words_and_silence_too():
    exchange = Exchange()
    exchange.tell(LeaseState.REFUSED, text="the lidar is silent")
    with pytest.raises(RefusedError, match="the lidar is silent"):
        exchange.ordering.result()
    exchange = Exchange()
    exchange.pass_time(20.0)
    with pytest.raises(LinkError, match="no companion"):
        exchange.ordering.result()


def test_a_pause_is_answered_by_the_pause_alone():
    exchange = Exchange(OrderKind.PAUSE)
    exchange.tell(LeaseState.LEADING)
    assert not exchange.ordering.finished
    exchange.tell(LeaseState.PAUSED)
    assert exchange.ordering.finished
