"""Solids are closed, face outwards and have the volume that they should have."""

import numpy as np
import pytest
import trimesh

from gcs.storage.solid_shapes import beam, box, hexahedron, profile_along, structure_of_solids, tube


def volume(triangles):
    return float(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6)


def is_closed(triangles):
    _, number = np.unique(triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    faces = number.reshape(-1, 3)
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    forward = {tuple(e) for e in edges}
    return len(forward) == len(edges) and all((b, a) in forward for a, b in forward)


START, END = np.array([1.0, 2, 3]), np.array([4.0, -2, 15])
LENGTH = 13.0
SLANTED = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-2, -2, 3), (2, -2, 3), (2, 2, 3), (-2, 2, 3)]
HOURGLASS = [[2.0, 0.0], [1.0, 1.0], [2.0, 3.0]]  # area 3 + 6


@pytest.mark.parametrize(
    ("solid", "wanted"),
    [
        (box([0, -1, 2], [3, 1, 7]), 30),
        (beam(START, END, 0.5, 2.0), LENGTH),
        (beam([0, 0, 0], [0, 0, 4], 0.5, 2.0), 4),
        (tube(START, END, 0.5, 8), LENGTH * 4 * 0.25 * np.sin(np.pi / 4)),
        (tube([0, 0, 9], [0, 0, 1], 1.0, 6), 8 * 3 * np.sin(np.pi / 3)),
        (tube([0, 0, 0], [0, 0, 3], 1.0, 4, end_radius=2.0), 2 + 4 + 8),
        (hexahedron(SLANTED), 3 * (4 + 16 + 8) / 3),
        (profile_along(HOURGLASS, [0, 0, 5], [0, 10, 5]), 90),
        (profile_along(HOURGLASS, [7, 1, 5], [4, 5, 5], pieces=7), 45),
    ],
    ids=["box", "beam", "upright beam", "tube", "tube downwards", "taper", "frustum", "profile", "profile in pieces"],
)
def test_closed_outward_and_of_the_right_volume(solid, wanted):
    assert is_closed(solid)
    assert volume(solid) == pytest.approx(wanted)


def test_a_level_beam_is_as_high_and_wide_as_asked():
    corners = beam([0, 0, 5], [0, 10, 5], 0.4, 2.0).reshape(-1, 3)
    np.testing.assert_allclose(corners.min(axis=0), [-0.2, 0, 4])
    np.testing.assert_allclose(corners.max(axis=0), [0.2, 10, 6])


def test_a_profile_stands_on_its_axis_and_no_triangle_is_longer_than_a_piece():
    triangles = profile_along(HOURGLASS, [0, 0, 5], [0, 10, 5], pieces=5)
    assert len(triangles) == 4 * 2 + 4 * 3 * 5
    np.testing.assert_allclose(triangles.reshape(-1, 3).min(axis=0), [-2, 0, 5])
    np.testing.assert_allclose(triangles.reshape(-1, 3).max(axis=0), [2, 10, 8])
    along = np.ptp(triangles[:, :, 1], axis=1)
    assert along.max() == pytest.approx(2)


def test_tubes_that_go_on_from_each_other_become_one():
    halves = [tube([0, 0, 0], [0, 0, 1], 0.5, 6), tube([0, 0, 1], [0, 0, 3], 0.5, 6)]
    joined = structure_of_solids(halves)
    mesh = trimesh.Trimesh(joined.vertices_m, joined.faces, process=False)
    assert len(joined.faces) == 2 * 4 * 6 - 2 * 6
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(3 * 6 * 0.25 * np.sin(np.pi / 3) / 2)


def test_a_face_given_twice_is_kept_once():
    cube = box([0, 0, 0], [1, 1, 1])
    once = structure_of_solids([cube, cube])
    assert trimesh.Trimesh(once.vertices_m, once.faces, process=False).volume == pytest.approx(1)


def test_solids_that_only_touch_or_overlap_keep_all_their_faces():
    solids = [box([0, 0, 0], [1, 1, 1]), box([1, 0.2, 0], [2, 0.8, 1]), box([0.5, 0.5, 0.5], [3, 3, 3])]
    assert len(structure_of_solids(solids).faces) == 36
