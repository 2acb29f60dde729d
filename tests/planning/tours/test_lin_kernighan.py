import numpy as np
import pytest

from gcs.planning.tours.exact_tour import exact_tour
from gcs.planning.tours.lin_kernighan import LocalSearch
from gcs.planning.tours.tour_candidates import best_candidates, candidate_graph, greedy_tour
from gcs.planning.tours.tour_costs import TourCosts


def search_of(n, seed=0, from_points=True):
    costs = TourCosts.of_points(np.random.default_rng(seed).uniform(0, 50, (n, 3)))
    costs = costs if from_points else TourCosts.of_matrix(costs.matrix())
    order = greedy_tour(costs)
    candidates = best_candidates(candidate_graph(costs, order))
    return costs, candidates, order, LocalSearch(costs, candidates, order, np.random.default_rng(seed))


def test_the_descent_ends_where_no_exchange_of_two_edges_with_candidates_gains():
    costs, candidates, order, search = search_of(120)
    search.descend()
    tour, matrix = search.order, costs.matrix()
    assert sorted(tour) == list(range(120))
    assert search.cost == pytest.approx(costs.of_tour(tour))
    assert search.cost < costs.of_tour(order)
    place = np.argsort(tour)
    for t1 in range(120):
        for side in (1, -1):
            t2 = tour[(place[t1] + side) % 120]
            for c in candidates[t2]:
                d = tour[(place[c] + side) % 120]
                gain = matrix[t1, t2] + matrix[c, d] - matrix[t2, d] - matrix[t1, c]
                assert d in (t1, t2) or d not in candidates[t2] or gain < 1e-6


@pytest.mark.parametrize("from_points", [True, False])
def test_kicks_repeat_with_their_seed_and_do_not_lose_nodes(from_points):
    orders = []
    for _ in range(2):
        costs, _, _, search = search_of(200, 3, from_points)
        search.descend()
        before = search.cost
        search.kick(2000)
        assert sorted(search.order) == list(range(200))
        assert costs.of_tour(search.order) < before
        orders.append(search.order.tolist())
    assert orders[0] == orders[1]


@pytest.mark.parametrize("seed", range(5))
def test_few_nodes_are_ordered_at_the_least_cost(seed):
    costs, _, _, search = search_of(13, seed)
    search.descend()
    search.kick(500)
    assert search.cost == pytest.approx(costs.of_tour(exact_tour(costs.matrix())))


def test_costs_without_the_triangle_inequality():
    rng = np.random.default_rng(1)
    matrix = np.triu(rng.uniform(1, 100, (60, 60)), 1)
    costs = TourCosts.of_matrix(matrix + matrix.T)
    order = greedy_tour(costs)
    search = LocalSearch(costs, best_candidates(candidate_graph(costs, order)), order, rng)
    search.descend()
    search.kick(1000)
    assert sorted(search.order) == list(range(60))
    assert search.cost < 0.9 * costs.of_tour(order)


def test_it_ends_at_what_is_enough_and_when_it_is_told_to():
    costs, _, order, search = search_of(50, 2)
    search.kick(5000, enough=costs.of_tour(order))
    assert search.order.tolist() == order.tolist()

    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search.kick(5000, stop)
