"""Predicted tracking errors against closed forms."""

import numpy as np
import pytest

from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
from gcs.planning.dynamics.geometric_controller import ControllerGains
from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2, QuadrotorParameters
from gcs.planning.dynamics.tracking_prediction import predict_tracking, usual_quadrotor
from gcs.planning.dynamics.wind_gusts import WindGusts

NO_DRAG = QuadrotorParameters(drag_n_s_m=(0.0, 0.0, 0.0))
GAINS = ControllerGains()


def leg(start, end, duration_s):
    """Rest to rest, 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7."""
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 0] = start
    coefficients[0, 4:] = np.array([35.0, -84.0, 70.0, -20.0])[:, None] * (np.asarray(end) - start)
    return PiecewisePolynomial(coefficients, np.array([duration_s]))


def still(seconds):
    return AngleProfile(np.array([0.0, seconds]), np.zeros(2))


def test_a_smooth_leg_without_drag_is_followed_to_centimetres():
    found = predict_tracking(leg((0, 0, 20.0), (20, 10, 30), 12.0), still(12.0), parameters=NO_DRAG)
    assert found.distance_m < 0.05
    assert found.deviation_m <= found.distance_m
    assert found.yaw_rad < 0.01
    assert found.saturated_share == 0.0
    hover = NO_DRAG.mass_kg * GRAVITY_M_S2 / 4
    assert found.thrust_n[0] < hover < found.thrust_n[1] < NO_DRAG.max_motor_thrust_n


def test_drag_holds_a_vehicle_back_by_drag_over_stiffness_along_the_way_and_not_aside():
    slow = leg((0, 0, 20.0), (80, 0, 20), 60.0)
    found = predict_tracking(slow, still(60.0), parameters=QuadrotorParameters())
    top = float(np.abs(slow.value(np.linspace(0, 60, 2001), 1)).max())
    parameters = QuadrotorParameters()
    expected = parameters.drag_n_s_m[0] * top / (parameters.mass_kg * GAINS.position_s2)
    assert found.axes_m[0] == pytest.approx(expected, rel=0.05)
    assert found.deviation_m < 0.1 * expected


def test_gusts_move_it_by_their_seed_and_strength():
    hover = leg((0, 0, 20.0), (0, 0, 20), 20.0)
    common = {"parameters": QuadrotorParameters(), "gusts": WindGusts(deviation_m_s=2.0)}
    one, again, other = (predict_tracking(hover, still(20.0), seed=seed, **common) for seed in (1, 1, 2))
    assert one == again != other
    strong = predict_tracking(
        hover, still(20.0), seed=1, parameters=QuadrotorParameters(), gusts=WindGusts((0, 0, 0), 4.0)
    )
    assert strong.distance_m == pytest.approx(2 * one.distance_m, rel=0.1)


def test_a_steady_wind_pushes_by_drag_over_stiffness():
    hover = leg((0, 0, 20.0), (0, 0, 20), 20.0)
    parameters = QuadrotorParameters()
    found = predict_tracking(hover, still(20.0), parameters=parameters, gusts=WindGusts((6.0, 0, 0), 0.0))
    expected = parameters.drag_n_s_m[0] * 6.0 / (parameters.mass_kg * GAINS.position_s2)
    assert found.axes_m[0] == pytest.approx(expected, rel=0.15)


def test_parts_of_a_long_flight_join_without_a_seam():
    """Longer than one part of the computation: the errors are those of the same leg flown alone."""
    long = predict_tracking(leg((0, 0, 20.0), (60, 0, 20), 100.0), still(100.0), parameters=NO_DRAG)
    assert long.distance_m < 0.01


def test_more_than_the_motors_can_give_is_seen():
    found = predict_tracking(leg((0, 0, 20.0), (0, 0, 120.0), 6.0), still(6.0), parameters=NO_DRAG)
    assert found.saturated_share > 0.05
    assert found.thrust_n[1] == pytest.approx(NO_DRAG.max_motor_thrust_n, rel=1e-3)


@pytest.mark.parametrize("mass", [0.5, 3.0, 12.0])
def test_the_usual_quadrotor_of_a_mass_flies(mass):
    parameters = usual_quadrotor(mass)
    assert 4 * parameters.max_motor_thrust_n / (mass * GRAVITY_M_S2) == pytest.approx(2.18, abs=0.01)
    found = predict_tracking(leg((0, 0, 20.0), (20, 10, 30), 12.0), still(12.0), parameters=parameters)
    assert found.distance_m < 0.3
