import numpy as np
import pytest

from gcs.planning.tours.tour_costs import TourCosts


def cloud(n, seed=0):
    return np.random.default_rng(seed).uniform(0, 50, (n, 3))


def test_points_and_their_matrix_are_the_same_costs():
    points = cloud(20)
    matrix = np.linalg.norm(points[:, None] - points[None], axis=-1)
    of_points, of_matrix = TourCosts.of_points(points), TourCosts.of_matrix(matrix)
    assert of_points.matrix() == pytest.approx(matrix)
    order = np.random.default_rng(1).permutation(20)
    legs = [matrix[a, b] for a, b in zip(order, np.roll(order, -1), strict=True)]
    for costs in (of_points, of_matrix):
        assert len(costs) == 20
        assert costs.of_tour(order) == pytest.approx(sum(legs))
        assert costs.of_tour(order, closed=False) == pytest.approx(sum(legs[:-1]))


def test_a_free_node_costs_nothing_to_reach():
    points = cloud(6)
    matrix = TourCosts.of_points(points, free_node=True).matrix()
    assert (matrix[0] == 0).all()
    assert matrix[1:, 1:] == pytest.approx(TourCosts.of_points(points).matrix())


@pytest.mark.parametrize("from_points", [True, False])
def test_the_nearest_are_those_of_a_full_sort(from_points):
    points = cloud(40, 2)
    matrix = TourCosts.of_points(points).matrix()
    costs = TourCosts.of_points(points) if from_points else TourCosts.of_matrix(matrix)
    among = np.array([3, 5, 8, 13, 21, 34, 1, 2])
    others, distances = costs.nearest(4, among)
    for node, row, cost in zip(among, others, distances, strict=True):
        rest = among[among != node]
        assert row.tolist() == rest[np.argsort(matrix[node, rest])][:4].tolist()
        assert cost == pytest.approx(np.sort(matrix[node, rest])[:4])


def test_a_node_is_not_its_own_neighbour_even_when_many_share_its_place():
    points = np.repeat([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 10, axis=0)
    others, distances = TourCosts.of_points(points).nearest(5, np.arange(20))
    assert (others != np.arange(20)[:, None]).all()
    assert (distances == 0).all()
