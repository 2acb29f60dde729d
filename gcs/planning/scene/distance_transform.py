"""The exact Euclidean distance transform of a grid, axis by axis (Felzenszwalb and Huttenlocher 2012)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.thread_pieces import in_pieces

if TYPE_CHECKING:
    from numpy.typing import NDArray

NOTHING = 1e12
"""Square of a distance where nothing is marked at all."""

LEAST_CELLS = 200_000
"""Fewer are not worth a thread: starting it takes longer, and on a busy machine it waits for its turn."""

Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


def squared_distance_transform(marked: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Squares of the distances (in cells) of cell centres from the nearest marked one.

    Args:
        marked: shape (nx, ny, nz).

    Returns:
        Shape (nx, ny, nz); exact as long as they are below 2^24; 1e12 everywhere when nothing is marked.
    """
    square = np.empty(marked.shape, dtype=np.float32)
    nx, ny, nz = marked.shape
    in_pieces(lambda first, end: _along_z_and_y(marked, square, first, end), nx, math.ceil(LEAST_CELLS / (ny * nz)))
    in_pieces(lambda first, end: _along_x(square, first, end), ny, math.ceil(LEAST_CELLS / (nx * nz)))
    return square


@compiled
def _along_z_and_y(marked: Marks, square: SingleFloats, first: int, end: int) -> None:
    """The planes `first` to `end` of constant x, each by itself."""
    ny, nz = marked.shape[1], marked.shape[2]
    line = np.empty(ny)
    places = np.empty(ny + 1, np.int64)
    borders = np.empty(ny + 2)
    for i in range(first, end):
        for j in range(ny):
            away = math.inf
            for k in range(nz):
                away = 0.0 if marked[i, j, k] else away + 1.0
                square[i, j, k] = min(away * away, NOTHING)
            away = math.inf
            for k in range(nz - 1, -1, -1):
                away = 0.0 if marked[i, j, k] else away + 1.0
                square[i, j, k] = min(float(square[i, j, k]), away * away)
        for k in range(nz):
            for j in range(ny):
                line[j] = square[i, j, k]
            _lower_envelope(line, places, borders)
            at = 0
            for j in range(ny):
                while borders[at + 1] < j:
                    at += 1
                square[i, j, k] = (j - places[at]) ** 2 + line[places[at]]


@compiled
def _along_x(square: SingleFloats, first: int, end: int) -> None:
    """The planes `first` to `end` of constant y, each by itself."""
    nx, nz = square.shape[0], square.shape[2]
    line = np.empty(nx)
    places = np.empty(nx + 1, np.int64)
    borders = np.empty(nx + 2)
    for j in range(first, end):
        for k in range(nz):
            for i in range(nx):
                line[i] = square[i, j, k]
            _lower_envelope(line, places, borders)
            at = 0
            for i in range(nx):
                while borders[at + 1] < i:
                    at += 1
                square[i, j, k] = (i - places[at]) ** 2 + line[places[at]]


@compiled
def _lower_envelope(heights: Floats, places: Ints, borders: Floats) -> None:
    """The parabolas `(x - q)^2 + heights[q]` that are lowest somewhere, in order.

    Args:
        heights: shape (n,).
        places: takes the q of each, shape (n + 1,).
        borders: takes where the one before ends and each begins, shape (n + 2,); the last is infinite.
    """
    last = 0
    places[0] = 0
    borders[0] = -math.inf
    for q in range(1, heights.shape[0]):
        border = _border(heights, places[last], q)
        while border <= borders[last]:
            last -= 1
            border = _border(heights, places[last], q)
        last += 1
        places[last] = q
        borders[last] = border
    borders[last + 1] = math.inf


@compiled
def _border(heights: Floats, p: int, q: int) -> float:
    """Where the parabolas of two places p < q cross."""
    return float(((heights[q] + q * q) - (heights[p] + p * p)) / (2.0 * (q - p)))
