"""Cuts of an order against every cut there is, from every home."""

import itertools
import math

import numpy as np
import pytest

from gcs.planning.tours.order_split import Cut, OrderCosts, share_order, split_order


def random_costs(rng, n, stops=None):
    home = rng.uniform(0, 10, 2)
    stops = rng.uniform(0, 10, (n, 2)) if stops is None else stops
    away = np.linalg.norm(stops - home, axis=1)
    return OrderCosts(away, np.linalg.norm(np.diff(stops, axis=0), axis=1), away * rng.uniform(0.5, 1.5, n))


def every_cut(n):
    for marks in itertools.product([False, True], repeat=n - 1):
        edges = [0, *(k + 1 for k, mark in enumerate(marks) if mark), n]
        yield [slice(a, b) for a, b in itertools.pairwise(edges)]


def total(costs, runs):
    return sum(costs.out[r.start] + costs.between[r.start : r.stop - 1].sum() + costs.back[r.stop - 1] for r in runs)


@pytest.mark.parametrize("seed", range(12))
def test_the_cheapest_of_all_cuts(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 10))
    costs, uses = random_costs(rng, n), random_costs(rng, n)
    run_cost = float(rng.uniform(0, 3))
    singles = max(total(uses, [slice(k, k + 1)]) for k in range(n))
    limit = singles * float(rng.uniform(1.0, 2.0))
    found = [run.stops for run in split_order([costs], [uses], limit, run_cost)]
    allowed = [runs for runs in every_cut(n) if all(total(uses, [r]) <= limit for r in runs)]
    least = min(total(costs, runs) + run_cost * len(runs) for runs in allowed)
    assert total(costs, found) + run_cost * len(found) == pytest.approx(least)
    assert all(total(uses, [r]) <= limit * (1 + 1e-12) for r in found)
    assert [k for r in found for k in range(n)[r]] == list(range(n))


def test_a_stop_that_uses_too_much_on_its_own():
    costs = random_costs(np.random.default_rng(1), 5)
    costs = OrderCosts(costs.out, costs.between, costs.out)
    limit = max(costs.of_run(k, k) for k in range(5)) * 0.999
    assert split_order([costs], [costs], limit) is None


def test_enough_for_all_is_one_run():
    costs = random_costs(np.random.default_rng(2), 6)
    assert split_order([costs, costs], [costs, costs], math.inf, 1.0) == [Cut(0, slice(0, 6))]


@pytest.mark.parametrize("seed", range(12))
def test_the_cheapest_of_all_cuts_and_all_homes(seed):
    rng = np.random.default_rng(200 + seed)
    n, homes = int(rng.integers(2, 8)), int(rng.integers(2, 4))
    stops = rng.uniform(0, 10, (n, 2))
    costs = [random_costs(rng, n, stops) for _ in range(homes)]
    uses = [random_costs(rng, n, stops) for _ in range(homes)]
    run_cost = float(rng.uniform(0, 3))
    singles = max(min(total(own, [slice(k, k + 1)]) for own in uses) for k in range(n))
    limit = singles * float(rng.uniform(1.0, 2.0))
    found = split_order(costs, uses, limit, run_cost)
    least = min(
        sum(total(costs[home], [run]) + run_cost for home, run in zip(chosen, runs, strict=True))
        for runs in every_cut(n)
        for chosen in itertools.product(range(homes), repeat=len(runs))
        if all(total(uses[home], [run]) <= limit for home, run in zip(chosen, runs, strict=True))
    )
    assert sum(total(costs[run.base], [run.stops]) + run_cost for run in found) == pytest.approx(least)
    assert all(total(uses[run.base], [run.stops]) <= limit * (1 + 1e-12) for run in found)
    assert [k for run in found for k in range(n)[run.stops]] == list(range(n))


def test_a_stop_that_only_another_home_is_near_enough_to():
    far = OrderCosts(np.array([1.0, 9.0]), np.array([8.0]), np.array([1.0, 9.0]))
    near = OrderCosts(np.array([9.0, 1.0]), np.array([8.0]), np.array([9.0, 1.0]))
    assert split_order([far, near], [far, near], 4.0) == [Cut(0, slice(0, 1)), Cut(1, slice(1, 2))]
    assert split_order([far], [far], 4.0) is None


@pytest.mark.parametrize("seed", range(12))
def test_the_shortest_longest_run_of_all_shares(seed):
    rng = np.random.default_rng(100 + seed)
    n = int(rng.integers(3, 10))
    vehicles = int(rng.integers(1, 4))
    stops = rng.uniform(0, 10, (n, 2))
    times = [random_costs(rng, n, stops) for _ in range(vehicles)]
    found = share_order(times)
    every = [runs for runs in every_cut(n) if len(runs) == vehicles]
    least = min(max(total(t, [r]) for t, r in zip(times, runs, strict=True)) for runs in every)
    assert len(found) == vehicles
    assert max(total(t, [r]) for t, r in zip(times, found, strict=True)) == pytest.approx(least)
    assert [k for r in found for k in range(n)[r]] == list(range(n))


def test_more_vehicles_than_stops():
    times = [random_costs(np.random.default_rng(3), 2)] * 3
    with pytest.raises(ValueError, match="more vehicles"):
        share_order(times)
