"""The work of one inspection shared by several vehicles, so that the last of them is done as early as possible.

One tour through all viewpoints is cut into as many runs as there are vehicles (`order_split`), stops are handed from
the longest run to others (`run_exchange`), and each run is put into a better order of its own. The flights are then
scheduled so that vehicles stay apart (`fleet_schedule`), which is proved over all time (`separation`). The proof is
about vehicles that keep to the common clock; one that falls behind has to be held, or the others have to wait for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.dynamics.energy import energy_wh
from gcs.planning.flights.battery_flights import Flight
from gcs.planning.flights.fleet_pads import pads_of_fleet
from gcs.planning.flights.fleet_schedule import schedule_fleet
from gcs.planning.flights.flight_base import base_at, leg_time_of, tour_from
from gcs.planning.flights.plan_group import PlanGroup
from gcs.planning.flights.rally_points import check_rally_points
from gcs.planning.flights.separation import Separation, least_separation
from gcs.planning.flights.viewpoint_choice import choose_viewpoints
from gcs.planning.paths.string_pulling import path_length
from gcs.planning.planner import Stopwatch, build_flight, coverage_together, plans_of_flights
from gcs.planning.tours.leg_table import LegTable
from gcs.planning.tours.order_split import OrderCosts, share_order
from gcs.planning.tours.run_exchange import HOME, exchange_stops
from gcs.planning.views.viewing_angles import HOLD_S, SETTLE_S
from gcs.planning.views.viewpoints import find_viewpoints

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.flights.flight_base import FlightBase
    from gcs.planning.tours.tour import Tour
    from gcs.planning.views.viewpoint_pose import ViewpointPose


VISIT_S = SETTLE_S + HOLD_S
"""Time that a visit takes at least."""


@dataclass(frozen=True, eq=False)
class Fleet(PlanGroup):
    """Plans of several vehicles that are flown at the same time.

    Attributes:
        separation: the nearest that two of them come, on the fleet's clock.
        lower_bound_s: no sharing of these viewpoints ends before this.
    """

    separation: Separation
    lower_bound_s: float


def plan_fleet(scenario: Scenario, structure: Structure, progress: Progress) -> Fleet:
    """Plan an inspection by several vehicles.

    Args:
        scenario: what is asked; `vehicle.count` is at least 2.
        structure: the placed structure.
        progress: told of every stage; may cancel.

    Raises:
        InputError: more vehicles than viewpoints, pads that are too near to each other or to something.
        InfeasibleError: there is no plan; says why and what would help.
        OperationCancelled: the progress said so.
    """
    count = scenario.vehicle.count
    home = base_at(scenario.home_m, scenario, structure, progress)
    scene = home.scene
    check_rally_points(scenario, scene.distance)
    found = find_viewpoints(home.scenario, structure, scene.space, scene.distance, progress)
    most = len(found.poses)
    if count > most:
        raise InputError(f"{count} vehicles for {most} viewpoints: use {most} at most", field="vehicle.count")
    poses, whole = choose_viewpoints(home, found.poses, found.others, progress)
    pads = pads_of_fleet(scenario, scene.distance, np.mean([p.position_m for p in poses], axis=0))
    bases = [home, *(base_at(pad, scenario, structure, progress) for pad in pads[1:])]
    sharing = _Sharing(bases, poses, progress)
    tours = sharing.tours(whole)
    watch = Stopwatch()
    built = [
        build_flight(base.scenario, base.scene.space, tour, poses, progress, watch)
        for base, tour in zip(bases, tours, strict=True)
    ]
    names = [f"vehicle {k + 1}" for k in range(count)]
    schedule = schedule_fleet(built, scenario.safety.apart_m, names, progress)
    separation = least_separation([flight.curve for flight in schedule], progress)
    if separation.distance_m < scenario.safety.apart_m:
        a, b = separation.pair
        raise InfeasibleError(
            f"{names[a]} and {names[b]} come as near as {separation.distance_m:.2f} m at {separation.time_s:.1f} s, "
            f"and {scenario.safety.apart_m:.2f} m are asked: ask for less separation, or use fewer vehicles",
            field="safety.separation_m",
        )
    flights = [
        Flight(base, tour, flight.built, energy_wh(flight.built.trajectory, scenario.vehicle))
        for base, tour, flight in zip(bases, tours, schedule, strict=True)
    ]
    plans = plans_of_flights(flights, "vehicle", structure, poses, found.faces, progress)
    earliest = min(flight.start_s for flight in schedule)
    return Fleet(
        plans=plans,
        starts_s=tuple(flight.start_s - earliest for flight in schedule),
        separation=replace(separation, time_s=separation.time_s - earliest),
        lower_bound_s=sharing.lower_bound_s,
        coverage=coverage_together(home, plans, structure, progress),
    )


class _Sharing:
    """Who visits what, by estimated times."""

    def __init__(self, bases: Sequence[FlightBase], poses: Sequence[ViewpointPose], progress: Progress) -> None:
        self._bases = bases
        self._poses = poses
        self._places = np.array([p.position_m for p in poses])
        self._progress = progress
        self.lower_bound_s = 0.0
        leg_time = leg_time_of(bases[0].scenario.vehicle)
        self._tables = [
            LegTable(
                base.scene.space,
                np.asarray(base.scenario.home_m, dtype=np.float64),
                self._places,
                lambda path: float(leg_time(np.array(path_length(path)))) + VISIT_S,
                lambda _: 0.0,  # batteries are asked when the flights are there
                progress,
            )
            for base in bases
        ]

    def tours(self, whole: Tour) -> list[Tour]:
        """The tour of each vehicle, from that of the first one alone; their `order` numbers all viewpoints."""
        self.lower_bound_s = self._lower_bound_s(whole)
        there = whole.order.tolist()
        runs = min((self._cut(order) for order in (there, there[::-1])), key=self._longest)
        if self._bases[0].scenario.planner.tour != "given":
            runs = exchange_stops(
                runs,
                self._places,
                lambda number, a, b: self._tables[number].least_cost(a, b),
                lambda number, stops: self._tables[number].cost(stops),
                longest=True,
                poll=self._tables[0].poll,
            )
        return [self._tour(number, run) for number, run in enumerate(runs)]

    def _lower_bound_s(self, whole: Tour) -> float:
        """Time that no sharing undercuts.

        Some vehicle goes to the furthest viewpoint. And one vehicle could fly all runs one after the other, from and to
        its own home, in the sum of their times and of ways between its pad and the others': so no runs are shorter in
        total than the bound of that tour less those ways, and the longest not shorter than their mean.
        """
        tables, nodes = self._tables, range(len(self._places))
        alone = max(min(table.least_cost(HOME, k) + table.least_cost(k, HOME) for table in tables) for k in nodes)
        if whole.metric != "time":
            return alone - VISIT_S
        first, links = tables[0], 0.0
        for table in tables[1:]:
            via = min(nodes, key=lambda k: first.least_cost(HOME, k) + table.least_cost(k, HOME))
            links += 2 * (first.leg(HOME, via).cost + table.leg(via, HOME).cost - 2 * VISIT_S)
        mean = (whole.lower_bound + len(nodes) * VISIT_S - links) / len(tables)
        return max(alone - VISIT_S, mean)

    def _cut(self, order: list[int]) -> list[list[int]]:
        times = [OrderCosts.of_order(order, table.least_cost) for table in self._tables]
        return [order[run] for run in share_order(times)]

    def _longest(self, runs: list[list[int]]) -> float:
        return max(self._tables[number].cost(run) for number, run in enumerate(runs))

    def _tour(self, number: int, run: Sequence[int]) -> Tour:
        return tour_from(self._bases[number], run, self._poses, self._progress)
