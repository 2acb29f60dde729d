"""Whole plans through viewpoints at the bare clearance: they certify, and they survive the loss of the stream."""

import numpy as np
import pytest

from gcs.core.inspection import NamedPoint
from gcs.core.progress import SilentProgress
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.planner import plan_rest, plan_tour
from gcs.planning.trajectories.safe_corridor import corridor_reach
from gcs.planning.trajectories.stream_loss import slow_for_stream_loss
from gcs.planning.views.viewpoint_pose import pose_towards

SIDES = {"east": (1, 0), "north": (0, 1), "west": (-1, 0), "south": (0, -1)}


@pytest.fixture(scope="module")
def scenario(tower_scenario):
    points = tuple(
        NamedPoint(name=name, position_m=(4.0 * x, 4.0 * y, 10.0), normal=(x, y, 0)) for name, (x, y) in SIDES.items()
    )
    return tower_scenario.model_copy(
        update={
            "inspection": tower_scenario.inspection.model_copy(update={"points": points}),
            "vehicle": tower_scenario.vehicle.model_copy(update={"max_jerk_m_s3": None}),
        }
    )


@pytest.fixture(scope="module")
def scene(scenario, tower):
    return prepare_scene(scenario, tower, SilentProgress())


@pytest.fixture(scope="module")
def poses(scene, scenario):
    """Two pictures of every side, 2 m apart, at the smallest distance there is."""
    assert scene.space.nearest_m == pytest.approx(scenario.centre_clearance_m + 0.05)
    places = []
    for name, (x, y) in SIDES.items():
        for k, along in enumerate((-1.0, 1.0)):
            target = np.array([4.0 * x - along * y, 4.0 * y + along * x, 9.0 + k])
            away = (scene.space.nearest_m + 1e-3) * np.array([x, y, 0.0])
            places.append(pose_towards(f"{name}{k}", target + away, -away, 0.001))
    return places


@pytest.fixture(scope="module")
def plan(scenario, tower, scene, poses):
    return plan_tour(scenario, tower, scene, poses, SilentProgress())


def to_the_tower(points):
    return np.linalg.norm(np.maximum(np.abs(points - [0, 0, 12]) - [4, 4, 12], 0), axis=-1)


def test_the_clearance_holds_to_the_millimetres_that_are_left(plan, scenario):
    times = np.append(np.arange(0.0, plan.trajectory.duration_s, 0.01), plan.trajectory.duration_s)
    hull = to_the_tower(plan.trajectory.value(times)).min() - scenario.vehicle.radius_m
    asked = scenario.safety.hull_clearance_m
    assert asked <= plan.certificates.min_clearance_m <= hull <= asked + 0.052
    assert plan.certificates.corridor_violation_m <= 1e-6
    assert plan.certificates.worst_viewpoint_miss_m < 1e-6


def test_every_box_of_the_corridor_is_clear(plan, scenario):
    low, high = plan.corridor_m[:, 0], plan.corridor_m[:, 1]
    gap = np.maximum(np.maximum(low - [4, 4, 24], [-4, -4, 0] - high), 0)
    assert np.linalg.norm(gap, axis=1).min() >= scenario.centre_clearance_m


def test_between_the_sides_the_corridor_is_as_wide_as_asked(plan, scenario):
    reach = corridor_reach(scenario.safety.corridor_half_width_m)
    line = np.concatenate(
        [a + np.linspace(0, 1, 50)[:, None] * (b - a) for a, b in zip(plan.path_m[:-1], plan.path_m[1:], strict=True)]
    )
    stops = np.array([v.position_m for v in plan.viewpoints])
    far = np.linalg.norm(line[:, None] - stops, axis=2).min(axis=1) > 2.0 + reach
    assert far.any()
    assert to_the_tower(line[far]).min() >= scenario.centre_clearance_m + reach


def test_tight_viewpoints_are_under_the_open_sky(plan):
    assert plan.certificates.open_sky == 1.0


def test_the_flight_takes_little_longer_than_from_further_away(plan, scenario, tower, scene, poses):
    reach = corridor_reach(scenario.safety.corridor_half_width_m)
    further = [pose_towards(p.name, p.position_m - (reach + 0.01) * p.direction, p.direction, p.gsd_m) for p in poses]
    wide = plan_tour(scenario, tower, scene, further, SilentProgress())
    assert scene.space.is_wide([v.position_m for v in wide.viewpoints]).all()
    assert plan.trajectory.duration_s < 1.15 * wide.trajectory.duration_s


def test_the_loss_of_the_stream_is_survived_and_costs_little(plan, scenario, scene):
    keep = scenario.vehicle.radius_m + scenario.safety.position_m + scenario.safety.model_m
    warp = slow_for_stream_loss(
        plan.trajectory,
        scene.distance,
        timeout_s=3.0,
        deceleration_m_s2=scenario.vehicle.max_acceleration_m_s2,
        acceleration_m_s2=scenario.vehicle.max_acceleration_m_s2,
        keep_m=keep,
        home_m=scenario.home_m,
    )
    assert warp.duration_s < 1.4 * plan.trajectory.duration_s
    # brute force: what is flown after a loss at any instant stays clear
    for t in np.arange(0.0, warp.duration_s, 0.1):
        at, velocity, _ = warp.setpoint(plan.trajectory, t)
        speed = np.linalg.norm(velocity)
        swept = 3.0 + speed / (2 * scenario.vehicle.max_acceleration_m_s2)
        assert to_the_tower(at + np.linspace(0, swept, 60)[:, None] * velocity).min() >= keep


def test_a_flight_is_resumed_from_a_tight_viewpoint(plan, scenario, tower, scene):
    start = plan.viewpoints[2].position_m
    rest = plan_rest(scenario, tower, scene, plan.viewpoints[3:], start, SilentProgress())
    np.testing.assert_allclose(rest.trajectory.value([0.0])[0], start, atol=1e-6)
    assert rest.certificates.min_clearance_m >= scenario.safety.hull_clearance_m - 1e-9
