"""Which sides can be seen from somewhere: a box from outside, and not from below when the camera cannot look up."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.picture_kernels import PictureLimits
from gcs.planning.views.seeable_sides import find_seeable, joined
from gcs.planning.views.surface_candidates import Targets
from gcs.planning.views.surface_samples import sample_surface

NEAREST, FURTHEST = 2.0, 10.0


class Room:
    """Everything within a grid is free, but for the tower and for cells that are said to be not."""

    def __init__(self, blocked=lambda centres: np.zeros(len(centres), bool), exact=None):
        self.pitch_m, self.low_m = 0.5, np.array([-20.0, -20, -20])
        centres = self.low_m + 0.5 * (np.indices((80, 80, 120)).reshape(3, -1).T + 0.5)
        inside = (np.abs(centres[:, :2]) < 4).all(axis=1) & (centres[:, 2] > 0) & (centres[:, 2] < 24)
        self.reachable_mask = ~(blocked(centres) | inside).reshape(80, 80, 120)
        self._exact = exact

    def is_reachable(self, points):
        outside = (np.abs(points[:, :2]) > 4).any(axis=1) | (points[:, 2] < 0) | (points[:, 2] > 24)
        return outside if self._exact is None else outside & self._exact(points)


def limits(**changes):
    plain = SimpleNamespace(least_cosine=0.5, pitch_low=-math.pi / 2, pitch_high=math.pi / 2)
    fields = dict.fromkeys(PictureLimits._fields, 0.0) | vars(plain) | changes
    return PictureLimits(**fields)


@pytest.fixture(scope="module")
def sides(tower):
    samples = sample_surface(tower, 2000, np.random.default_rng(0))
    # at an edge the inner side's place above it may stick out
    apart = np.abs(np.abs(samples.points_m - [0, 0, 12]) - [4, 4, 12])
    return samples[np.sort(apart, axis=1)[:, 1] > 0.01]


def seeable(tower, sides, room, limits_):
    sight = SightLines(tower)
    return (
        find_seeable(
            Targets.of(sides, sight.middle_m), NEAREST, FURTHEST, limits_, room, sight, np.random.default_rng(1),
            lambda share: None,
        ),
        sight,
    )  # fmt: skip


def outer(sides):
    return np.einsum("ij,ij->i", sides.points_m - [0, 0, 12], sides.normals) > 0


def test_a_box_is_seen_from_outside(tower, sides):
    found, sight = seeable(tower, sides, Room(), limits())
    np.testing.assert_array_equal(found.which, np.flatnonzero(outer(sides)))
    assert found.times.mean() > 3.5
    places, which = found.places + sight.middle_m, found.which[found.seen]
    assert sight.clear(places, sides.lifted_m[which]).all()
    way = places - sides.points_m[which]
    far = np.linalg.norm(way, axis=1)
    assert far.min() >= NEAREST - 1e-3
    assert far.max() <= FURTHEST + 1e-3
    assert ((way * sides.normals[which]).sum(axis=1) >= 0.5 * far).all()
    assert set(found.seen.tolist()) == set(range(len(found.which)))


def test_a_camera_that_cannot_look_up_sees_nothing_from_below(tower, sides):
    found, _ = seeable(tower, sides, Room(), limits(pitch_high=math.radians(20)))
    below = sides.normals[:, 2] < -0.5
    np.testing.assert_array_equal(found.which, np.flatnonzero(outer(sides) & ~below))


def test_only_reachable_places_count(tower, sides):
    east_only = Room(blocked=lambda centres: centres[:, 0] < 5, exact=lambda points: points[:, 0] >= 5)
    found, sight = seeable(tower, sides, east_only, limits())
    assert (found.places[:, 0] + sight.middle_m[0] >= 5).all()
    assert (sides.normals[found.which, 0] > -0.5).all()
    east = outer(sides) & (sides.normals[:, 0] > 0.5)
    assert np.isin(np.flatnonzero(east), found.which).all()


def test_places_beside_the_grid_s_cells_are_judged_exactly(tower, sides):
    # no cell above x = 7 is free, but the exact answer allows places up to x = 8
    room = Room(blocked=lambda centres: (centres[:, 0] > 7) | (centres[:, 0] < 0), exact=lambda p: p[:, 0] < 8)
    found, sight = seeable(tower, sides, room, limits())
    x = found.places[:, 0] + sight.middle_m[0]
    assert x.max() < 8


def test_nothing_is_seen_where_no_place_is_free(tower, sides):
    found, _ = seeable(tower, sides, Room(blocked=lambda centres: np.ones(len(centres), bool)), limits())
    assert len(found.which) == len(found.places) == 0


def test_two_findings_are_joined(tower, sides):
    found, _ = seeable(tower, sides, Room(), limits())
    both = joined(found, found)
    n = len(found.which)
    np.testing.assert_array_equal(both.times, np.tile(found.times, 2))
    np.testing.assert_array_equal(both.seen[len(found.seen) :], found.seen + n)
