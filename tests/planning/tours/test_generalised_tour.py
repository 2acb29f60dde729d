import itertools

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.tours.generalised_tour import best_choice, generalised_tour, target_costs
from gcs.planning.tours.tour_costs import TourCosts
from gcs.planning.tours.tour_solver import solve_tour


def instance(count, each, seed=0, spread=6.0):
    rng = np.random.default_rng(seed)
    centres = rng.uniform(0, 40, (count, 1, 3))
    points = (centres + spread * rng.standard_normal((count, each, 3))).reshape(-1, 3)
    return points, np.repeat(np.arange(count), each)


def brute_force(points, targets):
    costs = TourCosts.of_points(points)
    groups = [np.flatnonzero(targets == t) for t in range(targets.max() + 1)]
    return min(
        costs.of_tour(np.array(choice)[[0, *p]])
        for choice in itertools.product(*groups)
        for p in itertools.permutations(range(1, len(groups)))
    )


def test_the_choice_along_an_order_is_the_best_of_all():
    points, targets = instance(5, 3)
    start = np.arange(0, 18, 3)
    costs = TourCosts.of_points(points)
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(5)
        found = best_choice(points, start, order)
        assert targets[found].tolist() == order.tolist()
        groups = [range(start[t], start[t + 1]) for t in order]
        least = min(costs.of_tour(np.array(choice)) for choice in itertools.product(*groups))
        assert costs.of_tour(found) == pytest.approx(least)


@pytest.mark.parametrize(("count", "each"), [(1, 3), (2, 3), (3, 3), (4, 3), (5, 3), (6, 2)])
@pytest.mark.parametrize("seed", range(2))
def test_small_instances_are_solved_to_their_optimum(count, each, seed):
    points, targets = instance(count, each, seed)
    shuffled = np.random.default_rng(seed).permutation(len(points))
    found = generalised_tour(points[shuffled], targets[shuffled])
    assert sorted(targets[shuffled][found.order]) == list(range(count))
    assert found.cost == pytest.approx(brute_force(points, targets))


def test_targets_may_have_different_numbers_of_candidates():
    points, targets = instance(30, 4, 3)
    keep = np.random.default_rng(3).random(len(points)) < 0.6
    keep[::4] = True
    found = generalised_tour(points[keep], targets[keep])
    assert sorted(targets[keep][found.order]) == list(range(30))
    assert found.cost == pytest.approx(TourCosts.of_points(points[keep]).of_tour(found.order))


def test_choosing_and_ordering_together_pays():
    points, targets = instance(80, 5, 4, spread=8.0)
    in_turns = generalised_tour(points, targets, effort=0.0)
    together = generalised_tour(points, targets)
    assert together.cost < 0.97 * in_turns.cost
    again = generalised_tour(points, targets)
    assert together.order.tolist() == again.order.tolist()


def test_the_least_distances_between_targets_bound_it():
    points, targets = instance(5, 3, 6)
    between = target_costs(points, targets)
    least = [
        min(
            np.linalg.norm(points[a] - points[b])
            for a in np.flatnonzero(targets == 1)
            for b in np.flatnonzero(targets == k)
        )
        for k in (0, 2, 3, 4)
    ]
    assert between[1, [0, 2, 3, 4]] == pytest.approx(least)
    assert np.array_equal(between, between.T)
    costs = TourCosts.of_matrix(between)
    assert costs.of_tour(solve_tour(costs)) <= generalised_tour(points, targets).cost


def test_many_candidates_in_one_place():
    points, targets = np.zeros((40, 3)), np.repeat(np.arange(20), 2)
    found = generalised_tour(points, targets)
    assert sorted(targets[found.order]) == list(range(20))
    assert found.cost == 0.0


def test_a_target_without_candidates_is_named():
    with pytest.raises(InputError, match="target 1 has no candidate"):
        generalised_tour(np.zeros((2, 3)), [0, 2])
    with pytest.raises(InputError, match="no candidate"):
        generalised_tour(np.zeros((0, 3)), [])


def test_it_asks_whether_to_go_on():
    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generalised_tour(*instance(30, 3), poll=stop)
