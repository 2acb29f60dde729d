"""Sorties: a tour that takes more than one battery, flown in parts that each come home with the reserve.

The tour's order is cut where it costs least (`order_split`), stops are then handed between sorties where that is
cheaper still, and each sortie is put into a better order of its own. All this works with estimates of the energy. What
counts is the energy of the finished curves: while one of them is over the limit, the estimates are raised to what was
found and the tour is cut anew.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

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


@dataclass(frozen=True, eq=False)
class SortieRun(Generic[Built]):
    """One sortie.

    Attributes:
        order: its stops in visiting order.
        built: its trajectory, as it was built.
        energy_wh: of that trajectory.
    """

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
    table: LegTable,
    order: Sequence[int],
    usable_wh: float,
    build: Callable[[Sequence[int]], Built],
    energy_wh: Callable[[Built], float],
    names: Sequence[str],
    *,
    raised: float,
    sortie_cost: float,
    resequence: Callable[[Sequence[int]], Sequence[int]] | None,
) -> list[SortieRun[Built]]:
    """Cut a tour into sorties.

    Args:
        table: legs with their costs and estimated energies.
        order: the tour's stops in visiting order.
        usable_wh: what one sortie may take.
        build: makes the trajectory of a sortie from its stops.
        energy_wh: of such a trajectory.
        names: of the stops, for messages.
        raised: what the estimates are multiplied with at first.
        sortie_cost: of one sortie besides its legs, in the unit of the costs.
        resequence: gives a better order of the stops of a sortie; None where the given order has to be kept.

    Returns:
        The sorties in the order in which they are flown; every stop is in one of them, and none takes more than it
        may.

    Raises:
        InfeasibleError: a stop alone takes more; it is named, with what it takes.
    """
    search = _Sorties(table, usable_wh, build, energy_wh, names, raised, sortie_cost, resequence)
    for _ in range(MOST_TURNS):
        runs = search.cut(order)
        over = max(run.energy_wh for run in runs) > usable_wh
        if not over:
            return runs
    raise InfeasibleError(
        "the sorties' energy could not be brought under what a battery may give: take a larger battery",
        field="vehicle.battery",
    )


class _Sorties(Generic[Built]):
    def __init__(
        self,
        table: LegTable,
        usable_wh: float,
        build: Callable[[Sequence[int]], Built],
        energy_wh: Callable[[Built], float],
        names: Sequence[str],
        raised: float,
        sortie_cost: float,
        resequence: Callable[[Sequence[int]], Sequence[int]] | None,
    ) -> None:
        self._table = table
        self._usable = usable_wh
        self._build = build
        self._energy_of = energy_wh
        self._names = names
        self._raised = raised
        self._sortie_cost = sortie_cost
        self._resequence = resequence
        self._known: dict[tuple[int, ...], SortieRun[Built]] = {}

    def cut(self, order: Sequence[int]) -> list[SortieRun[Built]]:
        """Cut with the estimates as they are, build, and raise them where they were too low."""
        runs = [self._run(stops) for stops in self._improved(self._split(order))]
        worst = max(runs, key=lambda run: run.energy_wh)
        if worst.energy_wh > self._usable:
            self._raised = max(SURPLUS * worst.energy_wh / self._table.energy_wh(worst.order), SURPLUS * self._raised)
        return runs

    def _split(self, order: Sequence[int]) -> list[list[int]]:
        costs = self._order_costs(order, lambda a, b: self._table.leg(a, b).cost)
        uses = self._order_costs(order, lambda a, b: self._table.leg(a, b).energy_wh * self._raised)
        runs = split_order(costs, uses, self._usable, self._sortie_cost)
        if runs is not None:
            return [list(order[run]) for run in runs]
        return self._split_about_far_ones(order, uses)

    def _split_about_far_ones(self, order: Sequence[int], uses: OrderCosts) -> list[list[int]]:
        """Some stop is estimated to take too much alone; what it takes is known when it is built."""
        alone = [k for k in range(len(order)) if uses.of_run(k, k) > self._usable]
        if not alone:
            return [[stop] for stop in order]
        for k in alone:
            run = self._run([order[k]])
            if run.energy_wh > self._usable:
                raise InfeasibleError(
                    f"a flight to it alone takes {run.energy_wh:.1f} Wh, and {self._usable:.1f} Wh may be taken: take "
                    "a larger battery, fly faster, start nearer to it, or leave it out",
                    field=f"viewpoint {self._names[order[k]]}",
                )
        cuts = sorted({0, len(order), *alone, *(k + 1 for k in alone)})
        runs: list[list[int]] = []
        for first, end in itertools.pairwise(cuts):
            part = list(order[first:end])
            if first in alone:
                runs.append(part)
            else:
                runs.extend(self._split(part))
        return runs

    def _order_costs(self, order: Sequence[int], value: Callable[[int, int], float]) -> OrderCosts:
        return OrderCosts(
            out=np.array([value(HOME, stop) for stop in order]),
            between=np.array([value(a, b) for a, b in itertools.pairwise(order)]),
            back=np.array([value(stop, HOME) for stop in order]),
        )

    def _improved(self, runs: list[list[int]]) -> list[list[int]]:
        if self._resequence is None:
            return runs
        runs = exchange_stops(
            runs,
            self._table.stops_m,
            lambda _, a, b: self._table.least_cost(a, b),
            lambda _, stops: self._value(stops),
            longest=False,
            poll=self._table.poll,
        )
        return [self._sequenced(run) for run in runs]

    def _sequenced(self, run: list[int]) -> list[int]:
        other = list(self._resequence(run)) if self._resequence is not None and len(run) > 2 else run
        return min(run, other, key=self._value)

    def _value(self, stops: Sequence[int]) -> float:
        """Cost of a sortie; infinite when it is estimated to take too much."""
        if not self._fits(stops):
            return math.inf
        return self._table.cost(stops) + self._sortie_cost

    def _fits(self, stops: Sequence[int]) -> bool:
        known = self._known.get(tuple(stops))
        used = self._table.energy_wh(stops) * self._raised if known is None else known.energy_wh
        return used <= self._usable

    def _run(self, stops: Sequence[int]) -> SortieRun[Built]:
        key = tuple(stops)
        if key not in self._known:
            built = self._build(key)
            self._known[key] = SortieRun(key, built, self._energy_of(built))
        return self._known[key]
