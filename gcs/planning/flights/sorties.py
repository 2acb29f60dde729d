"""Sorties: a tour that takes more than one battery, flown in parts that each come home with the reserve.

The base of a sortie is where it takes off and lands. Tours' orders are cut where that costs least, with the bases with
which it does (`order_split`), stops are then handed between sorties where that is cheaper still, and each sortie is
given the base and the order that are cheapest for it. All this works with estimates of the energy. What counts is the
energy of the finished curves: while one of them is over the limit, the estimates are raised to what was found and the
tours are cut anew.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.tours.order_split import OrderCosts, split_order
from gcs.planning.tours.run_exchange import HOME, exchange_stops

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from gcs.planning.dynamics.rotor_power import RotorPower
    from gcs.planning.tours.leg_table import LegTable

Built = TypeVar("Built")

BATTERY_SWAP_S = 60.0
"""Time on the ground between two sorties, for a swap of the battery."""

MOST_TURNS = 12
SURPLUS = 1.002
"""The estimates are raised this much above what they fell short by."""


class BaseAndStops(NamedTuple):
    """A sortie before it is built: the number of its base, and its stops in visiting order."""

    base: int
    stops: list[int]


@dataclass(frozen=True, eq=False)
class SortieRun(Generic[Built]):
    """One sortie.

    Attributes:
        base: number of the base that it takes off from and lands at.
        order: its stops in visiting order.
        built: its trajectory, as it was built.
        energy_wh: of that trajectory.
    """

    base: int
    order: tuple[int, ...]
    built: Built
    energy_wh: float


def estimated_leg_energy_wh(
    path_m: NDArray[np.float64],
    power: RotorPower,
    leg_time: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    dwell_s: float,
) -> float:
    """Energy (Wh) of a leg at its mean speed, and of a dwell at its end.

    Args:
        path_m: polyline, shape (K, 3).
        power: of the vehicle.
        leg_time: time (s) of rest-to-rest legs of given lengths (m).
        dwell_s: at its end.
    """
    step = np.diff(path_m, axis=0)
    length = np.linalg.norm(step, axis=1)
    total = float(length.sum())
    at_rest = power.hover_w * dwell_s
    if total < 1e-9:
        return at_rest / 3600
    seconds = float(leg_time(np.array(total)))
    moving = length > 0
    velocity = step[moving] / length[moving, None] * (total / seconds)
    watts = power.power_w(velocity, np.zeros(3))
    return (float(watts @ length[moving]) / total * seconds + at_rest) / 3600


def find_sorties(
    tables: Sequence[LegTable],
    orders: Sequence[Sequence[int]],
    usable_wh: float,
    build: Callable[[int, Sequence[int]], Built],
    energy_wh: Callable[[Built], float],
    names: Sequence[str],
    *,
    raised: float,
    sortie_cost: float,
    resequence: Callable[[int, Sequence[int]], Sequence[int]] | None,
) -> list[SortieRun[Built]]:
    """Cut a tour into sorties.

    Args:
        tables: legs with their costs and estimated energies, for each base.
        orders: the stops in the visiting orders of one or several tours; the one that is cut best is taken.
        usable_wh: what one sortie may take.
        build: makes the trajectory of a sortie from the number of its base and its stops.
        energy_wh: of such a trajectory.
        names: of the stops, for messages.
        raised: what the estimates are multiplied with at first.
        sortie_cost: of one sortie besides its legs, in the unit of the costs.
        resequence: gives a better order of the stops of a sortie from a base; None where the given order has to be
            kept.

    Returns:
        The sorties in the order in which they are flown, those of a base one after the other unless the given order
        has to be kept; every stop is in one of them, and none takes more than it may.

    Raises:
        InfeasibleError: a stop alone takes more from every base; it is named, with the least that it takes.
    """
    search = _Sorties(tables, usable_wh, build, energy_wh, names, raised, sortie_cost, resequence)
    for _ in range(MOST_TURNS):
        runs = search.cut(orders)
        over = max(run.energy_wh for run in runs) > usable_wh
        if not over:
            return runs if resequence is None else sorted(runs, key=lambda run: run.base)
    raise InfeasibleError(
        "the sorties' energy could not be brought under what a battery may give: take a larger battery",
        field="vehicle.battery",
    )


class _Sorties(Generic[Built]):
    def __init__(
        self,
        tables: Sequence[LegTable],
        usable_wh: float,
        build: Callable[[int, Sequence[int]], Built],
        energy_wh: Callable[[Built], float],
        names: Sequence[str],
        raised: float,
        sortie_cost: float,
        resequence: Callable[[int, Sequence[int]], Sequence[int]] | None,
    ) -> None:
        self._tables = tables
        self._usable = usable_wh
        self._build = build
        self._energy_of = energy_wh
        self._names = names
        self._raised = raised
        self._sortie_cost = sortie_cost
        self._resequence = resequence
        self._known: dict[tuple[int, tuple[int, ...]], SortieRun[Built]] = {}

    def cut(self, orders: Sequence[Sequence[int]]) -> list[SortieRun[Built]]:
        """Cut with the estimates as they are, build, and raise them where they were too low."""
        best = min((self._split(order) for order in orders), key=lambda runs: sum(map(self._value, runs)))
        runs = [self._run(base, stops) for base, stops in self._improved(best)]
        worst = max(runs, key=lambda run: run.energy_wh)
        if worst.energy_wh > self._usable:
            estimate = self._tables[worst.base].energy_wh(worst.order)
            self._raised = max(SURPLUS * worst.energy_wh / estimate, SURPLUS * self._raised)
        return runs

    def _split(self, order: Sequence[int]) -> list[BaseAndStops]:
        """Cut at least cost; only legs that the cuts tried on the way there would be flown by are searched."""
        while True:
            self._tables[0].poll()
            costs = [OrderCosts.of_order(order, table.least_cost) for table in self._tables]
            uses = [self._order_uses(order, table) for table in self._tables]
            cuts = split_order(costs, uses, self._usable, self._sortie_cost)
            if cuts is None:
                return self._split_about_far_ones(order, uses)
            runs = [BaseAndStops(cut.base, list(order[cut.stops])) for cut in cuts]
            searched = [self._tables[run.base].search(run.stops) for run in runs]
            if not any(searched):
                return runs

    def _order_uses(self, order: Sequence[int], table: LegTable) -> OrderCosts:
        return OrderCosts.of_order(order, lambda a, b: table.least_energy_wh(a, b) * self._raised)

    def _split_about_far_ones(self, order: Sequence[int], uses: Sequence[OrderCosts]) -> list[BaseAndStops]:
        """Some stop is estimated to take too much alone; what it takes is known when it is built."""
        alone = {
            k: self._alone(stop) for k, stop in enumerate(order) if min(own.of_run(k, k) for own in uses) > self._usable
        }
        cuts = sorted({0, len(order), *alone, *(k + 1 for k in alone)})
        runs: list[BaseAndStops] = []
        for first, end in itertools.pairwise(cuts):
            if first in alone:
                runs.append(alone[first])
            else:
                runs.extend(self._split(order[first:end]))
        return runs

    def _alone(self, stop: int) -> BaseAndStops:
        """A sortie to one stop, from the cheapest base from which it takes no more than it may when it is built."""
        runs = [self._run(base, [stop]) for base in range(len(self._tables))]
        enough = [run for run in runs if run.energy_wh <= self._usable]
        if enough:
            cheapest = min(enough, key=lambda run: self._tables[run.base].cost(run.order))
            return BaseAndStops(cheapest.base, [stop])
        least = min(run.energy_wh for run in runs)
        raise InfeasibleError(
            f"a flight to it alone takes {least:.1f} Wh, and {self._usable:.1f} Wh may be taken: take "
            "a larger battery, fly faster, start nearer to it, or leave it out",
            field=f"viewpoint {self._names[stop]}",
        )

    def _improved(self, runs: list[BaseAndStops]) -> list[BaseAndStops]:
        if self._resequence is None:
            return runs
        runs = self._merged(runs)
        bases = [run.base for run in runs]
        exchanged = exchange_stops(
            [run.stops for run in runs],
            self._tables[0].stops_m,
            lambda number, a, b: self._tables[bases[number]].least_cost(a, b),
            lambda number, stops: self._value(BaseAndStops(bases[number], list(stops))),
            longest=False,
            poll=self._tables[0].poll,
        )
        return [self._bettered(BaseAndStops(base, stops)) for base, stops in zip(bases, exchanged, strict=True)]

    def _merged(self, runs: list[BaseAndStops]) -> list[BaseAndStops]:
        """Sorties put together two by two where one is enough and cheaper: the tour may have come by a place twice."""
        for one, other in itertools.combinations(runs, 2):
            two = self._value(one) + self._value(other)
            pairs = [(one.stops, other.stops), (one.stops, other.stops[::-1]), (one.stops[::-1], other.stops)]
            orders = [*(a + b for a, b in pairs), other.stops + one.stops]
            both = [BaseAndStops(base, order) for base in {one.base, other.base} for order in orders]
            best = min((run for run in both if self._may_be_less(run, two)), key=self._value, default=None)
            if best is not None and self._value(best) < two:
                return self._merged([best if run is one else run for run in runs if run is not other])
        return runs

    def _may_be_less(self, run: BaseAndStops, value: float) -> bool:
        """Whether a sortie may be worth less, before its legs are searched."""
        table = self._tables[run.base]
        if table.least_run_cost(run.stops) + self._sortie_cost >= value:
            return False
        return table.least_run_energy_wh(run.stops) * self._raised <= self._usable

    def _bettered(self, run: BaseAndStops) -> BaseAndStops:
        """A sortie with the base that is nearest to its round, and in a better order, where that is cheaper."""
        nearest = min(range(len(self._tables)), key=lambda base: (self._way_aside(base, run.stops), base != run.base))
        ways = [run] if nearest == run.base else [run, BaseAndStops(nearest, run.stops)]
        if self._resequence is not None and len(run.stops) > 2:
            ways += [BaseAndStops(way.base, list(self._resequence(*way))) for way in ways]
        return min(ways, key=self._value)

    def _way_aside(self, base: int, stops: Sequence[int]) -> float:
        """About what it costs to come by a base on a round of some stops."""
        least = self._tables[base].least_cost
        legs = zip(stops, [*stops[1:], stops[0]], strict=True)
        return min(least(a, HOME) + least(HOME, b) - (0.0 if a == b else least(a, b)) for a, b in legs)

    def _value(self, run: BaseAndStops) -> float:
        """Cost of a sortie; infinite when it is estimated to take too much."""
        if not self._fits(run):
            return math.inf
        return self._tables[run.base].cost(run.stops) + self._sortie_cost

    def _fits(self, run: BaseAndStops) -> bool:
        known = self._known.get((run.base, tuple(run.stops)))
        used = self._tables[run.base].energy_wh(run.stops) * self._raised if known is None else known.energy_wh
        return used <= self._usable

    def _run(self, base: int, stops: Sequence[int]) -> SortieRun[Built]:
        key = base, tuple(stops)
        if key not in self._known:
            built = self._build(*key)
            self._known[key] = SortieRun(*key, built, self._energy_of(built))
        return self._known[key]
