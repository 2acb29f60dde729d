import math

import numpy as np
import pytest

from gcs.planning.tour_bound import counting_bound, tour_lower_bound
from gcs.planning.tour_costs import TourCosts
from gcs.planning.tour_solver import solve_closed_tour, tour_cost, with_free_node


def random_costs(n, seed):
    points = np.random.default_rng(seed).uniform(0, 50, (n, 3))
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def bound_of(costs, order):
    return tour_lower_bound(TourCosts.of_matrix(costs), np.asarray(order))


@pytest.mark.parametrize("n", [4, 6, 9, 11])
@pytest.mark.parametrize("seed", range(5))
def test_it_is_never_above_the_optimum(n, seed):
    costs = random_costs(n, seed)
    order = solve_closed_tour(costs)
    best = tour_cost(costs, order)
    bound = bound_of(costs, order)
    assert 0.93 * best <= bound <= best * (1 + 1e-9)
    arbitrary = np.random.default_rng(seed).uniform(1, 10, (n, n))  # no triangle inequality
    arbitrary = np.triu(arbitrary, 1) + np.triu(arbitrary, 1).T
    order = solve_closed_tour(arbitrary)
    assert bound_of(arbitrary, order) <= tour_cost(arbitrary, order) * (1 + 1e-9)


def test_it_holds_whatever_tour_is_known():
    costs = random_costs(10, 1)
    best = tour_cost(costs, solve_closed_tour(costs))
    for seed in range(5):
        assert bound_of(costs, np.random.default_rng(seed).permutation(10)) <= best * (1 + 1e-9)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_few_nodes_have_one_tour(n):
    costs = random_costs(n, 0)
    assert bound_of(costs, np.arange(n)) == pytest.approx(tour_cost(costs, np.arange(n)))


def test_random_points_are_bounded_within_one_percent():
    costs = random_costs(200, 3)
    order = solve_closed_tour(costs)
    cost = tour_cost(costs, order)
    assert 0.985 * cost <= bound_of(costs, order) <= cost


def test_an_open_face_is_bounded_by_its_optimum():
    points = np.array([[x, 0.0, z * math.sqrt(3)] for x in range(4) for z in range(20)])
    costs = np.linalg.norm(points[:, None] - points[None], axis=-1)
    optimum = 79 + 19 * (math.sqrt(3) - 1)
    open_costs = with_free_node(costs)
    assert bound_of(open_costs, solve_closed_tour(open_costs)) == pytest.approx(optimum, rel=2e-3)
    assert counting_bound(points, closed=False) == pytest.approx(optimum)


def test_it_asks_whether_to_go_on():
    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tour_lower_bound(TourCosts.of_matrix(random_costs(30, 0)), np.arange(30), stop)
