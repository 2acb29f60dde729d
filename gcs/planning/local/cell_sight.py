"""Sight over blocked cells of the plane, exact to a billionth of a cell: a straight may touch cells, not enter them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

TOUCH = 1e-9
"""What reaches no deeper into a cell than this share of it only touches it."""

Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


@compiled
def clear_of_cells(ax: float, ay: float, bx: float, by: float, blocked: Marks) -> bool:
    """Whether a straight enters no blocked cell and does not slip between two that touch.

    Args:
        ax: of its start, in cells.
        ay: likewise.
        bx: of its end.
        by: likewise.
        blocked: shape (nx, ny); outside everything is blocked.
    """
    steep = abs(by - ay) > abs(bx - ax)
    if steep:
        ax, ay, bx, by = ay, ax, by, bx
    if ax > bx:
        ax, ay, bx, by = bx, by, ax, ay
    slope = (by - ay) / (bx - ax) if bx > ax else 0.0
    last = math.ceil(bx - TOUCH) - 1
    for i in range(math.floor(ax + TOUCH), last + 1):
        begin, end = ay + slope * (max(float(i), ax) - ax), ay + slope * (min(i + 1.0, bx) - ax)
        low, high = math.floor(min(begin, end) + TOUCH), math.ceil(max(begin, end) - TOUCH) - 1
        if high < low:  # on the line between two rows: one of them is enough
            row = round(begin)
            if _is_blocked(i, row - 1, blocked, steep) and _is_blocked(i, row, blocked, steep):
                return False
        for row in range(low, high + 1):
            if _is_blocked(i, row, blocked, steep):
                return False
        row = round(end)
        if i < last and abs(end - row) < TOUCH and _slips(i, row, blocked, steep):
            return False
    return True


@compiled
def _slips(i: int, row: int, blocked: Marks, steep: bool) -> bool:
    """Whether two blocked cells touch only in the lattice point at the high end of column i."""
    falling = _is_blocked(i, row, blocked, steep) and _is_blocked(i + 1, row - 1, blocked, steep)
    rising = _is_blocked(i, row - 1, blocked, steep) and _is_blocked(i + 1, row, blocked, steep)
    return falling or rising


@compiled
def _is_blocked(i: int, j: int, blocked: Marks, swapped: bool) -> bool:
    if swapped:
        i, j = j, i
    if i < 0 or j < 0 or i >= blocked.shape[0] or j >= blocked.shape[1]:
        return True
    return bool(blocked[i, j])


def convex_corners(blocked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Lattice points at which one cell is blocked and the three others are free, and where that one lies.

    Args:
        blocked: shape (nx, ny).

    Returns:
        Rows of i, j and the signs (+-1) of the blocked cell's side along both axes, shape (n, 4).
    """
    cells = blocked.view(np.uint8)
    west, east = cells[:-1], cells[1:]
    north = west[:, 1:] + east[:, 1:]
    at = np.argwhere(north + west[:, :-1] + east[:, :-1] == 1) + 1
    i, j = at.T
    is_east, is_north = blocked[i, j] | blocked[i, j - 1], blocked[i, j] | blocked[i - 1, j]
    return np.column_stack([at, 2 * is_east.astype(np.int64) - 1, 2 * is_north.astype(np.int64) - 1])
