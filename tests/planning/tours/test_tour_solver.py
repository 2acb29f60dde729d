import itertools
import math

import numpy as np
import pytest

from gcs.planning.tours.tour_bound import tour_lower_bound
from gcs.planning.tours.tour_costs import TourCosts
from gcs.planning.tours.tour_solver import (
    solve_closed_tour,
    solve_open_tour,
    solve_point_tour,
    solve_tour,
    tour_cost,
    with_free_node,
)


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


def test_the_closed_face_of_the_bridge_tower_is_solved_to_its_optimum():
    points = np.array([[x, 0.0, z * math.sqrt(3)] for x in range(4) for z in range(88)])
    costs = TourCosts.of_points(points)
    order = solve_point_tour(points, closed=True)
    assert sorted(order) == list(range(352))
    assert costs.of_tour(order) == pytest.approx(352 + 174 * (math.sqrt(3) - 1))
    costs_open = costs.of_tour(solve_point_tour(points, closed=False), closed=False)
    assert costs_open == pytest.approx(351 + 87 * (math.sqrt(3) - 1))


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 12, 14, 80])
def test_points_and_their_matrix_have_equally_good_tours(n, closed):
    points = np.random.default_rng(n).uniform(0, 50, (n, 3))
    matrix = random_costs(n, n)
    order = solve_point_tour(points, closed=closed)
    assert sorted(order) == list(range(n))
    other = solve_closed_tour(matrix) if closed else solve_open_tour(matrix)
    cost = TourCosts.of_points(points).of_tour(order, closed=closed)
    assert cost == pytest.approx(tour_cost(matrix, other, closed=closed), rel=1e-9 if n < 20 else 0.02)


def test_tours_repeat_with_their_seed():
    points = np.random.default_rng(3).uniform(0, 50, (400, 3))
    one, again, other = (solve_point_tour(points, closed=True, seed=s, effort=0.2) for s in (1, 1, 2))
    assert one.tolist() == again.tolist()
    assert one.tolist() != other.tolist()


def test_more_effort_and_a_start_do_not_make_it_worse():
    costs = TourCosts.of_points(np.random.default_rng(4).uniform(0, 50, (400, 3)))
    hasty = solve_tour(costs, effort=0.0)
    longer = solve_tour(costs, effort=1.0, start=hasty)
    assert costs.of_tour(longer) < costs.of_tour(hasty) < costs.of_tour(np.arange(400))


def test_random_points_come_within_a_percent_of_the_bound():
    costs = TourCosts.of_points(np.random.default_rng(5).uniform(0, 50, (300, 3)))
    order = solve_tour(costs)
    assert costs.of_tour(order) <= 1.01 * tour_lower_bound(costs, order)


@pytest.mark.parametrize("closed", [True, False])
def test_points_in_one_place_and_on_one_line(closed):
    for points in (np.ones((40, 3)), np.outer(np.arange(40.0), [1.0, 2.0, 3.0])):
        order = solve_point_tour(points[np.random.default_rng(0).permutation(40)], closed=closed)
        assert sorted(order) == list(range(40))
    line = np.outer(np.random.default_rng(0).permutation(40), [1.0, 2.0, 2.0])
    order = solve_point_tour(line, closed=closed)
    assert TourCosts.of_points(line).of_tour(order, closed=closed) == pytest.approx(39 * 3 * (2 if closed else 1))


def test_it_asks_whether_to_go_on():
    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve_point_tour(np.random.default_rng(0).uniform(0, 9, (50, 3)), closed=True, poll=stop)
