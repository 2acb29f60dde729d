import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gcs.core.errors import InputError
from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.scene.distance_field import build_distance_field, choose_pitch

LOW, HIGH = np.array([-10.0, -9.0, -8.0]), np.array([10.0, 9.0, 8.0])


def brute_force(structure, points):
    """Exact distances with trimesh's closest point and, for cables, plain point-to-segment distance."""
    best = np.full(len(points), np.inf)
    for triangle in structure.triangles_m:
        closest = trimesh.triangles.closest_point(np.repeat(triangle[None], len(points), axis=0), points)
        best = np.minimum(best, np.linalg.norm(closest - points, axis=1))
    for (a, b), radius in zip(structure.cable_ends_m, structure.cable_radii_m, strict=True):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        best = np.minimum(best, np.maximum(np.linalg.norm(points - a - t[:, None] * (b - a), axis=1) - radius, 0))
    return best


def scattered_structure(seed, cables=()):
    """Slivers, large and tiny triangles, a tilted plate."""
    rng = np.random.default_rng(seed)
    plate = Rotation.random(random_state=seed).apply([[-5, -3, 0], [5, -3, 0], [0, 4, 0]])
    sliver = np.array([[-6, -6, -6], [6, 6, 6], [6, 6.001, 6]])
    small = rng.uniform(-5, 5, (6, 1, 3)) + rng.normal(0, 0.05, (6, 3, 3))
    triangles = np.concatenate([plate[None], sliver[None], small])
    return Structure(triangles.reshape(-1, 3), np.arange(len(triangles) * 3).reshape(-1, 3), tuple(cables))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("pitch", [0.4, 0.9])
def test_it_is_a_lower_bound_everywhere_and_tight_at_centres(seed, pitch):
    structure = scattered_structure(seed, [Cable(from_m=(-8, 0, 5), to_m=(8, 3, -5), radius_m=0.3)])
    field = build_distance_field(structure, LOW, HIGH, pitch)
    rng = np.random.default_rng(seed)
    points = rng.uniform(LOW, HIGH - 1e-6, (3000, 3))
    assert (field.at(points) <= brute_force(structure, points) + 1e-9).all()
    cells = np.array([rng.integers(0, n, 3000) for n in field.distance_m.shape]).T
    exact = brute_force(structure, field.origin_m + (cells + 0.5) * pitch)
    bound = field.distance_m[tuple(cells.T)]
    assert (bound <= exact).all()
    assert (exact <= bound + field.looseness_m + 1e-3).all()


def test_a_thick_cable_alone_is_seen():
    triangle = np.array([[-9.0, -8, -7], [-9, -8, -6.9], [-9, -7.9, -7]])
    structure = Structure(triangle, np.array([[0, 1, 2]]), (Cable(from_m=(0, 0, -6), to_m=(0, 0, 6), radius_m=1.5),))
    field = build_distance_field(structure, LOW, HIGH, 0.5)
    assert field.at([[0.9, 0.0, 0.0]])[0] == 0.0
    assert 5.0 < field.at([[8.0, 0.0, 0.0]])[0] <= 6.5


def test_outside_the_grid_nothing_is_promised():
    field = build_distance_field(scattered_structure(0), LOW, HIGH, 1.0)
    assert field.at([[50.0, 0, 0], [0, 0, -20]]).tolist() == [0.0, 0.0]


def test_a_structure_that_reaches_out_of_the_volume_is_refused():
    with pytest.raises(InputError, match="reaches out"):
        build_distance_field(scattered_structure(0), LOW, HIGH - 5, 1.0)


def test_a_cancel_is_obeyed():
    class Cancelled(Exception):
        pass

    class Stop:
        def report(self, stage, fraction):
            assert stage == "distance_field"
            if fraction > 0.1:
                raise Cancelled

    with pytest.raises(Cancelled):
        build_distance_field(scattered_structure(0), LOW, HIGH, 1.0, Stop())


@pytest.mark.parametrize(
    ("size", "clearance", "expected"),
    [((10, 10, 10), 3.0, 0.25), ((100, 50, 100), 3.0, 0.5), ((200, 200, 100), 3.0, 1.0), ((400, 400, 150), 3.0, 1.26)],
)
def test_the_pitch_follows_the_volume(size, clearance, expected):
    pitch = choose_pitch((0, 0, 0), size, clearance)
    assert pitch == pytest.approx(expected, abs=0.01)
    assert np.prod(np.array(size) / pitch) <= 12.1e6


def test_little_clearance_asks_for_a_finer_grid():
    assert choose_pitch((0, 0, 0), (100, 50, 100), 1.2) == pytest.approx(0.4)
