"""Convex sets as planes: rows of an outward unit normal and an offset, `normal . p <= offset`, shape (m, 4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


def box_planes(box_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The six faces of a box with corners (2, 3), shape (6, 4)."""
    return np.column_stack([np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([box_m[1], -box_m[0]])])


def room_m(planes: NDArray[np.float64], point_m: NDArray[np.float64]) -> float:
    """Distance (m) of a point (3,) to the nearest plane of a set that it is in; negative outside."""
    return float((planes[:, 3] - planes[:, :3] @ point_m).min())


def inner_ball(planes: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Centre (3,) and radius (m) of the largest ball in a set, at most 1; negative where the planes leave nothing."""
    from scipy.optimize import linprog

    lengthened = np.column_stack([planes[:, :3], np.ones(len(planes))])
    bounds = [(None, None), (None, None), (None, None), (None, 1.0)]
    answer = linprog([0.0, 0.0, 0.0, -1.0], A_ub=lengthened, b_ub=planes[:, 3], bounds=bounds, method="highs")
    if answer.x is None:
        return np.zeros(3), -math.inf
    return np.asarray(answer.x[:3]), float(answer.x[3])


def outside_m(control: NDArray[np.float64], sets: Sequence[NDArray[np.float64]]) -> float:
    """How far (m) a control point lies beyond a plane of its piece's set at most, 0 when none does.

    Args:
        control: of the pieces, shape (n, 8, 3).
        sets: planes of each piece's set, n arrays.
    """
    planes = np.concatenate(sets)
    pieces = np.repeat(np.arange(len(sets)), [len(one) for one in sets])
    values = np.einsum("mkd,md->mk", control[pieces], planes[:, :3]) - planes[:, 3:]
    return float(values.max(initial=0.0))
