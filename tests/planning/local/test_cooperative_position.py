"""Cooperative positioning against the Cramer-Rao bound, which is computed here from the likelihood alone."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.local.cooperative_position import PositionFix, Sighting, sighted_position

OBSERVER = np.array([3.0, -20.0, 25.0])
OBSERVER_COVARIANCE = np.diag([0.4, 0.5, 0.9]) ** 2


def measured(target, observer):
    """Range, pitch and azimuth of a true place from another."""
    away = target - observer
    return np.array(
        [np.linalg.norm(away), math.atan2(away[2], math.hypot(away[0], away[1])), math.atan2(away[1], away[0])]
    )


def cramer_rao(target, deviations):
    """Bound of the covariance of the target's place: both places are unknown, the observer's is measured by its fix."""
    places = np.concatenate([target, OBSERVER])

    def model(places):
        return np.concatenate([measured(places[:3], places[3:]), places[3:]])

    step = 1e-6
    slope = np.array([(model(places + e) - model(places - e)) / (2 * step) for e in step * np.eye(6)]).T
    noise = np.zeros((6, 6))
    noise[:3, :3], noise[3:, 3:] = np.diag(np.square(deviations)), OBSERVER_COVARIANCE
    return np.linalg.inv(slope.T @ np.linalg.inv(noise) @ slope)[:3, :3]


@pytest.mark.parametrize(
    ("target", "deviations"),
    [
        ((10.0, 0.0, 8.0), (0.05, 0.01, 0.01)),
        ((40.0, 30.0, 5.0), (0.3, 0.02, 0.03)),
        ((-60.0, -5.0, 24.0), (0.1, 0.05, 0.08)),
        ((3.5, -19.0, 2.0), (0.05, 0.02, 0.05)),
    ],
    ids=["usual", "far", "coarse angles", "nearly straight below"],
)
def test_the_error_is_near_the_cramer_rao_bound_and_the_covariance_is_right(target, deviations):
    rng = np.random.default_rng(0)
    target = np.array(target)
    bound = cramer_rao(target, deviations)
    errors, surprises = [], []
    for _ in range(3000):
        observer = rng.multivariate_normal(OBSERVER, OBSERVER_COVARIANCE)
        distance, pitch, azimuth = measured(target, OBSERVER) + rng.normal(0.0, deviations)
        fix = sighted_position(
            PositionFix(observer, OBSERVER_COVARIANCE), Sighting(distance, pitch, azimuth, *deviations)
        )
        errors.append(fix.position_m - target)
        surprises.append(errors[-1] @ np.linalg.solve(fix.covariance_m2, errors[-1]))
    errors = np.array(errors)
    rms = math.sqrt((errors**2).sum(axis=1).mean())
    assert rms <= 2 * math.sqrt(np.trace(bound))
    assert rms == pytest.approx(math.sqrt(np.trace(bound)), rel=0.1)
    assert np.mean(surprises) == pytest.approx(3.0, rel=0.1)  # chi-squared with three degrees of freedom
    spread = np.sqrt(np.diag(bound) / len(errors))
    assert (np.abs(errors.mean(axis=0)) < 4 * spread).all()


def test_the_papers_equations_hold_when_the_angles_are_sure():
    fix = sighted_position(PositionFix(OBSERVER, OBSERVER_COVARIANCE), Sighting(20.0, 0.3, -2.0, 0.1, 1e-9, 1e-9))
    wanted = 20 * np.array([math.cos(0.3) * math.cos(-2.0), math.cos(0.3) * math.sin(-2.0), math.sin(0.3)])
    assert np.allclose(fix.position_m - OBSERVER, wanted)


GOOD = Sighting(20.0, 0.3, 1.0, 0.1, 0.01, 0.01)


@pytest.mark.parametrize(
    ("field", "bad"),
    [
        ("range_m", 0.0),
        ("range_m", math.nan),
        ("range_m", math.inf),
        ("pitch_rad", 3.0),
        ("azimuth_rad", math.nan),
        ("range_deviation_m", 0.0),
        ("pitch_deviation_rad", -0.1),
        ("azimuth_deviation_rad", 1.0),
    ],
)
def test_a_sighting_that_cannot_be_is_refused(field, bad):
    with pytest.raises(InputError) as error:
        replace(GOOD, **{field: bad})
    assert error.value.field == field


@pytest.mark.parametrize(
    ("position", "covariance"),
    [
        (np.zeros(2), np.eye(3)),
        (np.array([0.0, math.nan, 0.0]), np.eye(3)),
        (np.zeros(3), np.zeros((3, 3))),
        (np.zeros(3), np.diag([1.0, 1.0, -1.0])),
        (np.zeros(3), np.array([[1.0, 0.5, 0], [0, 1.0, 0], [0, 0, 1.0]])),
    ],
)
def test_a_fix_that_cannot_be_is_refused(position, covariance):
    with pytest.raises(InputError):
        PositionFix(position, covariance)
