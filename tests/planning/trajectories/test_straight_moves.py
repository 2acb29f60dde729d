"""Straight moves against the closed forms of the rest-to-rest polynomial, in corridors without room for more."""

import numpy as np
import pytest

from gcs.planning.numerics.bernstein import derivative
from gcs.planning.trajectories.flight_limits import FlightLimits, peaks
from gcs.planning.trajectories.safe_corridor import LegCorridor
from gcs.planning.trajectories.straight_moves import PEAKS, SHARE, straight_moves, straight_times

LIMITS = FlightLimits(5.0, 2.5, None)
JOINTS = np.array([[0.0, 0, 5], [0.05, 0, 5], [4, 0, 5], [4, 3, 5], [4, 3.02, 5], [4, 9, 5], [1, 5, 6]])


def thin_corridor(joints):
    low, high = np.minimum(joints[:-1], joints[1:]), np.maximum(joints[:-1], joints[1:])
    return LegCorridor(joints, np.stack([low - 1e-6, high + 1e-6], axis=1))


def test_the_peaks_are_those_of_the_polynomial():
    u = np.linspace(0, 1, 200_001)
    np.testing.assert_allclose([np.abs(SHARE.deriv(k)(u)).max() for k in (1, 2, 3)], PEAKS, rtol=1e-9)
    assert [SHARE.deriv(k)(x) for k in (1, 2, 3) for x in (0.0, 1.0)] == pytest.approx([0] * 6, abs=1e-12)
    assert SHARE(1.0) == pytest.approx(1.0)


def test_the_curve_stays_on_its_straights_and_passes_the_joints():
    leg = thin_corridor(JOINTS)
    times = straight_times(leg, LIMITS)
    assert len(times) == 3
    control, durations = straight_moves(leg, times)
    assert (control >= leg.boxes_m[:, :1]).all()
    assert (control <= leg.boxes_m[:, 1:]).all()
    np.testing.assert_allclose(control[:, 0], JOINTS[:-1], atol=1e-9)
    np.testing.assert_allclose(control[:, -1], JOINTS[1:], atol=1e-9)
    assert durations.sum() == pytest.approx(times.sum())


def test_it_is_smooth_and_stands_still_at_corners():
    control, durations = straight_moves(thin_corridor(JOINTS), straight_times(thin_corridor(JOINTS), LIMITS))
    for order in (1, 2, 3):
        slopes = derivative(control, order) / durations[:, None, None] ** order
        np.testing.assert_allclose(slopes[:-1, -1], slopes[1:, 0], atol=1e-6)
        for corner in (2, 5):
            np.testing.assert_allclose(slopes[corner, 0], 0.0, atol=1e-9)


@pytest.mark.parametrize("limits", [LIMITS, FlightLimits(0.5, 2.5, None), FlightLimits(5.0, 2.5, 3.0)])
def test_the_limits_hold_and_one_of_them_is_reached(limits):
    leg = thin_corridor(JOINTS)
    speed, acceleration, jerk = peaks(*straight_moves(leg, straight_times(leg, limits)))
    use = [speed / limits.speed_m_s, acceleration / limits.acceleration_m_s2]
    use += [jerk / limits.jerk_m_s3] if limits.jerk_m_s3 else []
    assert 0.995 < max(use) < 1.0
