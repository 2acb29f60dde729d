"""The tracking controller: equilibria, convergence, closed-form errors."""

import numpy as np
import pytest

from gcs.planning.dynamics.geometric_controller import REFERENCE_SIZE, ControllerGains, track_reference
from gcs.planning.dynamics.quadrotor import QuadrotorParameters, resting_state, rotation_of

PARAMETERS = QuadrotorParameters()
NO_DRAG = QuadrotorParameters(drag_n_s_m=(0.0, 0.0, 0.0))
GAINS = ControllerGains()
DT = 0.004


def hold(position, yaw=0.0, seconds=8.0):
    reference = np.zeros((round(seconds / DT), REFERENCE_SIZE))
    reference[:, :3] = position
    reference[:, 12] = yaw
    return reference


def circle(radius, speed, seconds):
    t = np.arange(0.0, seconds, DT)
    w = speed / radius
    c, s = np.cos(w * t), np.sin(w * t)
    zero = np.zeros_like(t)
    reference = np.zeros((len(t), REFERENCE_SIZE))
    reference[:, 0:3] = np.stack([radius * c, radius * s, zero + 10.0], axis=1)
    reference[:, 3:6] = np.stack([-s, c, zero], axis=1) * speed
    reference[:, 6:9] = np.stack([-c, -s, zero], axis=1) * speed * w
    reference[:, 9:12] = np.stack([s, -c, zero], axis=1) * speed * w * w
    return reference


def test_hover_on_the_reference_does_nothing():
    flown = track_reference(hold([1.0, 2.0, 3.0], yaw=0.4), DT, parameters=PARAMETERS, gains=GAINS)
    assert np.abs(flown - flown[0]).max() < 1e-9


def test_converges_from_a_large_upset():
    start = resting_state([4.0, -3.0, 12.0], yaw_rad=2.5, motor_thrust_n=PARAMETERS.hover_thrust_n)
    tilt = 1.0
    start[6:10] = [np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0]
    start[3:6] = [-2.0, 3.0, -1.0]
    flown = track_reference(hold([0, 0, 10]), DT, parameters=PARAMETERS, gains=GAINS, start=start)
    end = flown[-1]
    assert end[:3] == pytest.approx([0.0, 0.0, 10.0], abs=0.02)
    assert np.linalg.norm(end[3:6]) < 0.02
    assert rotation_of(end) == pytest.approx(np.eye(3), abs=0.01)


def test_a_steady_wind_pushes_it_off_by_drag_over_stiffness():
    flown = track_reference(
        hold([0.0, 0.0, 10.0], seconds=20.0), DT, parameters=PARAMETERS, gains=GAINS, wind_m_s=[5.0, 0.0, 0.0]
    )
    expected = PARAMETERS.drag_n_s_m[0] * 5.0 / (PARAMETERS.mass_kg * GAINS.position_s2)
    assert flown[-1, 0] == pytest.approx(expected, rel=0.01)


def test_tracks_a_circle_with_feed_forward():
    reference = circle(20.0, 3.0, 30.0)
    start = resting_state(reference[0, :3], motor_thrust_n=NO_DRAG.hover_thrust_n)
    start[3:6] = reference[0, 3:6]
    flown = track_reference(reference, DT, parameters=NO_DRAG, gains=GAINS, start=start)
    error = np.linalg.norm(flown[:, :3] - reference[:, :3], axis=1)
    assert error[len(error) // 2 :].max() < 0.02


def test_without_acceleration_feed_forward_the_circle_is_flown_wide_as_the_gains_say():
    reference = circle(20.0, 3.0, 60.0)
    reference[:, 6:12] = 0.0
    start = resting_state(reference[0, :3], motor_thrust_n=NO_DRAG.hover_thrust_n)
    start[3:6] = reference[0, 3:6]
    flown = track_reference(reference, DT, parameters=NO_DRAG, gains=GAINS, start=start)
    # Steady state of e'' + k_v e' + k_p e = -r'' for a rotating r'': |e| = w^2 R / |k_p - w^2 + i k_v w|.
    w = 3.0 / 20.0
    expected = w * w * 20.0 / abs(GAINS.position_s2 - w * w + 1j * GAINS.velocity_s * w)
    error = np.linalg.norm(flown[-2000:, :2] - reference[-2000:, :2], axis=1)
    assert error == pytest.approx(np.full(2000, expected), rel=0.05)


def test_yaw_follows_without_moving_the_vehicle():
    reference = hold([0, 0, 10], seconds=6.0)
    t = np.arange(len(reference)) * DT
    reference[:, 12] = np.minimum(0.8 * t, 2.4)
    reference[:, 13] = np.where(t < 3.0, 0.8, 0.0)
    flown = track_reference(reference, DT, parameters=PARAMETERS, gains=GAINS)
    r = rotation_of(flown[-1])
    assert np.arctan2(r[1, 0], r[0, 0]) == pytest.approx(2.4, abs=0.01)
    assert np.abs(flown[:, :3] - [0, 0, 10]).max() < 0.01


def test_the_heading_holds_while_the_vehicle_leans_this_way_and_that():
    """Leaning about two axes turns the body about its thrust; without the rate for it the heading swings."""
    reference = circle(3.0, 3.0, 20.0)
    reference[:, 12] = 0.7
    start = resting_state(reference[0, :3], yaw_rad=0.7, motor_thrust_n=NO_DRAG.hover_thrust_n)
    start[3:6] = reference[0, 3:6]
    flown = track_reference(reference, DT, parameters=NO_DRAG, gains=GAINS, start=start)
    r = rotation_of(flown[len(flown) // 2 :])
    heading = np.arctan2(-r[:, 0, 1], r[:, 1, 1])  # the body's y axis is level and across to it
    assert np.abs(heading - 0.7).max() < 5e-4


def test_the_commanded_lean_is_limited():
    start = resting_state([0, 0, 10], motor_thrust_n=PARAMETERS.hover_thrust_n)
    gains = ControllerGains(max_tilt_rad=0.3)
    flown = track_reference(hold([500.0, 0, 10], seconds=3.0), DT, parameters=PARAMETERS, gains=gains, start=start)
    lean = np.arccos(np.clip(rotation_of(flown)[:, 2, 2], -1, 1))
    assert lean[-1] == pytest.approx(0.3, abs=0.02)
    assert lean.max() < 0.36


def test_batches_agree_with_single_flights():
    references = np.stack([circle(20.0, 3.0, 2.0), circle(10.0, 2.0, 2.0)])
    together = track_reference(references, DT, parameters=PARAMETERS, gains=GAINS)
    assert together.shape == (2, references.shape[1], 17)
    for i in range(2):
        assert together[i] == pytest.approx(track_reference(references[i], DT, parameters=PARAMETERS, gains=GAINS))
