"""Certificates against dense samples and brute force, and faults that each of them must find."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.plan import Plan
from gcs.core.progress import SilentProgress
from gcs.core.scenario import Fence
from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
from gcs.planning.certificates import CertificateError, certify, check_figures, recheck
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.curve_figures import measure

CARRIED = {"coverage": None, "tour_cost": 1.0, "tour_lower_bound": 0.9, "energy_wh": 5.0, "open_sky": 1.0}


@pytest.fixture(scope="module")
def figures(tower_flight, tower_scenario, tower_distance):
    f = tower_flight
    return measure(f.built, f.path_m, f.viewpoints, tower_scenario, tower_distance, SilentProgress())


def failed(flight, scenario, distance, **changes):
    built = replace(flight.built, **{k: v for k, v in changes.items() if k != "viewpoints"})
    viewpoints = changes.get("viewpoints", flight.viewpoints)
    found = measure(built, flight.path_m, viewpoints, scenario, distance, SilentProgress())
    return {check.name for check in check_figures(found, scenario) if not check.ok}


def test_every_figure_is_what_dense_samples_show(figures, tower_flight, tower_scenario):
    """With the formulas of an outside check: 50 Hz samples, plain distances to a box and to every leg."""
    curve = tower_flight.built.trajectory
    t = np.append(np.arange(0, curve.duration_s, 0.02), curve.duration_s)
    p = curve.value(t)
    box = np.linalg.norm(np.maximum(np.abs(p - [0, 0, 12]) - [4, 4, 12], 0), axis=1)
    away = np.linalg.norm(p[:, :2] - np.array(tower_scenario.home_m)[:2], axis=1) > 0.5
    nearest = min(box.min(), p[away, 2].min()) - tower_scenario.vehicle.radius_m
    assert nearest - 0.006 <= figures.min_clearance_m <= nearest + 1e-9
    path = tower_flight.path_m
    deviation = np.full(len(p), np.inf)
    for a, b in itertools.pairwise(path):
        u = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        deviation = np.minimum(deviation, np.linalg.norm(p - a - u[:, None] * (b - a), axis=1))
    step = np.linalg.norm(np.diff(p, axis=0), axis=1)
    assert figures.mean_deviation_m == pytest.approx((deviation[1:] * step).sum() / step.sum(), abs=1e-3)
    assert figures.max_deviation_m == pytest.approx(deviation.max(), abs=1e-9)
    assert deviation.max() <= figures.deviation_bound_m <= deviation.max() + 0.05
    assert figures.length_m == pytest.approx(step.sum(), rel=1e-4)
    assert figures.path_length_m == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    for order, value in enumerate((figures.max_speed_m_s, figures.max_acceleration_m_s2, figures.max_jerk_m_s3), 1):
        sampled = np.linalg.norm(curve.value(t, order), axis=1).max()
        assert sampled <= value <= sampled * 1.01
    assert figures.worst_viewpoint_miss_m < 1e-9
    assert figures.corridor_violation_m < 1e-9
    assert figures.fence_room_m == pytest.approx(40 - 1.3 - 20.0, abs=0.2)


def test_a_good_flight_is_certified(tower_flight, tower_scenario, tower_distance, figures):
    f = tower_flight
    found = certify(f.built, f.path_m, f.viewpoints, tower_scenario, tower_distance, SilentProgress(), **CARRIED)
    assert found.min_clearance_m == figures.min_clearance_m >= tower_scenario.safety.hull_clearance_m
    assert found.viewpoints == 4
    assert found.tour_metric == "time"


def test_the_ground_counts_outside_the_column_over_home_only(tower_flight, tower_scenario, tower_distance):
    moved = tower_scenario.model_copy(update={"home_m": (-21.0, -20.0, 0.0)})
    f = tower_flight
    assert measure(
        f.built, f.path_m, f.viewpoints, moved, tower_distance, SilentProgress()
    ).min_clearance_m == pytest.approx(-tower_scenario.vehicle.radius_m, abs=0.006)


def test_too_fast_is_found(tower_flight, tower_scenario, tower_distance):
    curve = tower_flight.built.trajectory
    quick = PiecewisePolynomial(curve.coefficients, curve.durations_s * 0.9)
    assert "max_acceleration_m_s2" in failed(tower_flight, tower_scenario, tower_distance, trajectory=quick)
    slow = tower_scenario.model_copy(
        update={"vehicle": tower_scenario.vehicle.model_copy(update={"max_speed_m_s": 2.0, "max_jerk_m_s3": 0.5})}
    )
    assert failed(tower_flight, slow, tower_distance) == {"max_speed_m_s", "max_jerk_m_s3"}


def test_too_much_tilt_and_thrust_are_found(tower_flight, tower_scenario, tower_distance):
    weak = tower_scenario.vehicle.model_copy(update={"max_tilt_deg": 3.0, "max_thrust_ratio": 1.001})
    found = failed(tower_flight, tower_scenario.model_copy(update={"vehicle": weak}), tower_distance)
    assert found == {"max_tilt", "max_thrust_ratio"}
    able = tower_scenario.vehicle.model_copy(update={"max_tilt_deg": 40.0, "max_thrust_ratio": 1.5})
    assert not failed(tower_flight, tower_scenario.model_copy(update={"vehicle": able}), tower_distance)


def test_a_structure_that_is_too_near_is_found(tower_flight, tower_scenario, tower):
    near = replace(tower, vertices_m=tower.vertices_m + np.array([4.5, 0, 0]))
    assert failed(tower_flight, tower_scenario, SceneDistance(near, 0.0)) == {"min_clearance_m"}


def test_a_missed_viewpoint_is_found(tower_flight, tower_scenario, tower_distance):
    moved = [
        replace(v, position_m=v.position_m + np.array([0, 0, 0.06 * (v.id == 2)])) for v in tower_flight.viewpoints
    ]
    assert failed(tower_flight, tower_scenario, tower_distance, viewpoints=moved) == {"worst_viewpoint_miss_m"}


def test_an_exposure_while_flying_and_one_out_of_order_are_found(tower_flight, tower_scenario, tower_distance):
    late = [replace(v, time_s=v.time_s + 2.0) for v in tower_flight.viewpoints]
    assert {"worst_viewpoint_miss_m", "rest_speed", "rest_acceleration"} <= failed(
        tower_flight, tower_scenario, tower_distance, viewpoints=late
    )
    swapped = [tower_flight.viewpoints[i] for i in (0, 2, 1, 3)]
    assert failed(tower_flight, tower_scenario, tower_distance, viewpoints=swapped) == {"visiting_order"}


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_a_jump_of_any_derivative_is_found(tower_flight, tower_scenario, tower_distance, order):
    curve = tower_flight.built.trajectory
    coefficients = curve.coefficients.copy()
    coefficients[5, order, 0] += 1e-3
    broken = PiecewisePolynomial(coefficients, curve.durations_s)
    assert "continuity" in failed(tower_flight, tower_scenario, tower_distance, trajectory=broken)


def test_leaving_the_corridor_is_found(tower_flight, tower_scenario, tower_distance):
    boxes = tower_flight.built.corridor_m.copy()
    boxes[7, 1, 2] = boxes[7, 0, 2]
    assert failed(tower_flight, tower_scenario, tower_distance, corridor_m=boxes) == {"corridor_violation_m"}


def test_flying_far_from_the_path_is_found(tower_flight, tower_scenario, tower_distance):
    elsewhere = SimpleNamespace(**{**vars(tower_flight), "path_m": tower_flight.path_m[:-3]})
    assert failed(elsewhere, tower_scenario, tower_distance) == {"deviation"}


def test_wrong_or_hasty_angles_are_found(tower_flight, tower_scenario, tower_distance):
    yaw = tower_flight.built.yaw
    off = AngleProfile(yaw.times_s, yaw.angles_rad + 0.05)
    assert failed(tower_flight, tower_scenario, tower_distance, yaw=off) == {"viewing_angles"}
    knots = np.array([0.0, 0.1, tower_flight.built.trajectory.duration_s])
    jerked = AngleProfile(knots, np.array([-1.0, 0.0, 0.0]))
    assert {"gimbal_rate", "viewing_angles"} == failed(
        tower_flight, tower_scenario, tower_distance, gimbal_pitch=jerked
    )
    assert "yaw_rate" in failed(tower_flight, tower_scenario, tower_distance, yaw=jerked)


def test_leaving_the_fence_is_found(tower_flight, tower_scenario, tower_distance):
    low = tower_scenario.model_copy(update={"fence": Fence(max_height_m=18.5)})
    assert failed(tower_flight, low, tower_distance) == {"fence"}


def test_the_error_lists_all_that_failed_with_numbers(tower_flight, tower_scenario, tower):
    f = tower_flight
    near = SceneDistance(replace(tower, vertices_m=tower.vertices_m + np.array([4.5, 0, 0])), 0.0)
    moved = [replace(v, position_m=v.position_m + np.array([0, 0, 0.1])) for v in f.viewpoints]
    with pytest.raises(CertificateError) as error:
        certify(f.built, f.path_m, moved, tower_scenario, near, SilentProgress(), **CARRIED)
    message = str(error.value)
    assert "min_clearance_m" in message
    assert "asked 1.9" in message
    assert "worst_viewpoint_miss_m" in message
    assert "0.1 m, limit 0.05" in message
    assert error.value.exit_status == 3


@pytest.fixture(scope="module")
def plan(tower_flight, tower_scenario, tower_distance):
    f = tower_flight
    found = certify(f.built, f.path_m, f.viewpoints, tower_scenario, tower_distance, SilentProgress(), **CARRIED)
    return Plan(
        scenario=tower_scenario,
        cables=(),
        viewpoints=tuple(f.viewpoints),
        path_m=f.path_m,
        path_stops=f.path_stops,
        corridor_m=f.built.corridor_m,
        trajectory=f.built.trajectory,
        yaw=f.built.yaw,
        gimbal_pitch=f.built.gimbal_pitch,
        coverage=None,
        certificates=found,
        stages_s={},
    )


def test_a_plan_that_is_read_again_holds(plan, tower_distance):
    assert [check for check in recheck(plan, tower_distance) if not check.ok] == []


def test_recheck_finds_flattering_figures_another_home_and_other_stops(plan, tower_distance):
    def bad(changed):
        return {check.name for check in recheck(changed, tower_distance) if not check.ok}

    flattered = replace(plan.certificates, min_clearance_m=plan.certificates.min_clearance_m + 0.5, length_m=1.0)
    assert bad(replace(plan, certificates=flattered)) == {"recorded min_clearance_m", "recorded length_m"}
    elsewhere = plan.scenario.model_copy(update={"home_m": (-20.0, -20.3, 0.0)})
    assert bad(replace(plan, scenario=elsewhere)) == {"home", "path_stops"}
    assert bad(replace(plan, path_stops=np.array([0, 2, 4, 6, 9, 11]))) == {"path_stops"}
