"""The remembered path: straightened, loops cut, given up when full."""

import numpy as np
import pytest

from sitl_mocks.path_memory import SAVE_S, PathMemory, without_loops


def fly(memory, *points, step_m=0.5):
    """Fly straight from point to point; False as soon as the memory is full."""
    for a, b in zip(np.array(points[:-1], float), np.array(points[1:], float), strict=True):
        count = int(np.ceil(np.linalg.norm(b - a) / step_m))
        for k in range(count):
            if not memory.watch(a + (k + 1) / count * (b - a), SAVE_S):
                return False
    return True


def test_the_way_back_is_the_way_there_with_few_points():
    memory = PathMemory(np.zeros(3), 1.0, 300)
    corners = [[0, 0, 0], [0, 0, 30], [60, 0, 30], [60, 40, 30], [60, 40, 8]]
    assert fly(memory, *corners)
    way = np.array(memory.way_back(np.array([60.0, 40, 8])))
    assert len(way) < 20
    assert way[-1] == pytest.approx([0, 0, 0])
    for corner in corners[:-1]:
        assert np.linalg.norm(way - corner, axis=1).min() < 1.1
    assert memory.usable


def test_a_full_memory_is_given_up():
    memory = PathMemory(np.zeros(3), 1.0, 30)
    t = np.linspace(0, 20 * np.pi, 2000)
    assert not fly(memory, *np.column_stack([20 * np.cos(t), 20 * np.sin(t), 3 * t]))
    assert not memory.usable


def test_a_loop_is_cut_where_the_path_meets_itself():
    path = np.array([[0, 0, 0], [0, 0, 10], [20, 0, 10], [20, 20, 10], [5, 20, 10], [5, 0.4, 10], [5, -20, 10]], float)
    cut = without_loops(path, 0.99)
    assert len(cut) == 4
    assert cut[2] == pytest.approx([5.0, 0.0, 10.0], abs=0.5)
    assert cut[-1] == pytest.approx(path[-1])
    assert len(without_loops(path + np.array([0, 0, 1.5]) * (np.arange(7) > 3)[:, None], 0.99)) == 7


def test_nearest_pieces_against_brute_force():
    rng = np.random.default_rng(5)
    share = np.linspace(0, 1, 201)
    for _ in range(40):
        path = rng.uniform(-5, 5, (4, 3))
        dense = [path[k] + share[:, None] * (path[k + 1] - path[k]) for k in (0, 2)]
        apart = np.linalg.norm(dense[0][:, None] - dense[1], axis=-1).min()
        assert len(without_loops(path, apart - 0.06)) == 4
        assert len(without_loops(path, apart + 0.01)) == 3
