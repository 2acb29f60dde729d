import itertools
import math

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from gcs.planning.scene.grid_search import GridSearch, cover_depth

MOVES = [m for m in itertools.product((-1, 0, 1), repeat=3) if any(m)]


def graph(allowed, covered=None, penalty=1.0):
    """The moves as a sparse matrix: a diagonal needs every cell of the cube it crosses."""
    shape = np.array(allowed.shape)
    number = np.arange(allowed.size).reshape(allowed.shape)
    rows, columns, costs = [], [], []
    cells = np.argwhere(allowed)
    for move in MOVES:
        corners = [np.array(c) for c in itertools.product(*[sorted({0, m}) for m in move])]
        ends = cells + np.array(move)
        ok = ((ends >= 0) & (ends < shape)).all(axis=1)
        for corner in corners:
            ok[ok] = allowed[tuple((cells[ok] + corner).T)]
        cost = np.full(ok.sum(), math.sqrt(np.abs(move).sum()))
        if covered is not None:
            cost[covered[tuple(ends[ok].T)]] *= penalty
        rows.append(number[tuple(cells[ok].T)])
        columns.append(number[tuple(ends[ok].T)])
        costs.append(cost)
    n = allowed.size
    return coo_matrix((np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), (n, n)).tocsr()


def cluttered(seed, shape=(14, 12, 9), share=0.25):
    return np.random.default_rng(seed).random(shape) > share


def check_path(allowed, path, start, goal):
    assert path[0].tolist() == list(start)
    assert path[-1].tolist() == list(goal)
    assert allowed[tuple(path.T)].all()
    assert (np.abs(np.diff(path, axis=0)).max(axis=1) == 1).all()


@pytest.mark.parametrize("seed", range(6))
def test_costs_are_those_of_dijkstra(seed):
    allowed = cluttered(seed)
    moves = graph(allowed)
    grid = GridSearch(allowed.shape)
    rng = np.random.default_rng(seed)
    cells = np.argwhere(allowed)
    start = cells[rng.integers(len(cells))]
    truth = dijkstra(moves, indices=np.ravel_multi_index(tuple(start), allowed.shape))
    for goal in cells[rng.choice(len(cells), 40)]:
        expected = truth[np.ravel_multi_index(tuple(goal), allowed.shape)]
        found = grid.search(allowed, start, goal)
        if found is None:
            assert math.isinf(expected)
            continue
        check_path(allowed, found[0], start, goal)
        assert found[1] == pytest.approx(expected, rel=2e-6)
        assert found[1] == pytest.approx(np.linalg.norm(np.diff(found[0], axis=0), axis=1).sum())


@pytest.mark.parametrize("seed", range(6))
def test_cover_is_dear_and_the_estimate_never_too_high(seed):
    allowed = cluttered(seed, share=0.1)
    covered = np.zeros_like(allowed)
    covered[3:11, 2:10, :6] = True
    open_sky = allowed & ~covered
    penalty = 4.0
    moves = graph(allowed, covered, penalty)
    depth = cover_depth(allowed, open_sky)
    grid = GridSearch(allowed.shape)
    rng = np.random.default_rng(seed)
    cells = np.argwhere(allowed)
    for start in cells[rng.choice(len(cells), 8)]:
        truth = dijkstra(moves, indices=np.ravel_multi_index(tuple(start), allowed.shape))
        for goal in cells[rng.choice(len(cells), 8)]:
            expected = truth[np.ravel_multi_index(tuple(goal), allowed.shape)]
            found = grid.search(allowed, start, goal, depth, penalty)
            assert math.isinf(expected) if found is None else found[1] == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("weight", [1.2, 2.0])
@pytest.mark.parametrize("penalty", [1.0, 3.7])
def test_a_weighted_search_keeps_its_bound(share, weight, penalty):
    allowed = cluttered(3, (16, 14, 11), share)
    covered = np.zeros_like(allowed)
    covered[3:12, 2:11, :7] = penalty > 1
    moves = graph(allowed, covered, penalty)
    depth = cover_depth(allowed, allowed & ~covered) if penalty > 1 else None
    grid = GridSearch(allowed.shape)
    rng = np.random.default_rng(4)
    cells = np.argwhere(allowed)
    for start in cells[rng.choice(len(cells), 8)]:
        truth = dijkstra(moves, indices=np.ravel_multi_index(tuple(start), allowed.shape))
        for goal in cells[rng.choice(len(cells), 15)]:
            expected = truth[np.ravel_multi_index(tuple(goal), allowed.shape)]
            found = grid.search(allowed, start, goal, depth, penalty, weight)
            if found is None:
                assert math.isinf(expected)
                continue
            check_path(allowed, found[0], start, goal)
            assert expected * (1 - 1e-6) <= found[1] <= weight * expected * (1 + 1e-6)


def test_costs_are_those_of_dijkstra_among_large_bodies():
    allowed = np.ones((24, 22, 16), dtype=bool)
    allowed[6:10, 3:18, :12] = False
    allowed[13:15, :15, 3:] = False
    allowed[18:20, 6:, :10] = False
    moves = graph(allowed)
    grid = GridSearch(allowed.shape)
    rng = np.random.default_rng(6)
    cells = np.argwhere(allowed)
    for start in cells[rng.choice(len(cells), 5)]:
        truth = dijkstra(moves, indices=np.ravel_multi_index(tuple(start), allowed.shape))
        for goal in cells[rng.choice(len(cells), 40)]:
            found = grid.search(allowed, start, goal)
            check_path(allowed, found[0], start, goal)
            assert found[1] == pytest.approx(truth[np.ravel_multi_index(tuple(goal), allowed.shape)], rel=2e-6)


@pytest.mark.parametrize("share", [0.0, 0.05, 0.25])
def test_cover_depth_is_that_of_dijkstra(share):
    free = cluttered(5, (15, 13, 10), share)
    open_sky = free.copy()
    open_sky[2:13, 3:12, :8] = False
    depth = cover_depth(free, open_sky)
    covered = free & ~open_sky
    beside = np.asarray(graph(free)[:, open_sky.ravel()].sum(axis=1)).ravel().reshape(free.shape) > 0
    borders = np.flatnonzero((covered & beside).ravel())
    truth = dijkstra(graph(free, open_sky, 1e6), indices=borders, min_only=True).reshape(free.shape)
    truth[truth > 1e5] = np.inf  # only through the open
    assert np.allclose(depth[covered], truth[covered], rtol=0, atol=2e-2)


def test_cover_depth_is_the_way_to_the_border():
    allowed = np.ones((9, 9, 5), dtype=bool)
    open_sky = allowed.copy()
    open_sky[1:8, 1:8, :4] = False
    depth = cover_depth(allowed, open_sky)
    assert (depth[open_sky] == -1).all()
    assert depth[1, 4, 0] == 0
    assert depth[4, 4, 3] == 0
    assert depth[4, 4, 0] == pytest.approx(3)
    assert depth[3, 4, 0] == pytest.approx(2)


def test_what_has_no_way_out_has_infinite_depth():
    allowed = np.ones((5, 5, 5), dtype=bool)
    allowed[1:4, 1:4, 1:4] = False
    allowed[2, 2, 2] = True
    open_sky = allowed.copy()
    open_sky[2, 2, 2] = False
    assert math.isinf(cover_depth(allowed, open_sky)[2, 2, 2])


def test_a_weight_bounds_the_cost_and_saves_work():
    allowed = np.ones((60, 60, 30), dtype=bool)
    allowed[30, 15:45, :25] = False
    allowed[20, 25:35] = False
    grid = GridSearch(allowed.shape)
    best = grid.search(allowed, (5, 20, 5), (55, 40, 25))
    effort = grid.expanded
    quick = grid.search(allowed, (5, 20, 5), (55, 40, 25), weight=1.3)
    assert best[1] <= quick[1] <= 1.3 * best[1]
    assert grid.expanded < effort / 3


def test_corners_are_not_cut():
    allowed = np.ones((2, 2, 1), dtype=bool)
    allowed[1, 0, 0] = False
    path, cost = GridSearch(allowed.shape).search(allowed, (0, 0, 0), (1, 1, 0))
    assert cost == pytest.approx(2)
    assert path.tolist() == [[0, 0, 0], [0, 1, 0], [1, 1, 0]]


def test_from_a_cell_to_itself():
    allowed = np.ones((3, 3, 3), dtype=bool)
    path, cost = GridSearch(allowed.shape).search(allowed, (1, 1, 1), (1, 1, 1))
    assert (path.tolist(), cost) == ([[1, 1, 1]], 0.0)


def test_ends_that_are_not_allowed_have_no_path():
    allowed = np.ones((3, 3, 3), dtype=bool)
    allowed[0, 0, 0] = False
    grid = GridSearch(allowed.shape)
    assert grid.search(allowed, (0, 0, 0), (2, 2, 2)) is None
    assert grid.search(allowed, (2, 2, 2), (0, 0, 0)) is None


def test_a_long_search_asks_whether_to_go_on():
    allowed = np.ones((100, 100, 60), dtype=bool)
    allowed[50] = False  # no way: all of one half is searched
    calls = []
    assert GridSearch(allowed.shape).search(allowed, (0, 0, 0), (99, 0, 0), poll=lambda: calls.append(1)) is None
    assert len(calls) >= 2

    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        GridSearch(allowed.shape).search(allowed, (0, 0, 0), (99, 0, 0), poll=stop)


def test_the_nearest_of_many_cells_is_the_one_with_the_shortest_path():
    rng = np.random.default_rng(8)
    free = rng.random((14, 12, 10)) < 0.75
    grid = GridSearch(free.shape)
    cells = np.argwhere(free)
    for seed in range(20):
        wanted = np.zeros_like(free)
        some = cells[np.random.default_rng(seed).choice(len(cells), 4)]
        wanted[tuple(some.T)] = True
        start = cells[np.random.default_rng(100 + seed).integers(len(cells))]
        each = [grid.search(free, start, goal) for goal in some]
        shortest = min((found[1] for found in each if found is not None), default=None)
        found = grid.nearest(free, start, wanted)
        if shortest is None:
            assert found is None
            continue
        path, cost = found
        assert path[0].tolist() == start.tolist()
        assert wanted[tuple(path[-1])]
        assert cost == pytest.approx(shortest)


def test_a_start_that_is_wanted_is_its_own_nearest():
    free = np.ones((4, 4, 4), dtype=np.bool_)
    path, cost = GridSearch(free.shape).nearest(free, (1, 2, 3), free)
    assert path.tolist() == [[1, 2, 3]]
    assert cost == 0.0
    assert GridSearch(free.shape).nearest(~free, (1, 2, 3), free) is None
