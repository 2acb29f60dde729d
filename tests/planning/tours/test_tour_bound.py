import math

import numpy as np
import pytest

from gcs.planning.tours.exact_tour import exact_tour
from gcs.planning.tours.tour_bound import counting_bound, tour_lower_bound
from gcs.planning.tours.tour_costs import TourCosts
from gcs.planning.tours.tour_solver import solve_closed_tour, tour_cost, with_free_node


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


@pytest.mark.parametrize("n", [13, 14])
@pytest.mark.parametrize("seed", range(3))
def test_the_ascent_is_never_above_an_optimum_found_otherwise(n, seed):
    costs = random_costs(n, seed)
    best = tour_cost(costs, exact_tour(costs))
    for order in (exact_tour(costs), np.random.default_rng(seed).permutation(n)):
        assert 0.95 * best <= bound_of(costs, order) <= best * (1 + 1e-9)


def test_points_are_bounded_like_their_matrix():
    points = np.random.default_rng(8).uniform(0, 50, (150, 3))
    matrix = random_costs(150, 8)
    order = solve_closed_tour(matrix)
    assert tour_lower_bound(TourCosts.of_points(points), order) == pytest.approx(bound_of(matrix, order), rel=1e-3)


def test_the_closed_forms_of_the_towers_face():
    face = np.array([[x, 0.0, z * math.sqrt(3)] for x in range(4) for z in range(88)])
    assert counting_bound(face, closed=False) == pytest.approx(414.688, abs=5e-4)
    assert counting_bound(face, closed=True) == pytest.approx(479.377, abs=5e-4)
    turned = face[np.random.default_rng(0).permutation(352)][:, [2, 0, 1]] + 7.0
    assert counting_bound(turned, closed=True) == pytest.approx(479.377, abs=5e-4)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize(
    ("width", "height", "pitch"), [(3, 4, 1.7), (4, 3, 1.7), (2, 5, 0.4), (3, 3, 1.0), (2, 2, 3.0)]
)
def test_counting_is_never_above_the_optimum_and_reaches_open_ones(width, height, pitch, closed):
    grid = np.array([[x, 0.0, z * pitch] for x in range(width) for z in range(height)])
    costs = TourCosts.of_points(grid, free_node=not closed)
    best = costs.of_tour(exact_tour(costs.matrix()))
    bound = counting_bound(grid, closed=closed)
    assert bound <= best * (1 + 1e-9)
    if not closed:
        assert bound == pytest.approx(best)


def test_what_is_no_full_grid_is_not_counted():
    grid = np.array([[x, 0.0, z] for x in range(4) for z in range(5)], dtype=float)
    assert counting_bound(grid[1:], closed=True) is None
    assert counting_bound(np.concatenate([grid[1:], grid[1:2]]), closed=True) is None
    uneven = grid.copy()
    uneven[uneven[:, 2] == 4, 2] = 4.3
    assert counting_bound(uneven, closed=True) is None
    assert counting_bound(grid[grid[:, 0] == 0], closed=True) is None
    assert counting_bound(np.zeros((5, 3)), closed=True) is None


def test_it_asks_whether_to_go_on():
    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tour_lower_bound(TourCosts.of_matrix(random_costs(30, 0)), np.arange(30), stop)
