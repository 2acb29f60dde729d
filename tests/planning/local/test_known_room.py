"""What the known structure forbids: cells at the vehicle's height, curves at theirs, and columns; never the plan."""

import numpy as np
import pytest

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.known_room import KnownRoom

CELL = 0.5


def straight(start, end, seconds=10.0):
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 0] = start
    coefficients[0, 1] = np.subtract(end, start)
    return PiecewisePolynomial(coefficients, np.array([seconds]))


def beam():
    """20 m x 20 m x 10 m; a beam from 4 to 6 m high runs along y between x = 4 and 6 m."""
    blocked = np.zeros((40, 40, 20), dtype=np.bool_)
    blocked[28:32, :, 8:12] = True
    return BinaryMap(blocked, np.array([-10.0, -10.0, 0.0]), CELL)


PLAN = straight((-9.0, 0.0, 5.0), (9.0, 0.0, 5.0))  # through the beam, at y = 0
SEEN = BinaryMap(np.zeros((60, 60), dtype=np.bool_), np.array([-12.0, -12.0]), 0.4)


def forbidden_at(place, point):
    room = KnownRoom(beam(), PLAN)
    cell = np.floor(SEEN.cells(point)).astype(int)
    return bool(room.forbidden(SEEN, np.asarray(place, dtype=float))[tuple(cell)])


@pytest.mark.parametrize(
    ("height", "point", "expected"),
    [
        (5.0, (5.0, 5.0), True),  # the beam
        (5.0, (3.0, 5.0), False),
        (2.0, (5.0, 5.0), False),  # under it
        (8.0, (5.0, 5.0), False),  # over it
        (5.0, (5.0, 0.0), False),  # the plan passes there
        (4.0, (5.0, 0.0), True),  # but not at this height
        (5.0, (-11.0, 5.0), True),  # off the known map everything is ...
        (12.0, (0.0, 5.0), True),  # ... and above it
    ],
)
def test_cells_count_at_the_height_of_the_vehicle(height, point, expected):
    assert forbidden_at((-5.0, -5.0, height), point) == expected


def test_the_vehicle_may_leave_where_it_is():
    assert not forbidden_at((5.0, 5.0, 5.0), (5.0, 5.0))


def test_a_map_of_the_plane_counts_at_all_heights():
    flat = BinaryMap(beam().blocked.any(axis=2), np.array([-10.0, -10.0]), CELL)
    room = KnownRoom(flat, PLAN)
    cell = tuple(np.floor(SEEN.cells((5.0, 5.0))).astype(int))
    assert room.forbidden(SEEN, np.array([-5.0, -5.0, 9.0]))[cell]
    assert room.forbids(straight((0.0, 5.0, 9.0), (9.0, 5.0, 9.0))).any()
    assert not room.forbids(straight((0.0, 0.0, 5.0), (9.0, 0.0, 5.0))).any()


@pytest.mark.parametrize("seed", range(20))
def test_curves_are_forbidden_where_they_enter_the_structure_off_the_plan(seed):
    rng = np.random.default_rng(seed)
    start, end = rng.uniform((-9, 1.5, 0.5), (9, 9, 9.5), (2, 3))
    curve, known = straight(start, end), beam()
    times = np.linspace(0.0, curve.duration_s, 5000)
    places = curve.value(times)
    cells = np.floor(known.cells(places)).astype(int)
    inside = known.blocked[tuple(cells.T)]
    own = (np.linalg.norm(places[:, :2] - start[:2], axis=1) <= 0.6) & (abs(places[:, 2] - start[2]) <= 0.5)
    depth = (inside & ~own).mean() * np.linalg.norm(end - start)
    if depth == 0:
        assert not KnownRoom(known, PLAN).forbids(curve).any()
    elif depth > 1.5:  # its places are closer than that
        assert KnownRoom(known, PLAN).forbids(curve).any()


def test_the_plan_itself_is_not_forbidden():
    assert not KnownRoom(beam(), PLAN).forbids(PLAN).any()
    beside = straight((-9.0, 0.4, 5.2), (9.0, 0.4, 5.2))
    assert not KnownRoom(beam(), PLAN).forbids(beside).any()
    further = straight((-9.0, 1.0, 5.0), (9.0, 1.0, 5.0))
    assert KnownRoom(beam(), PLAN).forbids(further).any()


def test_columns_stop_at_the_structure():
    room = KnownRoom(beam(), PLAN)
    assert room.column_is_free(np.array([0.0, 5.0, 1.0]), 9.0)
    assert not room.column_is_free(np.array([5.0, 5.0, 1.0]), 9.0)
    assert not room.column_is_free(np.array([5.0, 5.0, 9.0]), 1.0)
    assert room.column_is_free(np.array([5.0, 5.0, 1.0]), 3.4)
    assert not room.column_is_free(np.array([0.0, 5.0, 9.0]), 11.0)  # off the map
