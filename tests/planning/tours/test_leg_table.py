"""Legs are searched when they are asked for; before that, straight lines stand in for them."""

import itertools

import numpy as np
import pytest
import trimesh

from gcs.core.progress import SilentProgress
from gcs.core.structure import Structure
from gcs.planning.paths.string_pulling import path_length
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.free_space import FreeSpace
from gcs.planning.tours.leg_table import LegTable
from gcs.planning.tours.run_exchange import HOME

LOW, HIGH = np.array([-20.0, -20.0, -1.0]), np.array([20.0, 20.0, 20.0])
HOME_M = np.array([-15.0, 0.0, 0.0])
STOPS_M = np.array([[-8.0, 0.0, 5.0], [8.0, 0.0, 5.0], [0.0, 9.0, 5.0]])


@pytest.fixture
def table():
    """A wall stands between stops 0 and 1; energy is the length of the way up and twice that of the way down."""
    wall = trimesh.creation.box(bounds=np.array([[-1.0, -6.0, 0.0], [1.0, 6.0, 12.0]]))
    structure = Structure(np.array(wall.vertices, float), np.array(wall.faces, np.int64))
    space = FreeSpace(build_distance_field(structure, LOW, HIGH, 0.5), 1.5, 0.0, HOME_M)

    def energy_wh(path):
        climb = float(path[-1, 2] - path[0, 2])
        return path_length(path) * (1.0 if climb >= 0 else 2.0)

    return LegTable(space, HOME_M, STOPS_M, path_length, energy_wh, SilentProgress())


def test_the_straight_line_counts_until_the_way_is_searched(table):
    straight = float(np.linalg.norm(STOPS_M[0] - STOPS_M[1]))
    assert not table.is_searched(0, 1)
    assert table.least_cost(0, 1) == table.least_energy_wh(0, 1) == pytest.approx(straight)
    cost = table.leg(0, 1).cost
    assert cost > straight + 1.0
    assert table.is_searched(1, 0)
    assert table.least_cost(0, 1) == table.least_cost(1, 0) == pytest.approx(cost)


def test_the_way_back_is_the_same_way_and_may_take_another_energy(table):
    out, back = table.leg(HOME, 0), table.leg(0, HOME)
    np.testing.assert_array_equal(out.path_m, back.path_m[::-1])
    assert back.energy_wh == pytest.approx(2 * out.energy_wh)
    assert table.least_energy_wh(0, HOME) == back.energy_wh


def test_a_search_tells_whether_it_had_to(table):
    run = [2, 1]
    before = table.least_run_cost(run), table.least_run_energy_wh(run)
    assert table.search(run)
    assert not table.search(run)
    assert not table.search([1, 2])
    assert before[0] <= table.least_run_cost(run) == pytest.approx(table.cost(run))
    assert before[1] <= table.least_run_energy_wh(run) == pytest.approx(table.energy_wh(run))


def test_the_matrix_has_the_costs_of_all_pairs(table):
    table.leg(0, 1)
    costs = table.least_costs(lambda steps: np.linalg.norm(steps, axis=-1))
    assert costs.shape == (4, 4)
    for a, b in itertools.product(range(-1, 3), repeat=2):
        assert costs[a, b] == pytest.approx(table.least_cost(a, b))
