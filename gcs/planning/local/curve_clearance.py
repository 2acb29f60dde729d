"""Proof that curves stay in free cells of a map of the plane, over their whole length.

A part of a curve lies in the box about its Bernstein control points. Where that box meets a blocked cell the part is
halved; a part that is smaller than the finest box and still meets one counts as blocked.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.bernstein import control_from_monomial
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.binary_map import BinaryMap

FINEST = 0.05
"""Extent, in cells, below which a part is not halved any more."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Counts = np.ndarray[tuple[int, ...], np.dtype[np.int32]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class CellCounts:
    """A map made ready to be asked about many boxes.

    Args:
        area: of the plane, grown by all that has to be kept.
        off_map_blocked: what lies off the map counts as blocked; free otherwise.
    """

    def __init__(self, area: BinaryMap, off_map_blocked: bool = True) -> None:
        self._area = area
        padded = np.pad(area.blocked, 1, constant_values=off_map_blocked)
        self._sums = np.zeros((padded.shape[0] + 1, padded.shape[1] + 1), dtype=np.int32)
        self._sums[1:, 1:] = padded.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)

    def blocked_pieces(self, curve: PiecewisePolynomial) -> NDArray[np.bool_]:
        """Which pieces of a curve are not proved to stay in free cells, shape (S,)."""
        control = self._area.cells(control_from_monomial(curve.coefficients)[..., :2])
        # One cell of padding on every side; what is further off is as the padding.
        return _blocked_pieces(np.ascontiguousarray(control) + 1.0, self._sums)


@compiled
def _blocked_pieces(control: Floats, sums: Counts) -> Marks:
    """Control points (S, 8, 2) in padded cells against sums of blocked cells from the low corner."""
    result = np.zeros(len(control), np.bool_)
    stack = np.empty((64, 8, 2))
    for piece in range(len(control)):
        stack[0] = control[piece]
        top = 1
        while top:
            top -= 1
            low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
            for k in range(8):
                low_x, high_x = min(low_x, stack[top, k, 0]), max(high_x, stack[top, k, 0])
                low_y, high_y = min(low_y, stack[top, k, 1]), max(high_y, stack[top, k, 1])
            if not _box_blocked(low_x, low_y, high_x, high_y, sums):
                continue
            if max(high_x - low_x, high_y - low_y) < FINEST or top + 2 > len(stack):
                result[piece] = True
                break
            _halve(stack, top)
            top += 2
    return result


@compiled
def _halve(stack: Floats, place: int) -> None:
    """Put the second half of a part (8, 2) behind it and the first in its place (de Casteljau)."""
    for axis in range(2):
        for level in range(8):
            stack[place + 1, 7 - level, axis] = stack[place, 7, axis]
            for k in range(7, level, -1):
                stack[place, k, axis] = 0.5 * (stack[place, k - 1, axis] + stack[place, k, axis])


@compiled
def _box_blocked(low_x: float, low_y: float, high_x: float, high_y: float, sums: Counts) -> bool:
    """Whether a box in padded cells meets a blocked one."""
    nx, ny = sums.shape[0] - 1, sums.shape[1] - 1
    i0, i1 = _clipped(np.floor(low_x), nx), _clipped(np.floor(high_x), nx) + 1
    j0, j1 = _clipped(np.floor(low_y), ny), _clipped(np.floor(high_y), ny) + 1
    return bool(sums[i1, j1] - sums[i0, j1] - sums[i1, j0] + sums[i0, j0] > 0)


@compiled
def _clipped(cell: float, count: int) -> int:
    return int(min(max(cell, 0.0), count - 1.0))
