"""A* on a grid of cells: 26 neighbours, no cut corners, and cells under cover made dear.

Without cover the estimate is the octile distance. With cover (a move into a covered cell costs `penalty` times its
length) a path from a cell `n` to a goal `g` either stays under cover or leaves it, so that with the octile distance
`o` and the depths under cover `w`

    h(n) = min(penalty o, o + (penalty - 1) (w(n) + w(g)))

never overestimates; it is what keeps searches under a roof small.

Of the many equally short ways over free cells one is enough. From a cell whose 26 neighbours are all allowed and
equally dear, only *natural* moves are made: those that go along no axis other than the last move did, or that one
backwards (the pruning of D. Harabor and A. Grastien, AAAI 2011, in three dimensions, without their jumps). Any other
next cell is reached from the one before as soon, or by a way of the same length with a shorter last move. So among
the best predecessors of a cell the one with the shortest last move never leaves it out, and by induction every cell
is reached at its least cost. For that, a settled cell that is reached at less cost is opened again, as happens with a
weight above 1, and lengths are multiples of `QUANTUM`, so that sums of the same moves in any order are equal.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.quaternary_heap import grown, sift_down, sift_up

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

OPTIMAL = 1.0 + 1e-6
"""Weight of the estimate to the goal: among equals the nearer to the goal goes first; costs at most a millionth."""

CELLS_BETWEEN_POLLS = 200_000

_ANY_GOAL = np.empty((0, 0, 0), dtype=np.bool_)

QUANTUM = 2.0**-24
"""Unit of the moves' lengths (pitches); costs are exact multiples of it."""

ROOT_2 = round(math.sqrt(2.0) / QUANTUM) * QUANTUM
ROOT_3 = round(math.sqrt(3.0) / QUANTUM) * QUANTUM

NO_MOVE = 13
"""Moves are numbered 0 to 26: `9 (dx + 1) + 3 (dy + 1) + dz + 1`."""

EVERY_CELL = 2**27 - 1

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Stamps = np.ndarray[tuple[int, ...], np.dtype[np.int32]]
Moves = np.ndarray[tuple[int, ...], np.dtype[np.int8]]


def _steps() -> NDArray[np.int64]:
    """The 27 moves, shape (27, 3), in the order of their numbers; the one in the middle stays."""
    return np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), axis=-1).reshape(27, 3)


def _natural_moves() -> NDArray[np.int64]:
    """Natural moves after each move, shape (27, 27), ended by -1; all of them after none."""
    natural = np.full((27, 27), -1, dtype=np.int64)
    for move, step in enumerate(_steps()):
        ways = ((_steps() == step) | (_steps() == 0)).all(axis=1) if move != NO_MOVE else np.ones(27, dtype=np.bool_)
        ways[NO_MOVE] = False
        natural[move, : ways.sum()] = np.flatnonzero(ways)
    return natural


def _crossed_cells() -> NDArray[np.int64]:
    """Cells of the cube that each move crosses, as bits of the 27 cells about its start, shape (27,)."""
    inside = ((_steps()[None] == _steps()[:, None]) | (_steps()[None] == 0)).all(axis=-1)
    return np.asarray((inside << np.arange(27)).sum(axis=1), dtype=np.int64)


NATURAL = _natural_moves()
CROSSED = _crossed_cells()
LENGTHS = np.array([0.0, 1.0, ROOT_2, ROOT_3])[np.abs(_steps()).sum(axis=1)]


class GridSearch:
    """Searches one grid many times; its working arrays are made once and never cleared.

    Args:
        shape: cells of the grid (nx, ny, nz).

    Attributes:
        expanded: cells that the last search settled.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        size = math.prod(shape)
        self._strides = np.array([shape[1] * shape[2], shape[2], 1], dtype=np.int64)
        self._cost = np.empty(size)
        self._came_by = np.empty(size, np.int8)
        self._stamp = np.zeros(size, np.int32)  # 2 n: cost known in search n; 2 n + 1: settled
        self._searches = 0
        self.expanded = 0

    def search(
        self,
        allowed: NDArray[np.bool_],
        start: ArrayLike,
        goal: ArrayLike,
        cover: NDArray[np.float32] | None = None,
        penalty: float = 1.0,
        weight: float = OPTIMAL,
        poll: Callable[[], None] | None = None,
    ) -> tuple[NDArray[np.int64], float] | None:
        """Shortest path over allowed cells; a diagonal move needs all cells of the cube it crosses.

        Args:
            allowed: cells that may be used, shape (nx, ny, nz).
            start: first cell, shape (3,).
            goal: last cell, shape (3,).
            cover: depth under cover as `cover_depth` gives it, shape (nx, ny, nz); None for no cover.
            penalty: cost of a pitch under cover, at least 1.
            weight: of the estimate; the path costs at most this many times the least, and a larger weight is faster.
            poll: called every 0.1 s or so of searching; may raise.

        Returns:
            The cells from start to goal, shape (K, 3), and the cost in pitches; None when there is no path.
        """
        first = np.asarray(start, dtype=np.int64)
        last = np.asarray(goal, dtype=np.int64)
        self.expanded = 0
        if not (allowed[tuple(first)] and allowed[tuple(last)]):
            return None
        if cover is None:
            cover, penalty = np.empty((0, 0, 0), dtype=np.float32), 1.0
        return self._run(allowed, first, last, _ANY_GOAL, cover, penalty, weight, poll)

    def nearest(
        self,
        allowed: NDArray[np.bool_],
        start: ArrayLike,
        wanted: NDArray[np.bool_],
        poll: Callable[[], None] | None = None,
    ) -> tuple[NDArray[np.int64], float] | None:
        """Shortest path over allowed cells to the nearest of some cells; moves as in `search`.

        Args:
            allowed: cells that may be used, shape (nx, ny, nz).
            start: first cell, shape (3,).
            wanted: cells to end in, those of them that are allowed, shape (nx, ny, nz).
            poll: as in `search`.

        Returns:
            As `search`.
        """
        first = np.asarray(start, dtype=np.int64)
        self.expanded = 0
        if not allowed[tuple(first)]:
            return None
        return self._run(allowed, first, first, wanted, np.empty((0, 0, 0), dtype=np.float32), 1.0, 0.0, poll)

    def _run(
        self,
        allowed: NDArray[np.bool_],
        first: NDArray[np.int64],
        last: NDArray[np.int64],
        wanted: NDArray[np.bool_],
        cover: NDArray[np.float32],
        penalty: float,
        weight: float,
        poll: Callable[[], None] | None,
    ) -> tuple[NDArray[np.int64], float] | None:
        self._searches += 1
        known = 2 * self._searches
        source = int(first @ self._strides)
        self._cost[source] = 0.0
        self._stamp[source] = known
        self._came_by[source] = NO_MOVE
        keys: Floats = np.zeros(1024)
        nodes: Ints = np.full(1024, source, dtype=np.int64)
        waiting, reached = 1, -1
        while waiting and reached < 0:
            if poll:
                poll()
            keys, nodes, waiting, settled, reached = _expand(
                allowed, cover, penalty, weight, last, wanted, self._strides, self._cost, self._came_by, self._stamp,
                known, keys, nodes, waiting, CELLS_BETWEEN_POLLS,
            )  # fmt: skip
            self.expanded += settled
        if reached < 0:
            return None
        end = np.array(np.unravel_index(reached, allowed.shape), dtype=np.int64)
        return _walk_back(self._came_by, first, end, self._strides), float(self._cost[reached])


def cover_depth(free: NDArray[np.bool_], open_sky: NDArray[np.bool_]) -> NDArray[np.float32]:
    """How far under cover each free cell lies.

    Args:
        free: cells that may be used, shape (nx, ny, nz).
        open_sky: those of them that are not under cover.

    Returns:
        Shape (nx, ny, nz): -1 outside cover; else the length (pitches) of the shortest path to a covered cell beside
        an open one, inf without one.
    """
    return _cover_depth(free, open_sky)


@compiled
def _octile(dx: int, dy: int, dz: int) -> float:
    """Length of the shortest 26-connected path without obstacles, in pitches."""
    a, b, c = abs(dx), abs(dy), abs(dz)
    least = min(a, b, c)
    most = max(a, b, c)
    middle = a + b + c - least - most
    return (ROOT_3 - ROOT_2) * least + (ROOT_2 - 1.0) * middle + most


@compiled
def _allowed_about(allowed: Marks, x: int, y: int, z: int) -> int:
    """Which of the 27 cells about one are allowed, as bits in the order of the moves."""
    bits = 0
    if 0 < x < allowed.shape[0] - 1 and 0 < y < allowed.shape[1] - 1 and 0 < z < allowed.shape[2] - 1:
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    bits |= int(allowed[x + i - 1, y + j - 1, z + k - 1]) << (9 * i + 3 * j + k)
        return bits
    for i in range(max(1 - x, 0), min(allowed.shape[0] - x + 1, 3)):
        for j in range(max(1 - y, 0), min(allowed.shape[1] - y + 1, 3)):
            for k in range(max(1 - z, 0), min(allowed.shape[2] - z + 1, 3)):
                bits |= int(allowed[x + i - 1, y + j - 1, z + k - 1]) << (9 * i + 3 * j + k)
    return bits


@compiled
def _expand(
    allowed: Marks,
    cover: SingleFloats,
    penalty: float,
    weight: float,
    goal: Ints,
    wanted: Marks,
    strides: Ints,
    cost: Floats,
    came_by: Moves,
    stamp: Stamps,
    known: int,
    keys: Floats,
    nodes: Ints,
    size: int,
    most: int,
) -> tuple[Floats, Ints, int, int, int]:
    """Settle up to `most` cells, or until the goal is settled, on a heap of `size` keys and nodes.

    A stamp of `known` or more is of this search: the cell's cost is known, or it is settled besides (`known + 1`).
    With marks in `wanted` any of those cells is the goal.

    Returns:
        The heap's keys, nodes and size, how many cells were settled, and the goal's node once it is (else -1).
    """
    settled = known + 1
    target = goal[0] * strides[0] + goal[1] * strides[1] + goal[2]
    covered_lengths = np.round(LENGTHS * (penalty / QUANTUM)) * QUANTUM
    goal_depth = 0.0
    if penalty > 1.0:
        goal_depth = max(cover[goal[0], goal[1], goal[2]], 0.0)
    expanded = 0
    while size > 0 and expanded < most:
        node = nodes[0]
        size -= 1
        sift_down(keys, nodes, size, keys[size], nodes[size])
        if stamp[node] == settled:
            continue
        stamp[node] = settled
        expanded += 1
        x = node // strides[0]
        y = node % strides[0] // strides[1]
        z = node % strides[1]
        if wanted[x, y, z] if wanted.size > 0 else node == target:
            return keys, nodes, size, expanded, node
        about = _allowed_about(allowed, x, y, z)
        tried = NATURAL[NO_MOVE]
        if about == EVERY_CELL and (penalty == 1.0 or _same_cover(cover, x, y, z)):
            tried = NATURAL[came_by[node]]
        for move in tried:
            if move < 0:
                break
            if about & CROSSED[move] != CROSSED[move]:
                continue
            dx, dy, dz = move // 9 - 1, move // 3 % 3 - 1, move % 3 - 1
            u, v, w = x + dx, y + dy, z + dz
            other = node + dx * strides[0] + dy * strides[1] + dz
            length = LENGTHS[move]
            estimate = _octile(goal[0] - u, goal[1] - v, goal[2] - w)
            if penalty > 1.0:
                depth = cover[u, v, w]
                if depth >= 0.0:
                    length = covered_lengths[move]
                estimate = min(penalty * estimate, estimate + (penalty - 1.0) * (max(depth, 0.0) + goal_depth))
            total = cost[node] + length
            if stamp[other] >= known and total >= cost[other]:
                continue
            cost[other] = total
            stamp[other] = known
            came_by[other] = move
            if size == keys.shape[0]:
                keys, nodes = grown(keys, nodes)
            sift_up(keys, nodes, size, total + weight * estimate, other)
            size += 1
    return keys, nodes, size, expanded, -1


@compiled
def _same_cover(cover: SingleFloats, x: int, y: int, z: int) -> bool:
    """Whether a cell inside the grid and its 26 neighbours are all under cover, or none of them is."""
    covered = cover[x, y, z] >= 0.0
    for i in range(-1, 2):
        for j in range(-1, 2):
            for k in range(-1, 2):
                if (cover[x + i, y + j, z + k] >= 0.0) != covered:
                    return False
    return True


@compiled
def _walk_back(came_by: Moves, start: Ints, goal: Ints, strides: Ints) -> Ints:
    backwards = [(goal[0], goal[1], goal[2])]
    x, y, z = backwards[0]
    while not (x == start[0] and y == start[1] and z == start[2]):
        move = came_by[x * strides[0] + y * strides[1] + z]
        x, y, z = x - (move // 9 - 1), y - (move // 3 % 3 - 1), z - (move % 3 - 1)
        backwards.append((x, y, z))
    cells = np.empty((len(backwards), 3), np.int64)
    for i in range(len(backwards)):
        cells[len(backwards) - 1 - i] = backwards[i]
    return cells


@compiled
def _cover_depth(free: Marks, open_sky: Marks) -> SingleFloats:
    """Dijkstra from the covered cells beside open ones."""
    nx, ny, nz = free.shape
    depth = np.full((nx, ny, nz), -1.0, np.float32)
    came_by = np.full((nx, ny, nz), NO_MOVE, np.int8)
    keys: Floats = np.empty(1024)
    nodes: Ints = np.empty(1024, np.int64)
    size = 0
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                if not free[x, y, z] or open_sky[x, y, z]:
                    continue
                depth[x, y, z] = np.inf
                about = _allowed_about(free, x, y, z)
                open_about = _allowed_about(open_sky, x, y, z)
                if open_about == 0:
                    continue
                for move in range(27):
                    if about & CROSSED[move] == CROSSED[move] and open_about >> move & 1:
                        depth[x, y, z] = 0.0
                if depth[x, y, z] == 0.0:
                    if size == keys.shape[0]:
                        keys, nodes = grown(keys, nodes)
                    sift_up(keys, nodes, size, 0.0, (x * ny + y) * nz + z)
                    size += 1
    while size > 0:
        key, node = keys[0], nodes[0]
        size -= 1
        sift_down(keys, nodes, size, keys[size], nodes[size])
        x, y, z = node // (ny * nz), node // nz % ny, node % nz
        if key > depth[x, y, z] + 1e-3:
            continue
        about = _allowed_about(free, x, y, z)
        for move in NATURAL[came_by[x, y, z] if about == EVERY_CELL else NO_MOVE]:
            if move < 0:
                break
            if about & CROSSED[move] != CROSSED[move]:
                continue
            u, v, w = x + move // 9 - 1, y + move // 3 % 3 - 1, z + move % 3 - 1
            total = key + LENGTHS[move]
            if depth[u, v, w] > total + 1e-3:
                depth[u, v, w] = total
                came_by[u, v, w] = move
                if size == keys.shape[0]:
                    keys, nodes = grown(keys, nodes)
                sift_up(keys, nodes, size, total, (u * ny + v) * nz + w)
                size += 1
    return depth
