import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError
from gcs.core.scenario import Fence, Safety, VehicleSpec
from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.fence import fence_volume, room_in_fence
from gcs.planning.scene.free_space import FreeSpace

CLEARANCE = 1.6
LOW, HIGH = np.array([-20.0, -20.0, -1.0]), np.array([20.0, 20.0, 30.0])
HOME = np.array([-15.3, -14.8, 0.0])


def boxes(*corners, cables=()):
    meshes = [trimesh.creation.box(bounds=np.array(c, dtype=float)) for c in corners]
    mesh = trimesh.util.concatenate(meshes)
    return Structure(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64), tuple(cables))


GANTRY = boxes(
    [(-8, -2, 0), (-6, 2, 14)],
    [(6, -2, 0), (8, 2, 14)],
    [(-8, -2, 12), (8, 2, 14)],
    cables=[Cable(from_m=(0, 0, 14), to_m=(15, 8, 0.5), radius_m=0.1)],
)


def space_about(structure, pitch=0.5, ground=0.0, home=HOME, fence=None, clearance=CLEARANCE, **more):
    return FreeSpace(build_distance_field(structure, LOW, HIGH, pitch), clearance, ground, home, fence, **more)


@pytest.fixture(scope="module")
def gantry():
    return space_about(GANTRY)


def true_distance(structure, points):
    best = np.full(len(points), np.inf)
    for triangle in structure.triangles_m:
        closest = trimesh.triangles.closest_point(np.repeat(triangle[None], len(points), axis=0), points)
        best = np.minimum(best, np.linalg.norm(closest - points, axis=1))
    for (a, b), radius in zip(structure.cable_ends_m, structure.cable_radii_m, strict=True):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1) - radius)
    return best


def keeps_all(points, home=HOME):
    over_home = np.linalg.norm(points[:, :2] - home[:2], axis=1) <= 0.5
    ground_kept = (points[:, 2] >= CLEARANCE - 1e-9) | (over_home & (points[:, 2] >= home[2] - 0.1))
    return (true_distance(GANTRY, points) >= CLEARANCE - 1e-9) & ground_kept


def along(a, b, count=200):
    return a + np.linspace(0, 1, count)[:, None] * (b - a)


def test_points_are_judged_exactly(gantry):
    points = np.random.default_rng(0).uniform(LOW, HIGH, (8000, 3))
    free = gantry.is_free(points)
    assert keeps_all(points[free]).all()
    assert not free.all()
    roomy = (true_distance(GANTRY, points) >= CLEARANCE + 0.051) & (points[:, 2] >= CLEARANCE + 0.051)
    assert free[roomy].all()


def test_free_segments_keep_the_distance_all_along(gantry):
    rng = np.random.default_rng(1)
    a, b = rng.uniform(LOW, HIGH, (2, 400, 3))
    free = gantry.segments_free(a, b)
    assert 0.2 < free.mean() < 0.9
    for p, q in zip(a[free], b[free], strict=True):
        assert keeps_all(along(p, q)).all()


def test_segments_with_room_are_free(gantry):
    rng = np.random.default_rng(2)
    a, b = rng.uniform(LOW, HIGH, (2, 250, 3))
    free = gantry.segments_free(a, b)
    for p, q in zip(a[~free], b[~free], strict=True):
        line = along(p, q, 1000)
        assert min(true_distance(GANTRY, line).min(), line[:, 2].min()) < CLEARANCE + 0.051


def test_strictly_free_segments_pass_in_parts_and_backwards(gantry):
    rng = np.random.default_rng(3)
    a, b = rng.uniform((-12, -6, 2), (12, 6, 18), (2, 4000, 3))
    strict = gantry.segments_free(a, b, strict=True)
    a, b = a[strict], b[strict]
    assert len(a) > 100
    assert gantry.segments_free(b, a).all()
    s, t = rng.random((2, len(a), 1))
    assert gantry.segments_free(a + s * (b - a), a + t * (b - a)).all()


def test_steps_between_free_face_neighbours_are_proved(gantry):
    free = gantry.free_mask
    rng = np.random.default_rng(4)
    for axis in range(3):
        both = free & np.roll(free, -1, axis=axis)
        both[tuple(slice(-1, None) if k == axis else slice(None) for k in range(3))] = False
        tight = both & (gantry.model.distance < CLEARANCE + 1.0)
        cells = np.argwhere(tight)
        cells = cells[rng.choice(len(cells), 300)]
        step = np.eye(3, dtype=int)[axis]
        a, b = gantry.centre_of(cells), gantry.centre_of(cells + step)
        assert gantry.segments_free(a, b, strict=True).all()


def test_little_more_than_half_a_pitch_is_lost_on_the_grid(gantry):
    cells = np.argwhere(np.ones_like(gantry.free_mask))
    centres = gantry.centre_of(cells)
    near = np.flatnonzero(np.abs(true_bound(centres) - CLEARANCE) < 2.0)
    near = np.random.default_rng(5).choice(near, 4000)
    kept = np.minimum(true_distance(GANTRY, centres[near]), centres[near, 2])
    free = gantry.free_mask[tuple(cells[near].T)]
    needed = CLEARANCE + gantry.pitch_m / 2 + gantry.model.tolerance
    assert (kept[free] >= needed - 1e-3).all()
    assert free[kept >= needed + 1e-3].all()


def true_bound(centres):
    """Cheap distance to the gantry's bounding box, to pick cells near it."""
    low, high = GANTRY.bounds_m
    return np.linalg.norm(np.maximum(np.maximum(low - centres, centres - high), 0), axis=1)


def test_the_column_over_home_reaches_the_ground(gantry):
    column = HOME + np.array([[0, 0, 0], [0, 0, 0.5], [0.4, 0, 0.3], [0, 0, 3]])
    assert gantry.is_free(column).all()
    assert gantry.is_reachable(column).all()
    assert not gantry.is_free(HOME + np.array([[0.6, 0, 0.3], [0, 0, -0.3]])).any()
    assert gantry.segment_free(HOME, gantry.take_off_m)
    assert not gantry.segment_free(HOME, HOME + np.array([4.0, 0, 3.0]))
    assert gantry.take_off_m[:2].tolist() == HOME[:2].tolist()
    assert gantry.take_off_m[2] >= CLEARANCE


def test_outside_the_grid_is_not_free(gantry):
    outside = np.array([[-25.0, 0, 10], [0, 0, 31], [0, 30, 5]])
    assert not gantry.is_free(outside).any()
    assert not gantry.is_reachable(outside).any()
    assert not gantry.is_open_sky(outside).any()
    assert not gantry.segment_free([-15, 0, 10], [-25, 0, 10])


def test_under_the_girder_there_is_no_open_sky(gantry):
    assert not gantry.is_open_sky([[0, 0, 5], [7, 0, 5]]).any()
    assert gantry.is_open_sky([[0, 0, 20], [0, 10, 5], HOME]).all()


def test_open_sky_means_that_the_climb_is_clear(gantry):
    points = np.random.default_rng(6).uniform(LOW, HIGH, (3000, 3))
    points = points[gantry.is_open_sky(points) & gantry.is_free(points)]
    for p in points[:400]:
        assert true_distance(GANTRY, along(p, np.array([p[0], p[1], 60.0]))).min() >= CLEARANCE - 1e-9


def test_a_smaller_climb_clearance_opens_more_sky(gantry):
    wide = space_about(GANTRY, climb_clearance_m=CLEARANCE - 0.8)
    assert (wide.open_sky_mask | ~gantry.open_sky_mask).all()
    beside = np.array([[0.0, -2 - CLEARANCE - 0.1, 5.0]])
    assert wide.is_open_sky(beside)[0]
    assert not gantry.is_open_sky(beside)[0]
    assert wide.is_free(beside)[0]


def test_a_closed_room_is_free_but_not_reachable():
    hollow = boxes([(-6, -6, 0), (6, 6, 12)])
    space = space_about(hollow)
    assert space.is_free([[0, 0, 6]])[0]
    assert not space.is_reachable([[0, 0, 6]])[0]
    assert space.is_reachable([[0, 10, 6]])[0]


def test_the_fence_holds_for_points_cells_and_segments():
    fence = fence_volume(
        Fence(include=[[(-19, -19), (19, -19), (19, 19), (-19, 19)]], max_height_m=25), VehicleSpec(), Safety()
    )
    space = space_about(GANTRY, fence=fence)
    points = np.random.default_rng(7).uniform(LOW, HIGH, (5000, 3))
    for inside in (points[space.is_free(points)], space.centre_of(np.argwhere(space.free_mask))):
        assert (room_in_fence(inside, fence) >= 0).all()
    assert not space.segment_free([-15, -15, 5], [-18.5, -15, 5])
    assert space.is_open_sky([[0, 15, 20]])[0], "the height limit is no roof"


@pytest.mark.parametrize(
    ("home", "words"),
    [
        ((-7.0, 0.0, 5.0), "too near"),
        ((-9.0, 0.0, 0.0), "too near"),
        ((-15.0, -15.0, -0.5), "below the ground"),
        ((-17.9, 0.0, 0.0), "fence"),
        ((-40.0, 0.0, 0.0), "planning volume"),
        ((0.0, 0.0, 0.0), "no free way up"),
    ],
)
def test_a_bad_home_is_named(home, words):
    fence = fence_volume(Fence(include=[[(-19, -19), (19, -19), (19, 19), (-19, 19)]]), VehicleSpec(), Safety())
    low_roof = boxes([(-8, -2, 0), (-6, 2, 14)], [(-4, -4, 2.5), (4, 4, 3)])
    with pytest.raises(InputError, match=words) as caught:
        space_about(low_roof, home=home, fence=fence)
    assert caught.value.field == "home_m"


def test_a_home_that_is_walled_in_is_named():
    with pytest.raises(InputError, match="enclosed") as caught:
        space_about(boxes([(-8, -8, -0.5), (8, 8, 12)]), home=(0.0, 0.0, 3.0), ground=None)
    assert caught.value.field == "home_m"


def test_without_a_ground_the_flight_still_starts_vertically():
    space = space_about(GANTRY, ground=None, home=(-15.0, -15.0, 2.0))
    assert space.take_off_m[2] > 2.0
    assert space.is_reachable([[-15.0, -15.0, 2.0], [-10.0, -15.0, 1.0]]).all()
