"""A* on a grid of cells: 26 neighbours, no cut corners, and cells under cover made dear.

Without cover the estimate is the octile distance. With cover (a move into a covered cell costs `penalty` times its
length) a path from a cell `n` to a goal `g` either stays under cover or leaves it, so that with the octile distance
`o` and the depths under cover `w`

    h(n) = min(penalty o, o + (penalty - 1) (w(n) + w(g)))

never overestimates; it is what keeps searches under a roof small.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.compiled import compiled
from gcs.planning.quaternary_heap import grown, sift_down, sift_up

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

OPTIMAL = 1.0 + 1e-6
"""Weight of the estimate to the goal: among equals the nearer to the goal goes first; costs at most a millionth."""

CELLS_BETWEEN_POLLS = 200_000

_ANY_GOAL = np.empty((0, 0, 0), dtype=np.bool_)

ROOT_2 = math.sqrt(2.0)
ROOT_3 = math.sqrt(3.0)

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Stamps = np.ndarray[tuple[int, ...], np.dtype[np.int32]]
Moves = np.ndarray[tuple[int, ...], np.dtype[np.int8]]


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
    return ROOT_3 * least + ROOT_2 * (middle - least) + (most - middle)


@compiled
def _move_length(allowed: Marks, x: int, y: int, z: int, dx: int, dy: int, dz: int) -> float:
    """Length of a move in pitches; 0 when it leaves the grid or the cube that it crosses is not allowed as a whole."""
    u, v, w = x + dx, y + dy, z + dz
    if u < 0 or u >= allowed.shape[0] or v < 0 or v >= allowed.shape[1] or w < 0 or w >= allowed.shape[2]:
        return 0.0
    if not allowed[u, v, w]:
        return 0.0
    axes = abs(dx) + abs(dy) + abs(dz)
    if axes < 2:
        return float(axes)
    if not (allowed[u, y, z] and allowed[x, v, z] and allowed[x, y, w]):
        return 0.0
    if not (allowed[u, v, z] and allowed[u, y, w] and allowed[x, v, w]):
        return 0.0
    return ROOT_2 if axes == 2 else ROOT_3


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

    With marks in `wanted` any of those cells is the goal.

    Returns:
        The heap's keys, nodes and size, how many cells were settled, and the goal's node once it is (else -1).
    """
    settled = known + 1
    target = goal[0] * strides[0] + goal[1] * strides[1] + goal[2]
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
        for move in range(27):
            dx, dy, dz = move // 9 - 1, move // 3 % 3 - 1, move % 3 - 1
            length = _move_length(allowed, x, y, z, dx, dy, dz)
            if length == 0.0:
                continue
            u, v, w = x + dx, y + dy, z + dz
            other = node + dx * strides[0] + dy * strides[1] + dz
            if stamp[other] == settled:
                continue
            estimate = _octile(goal[0] - u, goal[1] - v, goal[2] - w)
            if penalty > 1.0:
                depth = cover[u, v, w]
                if depth >= 0.0:
                    length *= penalty
                estimate = min(penalty * estimate, estimate + (penalty - 1.0) * (max(depth, 0.0) + goal_depth))
            total = cost[node] + length
            if stamp[other] == known and total >= cost[other]:
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
    keys: Floats = np.empty(1024)
    nodes: Ints = np.empty(1024, np.int64)
    size = 0
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                if not free[x, y, z] or open_sky[x, y, z]:
                    continue
                depth[x, y, z] = np.inf
                for move in range(27):
                    dx, dy, dz = move // 9 - 1, move // 3 % 3 - 1, move % 3 - 1
                    if _move_length(free, x, y, z, dx, dy, dz) > 0.0 and open_sky[x + dx, y + dy, z + dz]:
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
        for move in range(27):
            dx, dy, dz = move // 9 - 1, move // 3 % 3 - 1, move % 3 - 1
            length = _move_length(free, x, y, z, dx, dy, dz)
            if length == 0.0:
                continue
            u, v, w = x + dx, y + dy, z + dz
            if depth[u, v, w] > key + length + 1e-3:
                depth[u, v, w] = key + length
                if size == keys.shape[0]:
                    keys, nodes = grown(keys, nodes)
                sift_up(keys, nodes, size, key + length, (u * ny + v) * nz + w)
                size += 1
    return depth
