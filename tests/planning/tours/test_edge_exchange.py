import itertools

import numpy as np
import pytest

from gcs.planning.tours.edge_exchange import CUT, SCRATCH, SIDE, closing_table, exchange_edges, link_ends, write_nodes

N = 17


def exchange_of(rng, tour, k):
    """A random exchange: its scratch, its place and direction, and the edges that go and come."""
    base, direction = int(rng.integers(N)), int(rng.choice([1, -1]))

    def at(r):
        return int(tour[(base + direction * r) % N])

    cuts = rng.choice(N - 1, k - 1, replace=False)
    s = np.zeros(SCRATCH, dtype=np.int64)
    gone, come = [(at(N - 1), at(0))], []
    last = at(0)
    for i, cut in enumerate(cuts, 1):
        side = int(rng.integers(2))
        s[CUT + i], s[SIDE + i] = cut, side
        c, following = (at(cut), at(cut + 1)) if side else (at(cut + 1), at(cut))
        gone.append((c, following))
        come.append((last, c))
        last = following
    come.append((last, at(N - 1)))
    return s, base, direction, gone, come


def code_of(s, k):
    code, shift = 0, 0
    for i in range(1, k):
        code |= int(s[SIDE + i]) << shift
        shift += 1
        for j in range(1, i):
            code |= int(s[CUT + i] < s[CUT + j]) << shift
            shift += 1
    return code


def edges_of(tour):
    return sorted(tuple(sorted((int(a), int(b)))) for a, b in zip(tour, np.roll(tour, -1), strict=True))


def is_one_tour(edges):
    beside = {node: [] for node in range(N)}
    for a, b in edges:
        beside[a].append(b)
        beside[b].append(a)
    if any(a == b for a, b in edges) or any(len(others) != 2 for others in beside.values()):
        return False
    before, node, seen = None, 0, 0
    while True:
        one, other = beside[node]
        before, node = node, (other if one == before else one)
        seen += 1
        if node == 0:
            return seen == N


@pytest.mark.parametrize("k", [2, 3, 4, 5])
def test_the_table_knows_which_exchanges_give_one_tour(k):
    rng = np.random.default_rng(k)
    table, first = closing_table(5)
    outcomes = set()
    for _ in range(400):
        tour = rng.permutation(N).astype(np.uint32)
        s, base, direction, gone, come = exchange_of(rng, tour, k)
        edges = edges_of(tour)
        for edge in gone:
            edges.remove(tuple(sorted(edge)))
        edges = sorted([*edges, *(tuple(sorted(edge)) for edge in come)])
        if len(set(edges)) < N:
            continue  # an edge that was there already
        one_tour = bool(table[first[k] + code_of(s, k)])
        assert one_tour == is_one_tour(edges)
        outcomes.add(one_tour)
        if not one_tour:
            continue
        link_ends(k, s)
        position = np.argsort(tour).astype(np.uint32)
        before = tour.copy()
        moved, journal, marks = np.zeros(N, np.uint32), np.zeros(N, np.uint32), np.zeros((2, 4), np.int64)
        exchange_edges(s, k, base, direction, tour, position, moved, journal, marks, 0)
        assert edges_of(tour) == edges
        assert tour[position].tolist() == list(range(N))
        assert marks[1, 3] == marks[0, 2] <= N - N // k
        write_nodes(tour, position, *marks[0, :3], journal, 0)
        assert tour.tolist() == before.tolist()
        assert tour[position].tolist() == list(range(N))
    assert outcomes == {True, False}


def test_of_two_edges_one_way_gives_one_tour():
    table, first = closing_table(2)
    assert [int(table[first[2] + side]) for side in (0, 1)] == [1, 0]


def test_of_three_edges_half_of_all_ways_do_with_each_order_of_the_cuts():
    table, first = closing_table(3)
    valid = [
        (a, b, swapped)
        for a, b, swapped in itertools.product((0, 1), repeat=3)
        if table[first[3] + (a | b << 1 | swapped << 2)]
    ]
    assert len(valid) == 4
    assert (1, 1, 1) in valid  # a segment goes elsewhere as it is
