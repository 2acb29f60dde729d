"""Dead reckoning against its closed form, and corrections against what a fix is worth."""

import math

import numpy as np
import pytest

from sitl_mocks.position_estimator import PositionEstimator

STEP_S = 0.1


def reckoned(seed, seconds, *, fixes_m=None):
    """An estimator after a time at rest; with fixes ten times a second when their deviation is given."""
    estimator = PositionEstimator(seed)
    rng = np.random.default_rng(1000 + seed)
    for _ in range(round(seconds / STEP_S)):
        estimator.advance(STEP_S, np.zeros(3), np.zeros(3))
        if fixes_m is not None:
            for axis in range(3):
                estimator.take(axis, 0, rng.normal(0.0, fixes_m), 0.0, fixes_m)
    return estimator


def test_dead_reckoning_drifts_as_noise_and_bias_of_the_accelerometer_make_it():
    seconds = 20.0
    level = np.array([reckoned(seed, seconds).error_m[:2] for seed in range(150)])
    noise, bias, walk = 0.03, 0.02, 0.001
    wanted = math.sqrt(noise**2 * seconds**3 / 3 + bias**2 * seconds**4 / 4 + walk**2 * seconds**5 / 20)
    assert math.sqrt((level**2).mean()) == pytest.approx(wanted, rel=0.15)


def test_the_barometer_holds_the_height():
    heights = [reckoned(seed, 60.0).error_m[2] for seed in range(20)]
    assert 0.01 < math.sqrt(np.mean(np.square(heights))) < 0.4


def test_fixes_bring_the_error_below_their_own():
    errors = [reckoned(seed, 10.0, fixes_m=0.3).error_m for seed in range(40)]
    assert math.sqrt(np.mean(np.square(errors))) < 0.2


def test_a_late_fix_is_held_against_where_it_was_then():
    estimator = PositionEstimator(0)
    for step in range(1, 11):
        estimator.advance(STEP_S, np.array([2.0 * step * STEP_S, 0.0, 0.0]), np.array([2.0, 0.0, 0.0]))
    estimator.take(0, 0, 2.0 * 0.7, 0.3, 1e-6)  # exact, and 0.3 s old
    assert estimator.error_m[0] == pytest.approx(0.0, abs=0.02)
    estimator.take(0, 0, 2.0 * 0.7, 0.3, 1e-6)  # what was believed of the past is right by now, too
    assert estimator.error_m[0] == pytest.approx(0.0, abs=0.02)
    estimator.take(0, 0, 2.0 * 0.7, 0.0, 1e-9)  # taken for new, it is wrong by the way since then
    assert estimator.error_m[0] < -0.1
