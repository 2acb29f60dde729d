"""Rigid-body dynamics against closed forms."""

import numpy as np
import pytest

from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2, QuadrotorParameters, resting_state, rotation_of, simulate

NO_DRAG = QuadrotorParameters(drag_n_s_m=(0.0, 0.0, 0.0))


def test_free_fall_without_drag_is_a_parabola():
    start = resting_state([1.0, 2.0, 100.0])
    start[3:6] = [3.0, -1.0, 2.0]
    end = simulate(start, np.zeros(4), 2.0, parameters=NO_DRAG)
    assert end[:3] == pytest.approx([7.0, 0.0, 100.0 + 4.0 - 0.5 * GRAVITY_M_S2 * 4.0], abs=1e-9)
    assert end[3:6] == pytest.approx([3.0, -1.0, 2.0 - 2.0 * GRAVITY_M_S2], abs=1e-9)


def test_fall_with_drag_follows_the_exponential():
    parameters = QuadrotorParameters(drag_n_s_m=(0.0, 0.0, 0.9))
    end = simulate(resting_state([0.0, 0.0, 0.0]), np.zeros(4), 3.0, parameters=parameters)
    k = 0.9 / parameters.mass_kg
    assert end[5] == pytest.approx(-GRAVITY_M_S2 / k * (1.0 - np.exp(-3.0 * k)), rel=1e-8)


def test_wind_carries_a_drifting_vehicle_along():
    end = simulate(
        resting_state([0, 0, 0], motor_thrust_n=NO_DRAG.hover_thrust_n),
        np.full(4, NO_DRAG.hover_thrust_n),
        120.0,
        parameters=QuadrotorParameters(),
        wind_m_s=[4.0, -2.0, 0.0],
    )
    assert end[3:6] == pytest.approx([4.0, -2.0, 0.0], abs=1e-4)


def test_hover_thrust_is_an_equilibrium():
    hover = resting_state([0.0, 0.0, 10.0], yaw_rad=0.7, motor_thrust_n=NO_DRAG.hover_thrust_n)
    end = simulate(hover, np.full(4, NO_DRAG.hover_thrust_n), 30.0, parameters=QuadrotorParameters())
    assert end == pytest.approx(hover, abs=1e-9)


def test_torque_free_tumbling_keeps_angular_momentum_and_energy():
    parameters = QuadrotorParameters(inertia_kg_m2=(0.05, 0.08, 0.11), drag_n_s_m=(0.0, 0.0, 0.0))
    inertia = np.diag(parameters.inertia_kg_m2)
    start = resting_state([0.0, 0.0, 0.0])
    start[10:13] = [3.0, 0.4, -2.0]
    end = simulate(start, np.zeros(4), 5.0, parameters=parameters, dt_s=0.001)
    momentum = [rotation_of(s) @ inertia @ s[10:13] for s in (start, end)]
    energy = [s[10:13] @ inertia @ s[10:13] for s in (start, end)]
    assert momentum[1] == pytest.approx(momentum[0], abs=1e-8)
    assert energy[1] == pytest.approx(energy[0], rel=1e-9)
    assert np.linalg.norm(end[10:13] - start[10:13]) > 0.1  # it did tumble


def test_each_motor_turns_the_body_the_way_its_place_says():
    p = NO_DRAG
    lever = p.arm_m / np.sqrt(2.0)
    expected_signs = [(1, -1, -1), (1, 1, 1), (-1, 1, -1), (-1, -1, 1)]
    for motor, signs in enumerate(expected_signs):
        commands = np.zeros(4)
        commands[motor] = 2.0
        start = resting_state([0.0, 0.0, 0.0])
        start[13 + motor] = 2.0
        dt = 1e-3
        rates = simulate(start, commands, dt, parameters=p, dt_s=dt)[10:13]
        torque = np.array(signs) * 2.0 * np.array([lever, lever, p.torque_per_thrust_m])
        assert rates == pytest.approx(torque / np.array(p.inertia_kg_m2) * dt, rel=1e-3)


def test_motor_lag_and_saturation():
    p = NO_DRAG
    end = simulate(resting_state([0, 0, 0]), np.full(4, 1e6), p.motor_time_constant_s, parameters=p, dt_s=0.0005)
    assert end[13:17] == pytest.approx(np.full(4, p.max_motor_thrust_n * (1 - np.exp(-1.0))), rel=1e-6)


def test_batches_agree_with_single_vehicles():
    states = np.stack([resting_state([0, 0, 0]), resting_state([5, 5, 5], yaw_rad=1.0, motor_thrust_n=3.0)])
    commands = np.array([[1.0, 2.0, 3.0, 4.0], [8.0, 7.0, 8.0, 7.0]])
    together = simulate(states[:, None], commands[:, None], 0.3, parameters=NO_DRAG)
    assert together.shape == (2, 1, 17)
    for i in range(2):
        assert together[i, 0] == pytest.approx(simulate(states[i], commands[i], 0.3, parameters=NO_DRAG))


def test_a_step_that_is_too_long_is_refused():
    with pytest.raises(ValueError, match="dt_s"):
        simulate(resting_state([0, 0, 0]), np.zeros(4), 1.0, parameters=NO_DRAG, dt_s=0.1)
