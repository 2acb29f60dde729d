"""The stated error of a simplified mesh against distances of sampled points, both ways."""

import numpy as np
import pytest
import trimesh

from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.mesh_simplification import planning_mesh, simplify
from gcs.planning.scene.point_distance import SceneDistance, TriangleDistance


def soup(seed, triangles=300, size=0.4):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0, 5, (triangles, 1, 3)) + rng.uniform(-size, size, (triangles, 3, 3))
    return Structure(corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3))


def points_on(triangles, rng, each=40):
    """Random points of every triangle, its corners too; degenerate ones as well."""
    share = rng.dirichlet(np.ones(3), (len(triangles), each))
    share[:, :3] = np.eye(3)
    return np.einsum("fek,fkc->fec", share, triangles).reshape(-1, 3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [0.03, 0.4, 2.0])
@pytest.mark.parametrize("error", [0.05, 0.5])
def test_no_point_is_further_than_stated_either_way(seed, size, error):
    full = soup(seed, size=size)
    simplified = simplify(full, error)
    assert simplified.error_m <= error + 1e-9
    rng = np.random.default_rng(seed)
    there = points_on(full.triangles_m, rng)
    back = points_on(simplified.structure.triangles_m, rng)
    assert TriangleDistance(simplified.structure.triangles_m).distance(there).max() <= simplified.error_m
    assert TriangleDistance(full.triangles_m).distance(back).max() <= simplified.error_m


def test_the_stated_error_is_what_the_vertices_moved():
    full = soup(9)
    simplified = simplify(full, 0.3)
    moved = [np.linalg.norm(simplified.structure.vertices_m - vertex, axis=1).min() for vertex in full.vertices_m]
    assert max(moved) <= simplified.error_m < 0.3
    assert simplified.error_m > 0.1


def test_a_strut_thinner_than_the_cubes_stays_as_a_line():
    strut = trimesh.creation.box((0.02, 0.02, 10)).subdivide_loop(0)
    full = Structure(np.array(strut.vertices) + 0.013, np.array(strut.faces))
    simplified = simplify(full, 0.2)
    places = points_on(full.triangles_m, np.random.default_rng(0), each=200)
    assert TriangleDistance(simplified.structure.triangles_m).distance(places).max() <= simplified.error_m


def test_a_speck_stays_as_a_point():
    full = Structure(
        np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [5, 5, 5], [6, 5, 5], [5, 6, 5.0]]),
        np.array([[0, 1, 2], [3, 4, 5]]),
    )
    simplified = simplify(full, 0.1)
    assert len(simplified.structure.faces) == 2
    assert TriangleDistance(simplified.structure.triangles_m).distance([[0, 0, 0]])[0] <= simplified.error_m


def test_a_fine_surface_becomes_coarse():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=5)
    full = Structure(
        np.array(ball.vertices), np.array(ball.faces), cables=(Cable(from_m=(0, 0, 9), to_m=(9, 0, 9), radius_m=0.1),)
    )
    simplified = simplify(full, 0.5)
    assert simplified.full_triangles == len(full.faces)
    assert len(simplified.structure.faces) < len(full.faces) / 8
    assert simplified.structure.cables == full.cables


def test_each_triangle_is_there_once():
    full = soup(3, size=0.05)
    faces = simplify(full, 0.5).structure.faces
    assert len({tuple(sorted(f)) for f in faces.tolist()}) == len(faces)


def test_a_distance_field_of_it_less_its_error_is_a_lower_bound():
    full = soup(5)
    simplified = simplify(full, 0.3)
    low, high = full.bounds_m + np.array([[-2.0], [2.0]])
    field = build_distance_field(simplified.structure, low, high, 0.25)
    points = np.random.default_rng(1).uniform(low, high, (5000, 3))
    true = SceneDistance(full, None).distance(points)
    assert (field.at(points) - simplified.error_m <= true + 1e-9).all()


def test_small_meshes_and_those_that_gain_little_stay_as_they_are():
    small = soup(0)
    assert planning_mesh(small, 0.05).structure is small
    assert planning_mesh(small, 0.05).error_m == 0
    coarse = soup(1, triangles=200_001, size=2.0)
    assert planning_mesh(coarse, 0.001).structure is coarse
    fine = soup(1, triangles=200_001, size=0.01)
    assert 0 < planning_mesh(fine, 0.2).error_m <= 0.2


def test_map_sized_offsets_do_not_matter():
    full = soup(2)
    moved = Structure(full.vertices_m + np.array([500000, 4649776, 0]), full.faces)
    here, there = simplify(full, 0.2), simplify(moved, 0.2)
    assert len(here.structure.faces) == len(there.structure.faces)
    np.testing.assert_allclose(here.structure.vertices_m, there.structure.vertices_m - [500000, 4649776, 0], atol=1e-7)


def test_impossible_errors_are_refused():
    with pytest.raises(ValueError, match="positive"):
        simplify(soup(0), 0.0)
    with pytest.raises(ValueError, match="too small"):
        simplify(soup(0), 1e-7)
