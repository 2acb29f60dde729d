"""The proof that a curve stays in free cells, against many points on it."""

import numpy as np
import pytest

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.curve_clearance import CellCounts
from gcs.planning.numerics.bernstein import monomial_from_control

MANY = 4000
ORIGIN, CELL = np.array([-4.0, 2.0]), 0.5


def curve_of(control):
    return PiecewisePolynomial(monomial_from_control(control), np.ones(len(control)))


def test_pieces_are_judged_as_by_many_points():
    rng = np.random.default_rng(1)
    area = BinaryMap(rng.random((20, 16)) < 0.06, ORIGIN, CELL)
    control = np.concatenate([rng.uniform((-3, 3), (5, 9), (300, 8, 2)), np.zeros((300, 8, 1))], axis=2)
    # Half of them are short, so that some are free.
    control[::2] = control[::2, :1] + 0.15 * (control[::2] - control[::2, :1])
    judged = CellCounts(area).blocked_pieces(curve_of(control))
    times = np.linspace(0, 300, 300 * MANY, endpoint=False) + 1e-6
    points = curve_of(control).value(times)[:, :2].reshape(300, MANY, 2)
    cells = np.floor(area.cells(points)).astype(int)
    met = area.blocked[cells[..., 0], cells[..., 1]].any(axis=1)
    assert not (met & ~judged).any()
    assert 40 < (~judged).sum() < 260
    # What is judged blocked without a point in a blocked cell comes as near to one as the finest part is large.
    for piece in np.flatnonzero(judged & ~met):
        low = area.points_m(np.argwhere(area.blocked))
        away = np.maximum(np.maximum(low - points[piece][:, None], points[piece][:, None] - low - CELL), 0.0)
        assert np.linalg.norm(away, axis=2).min() < 0.1 * CELL


@pytest.mark.parametrize("off_map_blocked", [True, False])
def test_off_the_map_counts_as_told(off_map_blocked):
    area = BinaryMap(np.zeros((4, 4), dtype=np.bool_), np.zeros(2), 1.0)
    straight = np.linspace(0, 1, 8)[:, None] * np.array([10.0, 0.0, 0.0]) + np.array([2.0, 2.0, 0.0])
    outside = straight + np.array([30.0, 0.0, 0.0])
    inside = 0.1 * straight + np.array([1.0, 1.0, 0.0])
    judged = CellCounts(area, off_map_blocked).blocked_pieces(curve_of(np.stack([straight, outside, inside])))
    assert judged.tolist() == [off_map_blocked, off_map_blocked, False]
