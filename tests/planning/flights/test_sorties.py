"""Sorties against every way to share few stops, and what happens when energy is estimated badly."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError
from gcs.core.scenario import VehicleSpec
from gcs.planning.dynamics.rotor_power import RotorPower
from gcs.planning.flights.sorties import estimated_leg_energy_wh, find_sorties
from gcs.planning.tours.run_exchange import HOME, exchange_stops
from gcs.planning.tours.tour_solver import solve_closed_tour

BASE = np.array([0.0, 0.0, 0.0])


class Plane:
    """Straight legs; energy is estimated as the distance."""

    def __init__(self, stops, base=BASE):
        self.stops_m = stops
        self.base = np.asarray(base)
        self.polls = 0

    def at(self, node):
        return self.base if node == HOME else self.stops_m[node]

    def least_cost(self, a, b):
        return float(np.linalg.norm(self.at(a) - self.at(b)))

    def leg(self, a, b):
        away = self.least_cost(a, b)
        return SimpleNamespace(cost=away, energy_wh=away)

    def cost(self, order):
        return sum(self.least_cost(a, b) for a, b in itertools.pairwise([HOME, *order, HOME]))

    energy_wh = cost

    least_energy_wh = least_cost
    least_run_cost = least_run_energy_wh = cost

    def search(self, order):
        """All legs are straight."""
        return False

    def poll(self):
        self.polls += 1


def sequence(table):
    def of(run):
        nodes = [HOME, *run]
        costs = np.array([[table.least_cost(a, b) for b in nodes] for a in nodes])
        return [run[k - 1] for k in solve_closed_tour(costs)[1:]]

    return of


def solve(stops, usable, true_factor=1.0, sortie_cost=0.0, keep_order=False, raised=1.0, bases=(BASE,)):
    """The runs from several bases, and what was built: numbers of bases and orders."""
    tables = [Plane(stops, base) for base in bases]
    tour = sequence(tables[0])(list(range(len(stops))))
    built = []

    def build(base, order):
        built.append((base, order))
        return base, order

    runs = find_sorties(
        tables,
        [tour, *(sequence(table)(tour) for table in tables[1:] if not keep_order)],
        usable,
        build,
        lambda sortie: true_factor * tables[sortie[0]].cost(sortie[1]),
        [f"V{k}" for k in range(len(stops))],
        raised=raised,
        sortie_cost=sortie_cost,
        resequence=None if keep_order else lambda base, run: sequence(tables[base])(run),
    )
    assert all(run.built == (run.base, run.order) for run in runs)
    return tables[0], tour, runs, built


def partitions(items):
    if not items:
        yield []
        return
    first, *rest = items
    for part in partitions(rest):
        yield [[first], *part]
        for k in range(len(part)):
            yield [*part[:k], [first, *part[k]], *part[k + 1 :]]


def cheapest(tables, usable, sortie_cost):
    """Of all ways to share the stops between sorties, all orders in each, and all bases of each."""
    n = len(tables[0].stops_m)
    best_of = {
        group: min(table.cost(order) for table in tables for order in itertools.permutations(group))
        for size in range(1, n + 1)
        for group in itertools.combinations(range(n), size)
    }
    totals = []
    for part in partitions(list(range(n))):
        costs = [best_of[tuple(sorted(group))] for group in part]
        if max(costs) <= usable:
            totals.append(sum(costs) + sortie_cost * len(costs))
    return min(totals)


@pytest.mark.parametrize("seed", range(10))
def test_near_the_cheapest_of_all_ways(seed):
    rng = np.random.default_rng(seed)
    stops = rng.uniform(-10, 10, (6, 3))
    table = Plane(stops)
    usable = 1.4 * max(table.cost([k]) for k in range(6))
    _, _, runs, _ = solve(stops, usable, sortie_cost=2.0)
    assert sorted(k for run in runs for k in run.order) == list(range(6))
    assert all(run.energy_wh <= usable for run in runs)
    found = sum(table.cost(run.order) + 2.0 for run in runs)
    least = cheapest([table], usable, 2.0)
    assert least - 1e-9 <= found <= 1.12 * least


@pytest.mark.parametrize("seed", range(8))
def test_near_the_cheapest_of_all_ways_from_all_bases(seed):
    rng = np.random.default_rng(50 + seed)
    stops, bases = rng.uniform(-10, 10, (6, 3)), [BASE, *rng.uniform(-12, 12, (2, 3))]
    tables = [Plane(stops, base) for base in bases]
    usable = 1.4 * max(min(table.cost([k]) for table in tables) for k in range(6))
    _, _, runs, _ = solve(stops, usable, sortie_cost=2.0, bases=bases)
    assert sorted(k for run in runs for k in run.order) == list(range(6))
    assert all(run.energy_wh <= usable for run in runs)
    found = sum(tables[run.base].cost(run.order) + 2.0 for run in runs)
    least = cheapest(tables, usable, 2.0)
    assert least - 1e-9 <= found <= 1.12 * least
    assert [run.base for run in runs] == sorted(run.base for run in runs)


def test_stops_near_another_base_are_visited_from_there():
    stops = np.array([[2.0, 0, 0], [98, 0, 0], [3, 1, 0], [99, 1, 0]])
    _, _, runs, _ = solve(stops, 20.0, bases=(BASE, [100.0, 0, 0]))
    assert [(run.base, set(run.order)) for run in runs] == [(0, {0, 2}), (1, {1, 3})]


def test_a_stop_that_only_another_base_reaches_is_no_refusal():
    stops = np.array([[1.0, 0, 0], [11, 0, 0]])
    _, _, runs, _ = solve(stops, 20.0, bases=(BASE, [14.0, 0, 0]))
    assert [(run.base, run.order) for run in runs] == [(0, (0,)), (1, (1,))]
    with pytest.raises(InfeasibleError, match=r"viewpoint V1.*20\.0 Wh.*18\.0 Wh"):
        solve(stops, 18.0, bases=(BASE, [21.0, 0, 0]))


def test_the_order_is_that_of_a_tour_from_its_base():
    """From the first base one sortie is too much; the one from the second begins on its side."""
    stops = np.array([[40.0, 0, 0], [50, 0, 0], [60, 0, 0], [70, 0, 0], [45, 1, 0], [65, 1, 0]])
    bases = (BASE, [30.0, 30, 0], [80.0, 0, 0])
    table, _, runs, _ = solve(stops, 110.0, bases=bases)
    (run,) = runs
    assert run.base == 2
    assert Plane(stops, bases[2]).cost(run.order) == pytest.approx(
        min(Plane(stops, bases[2]).cost(order) for order in itertools.permutations(range(6)))
    )
    assert table.cost(run.order) > 110.0


def test_bases_that_are_no_nearer_are_not_used():
    stops = np.random.default_rng(9).uniform(-10, 10, (15, 3))
    alone, beside = solve(stops, 60.0), solve(stops, 60.0, bases=(BASE, BASE, [300.0, 0, 0]))
    assert [run.order for run in beside[2]] == [run.order for run in alone[2]]
    assert {run.base for run in beside[2]} == {0}


def test_with_other_bases_estimates_are_raised_too():
    stops = np.random.default_rng(3).uniform(-20, 20, (25, 3))
    bases = (BASE, [18.0, 0, 0], [-18.0, 0, 0])
    _, _, runs, built = solve(stops, 90.0, true_factor=1.3, bases=bases)
    assert all(run.energy_wh <= 90.0 for run in runs)
    assert sorted(k for run in runs for k in run.order) == list(range(25))
    assert len(built) == len(set(built))
    assert len({run.base for run in runs}) > 1


def test_the_given_order_is_kept():
    rng = np.random.default_rng(4)
    stops = rng.uniform(-10, 10, (20, 3))
    _, tour, runs, _ = solve(stops, 60.0, keep_order=True)
    assert [k for run in runs for k in run.order] == list(tour)


@pytest.mark.parametrize("seed", range(5))
def test_the_given_order_is_cut_at_least_cost_from_all_bases(seed):
    rng = np.random.default_rng(70 + seed)
    stops, bases = rng.uniform(-10, 10, (6, 3)), [BASE, *rng.uniform(-12, 12, (2, 3))]
    tables = [Plane(stops, base) for base in bases]
    usable = 1.3 * max(min(table.cost([k]) for table in tables) for k in range(6))
    _, tour, runs, _ = solve(stops, usable, sortie_cost=2.0, keep_order=True, bases=bases)
    least = math.inf
    for marks in itertools.product([False, True], repeat=5):
        edges = [0, *(k + 1 for k, mark in enumerate(marks) if mark), 6]
        parts = [tour[a:b] for a, b in itertools.pairwise(edges)]
        costs = [[c for t in tables if (c := t.cost(part)) <= usable] for part in parts]
        if all(costs):
            least = min(least, sum(min(own) + 2.0 for own in costs))
    assert [k for run in runs for k in run.order] == list(tour)
    assert sum(tables[run.base].cost(run.order) + 2.0 for run in runs) == pytest.approx(least)


def test_improving_never_makes_it_dearer():
    for seed in range(5):
        stops = np.random.default_rng(seed).uniform(-10, 10, (40, 3))
        kept = solve(stops, 70.0, keep_order=True)
        free = solve(stops, 70.0)
        assert sum(kept[0].cost(r.order) for r in free[2]) <= sum(kept[0].cost(r.order) for r in kept[2]) + 1e-9


def test_estimates_that_are_too_low_are_raised_until_the_built_ones_fit():
    stops = np.random.default_rng(8).uniform(-10, 10, (25, 3))
    _, _, runs, built = solve(stops, 80.0, true_factor=1.37)
    assert all(run.energy_wh <= 80.0 for run in runs)
    assert sorted(k for run in runs for k in run.order) == list(range(25))
    assert len(built) == len(set(built))


def test_a_far_stop_that_only_the_estimate_rules_out_is_flown_alone():
    stops = np.array([[1.0, 0, 0], [2, 0, 0], [9, 0, 0], [2, 1, 0]])
    _, _, runs, _ = solve(stops, 19.0, raised=1.3)
    assert (2,) in [run.order for run in runs]


def test_a_stop_that_no_battery_reaches_is_named():
    stops = np.array([[1.0, 0, 0], [2, 0, 0], [11, 0, 0]])
    with pytest.raises(InfeasibleError, match=r"viewpoint V2.*22\.0 Wh.*20\.0 Wh"):
        solve(stops, 20.0)


def test_exchange_makes_the_longest_run_shorter():
    stops = np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 0], [0, 1, 0]])
    table = Plane(stops)
    runs = exchange_stops(
        [[0, 1, 2, 3], [4]],
        stops,
        lambda _, a, b: table.least_cost(a, b),
        lambda _, run: table.cost(run) + len(run),
        longest=True,
        poll=table.poll,
    )
    assert max(table.cost(run) + len(run) for run in runs) < 12.0
    assert sorted(k for run in runs for k in run) == list(range(5))
    assert table.polls > 0


def test_energy_of_a_leg_is_power_times_time():
    power = RotorPower.of(VehicleSpec())
    path = np.array([[0.0, 0, 0], [0, 0, 10], [20, 0, 10]])
    leg_time = lambda length: length / 2.0  # noqa: E731
    up, level = power.power_w([0, 0, 2.0], np.zeros(3)), power.power_w([2.0, 0, 0], np.zeros(3))
    expected = (5 * up + 10 * level + 1.2 * power.hover_w) / 3600
    assert estimated_leg_energy_wh(path, power, leg_time, 1.2) == pytest.approx(float(expected))
    nowhere = estimated_leg_energy_wh(path[[0, 0]], power, leg_time, 1.2)
    assert nowhere == pytest.approx(1.2 * power.hover_w / 3600)
    assert math.isfinite(nowhere)
