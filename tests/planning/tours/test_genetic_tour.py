import itertools
import math

import numpy as np
import pytest

from gcs.planning.tours.genetic_tour import (
    GeneticOptions,
    diversity_threshold,
    genetic_tour,
    mutate,
    population_entropy,
    reverse_interval,
    set_in_segment,
    shift_interval,
    swap_genes,
)
from gcs.planning.tours.tour_costs import TourCosts


def cloud(n, seed=0):
    return TourCosts.of_points(np.random.default_rng(seed).uniform(0, 50, (n, 3)))


SMALL = GeneticOptions(population=40, generations=1500)


def test_the_mutations():
    for change, expected in (
        (reverse_interval, [0, 1, 6, 5, 4, 3, 2, 7]),
        (swap_genes, [0, 1, 6, 3, 4, 5, 2, 7]),
        (shift_interval, [0, 1, 6, 2, 3, 4, 5, 7]),
    ):
        order = np.arange(8)
        change(order, 2, 6)
        assert order.tolist() == expected


@pytest.mark.parametrize("mutate", [reverse_interval, swap_genes, shift_interval])
def test_a_mutated_order_has_all_genes(mutate):
    rng = np.random.default_rng(0)
    for _ in range(100):
        order = rng.permutation(12)
        first, last = sorted(rng.choice(12, 2, replace=False))
        before = order.copy()
        mutate(order, first, last)
        assert sorted(order) == list(range(12))
        assert order[:first].tolist() == before[:first].tolist()
        assert order[last + 1 :].tolist() == before[last + 1 :].tolist()


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("n", [4, 5, 8])
def test_what_a_mutation_costs_is_what_the_tour_costs_more(n, closed):
    costs, rng = cloud(n), np.random.default_rng(0)
    for kind, (first, last) in itertools.product(range(3), itertools.combinations(range(n), 2)):
        order = rng.permutation(n)
        before = costs.of_tour(order, closed=closed)
        more = mutate(costs.data, costs.from_points, closed, order, kind, first, last)
        assert more == pytest.approx(costs.of_tour(order, closed=closed) - before, abs=1e-9)


def crossed(parent, donor, start, length):
    child, stamp = np.empty(len(parent), dtype=np.int64), np.ones(len(parent), dtype=np.int64)
    set_in_segment(np.array(parent), np.array(donor), start, length, stamp, child)
    assert (stamp == 1).all()
    return child.tolist()


def test_the_papers_crossover():
    donor = [3, 1, 2, 0, 7, 6, 5, 4]
    assert crossed([0, 1, 2, 3, 4, 5, 6, 7], donor, 0, 3) == [3, 1, 2, 0, 4, 5, 6, 7]
    assert crossed([0, 1, 2, 3, 4, 5, 6, 7], donor, 3, 3) == [1, 2, 3, 0, 7, 6, 4, 5]
    assert crossed([0, 1, 2, 3, 4, 5, 6, 7], donor, 5, 3) == [0, 1, 2, 3, 7, 6, 5, 4]


def test_a_child_has_the_segment_and_the_other_genes_in_their_order():
    rng = np.random.default_rng(1)
    for _ in range(200):
        parent, donor = rng.permutation(11), rng.permutation(11)
        length = int(rng.integers(1, 11))
        start = int(rng.integers(0, 11 - length + 1))
        child = crossed(parent, donor, start, length)
        segment = donor[start : start + length].tolist()
        assert child[start : start + length] == segment
        assert child[:start] + child[start + length :] == [g for g in parent if g not in segment]


def test_the_entropy_of_populations_made_by_hand():
    assert population_entropy(np.array([[0, 1, 2]] * 4)) == pytest.approx(0.0)
    cyclic = np.array([[0, 1, 2, 3], [1, 2, 3, 0], [2, 3, 0, 1], [3, 0, 1, 2]])
    assert population_entropy(cyclic) == pytest.approx(2.0)  # log2 of the population, the largest there is
    # places 0 and 1: 3 of 4 alike; place 2: all alike
    mixed = np.array([[0, 1, 2], [0, 1, 2], [0, 1, 2], [1, 0, 2]])
    assert population_entropy(mixed) == pytest.approx(2 / 3 * -(0.75 * math.log2(0.75) + 0.25 * math.log2(0.25)))


def test_the_threshold_falls_from_its_share_of_the_largest_entropy():
    assert diversity_threshold(0, 100, 64, 0.5, 2.0) == pytest.approx(0.5 * 6)
    assert diversity_threshold(50, 100, 64, 0.5, 2.0) == pytest.approx(0.5 * 6 * math.exp(-1))


@pytest.mark.parametrize("closed", [True, False])
def test_few_nodes_are_ordered_at_the_least_cost(closed):
    costs = cloud(8)
    best = min(costs.of_tour(np.array(p), closed=closed) for p in itertools.permutations(range(8)))
    found = genetic_tour(costs, closed=closed, options=SMALL)
    assert sorted(found.order) == list(range(8))
    assert found.cost == pytest.approx(best)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_up_to_three_nodes_are_tried_out(n):
    costs = cloud(n)
    found = genetic_tour(costs, closed=False)
    assert sorted(found.order) == list(range(n))
    orders = itertools.permutations(range(n))
    assert found.cost == pytest.approx(min(costs.of_tour(np.array(p), closed=False) for p in orders))


def test_it_repeats_with_its_seed_and_never_loses_its_best():
    costs = cloud(40, 2)
    one, again, other = (genetic_tour(costs, closed=True, options=SMALL, seed=s) for s in (5, 5, 6))
    assert one.order.tolist() == again.order.tolist()
    assert one.order.tolist() != other.order.tolist()
    assert (np.diff(one.costs) <= 1e-6).all()
    assert one.cost == pytest.approx(one.costs[-1])
    assert one.cost == pytest.approx(costs.of_tour(one.order))
    random = np.mean([costs.of_tour(np.random.default_rng(k).permutation(40)) for k in range(20)])
    assert one.cost < 0.5 * random


def test_a_start_is_taken_over():
    costs = cloud(30, 3)
    good = genetic_tour(costs, closed=True, options=SMALL)
    short = GeneticOptions(population=40, generations=5)
    assert genetic_tour(costs, closed=True, options=short, start=good.order).cost <= good.cost * (1 + 1e-9)
    assert genetic_tour(costs, closed=True, options=short).cost > 1.5 * good.cost


def test_low_entropy_raises_the_rates():
    costs = cloud(30, 4)
    still = GeneticOptions(population=40, generations=300, crossover_rate=0.0, mutation_rate=0.02, threshold=0.0)
    stirred = GeneticOptions(population=40, generations=300, crossover_rate=0.0, mutation_rate=0.02, measure=0.05)
    calm, lively = (genetic_tour(costs, closed=True, options=o) for o in (still, stirred))
    assert calm.entropy[0] == pytest.approx(lively.entropy[0])
    assert lively.cost < 0.9 * calm.cost


def test_it_reports_and_asks_whether_to_go_on():
    shares = []
    genetic_tour(cloud(10), closed=True, options=GeneticOptions(population=50, generations=5000), poll=shares.append)
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert len(shares) > 1

    def stop(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        genetic_tour(cloud(10), closed=True, options=SMALL, poll=stop)
