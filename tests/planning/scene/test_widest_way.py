"""The largest clearance at which a closed-in place can be reached, against chambers whose door is known by hand."""

import numpy as np
import pytest
import trimesh

from gcs.core.structure import Structure
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.free_space import FreeSpace

LOW, HIGH = np.array([-16.0, -16.0, -1.0]), np.array([16.0, 16.0, 20.0])
HOME = np.array([-13.0, -13.0, 0.0])
PITCH = 0.25
MIDDLE = np.array([[0.0, 0.0, 6.0]])


def chamber(door_m):
    """A room of 10 x 10 x 12 m inside with a door in its east wall, as wide and high as is said."""
    half = door_m / 2
    walls = [
        [(-6, -6, 0), (-5, 6, 13)],
        [(-5, -6, 0), (6, -5, 13)],
        [(-5, 5, 0), (6, 6, 13)],
        [(-5, -5, 12), (6, 5, 13)],
        [(5, -5, 0), (6, -half, 12)],
        [(5, half, 0), (6, 5, 12)],
        [(5, -half, 0), (6, half, 6 - half)],
        [(5, -half, 6 + half), (6, half, 12)],
    ]
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(w, dtype=float)) for w in walls])
    return Structure(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))


def space(structure, clearance):
    return FreeSpace(build_distance_field(structure, LOW, HIGH, PITCH), clearance, 0.0, HOME)


@pytest.mark.parametrize("door_m", [2.0, 3.0])
def test_half_of_the_door_is_what_leads_in(door_m):
    structure = chamber(door_m)
    closed = space(structure, 2.0)
    assert not closed.is_reachable(MIDDLE)[0]
    room = closed.largest_clearance_m(MIDDLE)
    assert door_m / 2 - 2 * PITCH <= room <= door_m / 2
    assert space(structure, room).is_reachable(MIDDLE)[0]


def test_the_place_itself_counts():
    room = space(chamber(9.0), 2.0).largest_clearance_m(np.array([[-4.2, 0.0, 6.0]]))
    assert 0.8 - PITCH <= room <= 0.8


def test_no_door_no_way():
    structure = chamber(0.0)
    assert space(structure, 2.0).largest_clearance_m(MIDDLE) == 0.0


def test_the_best_of_several_places_counts():
    wide = space(chamber(3.0), 2.0)
    assert wide.largest_clearance_m(np.array([[-4.8, 0.0, 6.0], *MIDDLE])) == wide.largest_clearance_m(MIDDLE)
