"""Exchanges of edges in a tour that is kept as an array: which of them give one tour, and doing and undoing them.

An exchange of k edges cuts the tour into k segments. They are numbered along it from node t2 on, in the direction
from t1 to t2, where (t1, t2) is the first edge that goes; segment i has the ends 2 i and 2 i + 1. A cut is the number
of nodes from t2 to the last one before it. What an exchange is made of stands in a scratch array of `SCRATCH`
integers, in rows of `ROW`.
"""

from __future__ import annotations

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.tours.tour_costs import Ints

Nodes = np.ndarray[tuple[int, ...], np.dtype[np.uint32]]
"""Nodes and places: as unsigned numbers they index arrays faster, as none can be negative."""

# rows of the scratch array: an exchange as it is built up, one column for each removed edge
ROW = 16
END, CUT, SIDE, TRIED, GONE_ON, CODE, LINK, BORDER = range(0, 8 * ROW, ROW)
SCRATCH = 8 * ROW


@compiled
def closing_table(most_edges: int) -> tuple[Ints, Ints]:
    """Which exchanges give one tour.

    Args:
        most_edges: exchanges of 2 to so many are looked at.

    Returns:
        For k removed edges, `table[first[k] + code]` is 1 where the result is one tour. The code of an exchange has for
        its second, third, ... edge the side that was chosen (1 where the far end of the removed edge is its second
        node), then for each earlier one but the first whether the cut lies before it.
    """
    first = np.zeros(most_edges + 1, np.int64)
    size, bits = 0, 0
    for k in range(2, most_edges + 1):
        bits += k - 1
        first[k] = size
        size += 1 << bits
    table = np.zeros(size, np.int64)
    s = np.zeros(SCRATCH, np.int64)
    for k in range(2, most_edges + 1):
        cuts = k - 1
        for arrangement in range(cuts**cuts):
            rest = arrangement
            distinct = True
            for i in range(1, k):
                s[CUT + i] = rest % cuts
                rest //= cuts
                for j in range(1, i):
                    distinct &= s[CUT + j] != s[CUT + i]
            if not distinct:
                continue
            for sides in range(1 << cuts):
                code, shift = 0, 0
                for i in range(1, k):
                    s[SIDE + i] = (sides >> (i - 1)) & 1
                    code |= s[SIDE + i] << shift
                    shift += 1
                    for j in range(1, i):
                        code |= int(s[CUT + i] < s[CUT + j]) << shift
                        shift += 1
                link_ends(k, s)
                table[first[k] + code] = int(_closes(k, s))
    return table, first


@compiled
def link_ends(k: int, s: Ints) -> None:
    """Note in the scratch which ends of segments are joined by the added edges."""
    before = 0
    for i in range(1, k):
        segment = 0
        for j in range(1, k):
            segment += int(s[CUT + j] < s[CUT + i])
        inner, outer = 2 * segment + 1, 2 * segment + 2
        if s[SIDE + i] == 0:
            inner, outer = outer, inner
        s[LINK + before], s[LINK + inner] = inner, before
        before = outer
    last = 2 * k - 1
    s[LINK + before], s[LINK + last] = last, before


@compiled
def _closes(k: int, s: Ints) -> bool:
    end, visited = 0, 0
    while True:
        visited += 1
        end = s[LINK + (end ^ 1)]
        if end == 0 or visited > k:
            return visited == k


@compiled
def read_nodes(tour: Nodes, place: int, direction: int, count: int, to: Nodes, at: int) -> None:
    """Copy nodes from a place on along the tour."""
    n = len(tour)
    while count > 0:
        if direction > 0:
            run = min(count, n - place)
            for i in range(run):
                to[np.uint64(at + i)] = tour[np.uint64(place + i)]
            place = 0
        else:
            run = min(count, place + 1)
            for i in range(run):
                to[np.uint64(at + i)] = tour[np.uint64(place - i)]
            place = n - 1
        at += run
        count -= run


@compiled
def write_nodes(tour: Nodes, position: Nodes, place: int, direction: int, count: int, nodes: Nodes, at: int) -> None:
    """Put nodes into the tour from a place on."""
    n = len(tour)
    while count > 0:
        if direction > 0:
            run = min(count, n - place)
            for i in range(run):
                node = nodes[np.uint64(at + i)]
                tour[np.uint64(place + i)] = node
                position[node] = place + i
            place = 0
        else:
            run = min(count, place + 1)
            for i in range(run):
                node = nodes[np.uint64(at + i)]
                tour[np.uint64(place - i)] = node
                position[node] = place - i
            place = n - 1
        at += run
        count -= run


@compiled
def exchange_edges(
    s: Ints,
    k: int,
    base: int,
    direction: int,
    tour: Nodes,
    position: Nodes,
    moved: Nodes,
    journal: Nodes,
    marks: Ints,
    done: int,
) -> None:
    """Put the segments into their new order; the longest stays where it is, and what stood elsewhere is noted.

    Args:
        s: scratch with the cuts and the links of an exchange.
        k: removed edges.
        base: place of t2.
        direction: from t1 to t2 along the tour, 1 or -1.
        tour: nodes in visiting order, shape (n,).
        position: where in it each node is, shape (n,).
        moved: scratch, shape (n,).
        journal: takes the nodes that stood where others are put.
        marks: takes in row `done` the first place, the direction, the number of nodes and where in the journal they
            begin; the row after it takes where the next ones will.
        done: exchanges noted before.
    """
    n = len(tour)
    for i in range(k - 1):
        hole = i
        while hole > 0 and s[BORDER + hole - 1] > s[CUT + i + 1]:
            s[BORDER + hole] = s[BORDER + hole - 1]
            hole -= 1
        s[BORDER + hole] = s[CUT + i + 1]
    s[BORDER + k - 1] = n - 1
    longest, most = 0, s[BORDER] + 1
    for i in range(1, k):
        if s[BORDER + i] - s[BORDER + i - 1] > most:
            longest, most = i, s[BORDER + i] - s[BORDER + i - 1]
    count = 0
    end = s[LINK + 2 * longest + 1]
    while end >> 1 != longest:
        segment = end >> 1
        low = s[BORDER + segment - 1] + 1 if segment > 0 else 0
        high = s[BORDER + segment]
        if end & 1:
            read_nodes(tour, (base + direction * high) % n, -direction, high - low + 1, moved, count)
        else:
            read_nodes(tour, (base + direction * low) % n, direction, high - low + 1, moved, count)
        count += high - low + 1
        end = s[LINK + (end ^ 1)]
    place = (base + direction * (s[BORDER + longest] + 1)) % n
    used = marks[done, 3]
    marks[done, 0], marks[done, 1], marks[done, 2] = place, direction, count
    marks[done + 1, 3] = used + count
    read_nodes(tour, place, direction, count, journal, used)
    write_nodes(tour, position, place, direction, count, moved, 0)
