"""The lidar's map: what beams fill, carve and forget, and scans that cannot be."""

import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.local.lidar_map import LidarMap
from gcs.planning.local.lidar_scan import LidarScan
from gcs.planning.local.tangent_path import shortest_path

BEAMS = 360
STEP = 2 * math.pi / BEAMS


def scan_of_circles(position, heading, circles, most_m=15.0):
    """Exact ranges to circles (x, y, radius) from a place."""
    bearings = heading + STEP * np.arange(BEAMS)
    rays = np.column_stack([np.cos(bearings), np.sin(bearings)])
    ranges = np.full(BEAMS, math.inf)
    for x, y, radius in circles:
        to = np.array([x, y]) - position
        along = rays @ to
        square = radius**2 - (to @ to - along**2)
        hit = (square > 0) & (along > 0)
        ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(square[hit]))
    return LidarScan(ranges, 0.0, STEP, most_m)


def blocked_cells(area):
    return area.points_m(np.argwhere(area.blocked) + 0.5)


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5])
def test_what_is_seen_is_on_the_map_where_it_is(heading):
    area = LidarMap(40.0, 0.2, 5.0)
    position = np.array([103.0, -47.0])
    circles = [(109.0, -47.0, 1.0), (101.0, -40.0, 2.0)]
    area.take(scan_of_circles(position, heading, circles), position, heading, 0.0)
    cells = blocked_cells(area.blocked_at(0.0))
    assert len(cells) > 20
    off = [min(abs(math.hypot(x - cx, y - cy) - r) for cx, cy, r in circles) for x, y in cells]
    assert max(off) < 0.2
    assert area.blocked_at(0.0).is_blocked((108.05, -47.0))


def test_what_has_gone_is_carved_away_and_what_is_hidden_fades():
    area = LidarMap(40.0, 0.2, 4.0)
    position = np.array([0.0, 0.0])
    for k in range(10):
        area.take(scan_of_circles(position, 0.0, [(6.0, 0.0, 1.0)]), position, 0.0, 0.1 * k)
    assert area.blocked_at(0.9).is_blocked((5.05, 0.0))
    for k in range(10, 25):  # it has left: beams pass where it was
        area.take(scan_of_circles(position, 0.0, [(0.0, 6.0, 1.0)]), position, 0.0, 0.1 * k)
    assert not area.blocked_at(2.4).is_blocked((5.05, 0.0))
    assert area.blocked_at(2.4).is_blocked((0.0, 5.05))
    assert area.blocked_at(4.0).is_blocked((0.0, 5.05))
    assert not area.blocked_at(30.0).blocked.any()


def test_one_scan_is_enough_to_block():
    area = LidarMap(40.0, 0.2, 4.0)
    for k in range(20):
        area.take(scan_of_circles(np.zeros(2), 0.0, [(0.0, 6.0, 1.0)]), (0.0, 0.0), 0.0, 0.1 * k)
    area.take(scan_of_circles(np.zeros(2), 0.0, [(3.0, 0.0, 0.5)]), (0.0, 0.0), 0.0, 2.0)
    assert area.blocked_at(2.0).grown(0.3).is_blocked((2.5, 0.0))


def test_the_map_goes_with_the_vehicle_and_keeps_what_it_saw():
    area = LidarMap(40.0, 0.2, 100.0)
    circle = (6.0, 5.0, 1.0)
    for x in np.arange(0.0, 12.0, 0.5):
        position = np.array([x, 0.0])
        area.take(scan_of_circles(position, 0.3, [circle]), position, 0.3, x)
    cells = blocked_cells(area.blocked_at(12.0))
    on = np.abs(np.hypot(cells[:, 0] - 6.0, cells[:, 1] - 5.0) - 1.0)
    assert len(cells) > 10
    assert on.max() < 0.2
    area.take(scan_of_circles(np.array([500.0, 0.0]), 0.0, []), (500.0, 0.0), 0.0, 20.0)
    assert not area.blocked_at(20.0).blocked.any()


def test_beams_that_were_not_measured_say_nothing():
    scan = scan_of_circles(np.zeros(2), 0.0, [(6.0, 0.0, 1.0), (0.0, 6.0, 1.0)])
    half = LidarScan(scan.ranges_m, 0.0, STEP, 15.0, known=np.arange(BEAMS) > BEAMS // 8)
    area = LidarMap(40.0, 0.2, 4.0)
    area.take(half, (0.0, 0.0), 0.0, 0.0)
    assert not area.blocked_at(0.0).is_blocked((5.05, 0.05))
    assert area.blocked_at(0.0).is_blocked((0.05, 5.05))


def test_something_that_touches_the_sensor_is_on_the_vehicle():
    ranges = np.full(BEAMS, math.inf)
    ranges[10] = 0.0
    area = LidarMap(40.0, 0.2, 4.0)
    area.take(LidarScan(ranges, 0.0, STEP, 15.0), (1.0, 1.0), 0.0, 0.0)
    with pytest.raises(InputError, match="an obstacle is on the vehicle"):
        shortest_path((1.0, 1.0), (5.0, 5.0), area=area.blocked_at(0.0).grown(0.5))


def test_what_is_tracked_as_moving_leaves_no_trail():
    with_trail, without = LidarMap(40.0, 0.2, 50.0), LidarMap(40.0, 0.2, 50.0)
    for k in range(20):
        place = (6.0, -6.0 + 0.6 * k, 0.5)
        standing = (-6.0, 0.0, 1.0)
        scan = scan_of_circles(np.zeros(2), 0.0, [place, standing])
        with_trail.take(scan, (0.0, 0.0), 0.0, 0.1 * k)
        without.take(scan, (0.0, 0.0), 0.0, 0.1 * k, moving=np.array([place]))
    cells = blocked_cells(without.blocked_at(2.0))
    assert (cells[:, 0] < 0).all()
    assert without.blocked_at(2.0).is_blocked((-5.05, 0.05))
    assert (blocked_cells(with_trail.blocked_at(2.0))[:, 0] > 0).any()


def test_a_way_is_found_round_what_was_seen():
    area = LidarMap(40.0, 0.2, 4.0)
    area.take(scan_of_circles(np.zeros(2), 0.0, [(6.0, 0.0, 1.5)]), (0.0, 0.0), 0.0, 0.0)
    path = shortest_path((0.0, 0.0), (12.0, 0.0), area=area.blocked_at(0.0).grown(1.0))
    assert np.hypot(path.points_m[:, 0] - 6.0, path.points_m[:, 1]).min() >= 2.0
    assert 12.0 < path.length_m < 13.5


@pytest.mark.parametrize(
    ("ranges", "first", "step", "field", "words"),
    [
        (np.zeros(36), 0.0, 0.1, "ranges_m", "every range is 0"),
        (np.array([1.0, math.nan, 2.0]), 0.0, 0.1, "ranges_m", "beam 1 says nan"),
        (np.array([1.0, 2.0, -1.0]), 0.0, 0.1, "ranges_m", "beam 2 says -1"),
        (np.ones(72), 0.0, 0.1, "step_rad", "no sector"),
        (np.ones(3), 0.0, 0.0, "step_rad", "no sector"),
        (np.ones(3), math.nan, 0.1, "first_rad", "not finite"),
        (np.ones(0), 0.0, 0.1, "ranges_m", "a row of ranges"),
    ],
)
def test_a_scan_that_cannot_be_is_one_clear_error(ranges, first, step, field, words):
    with pytest.raises(InputError, match=words) as error:
        LidarScan(ranges, first, step, 10.0)
    assert error.value.field == field


def test_a_blind_scan_a_bad_pose_and_an_old_scan_are_refused():
    with pytest.raises(InputError, match="blind"):
        LidarScan(np.ones(3), 0.0, 0.1, 10.0, known=np.zeros(3, dtype=np.bool_))
    area = LidarMap(10.0, 0.2, 4.0)
    scan = LidarScan(np.ones(3), 0.0, 0.1, 10.0)
    area.take(scan, (0.0, 0.0), 0.0, 5.0)
    with pytest.raises(InputError, match="older than the map"):
        area.take(scan, (0.0, 0.0), 0.0, 4.0)
    with pytest.raises(InputError, match="finite"):
        area.take(scan, (math.nan, 0.0), 0.0, 6.0)
    for bad in ((0.0, 0.1, 1.0), (10.0, math.inf, 1.0), (10.0, 0.1, -1.0), (1e5, 0.1, 1.0)):
        with pytest.raises(InputError):
            LidarMap(*bad)
