"""The trajectory of a small tour, looked at with dense samples."""

import numpy as np
import pytest

from gcs.core.progress import SilentProgress
from gcs.planning.trajectories.time_allocation import FlightLimits
from gcs.planning.trajectories.trajectory_builder import build_trajectory, estimated_leg_time_s
from gcs.planning.views.viewing_angles import YAW_RATE_RAD_S


def test_it_starts_and_ends_at_home_at_rest_and_straight_up(tower_flight, tower_scenario):
    curve = tower_flight.built.trajectory
    home = np.array(tower_scenario.home_m)
    for t in (0.0, curve.duration_s):
        np.testing.assert_allclose(curve.value(t), home, atol=1e-9)
        for order in (1, 2, 3):
            np.testing.assert_allclose(curve.value(t, order), 0.0, atol=1e-9)
    points = curve.value(np.linspace(0, curve.duration_s, 20_001))
    low = points[points[:, 2] < 7.0]
    assert len(low) > 500
    assert np.linalg.norm(low[:, :2] - home[:2], axis=1).max() < 0.15
    assert points[:, 2].min() >= -1e-9


def test_it_rests_at_every_viewpoint_through_its_exposure(tower_flight):
    built = tower_flight.built
    for viewpoint in tower_flight.viewpoints:
        around = viewpoint.time_s + np.linspace(-0.9, 0.19, 7)
        np.testing.assert_allclose(
            built.trajectory.value(around), np.broadcast_to(viewpoint.position_m, (7, 3)), atol=1e-9
        )
        np.testing.assert_allclose(built.yaw.rate(around), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.sin(built.yaw.value(around) - viewpoint.yaw_rad), 0.0, atol=1e-9)
        np.testing.assert_allclose(built.gimbal_pitch.value(around), viewpoint.gimbal_pitch_rad, atol=1e-9)


def test_every_segment_stays_in_its_box_and_limits_hold(tower_flight, tower_scenario):
    built = tower_flight.built
    curve, vehicle = built.trajectory, tower_scenario.vehicle
    t = np.linspace(0, curve.duration_s, 40_001)
    segment = np.clip(np.searchsorted(curve.starts_s, t, side="right") - 1, 0, len(curve.durations_s) - 1)
    points = curve.value(t)
    assert (points >= built.corridor_m[segment, 0] - 1e-9).all()
    assert (points <= built.corridor_m[segment, 1] + 1e-9).all()
    limits = (vehicle.max_speed_m_s, vehicle.max_acceleration_m_s2, vehicle.max_jerk_m_s3)
    for order, limit in enumerate(limits, start=1):
        assert np.linalg.norm(curve.value(t, order), axis=1).max() <= limit


def test_a_vehicle_that_may_not_tilt_much_or_climb_hard_is_planned_so(tower_scenario):
    vehicle = tower_scenario.vehicle.model_copy(update={"max_tilt_deg": 6.0, "max_thrust_ratio": 1.03})
    scenario = tower_scenario.model_copy(update={"vehicle": vehicle})
    home = np.array(tower_scenario.home_m)
    over_home, stop = home + np.array([0, 0, 8.0]), np.array([-10.0, 0, 20])
    legs = [np.array([home, over_home, stop]), np.array([stop, over_home, home])]
    curve = build_trajectory(legs, np.zeros(1), np.zeros(1), scenario, SilentProgress()).trajectory
    thrust = curve.value(np.linspace(0, curve.duration_s, 20_001), 2) + np.array([0, 0, 9.80665])
    size = np.linalg.norm(thrust, axis=1)
    tilt = np.degrees(np.arccos(thrust[:, 2] / size)).max()
    assert tilt <= 6.0
    assert size.max() <= 1.03 * 9.80665
    assert max(tilt / 6, (size.max() / 9.80665 - 1) / 0.03) > 0.95


def test_the_estimate_of_leg_times_is_a_close_lower_bound(tower_flight, tower_scenario):
    vehicle = tower_scenario.vehicle
    limits = FlightLimits(vehicle.max_speed_m_s, vehicle.max_acceleration_m_s2)
    length = np.linalg.norm(np.diff(tower_flight.path_m, axis=0), axis=1).sum()
    legs = np.array([np.linalg.norm(np.diff(leg, axis=0), axis=1).sum() for leg in tower_flight.legs])
    dwells = 4 * 1.2
    flown = tower_flight.built.trajectory.duration_s - dwells
    assert legs.sum() == pytest.approx(length)
    assert 0.6 * flown < estimated_leg_time_s(legs, limits).sum() < flown
    np.testing.assert_allclose(estimated_leg_time_s(np.array([2.5, 10.0, 25.0]), limits), [2.0, 4.0, 7.0])


def test_two_viewpoints_at_one_place_are_two_exposures_with_a_turn_between(tower_scenario):
    home = np.array(tower_scenario.home_m)
    over_home, stop = home + np.array([0, 0, 8.0]), np.array([-10.0, 0, 10])
    legs = [np.array([home, over_home, stop]), np.array([stop, stop]), np.array([stop, over_home, home])]
    built = build_trajectory(legs, np.array([0.0, 1.5]), np.zeros(2), tower_scenario, SilentProgress())
    np.testing.assert_allclose(built.trajectory.value(built.exposures_s), [stop, stop], atol=1e-9)
    np.testing.assert_allclose(built.yaw.value(built.exposures_s), [0.0, 1.5], atol=1e-9)
    assert np.diff(built.exposures_s)[0] > 1.5 * 1.5 / YAW_RATE_RAD_S
    assert len(built.corridor_m) == len(built.trajectory.durations_s)
    np.testing.assert_allclose(built.trajectory.value(built.trajectory.duration_s), home, atol=1e-9)
