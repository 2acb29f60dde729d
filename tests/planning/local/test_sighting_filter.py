"""The filter over sightings: as sure as it says, surer than one sighting, no surer than the observer's place."""

import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.local.cooperative_position import PositionFix, Sighting, sighted_position
from gcs.planning.local.sighting_filter import RESTART_S, SightingFilter

OBSERVER = np.array([2.0, -25.0, 9.0])
PLACE_M = 0.05
DEVIATIONS = (0.05, 0.006, 0.006)
ACCELERATION_M_S2, EVERY_S = 0.7, 0.1


def flown(rng, seconds):
    """A motion as the filter assumes it, and each moment's sighting of it from an observer that errs all the time."""
    error = rng.normal(0.0, PLACE_M, 3)
    observer = PositionFix(OBSERVER + error, PLACE_M**2 * np.eye(3))
    position, velocity = np.zeros(3), rng.normal(0.0, 1.0, 3)
    for step in range(round(seconds / EVERY_S)):
        away = position - OBSERVER
        level = math.hypot(away[0], away[1])
        exact = [np.linalg.norm(away), math.atan2(away[2], level), math.atan2(away[1], away[0])]
        sighting = Sighting(*(exact + rng.normal(0.0, DEVIATIONS)), *DEVIATIONS)
        yield step * EVERY_S, position.copy(), velocity.copy(), observer, sighted_position(observer, sighting)
        jolt = rng.normal(0.0, ACCELERATION_M_S2 / math.sqrt(EVERY_S), 3)
        position += velocity * EVERY_S + jolt * EVERY_S**2 / 2
        velocity += jolt * EVERY_S


def test_it_is_as_sure_as_it_says_and_surer_than_one_sighting():
    rng = np.random.default_rng(0)
    position_nees, velocity_nees, filtered, alone = [], [], [], []
    for _ in range(100):
        followed = SightingFilter(ACCELERATION_M_S2)
        moments = list(flown(rng, 2.0))
        for at_s, _, _, observer, fix in moments:
            followed.add(at_s, fix, observer)
        at_s, position, velocity, _, fix = moments[-1]
        motion = followed.motion(at_s)
        off, off_m_s = motion.position_m - position, motion.velocity_m_s - velocity
        position_nees.append(off @ np.linalg.solve(motion.position_covariance_m2, off))
        velocity_nees.append(off_m_s @ np.linalg.solve(motion.velocity_covariance_m2_s2, off_m_s))
        filtered.append(off @ off)
        alone.append((fix.position_m - position) @ (fix.position_m - position))
    # The mean of chi-squared numbers of 3 degrees of freedom: 3 with a deviation of sqrt(6 / 100).
    assert abs(np.mean(position_nees) - 3.0) < 4 * math.sqrt(6 / 100)
    assert abs(np.mean(velocity_nees) - 3.0) < 4 * math.sqrt(6 / 100)
    assert np.mean(filtered) < 0.7 * np.mean(alone)


def test_no_number_of_sightings_averages_the_observers_own_error_away():
    rng = np.random.default_rng(1)
    followed = SightingFilter(1e-3)
    for at_s, _, _, observer, fix in flown(rng, 60.0):
        followed.add(at_s, fix, observer)
    covariance = followed.motion(at_s).position_covariance_m2
    assert np.linalg.eigvalsh(covariance)[0] >= PLACE_M**2


def test_it_tells_the_motion_ahead_and_back():
    followed = SightingFilter()
    observer = PositionFix(OBSERVER, 1e-6 * np.eye(3))
    velocity = np.array([1.0, -0.5, 0.2])
    for step in range(40):
        followed.add(0.1 * step, PositionFix(0.1 * step * velocity, 1e-4 * np.eye(3)), observer)
    for at_s in (3.7, 3.9, 4.2):
        assert np.allclose(followed.motion(at_s).position_m, at_s * velocity, atol=1e-3)
    spread = [np.trace(followed.motion(at_s).position_covariance_m2) for at_s in (3.9, 4.2, 4.6)]
    assert spread == sorted(spread)
    assert np.allclose(followed.motion(3.9).velocity_m_s, velocity, atol=1e-2)


def test_it_begins_anew_after_a_gap():
    followed = SightingFilter()
    observer = PositionFix(OBSERVER, 1e-4 * np.eye(3))
    followed.add(0.0, PositionFix(np.zeros(3), 1e-2 * np.eye(3)), observer)
    followed.add(0.1 + RESTART_S, PositionFix(np.full(3, 9.0), 1e-2 * np.eye(3)), observer)
    assert np.allclose(followed.motion(0.1 + RESTART_S).position_m, 9.0)


def test_what_is_not_later_and_what_was_never_seen_is_refused():
    followed = SightingFilter()
    fix = PositionFix(np.zeros(3), np.eye(3))
    observer = PositionFix(OBSERVER, 1e-4 * np.eye(3))
    with pytest.raises(InputError):
        followed.motion(0.0)
    followed.add(1.0, fix, observer)
    with pytest.raises(InputError):
        followed.add(1.0, fix, observer)
