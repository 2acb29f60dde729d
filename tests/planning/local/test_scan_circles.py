"""Round objects in sectors of 5 degrees, against where they are."""

import math

import numpy as np
import pytest

from gcs.planning.local.lidar_scan import LidarScan
from gcs.planning.local.scan_circles import scan_circles


@pytest.mark.parametrize("radius", [0.3, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("away", [3.0, 6.0, 10.0, 15.0])
def test_circles_are_found_as_well_as_they_are_said_to_be(radius, away, sector_scan):
    rng = np.random.default_rng(round(100 * radius + away))
    surprises, errors = [], []
    for _ in range(40):
        turn, heading = rng.uniform(-math.pi, math.pi, 2)
        position = rng.uniform(-20, 20, 2)
        middle = position + away * np.array([math.cos(turn), math.sin(turn)])
        found = scan_circles(sector_scan(position, heading, [(*middle, radius)], rng), position, heading)
        off = found.discs[:, :2] - middle
        k = int(np.linalg.norm(off, axis=1).argmin())
        errors.append(float(np.linalg.norm(off[k])))
        surprises.append(float(off[k] @ np.linalg.solve(found.covariances[k], off[k])))
    assert np.mean(errors) < 0.05 + 0.03 * away  # a sector is 0.087 of the distance wide
    assert np.mean(surprises) < 4.0  # two degrees of freedom: 2 when the covariance is right


def test_the_beams_may_turn_the_other_way(sector_scan):
    position, heading = np.array([1.0, 2.0]), 0.4
    scan = sector_scan(position, heading, [(7.0, 3.0, 0.8), (-3.0, -4.0, 0.4)])
    turned = LidarScan(np.roll(scan.ranges_m[::-1], 1), 0.0, -scan.step_rad, scan.most_m)
    one, other = (scan_circles(each, position, heading) for each in (scan, turned))
    assert len(one.discs) == 2
    order = one.discs[:, 0].argsort(), other.discs[:, 0].argsort()
    assert np.allclose(one.discs[order[0]], other.discs[order[1]], atol=1e-9)


def test_walls_and_an_empty_scan_give_no_circles(sector_scan):
    wall = [(9.0, y, 0.3) for y in np.arange(-15, 15, 0.3)]
    assert not len(scan_circles(sector_scan(np.zeros(2), 0.0, wall), np.zeros(2), 0.0).discs)
    assert not len(scan_circles(sector_scan(np.zeros(2), 0.0, []), np.zeros(2), 0.0).discs)
    assert not len(scan_circles(sector_scan(np.zeros(2), 0.0, [(3.2, 0.0, 3.0)]), np.zeros(2), 0.0).discs)


def test_unknown_sectors_say_nothing(sector_scan):
    scan = sector_scan(np.zeros(2), 0.0, [(5.0, 0.0, 0.3)])
    known = np.ones(72, dtype=np.bool_)
    known[2:71] = False
    half = LidarScan(np.where(known, scan.ranges_m, math.nan), 0.0, scan.step_rad, scan.most_m, known)
    (disc,) = scan_circles(half, np.zeros(2), 0.0).discs
    assert np.hypot(disc[0] - disc[2], disc[1]) == pytest.approx(4.7, abs=0.1)  # it may be wider where it is not seen
