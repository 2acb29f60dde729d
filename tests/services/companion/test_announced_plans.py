"""PLAN_ANNOUNCE on the ground: the companion gets the plan, and acknowledges it only when it could fly it now."""

from __future__ import annotations

import pytest

from gcs.core.errors import LinkError, RefusedError
from gcs.mavlink.plan_announcement import CompanionAnnouncement

PLAN_HASH = "5a" * 32


class SlowPlans:
    """A source whose preparation takes a while; what fails is told once, and then begun anew with the next call."""

    def __init__(self, clock):
        self._clock = clock
        self._making = None
        self.begun = 0
        self.take(0.0, None)

    def take(self, seconds, outcome):
        """What begins from now on takes so long and ends like this."""
        self.seconds, self.outcome = seconds, outcome

    def get(self, plan_hash, offboard_timeout_s):
        if self._making is None:
            self.begun += 1
            self._making = self._clock() + self.seconds, self.outcome
        ready_at, outcome = self._making
        if self._clock() < ready_at:
            return None
        if isinstance(outcome, Exception):
            self._making = None
            raise outcome
        return outcome


@pytest.fixture
def rig(make_world):
    """A vehicle on the ground, its companion, and a station that announces."""
    world = make_world()
    (world.plan,) = world.plans.plans.values()
    world.slow = SlowPlans(world.clock)
    world.slow.take(0.0, world.plan)
    world.plans.get = world.slow.get
    world.said = []

    async def announcing(plan_hash):
        send, clock = world._sender("station"), world.clock
        await world.station.channel.run(CompanionAnnouncement(plan_hash, 1, send, clock, world.said.append))

    world.announce = lambda plan_hash=PLAN_HASH, timeout_s=200.0: world.do(announcing(plan_hash), timeout_s)
    return world


def test_a_plan_is_acknowledged_when_it_is_ready_and_not_before(rig):
    rig.slow.take(40.0, rig.plan)
    rig.announce()
    assert 40.0 <= rig.now_s < 43.0
    assert rig.slow.begun == 1, "not anew with each announcement"
    assert any("makes it ready" in text for text in rig.said)
    before = rig.now_s
    rig.announce()  # just before arming
    assert rig.now_s - before < 0.5, "what it holds it acknowledges at once"
    assert not rig.world.truth()["armed"]


def test_a_plan_that_cannot_be_had_is_refused_with_the_reason(rig):
    rig.slow.take(2.0, LinkError("the station does not answer: timed out", field="http://10.0.0.9:8080"))
    with pytest.raises(RefusedError, match=r"http://10.0.0.9:8080: the station does not answer: timed out"):
        rig.announce()


def test_a_failure_of_an_earlier_asking_does_not_count(rig):
    rig.slow.take(20.0, LinkError("the station does not answer"))
    with pytest.raises(TimeoutError):
        rig.announce(timeout_s=5.0)
    rig.run(60.0)  # it has failed meanwhile, and nobody heard of it
    rig.slow.take(8.0, rig.plan)
    rig.announce()
    assert rig.slow.begun == 2


def test_a_plan_is_not_acknowledged_while_the_lidar_is_silent(rig):
    rig.vehicle.lidar.state = "silent"
    with pytest.raises(RefusedError, match="the lidar is silent"):
        rig.announce()
    rig.vehicle.lidar.state = "clear"
    rig.announce()


def test_in_flight_nothing_is_prepared(rig):
    rig.take_off()
    rig.order()
    rig.run(3.0)
    before = rig.slow.begun
    with pytest.raises(RefusedError, match="flies another plan"):
        rig.announce("ab" * 32)
    assert rig.slow.begun == before


def test_announcements_to_other_vehicles_are_not_answered(rig):

    async def announcing():
        other = CompanionAnnouncement(PLAN_HASH, 2, rig.core.handle, rig.clock, rig.said.append)
        await rig.station.channel.run(other)

    before = len(rig.sent_by_companion)
    with pytest.raises(LinkError, match="no companion is heard"):
        rig.do(announcing())
    assert rig.slow.begun == 0
    assert not [m for _, m in rig.sent_by_companion[before:] if m.get_type() == "TUNNEL" and m.payload_length > 120]
