"""OBSTACLE_DISTANCE and OBSTACLE_DISTANCE_3D: units, directions, and content that cannot be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.obstacle_messages import obstacle_point, obstacle_sectors


def distances(values=None, **changes):
    told = [65535] * 72
    for index, value in (values or {}).items():
        told[index] = value
    fields = {
        "time_usec": 5_000_000,
        "sensor_type": 0,
        "distances": told,
        "increment": 5,
        "min_distance": 20,
        "max_distance": 3000,
        "increment_f": 5.0,
        "angle_offset": 0.0,
        "frame": mavlink.MAV_FRAME_BODY_FRD,
    }
    return mavlink.MAVLink_obstacle_distance_message(**(fields | changes))


def test_sectors_go_clockwise_on_the_wire_and_counter_clockwise_here():
    sectors = obstacle_sectors(distances({0: 1000, 18: 250, 36: 3001}))
    assert sectors.first_rad == 0.0
    assert sectors.first_rad + 18 * sectors.step_rad == pytest.approx(-math.pi / 2), "the nineteenth is on the right"
    assert sectors.ranges_m[[0, 18]] == pytest.approx([10.0, 2.5])
    assert sectors.ranges_m[36] == math.inf
    assert np.flatnonzero(sectors.known).tolist() == [0, 18, 36]
    assert (sectors.least_m, sectors.most_m) == (0.2, 30.0)
    assert (sectors.at_us, sectors.northward) == (5_000_000, False)


def test_offset_and_fine_increment():
    sectors = obstacle_sectors(distances({0: 500}, angle_offset=-90.0, increment=2, increment_f=2.5))
    assert sectors.first_rad == pytest.approx(math.pi / 2), "from the left"
    assert sectors.step_rad == pytest.approx(-math.radians(2.5))
    assert obstacle_sectors(distances({0: 500}, increment_f=0.0, increment=5)).step_rad == pytest.approx(
        -math.radians(5)
    )


def test_sectors_about_north():
    sectors = obstacle_sectors(distances({0: 500}, frame=mavlink.MAV_FRAME_GLOBAL))
    assert sectors.northward
    assert sectors.first_rad == pytest.approx(math.pi / 2), "north is a quarter turn from east"


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"increment_f": math.nan}, "increment"),
        ({"increment": 0, "increment_f": 0.0}, "increment"),
        ({"angle_offset": math.inf}, "increment"),
        ({"min_distance": 3000}, "max_distance"),
        ({"frame": 99}, "frame"),
    ],
)
def test_impossible_sectors_are_refused(changes, field):
    with pytest.raises(InputError) as refused:
        obstacle_sectors(distances({0: 500}, **changes))
    assert refused.value.field == field


def test_more_than_a_circle_is_refused():
    with pytest.raises(InputError, match="more than a circle"):
        obstacle_sectors(distances({71: 400}, increment_f=7.0))


def point(x=3.0, y=4.0, z=1.0, **changes):
    fields = {"frame": mavlink.MAV_FRAME_BODY_FRD, "min_distance": 0.2, "max_distance": 30.0} | changes
    return mavlink.MAVLink_obstacle_distance_3d_message(
        time_boot_ms=1500, sensor_type=0, obstacle_id=65535, x=x, y=y, z=z, **fields
    )


def test_a_point_is_forward_left_and_up():
    read = obstacle_point(point())
    assert read.offset_m == pytest.approx([3.0, -4.0, -1.0])
    assert (read.time_boot_s, read.least_m, read.most_m) == (1.5, 0.2, 30.0)


@pytest.mark.parametrize(
    "message",
    [
        point(x=math.nan),
        point(x=0.0, y=0.0, z=0.0),
        point(frame=0),
        point(max_distance=-1.0),
        point(min_distance=math.nan),
    ],
)
def test_impossible_points_are_refused(message):
    with pytest.raises(InputError):
        obstacle_point(message)
