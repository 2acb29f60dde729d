import math

import numpy as np
import pytest

from gcs.planning.tour_bound import tour_lower_bound
from gcs.planning.tour_solver import solve_closed_tour, tour_cost, with_free_node


def random_costs(n, seed):
    points = np.random.default_rng(seed).uniform(0, 50, (n, 3))
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


@pytest.mark.parametrize("n", [4, 6, 9, 11])
@pytest.mark.parametrize("seed", range(5))
def test_it_is_never_above_the_optimum(n, seed):
    costs = random_costs(n, seed)
    best = tour_cost(costs, solve_closed_tour(costs))
    bound = tour_lower_bound(costs, best)
    assert 0.93 * best <= bound <= best * (1 + 1e-9)
    arbitrary = np.random.default_rng(seed).uniform(1, 10, (n, n))  # no triangle inequality
    arbitrary = np.triu(arbitrary, 1) + np.triu(arbitrary, 1).T
    best = tour_cost(arbitrary, solve_closed_tour(arbitrary))
    assert tour_lower_bound(arbitrary, best) <= best * (1 + 1e-9)


@pytest.mark.parametrize("guess", [0.5, 3.0])
def test_it_holds_whatever_tour_is_known(guess):
    costs = random_costs(10, 1)
    best = tour_cost(costs, solve_closed_tour(costs))
    assert tour_lower_bound(costs, guess * best) <= best * (1 + 1e-9)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_few_nodes_have_one_tour(n):
    costs = random_costs(n, 0)
    assert tour_lower_bound(costs, 1.0) == pytest.approx(tour_cost(costs, np.arange(n)))


def test_random_points_are_bounded_within_one_percent():
    costs = random_costs(200, 3)
    cost = tour_cost(costs, solve_closed_tour(costs))
    assert 0.985 * cost <= tour_lower_bound(costs, cost) <= cost


def test_an_open_face_is_bounded_by_its_optimum():
    points = np.array([[x, z * math.sqrt(3)] for x in range(4) for z in range(20)])
    costs = np.linalg.norm(points[:, None] - points[None], axis=-1)
    optimum = 79 + 19 * (math.sqrt(3) - 1)
    assert tour_lower_bound(with_free_node(costs), optimum) == pytest.approx(optimum, rel=1e-3)


def test_it_asks_whether_to_go_on():
    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tour_lower_bound(random_costs(30, 0), 100.0, stop)
