import numpy as np
import pytest
from scipy.sparse.csgraph import minimum_spanning_tree

from gcs.planning.tours.exact_tour import exact_tour
from gcs.planning.tours.one_tree import ascend, complete_one_tree, graph_of_edges, sparse_one_tree
from gcs.planning.tours.tour_costs import TourCosts


def cloud(n, seed):
    return TourCosts.of_points(np.random.default_rng(seed).uniform(0, 50, (n, 3)))


def complete_graph(costs):
    a, b = np.triu_indices(len(costs), 1)
    return graph_of_edges(len(costs), a, b, costs)


def reference(matrix, prices):
    """Bound of the cheapest 1-tree, with another library's spanning tree."""
    priced = matrix + prices[:, None] + prices[None] + 1000.0  # all above zero, as the library takes 0 for no edge
    tree = minimum_spanning_tree(priced[1:, 1:]).sum() - 1000.0 * (len(matrix) - 2)
    return tree + np.sort(priced[0, 1:] - 1000.0)[:2].sum() - 2 * prices.sum()


@pytest.mark.parametrize("seed", range(4))
def test_both_trees_cost_what_another_library_finds(seed):
    costs = cloud(30, seed)
    prices = np.random.default_rng(seed).normal(0, 5, 30)
    expected = reference(costs.matrix(), prices)
    for tree in (complete_one_tree(costs, prices), sparse_one_tree(complete_graph(costs), prices)):
        assert tree.bound == pytest.approx(expected)
        assert tree.degree.sum() == 2 * 30
        assert sorted(tree.order) == list(range(1, 30))
        nodes = tree.order[1:]
        edges = costs.matrix()[nodes, tree.parent[nodes]] + prices[nodes] + prices[tree.parent[nodes]]
        assert tree.edge_cost[nodes] == pytest.approx(edges)
        assert edges.sum() + sum(tree.zero_costs) - 2 * prices.sum() == pytest.approx(expected)


def test_matrix_and_points_give_the_same_tree():
    costs = cloud(25, 9)
    prices = np.random.default_rng(9).normal(0, 3, 25)
    matrix = TourCosts.of_matrix(costs.matrix())
    assert complete_one_tree(costs, prices).bound == pytest.approx(complete_one_tree(matrix, prices).bound)


@pytest.mark.parametrize("seed", range(3))
def test_prices_raise_the_bound_and_never_above_the_optimum(seed):
    costs = cloud(13, seed)
    optimum = costs.of_tour(exact_tour(costs.matrix()))
    prices = np.zeros(13)
    without = complete_one_tree(costs, prices).bound
    found = ascend(complete_graph(costs), prices, 500, 3.0)
    assert complete_one_tree(costs, prices).bound == pytest.approx(found)
    assert without < found <= optimum * (1 + 1e-9)
    assert found > 0.95 * optimum


def test_a_graph_has_each_edge_once_in_both_rows_by_cost():
    costs = cloud(6, 1)
    graph = graph_of_edges(6, np.array([0, 1, 2, 3, 3]), np.array([1, 0, 2, 4, 5]), costs)
    assert graph.start.tolist() == [0, 1, 2, 2, 4, 5, 6]
    assert graph.other[0] == 1
    assert graph.other[1] == 0
    assert sorted(graph.other[2:4]) == [4, 5]
    assert (np.diff(graph.cost[2:4]) >= 0).all()
    assert graph.cost[0] == pytest.approx(costs.matrix()[0, 1])


def test_it_asks_whether_to_go_on():
    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ascend(complete_graph(cloud(20, 0)), np.zeros(20), 10, 1.0, stop)
