"""From scans to discs to tracks, against obstacles whose true motion is known."""

import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.local.lidar_scan import LidarScan
from gcs.planning.local.moving_tracks import Tracker, TrackingOptions
from gcs.planning.local.scan_clusters import scan_discs

BEAMS = 720
STEP = 2 * math.pi / BEAMS


def scan_of(position, heading, circles, rng=None, first=0.0, beams=BEAMS):
    bearings = heading + first + STEP * np.arange(beams)
    rays = np.column_stack([np.cos(bearings), np.sin(bearings)])
    ranges = np.full(beams, math.inf)
    for x, y, radius in circles:
        to = np.array([x, y]) - position
        along = rays @ to
        square = radius**2 - (to @ to - along**2)
        hit = (square > 0) & (along > 0)
        ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(square[hit]))
    if rng is not None:
        ranges = np.maximum(ranges + rng.normal(0.0, 0.02, beams), 0.0)
    return LidarScan(ranges, first, STEP, 30.0)


@pytest.mark.parametrize("heading", [0.0, 0.7, 3.0])
def test_round_objects_become_discs_at_their_places(heading):
    circles = [(8.0, 0.0, 0.8), (-3.0, 6.0, 0.5), (0.0, -9.0, 1.2)]
    position = np.array([0.5, 0.2])
    discs = scan_discs(scan_of(position, heading, circles), position, heading)
    assert len(discs) == 3  # also the one that lies across the first beam
    for x, y, radius in circles:
        k = np.hypot(discs[:, 0] - x, discs[:, 1] - y).argmin()
        assert np.hypot(discs[k, 0] - x, discs[k, 1] - y) < 0.05 * radius
        assert 0.95 * radius < discs[k, 2] < 1.1 * radius


def test_a_box_becomes_a_disc_over_its_sides_that_are_seen():
    corners = np.array([(6.0, -1.0), (8.0, -1.0), (8.0, 1.0), (6.0, 1.0)])
    edges = [corners[k] + np.linspace(0, 1, 60)[:, None] * (corners[k - 1] - corners[k]) for k in range(4)]
    outline = [(x, y, 0.02) for edge in edges for x, y in edge]
    position = np.array([0.0, -8.0])
    (disc,) = scan_discs(scan_of(position, 0.0, outline), position, 0.0)
    assert np.hypot(disc[0] - 7.0, disc[1]) < 0.2
    assert disc[2] == pytest.approx(math.sqrt(2), abs=0.15)


def test_walls_and_an_empty_scan_give_no_discs():
    wall = [(9.0, y, 0.3) for y in np.arange(-8, 8, 0.3)]
    assert len(scan_discs(scan_of(np.zeros(2), 0.0, wall), np.zeros(2), 0.0)) == 0
    assert scan_discs(scan_of(np.zeros(2), 0.0, []), np.zeros(2), 0.0).shape == (0, 3)


def test_the_ends_of_a_sector_are_not_neighbours():
    circles = [(5.0, 0.3, 0.3), (5.0 * math.cos(1.5), 5.0 * math.sin(1.5), 0.3)]
    sector = scan_of(np.zeros(2), 0.0, circles, beams=round(1.6 / STEP))
    assert len(scan_discs(sector, np.zeros(2), 0.0)) == 2


@pytest.mark.parametrize("seed", range(5))
def test_a_vehicle_is_tracked_and_predicted_within_its_deviations(seed):
    rng = np.random.default_rng(seed)
    velocity = rng.uniform(1.0, 3.0) * np.array([math.cos(seed), math.sin(seed)])
    start = np.array([6.0, 4.0])
    tracker = Tracker()
    for k in range(30):
        time = 0.1 * k
        position = np.array([0.3 * time, 0.0])
        place = start + velocity * time
        scan = scan_of(position, 0.1 * time, [(*place, 0.9), (-5.0, 5.0, 0.6)], rng)
        tracker.see(scan_discs(scan, position, 0.1 * time), time)
    (track,) = tracker.moving()
    assert len(tracker.confirmed()) == 2
    assert np.linalg.norm(track.state[2:] - velocity) < 0.5
    for ahead in (0.5, 1.5, 3.0):
        error = np.linalg.norm(track.positions([2.9 + ahead])[0] - (start + velocity * (2.9 + ahead)))
        assert error < 3 * track.deviations_m([2.9 + ahead])[0] + 0.3
    deviations = track.deviations_m(2.9 + np.arange(0.0, 5.0, 0.5))
    assert (np.diff(deviations) > 0).all()


def test_two_that_cross_keep_their_numbers():
    tracker = Tracker()
    numbers = set()
    for k in range(60):
        time = 0.1 * k
        discs = np.array([[-6 + 2 * time, 0.4, 0.4], [6 - 2 * time, -0.4, 0.4]])
        tracker.see(discs, time)
        for track in tracker.confirmed():
            numbers.add((track.number, bool(track.state[2] > 0)))
    assert len(numbers) == 2


def test_the_filters_errors_are_what_its_covariance_says():
    rng = np.random.default_rng(3)
    options = TrackingOptions(measurement_m=0.2, wander_m2_s3=0.5)
    surprises = []
    for _ in range(200):
        tracker = Tracker(options)
        place, velocity = rng.normal(0, 5, 2), rng.normal(0, 2, 2)
        root = np.linalg.cholesky(0.5 * np.array([[0.1**3 / 3, 0.1**2 / 2], [0.1**2 / 2, 0.1]]))
        for k in range(25):
            tracker.see(np.append(place + rng.normal(0, 0.2, 2), 0.5)[None], 0.1 * k)
            noise = root @ rng.normal(size=(2, 2))
            place, velocity = place + 0.1 * velocity + noise[0], velocity + noise[1]
        tracks = tracker.confirmed()
        if len(tracks) == 1:
            last = tracks[0].at(2.5)
            error = last.state - np.concatenate([place, velocity])
            surprises.append(error @ np.linalg.solve(last.covariance, error))
    assert len(surprises) > 180
    assert np.mean(surprises) == pytest.approx(4.0, rel=0.25)


def test_what_stands_does_not_move_and_what_is_gone_is_forgotten():
    rng = np.random.default_rng(0)
    tracker = Tracker()
    for k in range(40):
        tracker.see(np.array([[3.0, 1.0, 0.5]]) + np.append(rng.normal(0, 0.1, 2), 0.0), 0.1 * k)
    assert len(tracker.confirmed()) == 1
    assert tracker.moving() == []
    for k in range(40, 70):
        tracker.see(np.empty((0, 3)), 0.1 * k)
    assert tracker.confirmed() == []


def test_bad_discs_and_old_times_are_refused():
    tracker = Tracker()
    tracker.see(np.array([[1.0, 2.0, 0.5]]), 1.0)
    with pytest.raises(InputError, match="older"):
        tracker.see(np.empty((0, 3)), 0.5)
    for bad in (np.array([[1.0, math.nan, 0.5]]), np.array([1.0, 2.0, 0.5])):
        with pytest.raises(InputError, match="three finite numbers"):
            tracker.see(bad, 2.0)
