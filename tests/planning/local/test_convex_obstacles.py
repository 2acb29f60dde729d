"""Convex obstacles: what is refused, and touching against entering."""

import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.local.convex_obstacles import TOUCH_M, ConvexObstacles, clear_of_polygons, inside_polygons

SQUARE = [(0, 0), (2, 0), (2, 2), (0, 2)]


def test_the_sense_of_rotation_does_not_matter():
    for polygon in (SQUARE, SQUARE[::-1]):
        packed = ConvexObstacles.of([polygon]).packed
        assert inside_polygons(1.0, 1.0, packed, TOUCH_M)
        assert not inside_polygons(2.0, 1.0, packed, TOUCH_M)
        assert not inside_polygons(3.0, 1.0, packed, TOUCH_M)


@pytest.mark.parametrize(
    "bad",
    [
        [(0, 0), (1, 0)],
        [(0, 0), (1, 0), (2, 0)],
        [(0, 0), (2, 0), (1, 0.5), (1, 2)],
        [(0, 0), (1, 0), (math.nan, 1)],
        [(math.cos(4 * math.pi * k / 5), math.sin(4 * math.pi * k / 5)) for k in range(5)],
        [(0, 0, 0), (1, 0, 0), (1, 1, 0)],
    ],
    ids=["two corners", "in a line", "notch", "NaN", "star", "three axes"],
)
def test_what_is_no_convex_polygon_is_refused_by_its_number(bad):
    with pytest.raises(InputError, match="obstacle 1:"):
        ConvexObstacles.of([SQUARE, bad])


@pytest.mark.parametrize(
    ("a", "b", "clear"),
    [
        ((-1, 0), (3, 0), True),
        ((-1, 1e-6), (3, 1e-6), False),
        ((-1, 1), (1, 3), True),
        ((-1, 0.9), (1, 2.9), False),
        ((0.5, 0.5), (1.5, 1.5), False),
        ((-1, 1), (-0.1, 1), True),
        ((3, 3), (3, 3), True),
    ],
)
def test_a_straight_may_touch_but_not_enter(a, b, clear):
    packed = ConvexObstacles.of([SQUARE]).packed
    for one, other in ((a, b), (b, a)):
        assert clear_of_polygons(*map(float, one + other), packed) == clear


def test_the_planes_are_those_of_the_edges():
    packed = ConvexObstacles.of([SQUARE]).packed
    assert np.allclose(packed.planes, [(0, -1, 0), (1, 0, 2), (0, 1, 2), (-1, 0, 0)])
