import math

import numpy as np
import pytest

from gcs.core.scenario import Fence, Safety, VehicleSpec
from gcs.planning.scene.fence import fence_volume, room_in_fence

VEHICLE, SAFETY = VehicleSpec(radius_m=0.5), Safety(tracking_m=0.5, position_m=0.3)
SQUARE = ((-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0))
L_SHAPE = ((0.0, 0.0), (30.0, 0.0), (30.0, 10.0), (10.0, 10.0), (10.0, 30.0), (0.0, 30.0))


def room(point, **fence):
    return float(room_in_fence([point], fence_volume(Fence(**fence), VEHICLE, SAFETY))[0])


def test_the_margin_is_hull_and_errors():
    assert fence_volume(None, VEHICLE, SAFETY).margin_m == pytest.approx(1.3)


def test_without_a_fence_all_is_inside():
    assert room_in_fence([[1e4, -1e4, 1e3]], fence_volume(None, VEHICLE, SAFETY))[0] == math.inf


def test_room_to_the_nearest_edge_less_the_margin():
    assert room((4, 0, 5), include=[SQUARE]) == pytest.approx(6 - 1.3)
    assert room((12, 0, 5), include=[SQUARE]) == pytest.approx(-2 - 1.3)
    assert room((13, 14, 5), include=[SQUARE]) == pytest.approx(-5 - 1.3)


def test_a_hole_keeps_its_distance():
    hole = ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0))
    assert room((5, 0, 5), include=[SQUARE], exclude=[hole]) == pytest.approx(3 - 1.3)
    assert room((0, 0, 5), include=[SQUARE], exclude=[hole]) == pytest.approx(-2 - 1.3)


def test_only_an_exclusion_leaves_the_rest_open():
    assert room((100, 0, 5), exclude=[SQUARE]) == pytest.approx(90 - 1.3)


def test_two_included_areas_are_a_union():
    other = ((20.0, -10.0), (40.0, -10.0), (40.0, 10.0), (20.0, 10.0))
    assert room((30, 0, 5), include=[SQUARE, other]) == pytest.approx(10 - 1.3)
    assert room((15, 0, 5), include=[SQUARE, other]) < 0


def test_the_height_limit():
    assert room((0, 0, 100), max_height_m=110) == pytest.approx(10 - 1.3)
    assert room((0, 0, 109), include=[SQUARE], max_height_m=110) == pytest.approx(1 - 1.3)


def test_a_concave_polygon():
    assert room((5, 5, 0), include=[L_SHAPE]) == pytest.approx(5 - 1.3)
    assert room((20, 20, 0), include=[L_SHAPE]) == pytest.approx(-10 - 1.3)


def test_room_never_changes_faster_than_the_point_moves():
    fence = fence_volume(Fence(include=[SQUARE, L_SHAPE], exclude=[SQUARE[:3]], max_height_m=20), VEHICLE, SAFETY)
    rng = np.random.default_rng(0)
    a, b = rng.uniform(-20, 40, (5000, 3)), rng.uniform(-20, 40, (5000, 3))
    change = np.abs(room_in_fence(a, fence) - room_in_fence(b, fence))
    assert (change <= np.linalg.norm(a - b, axis=1) + 1e-9).all()
