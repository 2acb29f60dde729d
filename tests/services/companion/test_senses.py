"""What is wrong with the lidar's messages is said once, and what lies on the vehicle is nothing to fly away from."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.mavlink.companion_lease import LeaseState
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.services.companion.senses import Senses
from sitl_mocks.dialect import mavlink

TRUCK = {"kind": "vehicle", "radius_m": 1.0, "height_m": 20.0, "path_m": [[6.0, 0.3]]}


def flying(make_world, **options):
    world = make_world(**options)
    world.take_off()
    assert world.order().state is LeaseState.LEADING
    return world


def spoiled(world, spoil, every=1):
    """Have some of the scans arrive otherwise than they were sent."""
    counted = [0]

    def change(message):
        if message.get_type() == "OBSTACLE_DISTANCE":
            counted[0] += 1
            assert message.distances  # its fields are unpacked now, and may be changed
            if counted[0] % every == 0:
                spoil(message)
        return False

    world.drop = change


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
    world = flying(make_world)
    spoiled(world, spoil, every=2)
    world.fly_until(LeaseState.FINISHED)
    assert sum(words in text for text in world.texts) == 1, world.texts


@pytest.mark.parametrize("range_cm", [0, 10, 30])
def test_what_is_on_the_vehicle_is_said_and_ends_the_lease_in_a_hold(make_world, range_cm):
    world = flying(make_world)

    def arm_in_the_way(message):
        message.distances = [*message.distances[:18], range_cm, *message.distances[19:]]

    spoiled(world, arm_in_the_way)
    before = world.station.poses.newest.position_m
    status = world.fly_until(LeaseState.ENDED, timeout_s=30.0)
    assert "on the vehicle or its lidar, 270 degrees left of the nose" in status.text
    assert sum("slows to a hover" in text for text in world.texts) == 1
    assert np.linalg.norm(world.station.poses.newest.position_m[:2] - before[:2]) < 12.0
    assert world.core._outbox.reports, "the viewpoints that were not reached are accounted for"


def test_sectors_and_points_together_make_no_flood(make_world):
    world = flying(make_world, obstacles=[TRUCK], tells_3d=True)
    world.fly_until(LeaseState.FINISHED)
    assert not any("lidar" in text for text in world.texts), world.texts


def test_points_outside_the_slab_are_a_sign_of_life():
    said, clock = [], [100.0]
    vehicle = SimpleNamespace(now_s=lambda: clock[0], poses=SimpleNamespace(attitude=lambda at_s: (0.0, 0.0, 0.0)))
    senses, packer, parser = Senses(1.0, said.append), FramePacker(1, 1), FrameParser()
    for k in range(30):
        clock[0] = 100.0 + 0.1 * k
        high = mavlink.MAVLink_obstacle_distance_3d_message(
            round(1e3 * clock[0]), 0, mavlink.MAV_FRAME_BODY_FRD, 65535, 5.0, 0.0, -6.0, 0.2, 30.0
        )
        for message in parser.feed(packer.pack(high)):
            assert senses.take(message, vehicle, 0.4) is None
    assert senses.lidar_age_s(clock[0]) == pytest.approx(0.0, abs=1e-3)
    assert senses.lidar_age_s(clock[0] + 5.0) == pytest.approx(5.0, abs=1e-3)
    assert said == []
