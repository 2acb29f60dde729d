"""Solids are closed, face outwards and have the volume that they should have."""

import numpy as np
import pytest

from gcs.storage.solid_shapes import beam, box, hexahedron, tube


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


@pytest.mark.parametrize(
    ("solid", "wanted"),
    [
        (box([0, -1, 2], [3, 1, 7]), 30),
        (beam(START, END, 0.5, 2.0), LENGTH),
        (beam([0, 0, 0], [0, 0, 4], 0.5, 2.0), 4),
        (tube(START, END, 0.5, 8), LENGTH * 4 * 0.25 * np.sin(np.pi / 4)),
        (tube([0, 0, 9], [0, 0, 1], 1.0, 6), 8 * 3 * np.sin(np.pi / 3)),
        (hexahedron(SLANTED), 3 * (4 + 16 + 8) / 3),
    ],
    ids=["box", "beam", "upright beam", "tube", "tube downwards", "frustum"],
)
def test_closed_outward_and_of_the_right_volume(solid, wanted):
    assert is_closed(solid)
    assert volume(solid) == pytest.approx(wanted)


def test_a_level_beam_is_as_high_and_wide_as_asked():
    corners = beam([0, 0, 5], [0, 10, 5], 0.4, 2.0).reshape(-1, 3)
    np.testing.assert_allclose(corners.min(axis=0), [-0.2, 0, 4])
    np.testing.assert_allclose(corners.max(axis=0), [0.2, 10, 6])
