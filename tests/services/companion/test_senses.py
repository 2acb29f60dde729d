"""What the lidar says in one message or many, well or badly; what lies on the vehicle is nothing to fly away from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.core.errors import RefusedError
from gcs.core.replanning import ReplanReason
from gcs.core.vehicle import FlightMode
from gcs.mavlink.companion_lease import LeaseState
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.plan_announcement import CompanionAnnouncement
from sitl_mocks.dialect import mavlink

TRUCK = {"kind": "vehicle", "radius_m": 1.0, "height_m": 20.0, "path_m": [[6.0, 0.3]]}
MAST = {"kind": "vehicle", "radius_m": 1.0, "height_m": 20.0, "path_m": [[6.0, 20.0]]}
SECTORS, POINT = "OBSTACLE_DISTANCE", "OBSTACLE_DISTANCE_3D"
UNKNOWN = 65535


def flying(make_world, **options):
    world = make_world(**options)
    world.take_off()
    assert world.order().state is LeaseState.LEADING
    return world


def unpack(message):
    """Its fields may be changed then."""
    return [getattr(message, name) for name in message.layout.fields]


def change(world, kind, spoil, every=1):
    """Have some of the messages of a kind arrive otherwise than they were sent."""
    counted = [0]

    def spoiled(message):
        if message.get_type() == kind:
            counted[0] += 1
            unpack(message)
            if counted[0] % every == 0:
                return bool(spoil(message))
        return False

    world.drop = spoiled


# ---- bad scans


def no_step(message):
    message.increment_f = math.nan


def too_many_sectors(message):
    message.increment_f = 30.0


def nothing_but_zeros(message):
    message.distances = [0] * len(message.distances)


@pytest.mark.parametrize(
    ("spoil", "words"), [(no_step, "nan"), (too_many_sectors, "72 sectors"), (nothing_but_zeros, "every range is 0")]
)
def test_bad_scans_among_good_ones_are_said_once_and_cost_nothing(make_world, spoil, words):
    world = flying(make_world, obstacles=[TRUCK])
    change(world, SECTORS, spoil, every=2)
    world.fly_until(LeaseState.FINISHED)
    assert sum(words in text for text in world.texts) == 1, world.texts
    truth = world.world.truth()
    assert truth["obstacles"]["touched"] == {}
    assert truth["captures"] == 2


def test_a_number_that_changes_does_not_make_a_new_text(make_world):
    world = flying(make_world)
    world.run(3.0)

    def jumps(message):
        message.x += 2.0 + 0.01 * (round(message.time_usec / 1e5) % 50) if message.time_usec // 500_000 % 2 else 0.0

    change(world, "ODOMETRY", jumps)
    world.run(9.0)
    assert sum("off the estimator" in text for text in world.texts) == 1, world.texts


# ---- on the vehicle


def sectors_see(range_cm):
    def arm_in_the_way(message):
        message.distances = [*message.distances[:18], range_cm, *message.distances[19:]]

    return arm_in_the_way


def points_see(world):
    """The same from a sensor that sends points, too: one to the right."""

    def arm_in_the_way(message):
        at_ms = message.time_usec // 1000
        point = mavlink.MAVLink_obstacle_distance_3d_message(at_ms, 0, 12, UNKNOWN, 0.0, 0.3, 0.1, 0.2, 30.0)
        for heard in FrameParser().feed(FramePacker(1, 1).pack(point)):
            world.core.handle(heard)

    return arm_in_the_way


@pytest.mark.parametrize("seen", ["0 cm", "10 cm", "30 cm", "30 cm, now and then", "a point"])
def test_what_is_on_the_vehicle_is_said_and_ends_the_lease_in_a_hold(make_world, seen):
    world = flying(make_world)
    spoil = points_see(world) if seen == "a point" else sectors_see(int(seen.split()[0]))
    change(world, SECTORS, spoil, every=3 if "now" in seen else 1)
    before = world.station.poses.newest.position_m
    status = world.fly_until(LeaseState.ENDED, timeout_s=30.0)
    assert status.text.startswith("something is on the vehicle or its lidar, 90 degrees right of the nose")
    assert sum("slows to a hover" in text for text in world.texts) == 1, world.texts
    assert np.linalg.norm(world.station.poses.newest.position_m[:2] - before[:2]) < 12.0
    assert [report.reason for report in world.outbox.reports] == [ReplanReason.LEASE_ENDED], "it fled from nothing"
    world.run(3.0)
    assert world.station.mode is FlightMode.HOLD
    with pytest.raises(RefusedError, match="on the vehicle"):
        world.order(lease=2)


def test_what_was_on_the_vehicle_for_a_moment_costs_a_moment(make_world):
    world = flying(make_world)
    change(world, SECTORS, sectors_see(30))
    world.run(4.0)
    assert world.core._flight.hold_reasons == ("lidar",)
    world.drop = lambda message: False
    world.fly_until(LeaseState.FINISHED)
    assert world.outbox.reports == []


def test_with_something_on_the_vehicle_nothing_takes_off(make_world):
    world = make_world()
    (plan_hash,) = world.plans.plans
    change(world, SECTORS, sectors_see(30))

    async def announcing():
        asked = CompanionAnnouncement(plan_hash, 1, world._sender("station"), world.clock, lambda text: None)
        await world.station.channel.run(asked)

    world.run(5.0)
    world.do(announcing())  # it learns how large the vehicle is
    world.run(3.0)
    with pytest.raises(RefusedError, match="something is on the vehicle or its lidar, 90 degrees right"):
        world.do(announcing())


# ---- points in space


def seen_scans(world):
    """The ages of the scans that the flight is given from now on."""
    ages, see = [], world.core._flight.see

    def noticed(scan, at_s):
        ages.append(world.vehicle.time_s - at_s)
        see(scan, at_s)

    world.core._flight.see = noticed
    return ages


def test_sectors_and_points_of_one_sensor_are_one_scan_and_make_no_flood(make_world):
    world = flying(make_world, obstacles=[TRUCK], tells_3d=True)
    world.run(3.0)
    ages = seen_scans(world)
    world.run(2.0)
    assert 19 <= len(ages) <= 21
    world.fly_until(LeaseState.FINISHED)
    assert not any("lidar" in text for text in world.texts), world.texts


def test_points_alone_are_flown_round_and_soon(make_world):
    world = make_world(obstacles=[TRUCK], tells_3d=True)
    world.drop = lambda message: message.get_type() == SECTORS
    world.take_off()
    world.order()
    world.run(3.0)
    ages = seen_scans(world)
    world.run(2.0)
    assert 19 <= len(ages) <= 21
    assert max(ages) < 0.07, "a scan does not wait for the next one"
    world.fly_until(LeaseState.FINISHED)
    truth = world.world.truth()
    assert truth["obstacles"]["touched"] == {}
    assert truth["captures"] == 2
    assert world.outbox.reports[0].reason is ReplanReason.STANDING_OBSTACLE


def test_what_one_sensor_sees_is_not_lost_because_it_is_slower_than_the_other(make_world):
    """The sectors look back only; the points are told 50 ms late."""
    world = make_world(obstacles=[TRUCK], tells_3d=True)

    def look_back(message):
        if message.get_type() == SECTORS:
            unpack(message)
            message.distances = [UNKNOWN] * 30 + message.distances[30:42] + [UNKNOWN] * 30
        elif message.get_type() == POINT:
            unpack(message)
            message.time_boot_ms -= 50
        return False

    world.drop = look_back
    world.take_off()
    world.order()
    world.fly_until(LeaseState.FINISHED)
    assert world.world.truth()["obstacles"]["touched"] == {}
    assert world.outbox.reports[0].reason is ReplanReason.STANDING_OBSTACLE
    assert not any("lidar" in text for text in world.texts), world.texts


def test_points_outside_the_slab_are_a_sign_of_life(make_world):
    world = make_world(obstacles=[MAST], tells_3d=True)

    def high_up(message):
        message.z -= 6.0

    change(world, POINT, high_up)
    spoil = world.drop
    world.drop = lambda message: message.get_type() == SECTORS or spoil(message)
    world.take_off()
    world.order()
    world.fly_until(LeaseState.FINISHED)
    assert not any("lidar" in text for text in world.texts), world.texts


def test_where_nothing_is_in_reach_points_are_silent_and_that_is_said(make_world):
    world = make_world(tells_3d=True)
    world.drop = lambda message: message.get_type() == SECTORS
    world.take_off()
    with pytest.raises(RefusedError, match="the lidar is silent: OBSTACLE_DISTANCE"):
        world.order()


def test_the_last_obstacle_drives_off_and_points_alone_do_not_do(make_world):
    leaves = {**MAST, "path_m": [[6.0, 20.0], [6.0, 80.0]], "speed_m_s": 4.0, "start_s": 12.0}
    world = make_world(obstacles=[leaves], tells_3d=True)
    world.drop = lambda message: message.get_type() == SECTORS
    world.take_off()
    world.order()
    assert "lidar is silent" in world.fly_until(LeaseState.ENDED).text
    words = "_3D alone is mute in free air: slows to a hover"
    assert sum(text.endswith(words) for text in world.texts) == 1, world.texts
