"""The planner as a whole: what it returns is proved here again by plain means, and it stops when it is told to."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError, OperationCancelled
from gcs.core.inspection import NamedPoint, SurfaceTask
from gcs.core.progress import SilentProgress
from gcs.core.scenario import Battery, Fence
from gcs.core.structure import Structure
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.planner import BACK_BENDS_M, MOST_DRIFT_M, make_plan, plan_rest

SIDES = {"east": (1, 0), "north": (0, 1), "west": (-1, 0), "south": (0, -1)}
POINTS = tuple(
    NamedPoint(name=name, position_m=(4.0 * x, 4.0 * y, 10.0 + 2 * k), normal=(x, y, 0))
    for k, (name, (x, y)) in enumerate(SIDES.items())
)


class Told:
    """Remembers the stages; stops the work at one of them."""

    def __init__(self, stop_at=None):
        self.stages = []
        self.stop_at = stop_at

    def report(self, stage, fraction):
        assert -1e-9 <= fraction <= 1 + 1e-9
        if stage not in self.stages:
            self.stages.append(stage)
        if stage == self.stop_at:
            raise OperationCancelled("stop")


@pytest.fixture(scope="module")
def scenario(tower_scenario):
    surface = SurfaceTask(gsd_mm=5.0, overlap=0.0)
    return tower_scenario.model_copy(
        update={
            "inspection": tower_scenario.inspection.model_copy(update={"points": POINTS, "surface": surface}),
            "vehicle": tower_scenario.vehicle.model_copy(update={"max_jerk_m_s3": None}),
            "fence": Fence(include=(((-30, -30), (16, -30), (16, 30), (-30, 30)),), max_height_m=34.0),
        }
    )


@pytest.fixture(scope="module")
def planned(scenario, tower):
    told = Told()
    return make_plan(scenario, tower, told), told.stages


@pytest.fixture(scope="module")
def scene(scenario, tower):
    return prepare_scene(scenario, tower, SilentProgress())


def to_the_tower(points):
    """Distance from the box of 8 m x 8 m x 24 m on the ground."""
    return np.linalg.norm(np.maximum(np.abs(points - [0, 0, 12]) - [4, 4, 12], 0), axis=-1)


def sampled(plan):
    times = np.append(np.arange(0.0, plan.trajectory.duration_s, 0.01), plan.trajectory.duration_s)
    return times, plan.trajectory.value(times)


def keeps_clear(plan, scenario):
    _, positions = sampled(plan)
    asked = scenario.vehicle.radius_m + scenario.safety.hull_clearance_m
    assert to_the_tower(positions).min() >= asked
    away = np.linalg.norm(positions[:, :2] - np.array(scenario.home_m)[:2], axis=1) > 0.5
    assert positions[away, 2].min() >= asked
    slack = scenario.vehicle.radius_m
    assert (positions[:, :2] >= -30 + slack).all()
    assert positions[:, 0].max() <= 16 - slack
    assert positions[:, 1].max() <= 30 - slack
    assert positions[:, 2].max() <= 34 - slack


def test_the_curve_keeps_clear_and_inside_the_fence(planned, scenario):
    plan, _ = planned
    keeps_clear(plan, scenario)
    hull = to_the_tower(sampled(plan)[1]).min() - scenario.vehicle.radius_m
    assert plan.certificates.min_clearance_m <= hull + 1e-9


def test_it_starts_and_ends_at_rest_at_home_and_is_no_quicker_than_allowed(planned, scenario):
    plan, _ = planned
    times, _ = sampled(plan)
    ends = [0.0, plan.trajectory.duration_s]
    np.testing.assert_allclose(plan.trajectory.value(ends), [scenario.home_m] * 2, atol=1e-6)
    np.testing.assert_allclose(plan.trajectory.value(ends, 1), 0.0, atol=1e-6)
    assert np.linalg.norm(plan.trajectory.value(times, 1), axis=1).max() <= scenario.vehicle.max_speed_m_s * (1 + 1e-6)
    fastest = np.linalg.norm(plan.trajectory.value(times, 2), axis=1).max()
    assert fastest <= scenario.vehicle.max_acceleration_m_s2 * (1 + 1e-6)


def test_every_point_is_looked_at_from_its_side_at_standstill(planned):
    plan, _ = planned
    for point in POINTS:
        (view,) = [v for v in plan.viewpoints if v.name == point.name]
        place = plan.trajectory.value([view.time_s])[0]
        np.testing.assert_allclose(place, view.position_m, atol=1e-6)
        assert np.linalg.norm(plan.trajectory.value([view.time_s], 1)) < 1e-6
        towards = np.array(point.position_m) - place
        assert towards @ np.array(point.normal) < 0
        np.testing.assert_allclose(view.direction, towards / np.linalg.norm(towards), atol=1e-6)


def test_the_surface_is_seen(planned):
    plan, _ = planned
    assert plan.certificates.coverage > 0.95
    assert plan.certificates.viewpoints == len(plan.viewpoints) > len(POINTS)


def test_viewpoints_are_numbered_and_timed_in_visiting_order(planned):
    plan, _ = planned
    assert [v.id for v in plan.viewpoints] == list(range(len(plan.viewpoints)))
    times = [v.time_s for v in plan.viewpoints]
    assert times == sorted(times)
    stops = plan.path_m[plan.path_stops][1:-1]
    np.testing.assert_allclose(stops, [v.position_m for v in plan.viewpoints], atol=1e-9)
    assert plan.certificates.tour_lower_bound <= plan.certificates.tour_cost * (1 + 1e-9)


def test_the_seconds_of_every_stage_are_told(planned):
    plan, stages = planned
    assert list(plan.stages_s) == ["scene", "viewpoints", "tour", "trajectory", "coverage", "certificates", "bound"]
    assert all(seconds >= 0 for seconds in plan.stages_s.values())
    assert set(stages) >= {"distance_field", "free_space", "viewpoints", "tour", "trajectory", "coverage"}


def test_the_same_seed_gives_the_same_plan(planned, scenario, tower):
    again = make_plan(scenario, tower, SilentProgress())
    np.testing.assert_array_equal(again.trajectory.coefficients, planned[0].trajectory.coefficients)


def test_it_can_be_stopped_in_every_stage(planned, scenario, tower):
    _, stages = planned
    for stage in stages:
        told = Told(stop_at=stage)
        with pytest.raises(OperationCancelled):
            make_plan(scenario, tower, told)
        assert told.stages[-1] == stage


def test_a_battery_that_is_too_small_is_refused(scenario, tower):
    small = scenario.vehicle.model_copy(update={"battery": Battery(capacity_wh=1.0)})
    with pytest.raises(InfeasibleError, match=r"viewpoint \w+: .* takes \d.*larger battery"):
        make_plan(scenario.model_copy(update={"vehicle": small}), tower, SilentProgress())


def test_slow_vehicles_are_planned_with_as_few_pieces(planned, scenario, tower):
    slow = scenario.vehicle.model_copy(update={"max_speed_m_s": 0.3})
    plan = make_plan(scenario.model_copy(update={"vehicle": slow}), tower, SilentProgress())
    assert plan.certificates.max_speed_m_s <= 0.3 * (1 + 1e-6)
    assert len(plan.trajectory.durations_s) < 8 * len(planned[0].trajectory.durations_s)


# ---- the rest of a tour ----


def test_the_rest_of_a_tour_from_a_hover(planned, scenario, tower, scene):
    plan, _ = planned
    remaining = plan.viewpoints[3:]
    start = plan.trajectory.value([(plan.viewpoints[2].time_s + plan.viewpoints[3].time_s) / 2])[0]
    rest = plan_rest(scenario, tower, scene, remaining, start, SilentProgress())
    np.testing.assert_allclose(rest.trajectory.value([0.0])[0], start, atol=1e-6)
    np.testing.assert_allclose(rest.trajectory.value([rest.trajectory.duration_s])[0], scenario.home_m, atol=1e-6)
    assert [(v.id, v.name) for v in rest.viewpoints] == [(v.id, v.name) for v in remaining]
    for view in rest.viewpoints:
        np.testing.assert_allclose(rest.trajectory.value([view.time_s])[0], view.position_m, atol=1e-6)
    keeps_clear(rest, scenario)


def test_nothing_remains_but_the_way_home(planned, scenario, tower, scene):
    plan, _ = planned
    start = plan.viewpoints[-1].position_m
    rest = plan_rest(scenario, tower, scene, (), start, SilentProgress())
    assert rest.viewpoints == ()
    np.testing.assert_allclose(rest.trajectory.value([rest.trajectory.duration_s])[0], scenario.home_m, atol=1e-6)
    keeps_clear(rest, scenario)


def test_a_vehicle_that_has_drifted_a_little_goes_back_first(planned, scenario, tower, scene):
    """It hovers a little nearer than the searched space goes, but still clear of the tower."""
    plan, _ = planned
    asked = scenario.vehicle.radius_m + scenario.safety.hull_clearance_m
    start = np.array([-(4.0 + asked + 0.02), 0.0, 12.0])
    assert not scene.space.is_reachable(start[None])[0]
    rest = plan_rest(scenario, tower, scene, plan.viewpoints[-2:], start, SilentProgress())
    np.testing.assert_allclose(rest.trajectory.value([0.0])[0], start, atol=1e-6)
    assert rest.certificates.min_clearance_m >= scenario.safety.hull_clearance_m - 1e-9
    keeps_clear(rest, scenario)


@pytest.mark.parametrize("room", [0.015, 0.002, -0.03])
@pytest.mark.parametrize("slant", [-0.7, 0.0, 0.7])
def test_the_bend_of_the_way_back_is_allowed_for_wherever_the_hover_is(planned, scenario, tower, scene, room, slant):
    """A hover with hardly more room than is asked leaves no more for its way back than one with a little less."""
    plan, _ = planned
    asked = scenario.vehicle.radius_m + scenario.safety.hull_clearance_m
    start = np.array([-(4.0 + asked + room), slant, 12.0])
    rest = plan_rest(scenario, tower, scene, plan.viewpoints[-2:], start, SilentProgress())
    assert rest.certificates.min_clearance_m >= scenario.safety.hull_clearance_m + min(room, 0.0) - BACK_BENDS_M
    _, positions = sampled(rest)
    assert to_the_tower(positions).min() >= asked + min(room, 0.0) - BACK_BENDS_M


def test_a_vehicle_that_hovers_too_near_is_not_flown(planned, scenario, tower, scene):
    plan, _ = planned
    with pytest.raises(InfeasibleError):
        plan_rest(scenario, tower, scene, plan.viewpoints[-1:], [-5.0, 0.0, 12.0], SilentProgress())


def test_a_vehicle_that_is_deep_inside_is_flown_clear_by_hand(planned, scenario, tower, scene):
    plan, _ = planned
    with pytest.raises(InfeasibleError, match="by hand"):
        plan_rest(scenario, tower, scene, plan.viewpoints[-1:], [0.0, 0.0, 12.0], SilentProgress())
    assert MOST_DRIFT_M < 4.0


def test_the_rest_can_be_stopped(planned, scenario, tower, scene):
    plan, _ = planned
    for stage in ("trajectory", "certificates"):
        with pytest.raises(OperationCancelled):
            plan_rest(scenario, tower, scene, plan.viewpoints[-2:], plan.viewpoints[0].position_m, Told(stage))


def test_a_cavity_has_no_way_in(tower_scenario):
    import trimesh

    walls = trimesh.util.concatenate([trimesh.creation.box(extents=(s, s, s)) for s in (16, 14)])
    hollow = Structure(np.asarray(walls.vertices) + np.array([0, 0, 8]), np.asarray(walls.faces, dtype=np.int64))
    inside = (NamedPoint(name="I", position_m=(-7.0, 0.0, 8.0), normal=(1, 0, 0)),)
    task = tower_scenario.inspection.model_copy(update={"points": inside})
    with pytest.raises(InfeasibleError, match=r"inspection\.points\.I.*no way leads there"):
        make_plan(tower_scenario.model_copy(update={"inspection": task}), hollow, SilentProgress())
