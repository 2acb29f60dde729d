"""Equal vertices, repeated and degenerate triangles against what was put in."""

import numpy as np
import pytest

from gcs.storage.mesh_cleaning import clean_mesh, distinct_rows, is_degenerate


def triangles(mesh):
    return {tuple(sorted(map(tuple, t))) for t in mesh.vertices[mesh.faces].tolist()}


def grid(n=12):
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = (k.reshape(-1) for k in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack([x, y, x * y / 7], -1).reshape(-1, 3).astype(float), faces


def test_a_soup_of_corners_is_welded_and_keeps_its_triangles():
    vertices, faces = grid()
    soup = vertices[faces].reshape(-1, 3)
    mesh = clean_mesh(soup, np.arange(len(soup)).reshape(-1, 3))
    assert len(mesh.vertices) == len(vertices)
    assert (mesh.degenerate, mesh.duplicates) == (0, 0)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], soup.reshape(-1, 3, 3))


def test_repeated_triangles_are_dropped_whichever_way_round():
    vertices, faces = grid()
    more = np.concatenate([faces, faces[5:9][:, [1, 2, 0]], faces[20:23][:, ::-1]])
    soup = vertices[more].reshape(-1, 3)
    mesh = clean_mesh(soup, np.arange(len(soup)).reshape(-1, 3))
    assert mesh.duplicates == 7
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], vertices[faces])


def test_lines_and_points_are_dropped_and_their_vertices_with_them():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9], [2, 0, 0], [np.nan, 0, 0]])
    mesh = clean_mesh(vertices, np.array([[0, 1, 2], [3, 3, 3], [0, 1, 1], [0, 1, 4]]))
    assert (mesh.degenerate, mesh.duplicates) == (3, 0)
    assert triangles(mesh) == {((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))}
    assert len(mesh.vertices) == 3


def test_minus_zero_is_zero():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, -0.0], [0, 0, 1.0]])
    assert len(clean_mesh(vertices, np.array([[0, 1, 2], [3, 1, 4]])).vertices) == 4


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_degenerate_does_not_depend_on_units(scale):
    vertices = scale * np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0], [0.5, 1e-10, 0]])
    assert is_degenerate(vertices, np.array([[0, 1, 2], [0, 1, 3]])).tolist() == [False, True]


def test_rows_are_told_as_by_brute_force(monkeypatch):
    rng = np.random.default_rng(0)
    rows = rng.integers(0, 6, (800, 3)).astype(np.uint64)
    kinds: dict[tuple[int, ...], int] = {}
    expected = [kinds.setdefault(tuple(row), len(kinds)) for row in rows.tolist()]
    first, number = distinct_rows(rows)
    assert number.tolist() == expected
    assert [tuple(row) for row in rows[first].tolist()] == list(kinds)
    monkeypatch.setattr("gcs.storage.mesh_cleaning._ODD", (0, 0, 0))  # every row has the same key
    again, same_number = distinct_rows(rows)
    assert again.tolist() == first.tolist()
    assert same_number.tolist() == expected
