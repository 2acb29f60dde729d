"""Trees of straights that sampling planners grow from a root, and what all of them do with these.

Kernels work in units of cells and always on three axes; in the plane the third coordinate is the same everywhere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled

NONE = -1

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class SearchTree(NamedTuple):
    """Nodes of a tree; node 0 is the root.

    Attributes:
        points: shape (N, 3), cells; there is room for N nodes.
        parent: shape (N,); of the root `NONE`.
        cost: length of the way from the root, cells, shape (N,).
        first_child: shape (N,); `NONE` of a leaf.
        next_sibling: the next child of the same parent, or `NONE`, shape (N,).
        size: how many nodes there are, shape (1,).
    """

    points: Floats
    parent: Ints
    cost: Floats
    first_child: Ints
    next_sibling: Ints
    size: Ints


def rooted_tree(root: Floats, room: int) -> SearchTree:
    """A tree of its root (3,) alone with room for so many nodes."""
    tree = SearchTree(
        np.empty((room, 3)),
        np.full(room, NONE),
        np.zeros(room),
        np.full(room, NONE),
        np.full(room, NONE),
        np.array([1]),
    )
    tree.points[0] = root
    return tree


def with_room(tree: SearchTree, room: int) -> SearchTree:
    """The tree, moved into arrays twice as long or longer where it has no room for so many nodes more."""
    count = int(tree.size[0])
    if count + room <= len(tree.parent):
        return tree
    longer = rooted_tree(tree.points[0], 2 * count + room)
    for old, new in zip(tree[:-1], longer[:-1], strict=True):
        new[:count] = old[:count]
    longer.size[0] = count
    return longer


def way_from_root(tree: SearchTree, node: int) -> Floats:
    """Points from the root to a node, shape (K, 3), cells."""
    way = []
    while node != NONE:
        way.append(tree.points[node])
        node = int(tree.parent[node])
    return np.array(way[::-1])


@compiled
def straight_free(a: Floats, b: Floats, blocked: Marks) -> bool:
    """Whether a straight (cells) meets free cells alone (Amanatides and Woo 1987); outside everything is blocked."""
    cell, last, step = np.empty(3, np.int64), np.empty(3, np.int64), np.zeros(3, np.int64)
    following, apart = np.full(3, np.inf), np.full(3, np.inf)
    left = 0
    for k in range(3):
        cell[k], last[k] = math.floor(a[k]), math.floor(b[k])
        if cell[k] < 0 or last[k] < 0 or cell[k] >= blocked.shape[k] or last[k] >= blocked.shape[k]:
            return False
        move = b[k] - a[k]
        left += abs(last[k] - cell[k])
        if last[k] != cell[k]:
            step[k] = 1 if move > 0.0 else -1
            apart[k] = 1.0 / abs(move)
            following[k] = ((cell[k] + 1 if move > 0.0 else cell[k]) - a[k]) / move
    while True:
        if blocked[cell[0], cell[1], cell[2]]:
            return False
        if left == 0:
            return True
        axis = 0
        for k in range(1, 3):
            if following[k] < following[axis]:
                axis = k
        cell[axis] += step[axis]
        following[axis] = following[axis] + apart[axis] if cell[axis] != last[axis] else np.inf
        left -= 1


@compiled
def distance(a: Floats, b: Floats) -> float:
    """Between two points (3,)."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled
def add_node(tree: SearchTree, point: Floats, parent: int, cost: float) -> int:
    """Hang a node on another; its number."""
    node = tree.size[0]
    tree.size[0] += 1
    tree.points[node] = point
    tree.parent[node], tree.cost[node] = parent, cost
    tree.next_sibling[node] = tree.first_child[parent]
    tree.first_child[parent] = node
    return int(node)


@compiled
def hang_anew(tree: SearchTree, node: int, parent: int, cost: float) -> None:
    """Give a node another parent, from which its way is shorter, and tell all that hang on it."""
    old = tree.parent[node]
    if tree.first_child[old] == node:
        tree.first_child[old] = tree.next_sibling[node]
    else:
        before = tree.first_child[old]
        while tree.next_sibling[before] != node:
            before = tree.next_sibling[before]
        tree.next_sibling[before] = tree.next_sibling[node]
    tree.parent[node] = parent
    tree.next_sibling[node] = tree.first_child[parent]
    tree.first_child[parent] = node
    saved = tree.cost[node] - cost
    at = node
    while True:  # depth first through what hangs on the node
        tree.cost[at] -= saved
        if tree.first_child[at] != NONE:
            at = tree.first_child[at]
            continue
        while at != node and tree.next_sibling[at] == NONE:
            at = tree.parent[at]
        if at == node:
            return
        at = tree.next_sibling[at]


@compiled
def nearest_node(tree: SearchTree, point: Floats) -> int:
    """The node nearest to a point."""
    best, least = 0, np.inf
    for node in range(tree.size[0]):
        away = tree.points[node]
        square = (away[0] - point[0]) ** 2 + (away[1] - point[1]) ** 2 + (away[2] - point[2]) ** 2
        if square < least:
            best, least = node, square
    return best


@compiled
def near_nodes(tree: SearchTree, point: Floats, radius: float) -> Ints:
    """The nodes within a radius of a point."""
    near = np.empty(tree.size[0], np.int64)
    count = 0
    for node in range(tree.size[0]):
        away = tree.points[node]
        square = (away[0] - point[0]) ** 2 + (away[1] - point[1]) ** 2 + (away[2] - point[2]) ** 2
        if square <= radius * radius:
            near[count] = node
            count += 1
    return near[:count]


@compiled
def near_radius(tree: SearchTree, gamma: float, axes: int) -> float:
    """The radius that shrinks as the tree grows, `gamma (log n / n)^(1 / axes)` (Karaman and Frazzoli 2011).

    The node to come counts: otherwise a root alone would have no neighbours, and no tree would ever join it.
    """
    n = tree.size[0] + 1
    return float(gamma * (math.log(n) / n) ** (1.0 / axes))


@compiled
def best_parent(tree: SearchTree, point: Floats, near: Ints, blocked: Marks) -> tuple[int, float]:
    """The node among some from which the way to a point is shortest, and its length; `NONE` where none is free."""
    costs = np.empty(len(near))
    for k in range(len(near)):
        costs[k] = tree.cost[near[k]] + distance(tree.points[near[k]], point)
    for _ in range(len(near)):
        k = int(np.argmin(costs))
        if straight_free(tree.points[near[k]], point, blocked):
            return int(near[k]), float(costs[k])
        costs[k] = np.inf
    return NONE, np.inf


@compiled
def rewire(tree: SearchTree, through: int, near: Ints, blocked: Marks) -> None:
    """Hang the nodes among some on another node, to which the way through it is shorter."""
    for node in near:
        cost = tree.cost[through] + distance(tree.points[through], tree.points[node])
        if cost < tree.cost[node] - 1e-12 and straight_free(tree.points[through], tree.points[node], blocked):
            hang_anew(tree, node, through, cost)


@compiled
def steered(origin: Floats, towards: Floats, step: float) -> Floats:
    """The point towards another, a step away or the other itself."""
    away = distance(origin, towards)
    if away <= step:
        return towards.copy()
    return origin + (step / away) * (towards - origin)


@compiled
def extend_star(tree: SearchTree, towards: Floats, step: float, gamma: float, axes: int, blocked: Marks) -> int:
    """One step of RRT*: a node towards a point on its best parent, its neighbours rewired; `NONE` where blocked."""
    nearest = nearest_node(tree, towards)
    point = steered(tree.points[nearest], towards, step)
    if not straight_free(tree.points[nearest], point, blocked):
        return NONE
    near = near_nodes(tree, point, min(near_radius(tree, gamma, axes), step))
    parent, cost = best_parent(tree, point, near, blocked)
    direct = tree.cost[nearest] + distance(tree.points[nearest], point)
    if parent == NONE or direct < cost:
        parent, cost = nearest, direct
    node = add_node(tree, point, parent, cost)
    rewire(tree, node, near, blocked)
    return node
