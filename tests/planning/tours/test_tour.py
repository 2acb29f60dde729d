import itertools

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InfeasibleError, OperationCancelled
from gcs.core.scenario import PlannerOptions
from gcs.core.structure import Structure
from gcs.planning.paths.path_search import find_path
from gcs.planning.paths.string_pulling import path_length
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.free_space import FreeSpace
from gcs.planning.tours.tour import find_tour

LOW, HIGH = np.array([-20.0, -20.0, -1.0]), np.array([20.0, 20.0, 32.0])
HOME = np.array([-15.0, -15.0, 0.0])


def leg_time(length_m):
    """From rest to rest at 2.5 m/s² and at most 5 m/s."""
    return np.where(length_m < 10, 2 * np.sqrt(length_m / 2.5), length_m / 5 + 2)


@pytest.fixture(scope="module")
def space():
    corners = [[(-8, -3, 0), (-5, 3, 20)], [(5, -3, 0), (8, 3, 20)], [(-8, -3, 16), (8, 3, 20)]]
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(c, dtype=float)) for c in corners])
    structure = Structure(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))
    return FreeSpace(build_distance_field(structure, LOW, HIGH, 0.5), 1.5, 0.0, HOME)


def stops_in(space, count, seed):
    points = np.random.default_rng(seed).uniform((-12, -8, 2), (12, 8, 25), (50 * count, 3))
    return points[space.is_reachable(points)][:count]


def path_cost(path, metric):
    step = np.diff(path, axis=0)
    if metric == "energy":
        return float(2.0 * np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2 + 5.0 * step[:, 2] ** 2).sum())
    return path_length(path) if metric == "length" else float(leg_time(np.array(path_length(path))))


def cost_of(order, costs):
    nodes = [0, *(k + 1 for k in order), 0]
    return sum(costs[min(a, b), max(a, b)] for a, b in itertools.pairwise(nodes))


@pytest.mark.parametrize("method", ["fast", "genetic"])
@pytest.mark.parametrize("metric", ["length", "time", "energy"])
def test_it_is_the_best_order_over_the_searched_paths(space, metric, method):
    stops = stops_in(space, 6, 1)
    points = np.concatenate([HOME[None], stops])
    pairs = itertools.combinations(range(7), 2)
    costs = {(a, b): path_cost(find_path(space, points[a], points[b]), metric) for a, b in pairs}
    best = min(cost_of(order, costs) for order in itertools.permutations(range(6)))
    tour = find_tour(space, HOME, stops, PlannerOptions(tour=method, metric=metric, k=2.0, mu=5.0), leg_time)
    assert tour.metric == metric
    assert tour.cost == pytest.approx(best)
    assert cost_of(tour.order, costs) == pytest.approx(best)
    assert tour.lower_bound <= tour.cost
    assert tour.lower_bound > 0.99 * best  # the best tour over what is known of all pairs
    assert tour.searched < len(costs)


def test_weighing_climbs_changes_the_order(space):
    stops = np.array([[-12.0, y, z] for y in (-6.0, 0.0, 6.0) for z in (4.0, 9.0, 14.0)])
    climbs = []
    for mu in (0.01, 100.0):
        tour = find_tour(space, HOME, stops, PlannerOptions(metric="energy", mu=mu), leg_time)
        climbs.append(np.abs(np.diff(stops[tour.order][:, 2])).sum())
    assert climbs[0] > climbs[1]


def test_tours_repeat_with_their_seed(space):
    stops = stops_in(space, 40, 5)
    tours = [find_tour(space, HOME, stops, PlannerOptions(seed=3), leg_time) for _ in range(2)]
    assert tours[0].order.tolist() == tours[1].order.tolist()


@pytest.mark.parametrize("count", [1, 2, 25, 60])
def test_the_legs_join_home_and_all_stops_freely(space, count):
    stops = stops_in(space, count, 2)
    tour = find_tour(space, HOME, stops, PlannerOptions(metric="length"), leg_time)
    assert sorted(tour.order) == list(range(count))
    places = np.concatenate([HOME[None], stops[tour.order], HOME[None]])
    assert len(tour.legs_m) == count + 1
    for leg, start, end in zip(tour.legs_m, places[:-1], places[1:], strict=True):
        assert leg[0] == pytest.approx(start)
        assert leg[-1] == pytest.approx(end)
        assert space.segments_free(leg[:-1], leg[1:]).all()
    first, last = tour.legs_m[0], tour.legs_m[-1]
    assert first[1].tolist() == last[-2].tolist() == space.take_off_m.tolist()
    assert tour.cost == pytest.approx(sum(path_length(leg) for leg in tour.legs_m))
    assert 0.8 * tour.cost < tour.lower_bound <= tour.cost


def test_it_beats_the_order_of_the_list(space):
    stops = stops_in(space, 40, 3)
    fast = find_tour(space, HOME, stops, PlannerOptions(), leg_time)
    given = find_tour(space, HOME, stops, PlannerOptions(tour="given"), leg_time)
    assert given.order.tolist() == list(range(40))
    assert fast.cost < 0.7 * given.cost
    assert given.lower_bound <= fast.cost


def test_two_stops_at_one_place(space):
    stop = np.array([[-12.0, 0.0, 10.0]])
    tour = find_tour(space, HOME, np.repeat(stop, 2, axis=0), PlannerOptions(), leg_time)
    assert tour.legs_m[1] == pytest.approx(np.repeat(stop, 2, axis=0))


def test_a_stop_that_cannot_be_reached_is_named(space):
    stops = np.array([[-12.0, 0.0, 10.0], [-6.5, 0.0, 10.0]])
    with pytest.raises(InfeasibleError, match=r"viewpoint L4: no way leads from home.*; leave it out"):
        find_tour(space, HOME, stops, PlannerOptions(), leg_time, names=["L3", "L4"])
    with pytest.raises(InfeasibleError, match="viewpoint 2"):
        find_tour(space, HOME, stops, PlannerOptions(), leg_time)


def test_a_stop_behind_a_narrow_door_is_named_with_the_clearance_that_leads_in():
    walls = [
        [(-6, -6, 0), (-5, 6, 13)],
        [(-5, -6, 0), (6, -5, 13)],
        [(-5, 5, 0), (6, 6, 13)],
        [(-5, -5, 12), (6, 5, 13)],
        [(5, -5, 0), (6, -1.5, 12)],
        [(5, 1.5, 0), (6, 5, 12)],
    ]  # a room whose door, 3 m wide, is all there is of the east wall
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(w, dtype=float)) for w in walls])
    structure = Structure(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))
    field = build_distance_field(structure, LOW, HIGH, 0.25)
    stops = [[-12.0, 0.0, 6.0], [0.0, 0.0, 6.0]]
    with pytest.raises(InfeasibleError, match=r"viewpoint IN: .* with (1\.[0-4]\d) m it could be reached") as refused:
        find_tour(FreeSpace(field, 2.0, 0.0, HOME), HOME, stops, PlannerOptions(), leg_time, names=["OUT", "IN"])
    told = float(refused.value.message.split("; with ")[1].split(" m")[0])
    assert len(find_tour(FreeSpace(field, told - 0.01, 0.0, HOME), HOME, stops, PlannerOptions(), leg_time).order) == 2


def test_nothing_to_visit_is_said(space):
    with pytest.raises(InfeasibleError, match="nothing to visit"):
        find_tour(space, HOME, np.zeros((0, 3)), PlannerOptions(), leg_time)


def test_a_cancel_is_obeyed_and_progress_grows(space):
    fractions = []

    class Record:
        def report(self, stage, fraction):
            assert stage == "tour"
            fractions.append(fraction)

    find_tour(space, HOME, stops_in(space, 25, 4), PlannerOptions(), leg_time, Record())
    assert fractions[-1] == 1.0
    assert (np.diff(fractions) >= -1e-9).all()

    class Stop:
        def report(self, stage, fraction):
            if fraction > 0.1:
                raise OperationCancelled("stopped")

    with pytest.raises(OperationCancelled):
        find_tour(space, HOME, stops_in(space, 25, 4), PlannerOptions(), leg_time, Stop())
