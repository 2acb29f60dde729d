import itertools

import numpy as np
import pytest
from scipy.sparse.csgraph import minimum_spanning_tree

from gcs.planning.tours.one_tree import graph_of_edges
from gcs.planning.tours.tour_candidates import CANDIDATES, best_candidates, candidate_graph, greedy_tour
from gcs.planning.tours.tour_costs import TourCosts


def cloud(n, seed=0):
    return np.random.default_rng(seed).uniform(0, 50, (n, 3))


def greedy_by_definition(matrix):
    """Cost of the greedy path: all edges by cost, each taken that leaves paths."""
    n = len(matrix)
    part, degree, total = list(range(n)), [0] * n, 0.0
    for a, b in sorted(itertools.combinations(range(n), 2), key=lambda e: matrix[e]):
        if degree[a] < 2 and degree[b] < 2 and part[a] != part[b]:
            total += matrix[a, b]
            degree[a] += 1
            degree[b] += 1
            old, new = part[a], part[b]
            part = [new if p == old else p for p in part]
    return total


@pytest.mark.parametrize("seed", range(3))
def test_the_greedy_tour_takes_the_cheapest_edges(seed):
    points = cloud(11, seed)
    costs = TourCosts.of_points(points)
    order = greedy_tour(costs)
    assert sorted(order) == list(range(11))
    assert costs.of_tour(order, closed=False) == pytest.approx(greedy_by_definition(costs.matrix()))


@pytest.mark.parametrize("from_points", [True, False])
def test_far_clusters_are_joined(from_points):
    points = np.concatenate([cloud(60, k) * 0.01 + 100 * k for k in range(4)])
    costs = TourCosts.of_points(points)
    costs = costs if from_points else TourCosts.of_matrix(costs.matrix())
    order = greedy_tour(costs)
    assert sorted(order) == list(range(240))
    assert sum(order[i] // 60 != order[i - 1] // 60 for i in range(240)) == 4


def test_all_nodes_in_one_place_and_a_free_node():
    costs = TourCosts.of_points(np.ones((50, 3)), free_node=True)
    order = greedy_tour(costs)
    assert sorted(order) == list(range(51))
    assert costs.of_tour(order) == 0.0
    assert best_candidates(candidate_graph(costs, order)).shape == (51, CANDIDATES)


def one_tree_with(matrix, edge):
    """Cost of the cheapest 1-tree that has an edge."""
    matrix = matrix + 100.0
    rest = matrix[1:, 1:].copy()
    a, b = edge
    zero = np.sort(matrix[0, 1:])[:2].sum()
    if a == 0:
        other = np.sort(np.delete(matrix[0, 1:], b - 1))[0]
        zero = matrix[0, b] + other
    else:
        rest[a - 1, b - 1] = rest[b - 1, a - 1] = 1e-6
    tree = minimum_spanning_tree(rest).sum()
    return zero + tree + (matrix[a, b] - 1e-6 if a else 0.0)


def test_candidates_are_those_without_which_the_one_tree_would_hardly_cost_less():
    costs = TourCosts.of_points(cloud(12, 4))
    matrix = costs.matrix()
    a, b = np.triu_indices(12, 1)
    found = best_candidates(graph_of_edges(12, a, b, costs), steps=1)  # at no prices yet
    for node in range(12):
        others = [j for j in range(12) if j != node]
        alpha = {j: one_tree_with(matrix, (min(node, j), max(node, j))) for j in others}
        worst = sorted(alpha.values())[CANDIDATES - 1]
        assert all(alpha[j] <= worst + 1e-3 for j in found[node])
        assert (np.diff(matrix[node, found[node]]) >= 0).all()


def test_rows_with_few_candidates_end_with_the_node_itself():
    costs = TourCosts.of_points(cloud(6, 5))
    ring = graph_of_edges(6, np.arange(6), np.roll(np.arange(6), -1), costs)
    found = best_candidates(ring)
    for node in range(6):
        assert set(found[node][:2]) == {(node - 1) % 6, (node + 1) % 6}
        assert (found[node][2:] == node).all()
