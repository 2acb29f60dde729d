"""The binarised map: places, what growing it promises, and bad maps."""

import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.local.binary_map import BinaryMap, mark_about


def test_points_and_cells_are_each_others_inverse(room):
    points = np.random.default_rng(0).uniform(-9, 9, (20, 3))
    assert np.allclose(room.points_m(room.cells(points)), points)
    assert room.is_blocked((0.0, 0.0, 7.9))
    assert not room.is_blocked((0.0, 0.0, 8.1))
    assert room.is_blocked((10.1, 0.0, 9.0))


@pytest.mark.parametrize("axes", [2, 3])
def test_every_point_of_a_free_cell_keeps_the_distance(axes):
    rng = np.random.default_rng(axes)
    blocked = rng.random((12,) * axes) < 0.01
    blocked[(5,) * axes] = True
    grown = BinaryMap(blocked, np.zeros(axes), 0.5).grown(1.1)
    low = 0.5 * np.argwhere(blocked)
    points = rng.uniform(0.0, 6.0, (20_000, axes))
    nearest = np.maximum(np.maximum(low - points[:, None], points[:, None] - low - 0.5), 0.0)
    away = np.linalg.norm(nearest, axis=2).min(axis=1)
    free = np.array([not grown.is_blocked(point) for point in points])
    assert away[free].min() >= 1.1
    # Nor is more blocked than the two cells' diagonals make unsure.
    assert away[~free].max() <= 1.1 + 2 * 0.5 * math.sqrt(axes)


@pytest.mark.parametrize("seed", range(20))
def test_what_is_marked_about_a_straight_is_nearer_than_the_reach(seed):
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-6.0, 26.0, 2), rng.uniform(-6.0, 26.0, 2)
    if seed == 0:
        end = start.copy()
    marked, reach = np.zeros((20, 16), dtype=np.bool_), rng.uniform(0.5, 9.0)
    mark_about(marked, start, end, reach)
    along = start + np.linspace(0.0, 1.0, 5001)[:, None] * (end - start)
    middles = np.argwhere(np.ones_like(marked)) + 0.5
    away = np.linalg.norm(middles[:, None] - along, axis=2).min(axis=1).reshape(marked.shape)
    sure = np.abs(away - reach) > 0.01
    assert (marked == (away < reach))[sure].all()


def test_growing_by_nothing_changes_nothing(paper_map):
    assert (paper_map.grown(0.0).blocked == paper_map.blocked).all()


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: BinaryMap(np.zeros(4, dtype=np.bool_), np.zeros(1), 1.0), "blocked"),
        (lambda: BinaryMap(np.zeros((0, 4), dtype=np.bool_), np.zeros(2), 1.0), "blocked"),
        (lambda: BinaryMap(np.zeros((4, 4), dtype=np.bool_), np.zeros(3), 1.0), "origin_m"),
        (lambda: BinaryMap(np.zeros((4, 4), dtype=np.bool_), np.zeros(2), 0.0), "cell_m"),
        (lambda: BinaryMap(np.zeros((4, 4), dtype=np.bool_), np.zeros(2), 1.0).grown(math.nan), "R"),
    ],
)
def test_bad_maps_are_refused(make, field):
    with pytest.raises(InputError) as error:
        make()
    assert error.value.field == field


def test_the_room_at_a_point_is_how_far_the_map_can_grow(paper_map):
    for point in ((10.0, 29.0), (17.3, 20.1), (30.0, 40.0)):
        room = paper_map.room_m(point)
        assert room > 2.0
        assert not paper_map.grown(room).is_blocked(point)
        assert paper_map.grown(room + 1e-3).is_blocked(point)
    assert paper_map.room_m((22.0, 30.0)) < 0
    assert BinaryMap(np.zeros((3, 3), dtype=np.bool_), np.zeros(2), 1.0).room_m((1.0, 1.0)) == math.inf
