"""Local search for tours: sequential exchanges of up to five edges, and kicks that are taken back if they do not help.

An exchange removes edges and adds as many: from a node t1 the tour's edge (t1, t2) goes, t2 is joined to a candidate
c, one of c's two edges goes, its other end is joined to a candidate, and so on while the sum of what was removed less
what was added stays positive; it is done as soon as closing it at t1 gains and gives one tour (S. Lin, B. Kernighan,
Operations Research 21, 1973; sequential basis moves as by K. Helsgaun, Math. Programming Computation 1, 2009).
Nothing is moved while searching: whether an exchange gives one tour depends only on the order of its cuts along the
tour and on which side of each was chosen, and is looked up. Nodes wait in a queue for their turn; those at the ends
of changed edges come again.

A kick exchanges four edges near a random node in the one way that no sequence of such steps finds (O. Martin, S.
Otto, E. Felten, Complex Systems 5, 1991); the nodes are found by random walks over the candidates (D. Applegate et
al., INFORMS J. on Computing 15, 2003). What became worse is taken back from a journal, but for a little more that is
accepted with a chance that falls to nothing.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.tours.edge_exchange import (
    CODE,
    CUT,
    END,
    GONE_ON,
    LINK,
    ROW,
    SCRATCH,
    SIDE,
    TRIED,
    Nodes,
    closing_table,
    exchange_edges,
    link_ends,
    write_nodes,
)
from gcs.planning.tours.tour_costs import Floats, Ints, TourCosts, pair_cost

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

BREADTH = (5, 5, 3, 2)
"""How many partial exchanges of one edge, two edges, ... are looked into further at each node."""

WALK = 5
"""Steps between a kick's nodes."""

MOST_WALKS = 50
"""A kick is left out when so many do not end at four nodes."""

WARMTH = 0.1
"""Excess that is accepted with a chance of 1/e at first, in mean costs to the nearest candidate."""

KICKS_AT_ONCE = 1000
NOTHING = 1e-10
"""Gains below this share of the mean cost to the nearest candidate are rounding."""


class _Search(NamedTuple):
    """What the kernels work on.

    Attributes:
        data, from_points: as in `TourCosts`.
        candidates, distances: nodes that are worth joining to each, nearest first, and the costs, shape (n, k).
        tour, position: the nodes in visiting order, and where in it each node is, shape (n,).
        breadth: as `BREADTH`.
        table, first: as `closing_table` makes them.
        exchange: scratch: the exchange that is being built.
        gains: scratch: what was removed less what was added, by the number of removed edges.
        moved: scratch: nodes on their way to other places, shape (n,).
        journal, marks: nodes that stood elsewhere before, and for each exchange the first place, the direction, the
            number of nodes, and where in the journal they begin.
        queue, waiting: nodes from which an improvement is looked for, and whether each is in it, shape (n,).
        nothing: a gain that is none.
    """

    data: Floats
    from_points: bool
    candidates: Nodes
    distances: Floats
    tour: Nodes
    position: Nodes
    breadth: Ints
    table: Ints
    first: Ints
    exchange: Ints
    gains: Floats
    moved: Nodes
    journal: Nodes
    marks: Ints
    queue: Nodes
    waiting: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    nothing: float


class LocalSearch:
    """A tour that gets better.

    Args:
        costs: between nodes.
        candidates: nodes that are worth joining to each, nearest first, shape (n, k); rows may end with the node
            itself.
        order: the tour to begin with, shape (n,), n >= 8.
        rng: for the kicks.
    """

    def __init__(
        self, costs: TourCosts, candidates: NDArray[np.int64], order: NDArray[np.int64], rng: np.random.Generator
    ) -> None:
        n = len(order)
        self._costs = costs
        self._rng = rng
        self._tour = order.astype(np.uint32)
        self._position = np.empty(n, dtype=np.uint32)
        self._position[self._tour] = np.arange(n, dtype=np.uint32)
        self._candidates = np.ascontiguousarray(candidates, dtype=np.uint32)
        distances = _candidate_costs(costs.data, costs.from_points, self._candidates)
        nearest = distances[:, 0][np.isfinite(distances[:, 0])]
        self._unit = max(
            float(nearest.mean()) if len(nearest) else 0.0, float(distances[np.isfinite(distances)].mean())
        )
        self._search = _Search(
            costs.data,
            costs.from_points,
            self._candidates,
            distances,
            self._tour,
            self._position,
            np.array(BREADTH, dtype=np.int64),
            *closing_table(len(BREADTH) + 1),
            np.zeros(SCRATCH, dtype=np.int64),
            np.zeros(ROW),
            np.empty(n, dtype=np.uint32),
            np.empty(max(40 * n, 100_000), dtype=np.uint32),
            np.zeros((1000, 4), dtype=np.int64),
            np.empty(n, dtype=np.uint32),
            np.zeros(n, dtype=np.bool_),
            NOTHING * self._unit,
        )

    @property
    def order(self) -> NDArray[np.int64]:
        """The nodes in visiting order, shape (n,)."""
        return self._tour.astype(np.int64)

    def descend(self) -> None:
        """Exchange edges until nothing gains."""
        _descend(self._search)

    @property
    def cost(self) -> float:
        """Cost of the closed tour."""
        return self._costs.of_tour(self.order)

    def kick(self, kicks: int, poll: Callable[[], None] | None = None, enough: float = -math.inf) -> None:
        """Kick and repair.

        Args:
            kicks: how often.
            poll: called now and then; may raise.
            enough: a cost that ends it.
        """
        for begin in range(0, kicks, KICKS_AT_ONCE):
            if poll:
                poll()
            if self.cost <= enough:
                break
            end = min(begin + KICKS_AT_ONCE, kicks)
            _kick(self._search, self._rng, begin, end, kicks, WARMTH * self._unit)


@compiled
def _candidate_costs(data: Floats, from_points: bool, candidates: Nodes) -> Floats:
    costs = np.empty(candidates.shape)
    for i in range(candidates.shape[0]):
        for k in range(candidates.shape[1]):
            j = candidates[i, k]
            costs[i, k] = math.inf if j == i else pair_cost(data, from_points, i, j)
    return costs


@compiled
def _improve(
    data: Floats,
    from_points: bool,
    candidates: Nodes,
    distances: Floats,
    tour: Nodes,
    position: Nodes,
    breadth: Ints,
    table: Ints,
    first: Ints,
    s: Ints,
    gains: Floats,
    nothing: float,
    t1: int,
) -> tuple[float, int, int, int]:
    """Look for an exchange that gains, with one of the edges at a node removed first.

    Fields of `_Search` one by one: taking them out of it at each call would cost a fifth of the time.

    Returns:
        The gain (0 when there is none), the number of edges, t2's place and the direction from t1 to it; the exchange
        itself is in the scratch array.
    """
    n, deepest = len(tour), len(breadth)
    width = np.uint64(2 * candidates.shape[1])
    for direction in (1, -1):
        base = np.int64(position[t1]) + direction
        if base >= n:
            base -= n
        elif base < 0:
            base += n
        last = tour[np.uint64(base)]
        s[END], s[END + 1] = t1, last
        level, choice = 1, np.uint64(0)
        s[CODE + 1], s[GONE_ON + 1] = 0, 0
        gains[1] = pair_cost(data, from_points, t1, last)
        while True:
            exhausted = choice >= width or s[GONE_ON + level] >= breadth[level - 1]
            gain = -math.inf if exhausted else gains[level] - distances[last, choice >> np.uint64(1)]
            if gain <= nothing:
                level -= 1
                if level == 0:
                    break
                last, choice = np.uint32(s[END + 2 * level - 1]), np.uint64(s[TRIED + level])
                continue
            c = candidates[last, choice >> np.uint64(1)]
            side = np.int64(choice & np.uint64(1))
            choice += np.uint64(1)
            place = np.int64(position[c])
            beside = place + (2 * side - 1) * direction
            if beside >= n:
                beside -= n
            elif beside < 0:
                beside += n
            node = tour[np.uint64(beside)]
            if node == last:
                continue
            gain += pair_cost(data, from_points, c, node)
            closed = gain - pair_cost(data, from_points, node, t1)
            if level == deepest and closed <= nothing:
                continue
            cut = (place - base) * direction
            if cut < 0:
                cut += n
            cut += side - 1
            if cut < 0 or cut == n - 1:
                continue  # the edge (t1, t2) itself
            code = s[CODE + level]
            shift = (level - 1) * level // 2
            code |= side << shift
            again = False
            for i in range(1, level):
                again |= s[CUT + i] == cut
                code |= np.int64(cut < s[CUT + i]) << (shift + i)
            if again:
                continue
            one_tour = table[first[level + 1] + code] == 1
            gaining = one_tour and closed > nothing
            if not gaining and (level == deepest or not (one_tour or level == 1)):
                continue
            s[CUT + level], s[SIDE + level] = cut, side
            s[END + 2 * level], s[END + 2 * level + 1] = c, node
            if gaining:
                link_ends(level + 1, s)
                return float(closed), level + 1, int(base), direction
            s[GONE_ON + level] += 1
            s[TRIED + level] = choice
            level += 1
            s[CODE + level], s[GONE_ON + level] = code, 0
            gains[level] = gain
            last, choice = node, np.uint64(0)
    return 0.0, 0, 0, 0


@compiled
def _repair(x: _Search, count: int, done: int, keep: bool) -> tuple[float, int]:
    """Improve from the first `count` nodes of the queue on until nothing gains.

    Args:
        x: what to work on.
        count: nodes in the queue.
        done: exchanges in the journal.
        keep: whether exchanges stay in the journal.

    Returns:
        The gain, and the number of exchanges in the journal.
    """
    tour, position, s, queue, waiting, marks = x.tour, x.position, x.exchange, x.queue, x.waiting, x.marks
    data, candidates, distances, breadth, table, first = (
        x.data,
        x.candidates,
        x.distances,
        x.breadth,
        x.table,
        x.first,
    )
    gains, n, longest_journal = x.gains, len(tour), len(x.journal)
    total, head = 0.0, 0
    while count > 0:
        node = queue[head]
        head = head + 1 if head + 1 < n else 0
        count -= 1
        waiting[node] = False
        while done + 1 < len(marks) and marks[done, 3] + n <= longest_journal:
            gain, k, base, direction = _improve(
                data,
                x.from_points,
                candidates,
                distances,
                tour,
                position,
                breadth,
                table,
                first,
                s,
                gains,
                x.nothing,
                node,
            )
            if k == 0:
                break
            exchange_edges(s, k, base, direction, tour, position, x.moved, x.journal, marks, done)
            total += gain
            done += int(keep)
            for i in range(2 * k):
                end = np.uint32(s[END + i])
                if not waiting[end]:
                    waiting[end] = True
                    tail = head + count
                    queue[tail if tail < n else tail - n] = end
                    count += 1
    return total, done


@compiled
def _descend(x: _Search) -> None:
    x.queue[:] = x.tour
    x.waiting[:] = True
    _repair(x, len(x.tour), 0, False)


@compiled
def _kick(x: _Search, rng: np.random.Generator, begin: int, end: int, kicks: int, warmth: float) -> None:
    """The kicks from `begin` to `end` of so many."""
    s, tour, n = x.exchange, x.tour, len(x.tour)
    places = np.empty(4, np.int64)
    for turn in range(begin, end):
        if not _choose_places(x, rng, places):
            continue
        base = places[3] + 1 if places[3] + 1 < n else 0
        loss, count = 0.0, 0
        for j in range(4):
            s[CUT + j + 1] = (places[j] - base) % n
            node = tour[places[j]]
            after = tour[(places[j] + 1) % n]
            joined = tour[(places[(j + 2) % 4] + 1) % n]
            loss += pair_cost(x.data, x.from_points, node, joined) - pair_cost(x.data, x.from_points, node, after)
            s[LINK + 2 * j + 1] = 2 * ((j + 3) % 4)
            s[LINK + 2 * ((j + 3) % 4)] = 2 * j + 1
            for i in (node, after):
                if not x.waiting[i]:
                    x.waiting[i] = True
                    x.queue[count] = i
                    count += 1
        exchange_edges(s, 4, base, 1, tour, x.position, x.moved, x.journal, x.marks, 0)
        gain, done = _repair(x, count, 1, True)
        allowed = -warmth * (1.0 - turn / kicks) * math.log(1.0 - rng.random())
        if loss - gain > allowed + x.nothing:
            for i in range(done - 1, -1, -1):
                write_nodes(tour, x.position, x.marks[i, 0], x.marks[i, 1], x.marks[i, 2], x.journal, x.marks[i, 3])


@compiled
def _choose_places(x: _Search, rng: np.random.Generator, places: Ints) -> bool:
    """Four places in the tour, ascending: of a random node, and of the ends of random walks from it."""
    centre = np.uint32(rng.random() * len(x.tour))
    places[0] = x.position[centre]
    found = 1
    for _ in range(MOST_WALKS):
        node = centre
        for _ in range(WALK):
            node = x.candidates[node, np.uint64(rng.random() * x.candidates.shape[1])]
        place = np.int64(x.position[node])
        hole = found
        new = True
        for i in range(found):
            new &= places[i] != place
        if not new:
            continue
        while hole > 0 and places[hole - 1] > place:
            places[hole] = places[hole - 1]
            hole -= 1
        places[hole] = place
        found += 1
        if found == 4:
            return True
    return False
