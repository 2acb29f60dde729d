"""A 4-ary heap of keys and nodes in two arrays, for kernels; the least key stands first."""

from __future__ import annotations

import numpy as np

from gcs.planning.numerics.compiled import compiled

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@compiled
def sift_up(keys: Floats, nodes: Ints, place: int, key: float, node: int) -> None:
    """Put an entry at a place that has just become free (the end, when one is added) and restore the order."""
    while place > 0:
        parent = (place - 1) // 4
        if keys[parent] <= key:
            break
        keys[place] = keys[parent]
        nodes[place] = nodes[parent]
        place = parent
    keys[place] = key
    nodes[place] = node


@compiled
def sift_down(keys: Floats, nodes: Ints, size: int, key: float, node: int) -> None:
    """Put an entry in the place of the first and restore the order of `size` entries."""
    place = 0
    while True:
        child = 4 * place + 1
        if child >= size:
            break
        least = child
        for other in range(child + 1, min(child + 4, size)):
            if keys[other] < keys[least]:
                least = other
        if keys[least] >= key:
            break
        keys[place] = keys[least]
        nodes[place] = nodes[least]
        place = least
    keys[place] = key
    nodes[place] = node


@compiled
def grown(keys: Floats, nodes: Ints) -> tuple[Floats, Ints]:
    """Twice the room, with what is in it."""
    n = keys.shape[0]
    return np.concatenate((keys, np.empty(n))), np.concatenate((nodes, np.empty(n, np.int64)))
