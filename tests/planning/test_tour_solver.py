import itertools
import math

import numpy as np
import pytest

from gcs.planning.tour_solver import solve_closed_tour, solve_open_tour, tour_cost, with_free_node


def random_costs(n, seed):
    points = np.random.default_rng(seed).uniform(0, 50, (n, 3))
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def brute_force(costs, closed):
    first = [()] if not closed else [(0,)]
    rest = range(1, len(costs)) if closed else range(len(costs))
    return min(tour_cost(costs, np.array(first[0] + p), closed=closed) for p in itertools.permutations(rest))


@pytest.mark.parametrize("n", [4, 5, 7, 8])
@pytest.mark.parametrize("seed", range(3))
def test_small_closed_tours_are_optimal(n, seed):
    costs = random_costs(n, seed)
    order = solve_closed_tour(costs)
    assert sorted(order) == list(range(n))
    assert tour_cost(costs, order) == pytest.approx(brute_force(costs, closed=True))


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_small_open_tours_are_optimal(n):
    costs = random_costs(n, 5)
    order = solve_open_tour(costs)
    assert sorted(order) == list(range(n))
    assert tour_cost(costs, order, closed=False) == pytest.approx(brute_force(costs, closed=False))


def test_the_two_solvers_agree():
    for seed in range(4):
        costs = random_costs(12, seed)
        far = np.full((14, 14), 0.0)  # two nodes more at the place of node 0 take it past the exact limit
        far[:12, :12] = costs
        far[12:, :12] = costs[0]
        far[:12, 12:] = costs[:, :1]
        assert tour_cost(far, solve_closed_tour(far)) == pytest.approx(
            tour_cost(costs, solve_closed_tour(costs)), rel=1e-3
        )


def test_the_order_starts_at_node_0_in_a_fixed_direction():
    costs = random_costs(60, 1)
    order = solve_closed_tour(costs)
    assert order[0] == 0
    assert order[1] < order[-1]


def test_the_face_of_the_bridge_tower_is_solved_to_its_optimum():
    points = np.array([[x, z * math.sqrt(3)] for x in range(4) for z in range(88)])
    costs = np.linalg.norm(points[:, None] - points[None], axis=-1)
    assert tour_cost(costs, solve_open_tour(costs), closed=False) == pytest.approx(351 + 87 * (math.sqrt(3) - 1))


def test_costs_of_any_size_are_scaled():
    for scale in (1e-3, 1e4):
        costs = random_costs(30, 2) * scale
        assert tour_cost(costs, solve_closed_tour(costs)) < 0.5 * tour_cost(costs, np.arange(30))
    assert sorted(solve_closed_tour(np.zeros((15, 15)))) == list(range(15))


def test_a_free_node_costs_nothing():
    costs = with_free_node(np.ones((2, 2)))
    assert costs.tolist() == [[0, 0, 0], [0, 1, 1], [0, 1, 1]]
