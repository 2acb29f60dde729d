"""The tower paper's genetic algorithm for tours: crossover and mutation rates follow the population's entropy.

A chromosome is an order of the nodes, its fitness 1 / W with W the cost of the tour. The population is divided into
groups. In every generation the best 30 % of each group survive (of equals the younger); the others of the group are
replaced by children of a survivor: at the crossover rate a segment of the next group's best is set into it, round
which the other genes keep their order; at the mutation rate one of three mutations follows (an interval reversed, two
genes swapped, an interval shifted round by one). Where the population's entropy is below a threshold, the rates are
raised. As segments go from group to group, a group that found something else keeps it for a while: with many small
groups the tour's large shape, which no single mutation changes any more in the end, is chosen from many.

Source: W. Xu et al., "Trajectory planning of rotor UAV for inspection of cable-stayed bridge tower", 2019, equations
2 to 9. The exponent of the threshold is taken per share of the run (the printed one lacks the division by the number
of generations); the entropy that is compared is the mean over the genes.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.tours.tour_costs import Floats, Ints, TourCosts, pair_cost

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

SURVIVING_SHARE = 0.3
REVERSAL, SWAP, SHIFT = range(3)
"""The mutations."""

GENERATIONS_PER_NODE = 160
ENTROPY_EVERY = 20
CHILDREN_AT_ONCE = 100_000
EXACT_AGAIN = 1000
"""Generations after which the costs, kept up to date by differences, are summed anew."""

SAME = 1e-12
"""Share of the cost by which equals differ at most."""


@dataclass(frozen=True)
class GeneticOptions:
    """Parameters of the algorithm, by the paper's symbols.

    Attributes:
        population: m, a multiple of the group.
        group: g.
        generations: L; 160 for each node when not given.
        crossover_rate: p_fc, the rate where the population is diverse enough.
        mutation_rate: p_fv.
        threshold: R of `T(l) = R log2(m) exp(-G l / L)`.
        decay: G.
        measure: u: the rates grow by `max(0, T - H) / u` of themselves.
    """

    population: int = 1000
    group: int = 5
    generations: int | None = None
    crossover_rate: float = 0.1
    mutation_rate: float = 0.6
    threshold: float = 0.9
    decay: float = 1.0
    measure: float = 2.0


@dataclass(frozen=True, eq=False)
class GeneticTour:
    """What the algorithm found.

    Attributes:
        order: the nodes in visiting order, shape (n,).
        cost: W.
        costs: of the best after each generation, shape (L,).
        entropy: H of each generation, mean over the genes (bit), shape (L,).
    """

    order: NDArray[np.int64]
    cost: float
    costs: NDArray[np.float64]
    entropy: NDArray[np.float64]


def genetic_tour(
    costs: TourCosts,
    *,
    closed: bool,
    options: GeneticOptions | None = None,
    seed: int = 0,
    start: NDArray[np.int64] | None = None,
    poll: Callable[[float], None] | None = None,
) -> GeneticTour:
    """Breed a short tour.

    Args:
        costs: between n nodes.
        closed: whether the way back counts.
        options: parameters.
        seed: of the random numbers.
        start: an order that is in the first population, which is random otherwise.
        poll: called now and then with the share that is done; may raise.

    Returns:
        The best tour of all generations.
    """
    options = options or GeneticOptions()
    n, m = len(costs), options.population
    if n < 4:
        return _best_of_all(costs, closed)
    generations = options.generations or GENERATIONS_PER_NODE * n
    rng = np.random.default_rng(seed)
    people = np.array([rng.permutation(n) for _ in range(m)], dtype=np.int64)
    if start is not None:
        people[0] = start
    paid = np.array([costs.of_tour(order, closed=closed) for order in people])
    deal = np.arange(m)
    best, entropy = np.empty(generations), np.empty(generations)
    rates = np.array([options.crossover_rate, options.mutation_rate])
    control = np.array([options.threshold, options.decay, options.measure])
    at_once = max(1, CHILDREN_AT_ONCE // m)
    for begin in range(0, generations, at_once):
        if poll:
            poll(begin / generations)
        end = min(begin + at_once, generations)
        _breed(
            costs.data, costs.from_points, closed, people, paid, deal, options.group, rates, control, rng, begin, end,
            best, entropy,
        )  # fmt: skip
    order = people[int(paid.argmin())].copy()
    return GeneticTour(order, costs.of_tour(order, closed=closed), best, entropy)


def _best_of_all(costs: TourCosts, closed: bool) -> GeneticTour:
    """At most three nodes: all orders are tried."""
    orders = [np.array(p, dtype=np.int64) for p in itertools.permutations(range(len(costs)))]
    order = min(orders, key=lambda o: costs.of_tour(o, closed=closed))
    return GeneticTour(order, costs.of_tour(order, closed=closed), np.empty(0), np.empty(0))


@compiled
def population_entropy(people: Ints) -> float:
    """Entropy of the genes, `H_j = -sum p log2 p` over the nodes at place j, mean over the places (bit).

    Args:
        people: orders, shape (m, n).
    """
    m, n = people.shape
    count = np.zeros(n, np.int64)
    part = np.zeros(m + 1)
    for c in range(1, m + 1):
        part[c] = -c / m * math.log2(c / m)
    total = 0.0
    for j in range(n):
        for i in range(m):
            node = people[i, j]
            total += part[count[node] + 1] - part[count[node]]
            count[node] += 1
        for i in range(m):
            count[people[i, j]] = 0
    return total / n


@compiled
def diversity_threshold(generation: int, generations: int, population: int, threshold: float, decay: float) -> float:
    """`T(l) = R log2(m) exp(-G l / L)` (bit)."""
    return threshold * math.log2(population) * math.exp(-decay * generation / generations)


@compiled
def set_in_segment(parent: Ints, donor: Ints, start: int, length: int, stamp: Ints, child: Ints) -> None:
    """Crossover: the donor's genes of a segment at their places, the parent's others around it in the parent's order.

    Args:
        parent: an order, shape (n,).
        donor: another.
        start: first place of the segment.
        length: genes in it.
        stamp: scratch, ones, shape (n,).
        child: takes the result.
    """
    n = len(parent)
    for j in range(start, start + length):
        stamp[donor[j]] = 0
    place = 0
    for j in range(n):
        node = parent[j]
        child[min(place, n - 1)] = node
        place += stamp[node]
    for j in range(n - length - 1, start - 1, -1):
        child[j + length] = child[j]
    for j in range(start, start + length):
        child[j] = donor[j]
        stamp[donor[j]] = 1


@compiled
def reverse_interval(order: Ints, first: int, last: int) -> None:
    """Mutation: the genes from one place to another in reverse."""
    while first < last:
        order[first], order[last] = order[last], order[first]
        first += 1
        last -= 1


@compiled
def swap_genes(order: Ints, first: int, last: int) -> None:
    """Mutation: the genes at two places change places."""
    order[first], order[last] = order[last], order[first]


@compiled
def shift_interval(order: Ints, first: int, last: int) -> None:
    """Mutation: the genes from one place to another move on by one, the last of them to the front."""
    node = order[last]
    for j in range(last, first, -1):
        order[j] = order[j - 1]
    order[first] = node


@compiled
def _link(data: Floats, from_points: bool, closed: bool, order: Ints, j: int) -> float:
    """Cost from place j to the next; j may be the place before the first or the last."""
    last = len(order) - 1
    if j >= 0 and j < last:
        return pair_cost(data, from_points, order[j], order[j + 1])
    return pair_cost(data, from_points, order[last], order[0]) if closed else 0.0


@compiled
def _around(data: Floats, from_points: bool, closed: bool, order: Ints, first: int, last: int) -> float:
    """Cost of the edges that lead into an interval and out of it; of the whole closed tour that is one and the same."""
    total = _link(data, from_points, closed, order, last)
    if first > 0 or last < len(order) - 1:
        total += _link(data, from_points, closed, order, first - 1)
    return total


@compiled
def mutate(data: Floats, from_points: bool, closed: bool, order: Ints, kind: int, first: int, last: int) -> float:
    """Mutate in one of the three ways and return what the tour costs more."""
    before = _around(data, from_points, closed, order, first, last)
    after = 0.0
    if kind == REVERSAL:
        reverse_interval(order, first, last)
    elif kind == SWAP:
        before += _link(data, from_points, closed, order, first) + _link(data, from_points, closed, order, last - 1)
        swap_genes(order, first, last)
        after += _link(data, from_points, closed, order, first) + _link(data, from_points, closed, order, last - 1)
    else:
        before += _link(data, from_points, closed, order, last - 1)
        shift_interval(order, first, last)
        after += _link(data, from_points, closed, order, first)
    return after + _around(data, from_points, closed, order, first, last) - before


@compiled
def _sum(data: Floats, from_points: bool, closed: bool, order: Ints) -> float:
    total = _link(data, from_points, closed, order, len(order) - 1)
    for j in range(1, len(order)):
        total += pair_cost(data, from_points, order[j - 1], order[j])
    return total


@compiled
def _breed(
    data: Floats,
    from_points: bool,
    closed: bool,
    people: Ints,
    costs: Floats,
    deal: Ints,
    group: int,
    rates: Floats,
    control: Floats,
    rng: np.random.Generator,
    begin: int,
    end: int,
    best: Floats,
    entropy: Floats,
) -> None:
    """The generations from `begin` to `end`; `deal` is who is in which group, best first when it is sorted."""
    m, n = people.shape
    stamp = np.ones(n, np.int64)
    surviving = max(1, int(SURVIVING_SHARE * group + 0.5))
    for generation in range(begin, end):
        if generation % ENTROPY_EVERY == 0:
            entropy[generation] = population_entropy(people)
        else:
            entropy[generation] = entropy[generation - 1]
        wanted = diversity_threshold(generation, len(best), m, control[0], control[1])
        raised = 1.0 + max(0.0, wanted - entropy[generation]) / control[2]
        for begin_of_group in range(0, m, group):
            _sort_group(deal, begin_of_group, min(begin_of_group + group, m), costs)
        for begin_of_group in range(0, m, group):
            donor = deal[(begin_of_group + group) % m] if begin_of_group + group < m else deal[0]
            for k in range(begin_of_group + surviving, min(begin_of_group + group, m)):
                child, parent = deal[k], deal[begin_of_group + int(rng.random() * surviving)]
                if rng.random() < rates[0] * raised:
                    length = 1 + int(rng.random() * (n - 1))
                    start = int(rng.random() * (n - length + 1))
                    set_in_segment(people[parent], people[donor], start, length, stamp, people[child])
                    costs[child] = _sum(data, from_points, closed, people[child])
                else:
                    for j in range(n):
                        people[child, j] = people[parent, j]
                    costs[child] = costs[parent]
                if rng.random() < rates[1] * raised:
                    first, last = _random_interval(n, rng)
                    kind = int(rng.random() * (SHIFT + 1))
                    costs[child] += mutate(data, from_points, closed, people[child], kind, first, last)
        if generation % EXACT_AGAIN == 0:
            for i in range(m):
                costs[i] = _sum(data, from_points, closed, people[i])
        best[generation] = costs.min()


@compiled
def _sort_group(deal: Ints, begin: int, end: int, costs: Floats) -> None:
    """By cost; of equals the later one, which is the younger, comes first: so the survivors drift among equals."""
    for i in range(begin + 1, end):
        member, hole = deal[i], i
        while hole > begin and costs[deal[hole - 1]] > costs[member] - SAME * abs(costs[member]):
            deal[hole] = deal[hole - 1]
            hole -= 1
        deal[hole] = member


@compiled
def _random_interval(n: int, rng: np.random.Generator) -> tuple[int, int]:
    """First and last place of an interval of two genes or more."""
    if rng.random() < 0.5:
        further = int(math.exp(rng.random() * math.log(n)))
    else:
        further = 1 + int((1.0 - math.sqrt(rng.random())) * (n - 1))
    further = min(further, n - 1)
    first = int(rng.random() * (n - further))
    return first, first + further
