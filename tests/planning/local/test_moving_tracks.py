"""From scans to discs to tracks, against obstacles whose true motion is known."""

import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.local.moving_tracks import Tracker, TrackingOptions
from gcs.planning.local.scan_circles import scan_circles


@pytest.mark.parametrize("seed", range(5))
def test_a_vehicle_is_tracked_and_predicted_within_its_deviations(seed, sector_scan):
    rng = np.random.default_rng(seed)
    velocity = rng.uniform(1.0, 3.0) * np.array([math.cos(seed), math.sin(seed)])
    start = np.array([6.0, 4.0])
    tracker = Tracker()
    for k in range(30):
        time = 0.1 * k
        position = np.array([0.3 * time, 0.0])
        place = start + velocity * time
        scan = sector_scan(position, 0.1 * time, [(*place, 0.9), (-5.0, 5.0, 0.6)], rng)
        circles = scan_circles(scan, position, 0.1 * time)
        tracker.see(circles.discs, time, circles.covariances)
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


@pytest.mark.parametrize("seed", range(6))
def test_what_stands_is_not_taken_for_moving_by_a_vehicle_that_passes(seed, sector_scan):
    rng = np.random.default_rng(seed)
    circles = [(rng.uniform(5, 25), rng.uniform(-6, 6), rng.uniform(0.3, 1.5)) for _ in range(2)]
    tracker = Tracker()
    for k in range(80):
        time = 0.1 * k
        position = np.array([3.0 * time, 0.0])
        if any(np.hypot(position[0] - x, y) < r + 0.3 for x, y, r in circles):
            break
        found = scan_circles(sector_scan(position, 0.0, circles, rng), position, 0.0)
        tracker.see(found.discs, time, found.covariances)
        assert all(track.speed_m_s < 1.2 for track in tracker.moving())
