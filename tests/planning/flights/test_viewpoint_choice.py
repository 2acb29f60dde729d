"""The choice between viewpoints: against all choices and orders where nothing is in the way, and round real things."""

import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.errors import OperationCancelled
from gcs.core.inspection import Inspection, NamedPoint
from gcs.core.progress import SilentProgress
from gcs.core.scenario import PlannerOptions, parse_scenario
from gcs.planning.flights.flight_base import FlightBase, tour_from
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.flights.viewpoint_choice import WORTHWHILE, choice_over_straight_lines, choose_viewpoints
from gcs.planning.tours.tour_metric import tour_metric
from gcs.planning.views.viewpoint_pose import pose_towards
from gcs.planning.views.viewpoints import find_viewpoints
from gcs.storage.mesh_files import load_structure, sample_scenario

QUIET = SilentProgress()
HOME = np.array([-20.0, -20.0, 0.0])


def pose_at(place, name="P"):
    return pose_towards(name, place, (1, 0, 0), 0.001)


def random_candidates(count, each, seed):
    rng = np.random.default_rng(seed)
    centres = rng.uniform([-15, -15, 5], [15, 15, 25], (count, 3))
    places = centres[:, None] + 3 * rng.standard_normal((count, each, 3))
    poses = [pose_at(of_one[0], f"P{k}") for k, of_one in enumerate(places)]
    others = {k: [pose_at(p, f"P{k}") for p in of_one[1:]] for k, of_one in enumerate(places) if k != 1}
    return poses, others


def in_the_open(**options):
    space = SimpleNamespace(in_home_column=lambda _: True, take_off_m=HOME + np.array([0.0, 0.0, 4.0]))
    scenario = SimpleNamespace(home_m=tuple(HOME), planner=PlannerOptions(**options))
    return SimpleNamespace(scene=SimpleNamespace(space=space), scenario=scenario)


def least_cost(candidates, base, orders):
    metric = tour_metric(base.scenario.planner, None)
    return min(cost_of(choice, order, base, metric) for choice in itertools.product(*candidates) for order in orders)


def cost_of(choice, order, base, metric):
    above = base.scene.space.take_off_m
    return metric.of_path([above, *(choice[k].position_m for k in order), above])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("options", [{"metric": "length"}, {"metric": "energy", "mu": 9.0}], ids=["length", "energy"])
@pytest.mark.parametrize("tour", ["fast", "given"])
def test_no_other_choice_in_any_order_is_shorter(tour, options, seed):
    base = in_the_open(tour=tour, **options)
    poses, others = random_candidates(4, 3, seed)
    candidates = [(pose, *others.get(k, ())) for k, pose in enumerate(poses)]
    orders = [range(4)] if tour == "given" else list(itertools.permutations(range(4)))
    chosen = choice_over_straight_lines(base, poses, others, QUIET)
    assert all(pose in of_one for pose, of_one in zip(chosen, candidates, strict=True))
    metric = tour_metric(base.scenario.planner, None)
    found = min(cost_of(chosen, order, base, metric) for order in orders)
    assert found == pytest.approx(least_cost(candidates, base, orders))


SIDES = {"east": (1, 0), "north": (0, 1), "west": (-1, 0), "south": (0, -1)}


@pytest.fixture(scope="module")
def tower_base(tower_scenario, tower):
    points = tuple(
        NamedPoint(name=f"{name} {z}", position_m=(4.0 * x, 4.0 * y, z), normal=(x, y, 0), hold_s=3.0)
        for name, (x, y) in SIDES.items()
        for z in (10.0, 20.0)
    )
    scenario = tower_scenario.model_copy(update={"inspection": Inspection(points=points)})
    return FlightBase(scenario, prepare_scene(scenario, tower, QUIET))


@pytest.fixture(scope="module")
def found(tower_base, tower):
    scene = tower_base.scene
    return find_viewpoints(tower_base.scenario, tower, scene.space, scene.distance, QUIET)


def with_options(base, **options):
    planner = base.scenario.planner.model_copy(update=options)
    return FlightBase(base.scenario.model_copy(update={"planner": planner}), base.scene)


@pytest.mark.parametrize("options", [{"metric": "time"}, {"metric": "energy"}, {"tour": "given"}], ids=str)
def test_choosing_shortens_the_tour_round_a_tower(tower_base, found, options):
    base = with_options(tower_base, **options)
    poses, tour = choose_viewpoints(base, found.poses, found.others, QUIET)
    alone = tour_from(base, range(len(found.poses)), found.poses, QUIET)
    assert tour.cost < 0.97 * alone.cost
    assert [p.name for p in poses] == [p.name for p in found.poses]
    assert {p.hold_s for p in poses} == {3.0}
    for k, pose in enumerate(poses):
        assert any(pose is offered for offered in (found.poses[k], *found.others[k]))
    for leg, k in zip(tour.legs_m, tour.order, strict=False):
        np.testing.assert_array_equal(leg[-1], poses[k].position_m)
    if "tour" in options:
        assert tour.order.tolist() == list(range(len(poses)))
    again, _ = choose_viewpoints(base, found.poses, found.others, QUIET)
    assert all(a is b for a, b in zip(again, poses, strict=True))


def test_the_best_viewpoints_are_kept_where_others_save_too_little(tower_base, found):
    nearly = {
        k: [pose_at(p.position_m + WORTHWHILE / 10 * (HOME - p.position_m), p.name)] for k, p in enumerate(found.poses)
    }
    nearly = {k: views for k, views in nearly.items() if tower_base.scene.space.is_reachable(views[0].position_m)[0]}
    assert nearly
    assert choice_over_straight_lines(tower_base, found.poses, nearly, QUIET) != found.poses
    poses, tour = choose_viewpoints(tower_base, found.poses, nearly, QUIET)
    assert poses is found.poses
    assert tour.cost == tour_from(tower_base, range(len(poses)), poses, QUIET).cost


def test_the_genetic_algorithm_orders_the_best_viewpoints(tower_base, found):
    poses, _ = choose_viewpoints(with_options(tower_base, tour="genetic"), found.poses, found.others, QUIET)
    assert poses is found.poses


@pytest.mark.parametrize("calls", [1, 4])
def test_it_can_be_stopped(tower_base, found, calls):
    told = []

    def report(stage, fraction):
        told.append((stage, fraction))
        if len(told) == calls:
            raise OperationCancelled("stop")

    with pytest.raises(OperationCancelled, match="stop"):
        choose_viewpoints(tower_base, found.poses, found.others, SimpleNamespace(report=report))
    assert len(told) == calls
    assert {stage for stage, _ in told} == {"tour"}


def test_the_sample_crane_is_inspected_on_a_shorter_way():
    scenario = parse_scenario(sample_scenario("gantry-crane"))
    crane, _ = load_structure(scenario.structure, Path())
    base = FlightBase(scenario, prepare_scene(scenario, crane, QUIET))
    found = find_viewpoints(scenario, crane, base.scene.space, base.scene.distance, QUIET)
    poses, tour = choose_viewpoints(base, found.poses, found.others, QUIET)
    assert len(poses) == 18
    flown = sum(np.linalg.norm(np.diff(leg, axis=0), axis=1).sum() for leg in tour.legs_m)
    assert flown < 185.0  # 194.4 m with the best viewpoints
    assert base.scene.space.is_open_sky([p.position_m for p in poses]).all()
