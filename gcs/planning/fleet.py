"""The work of one inspection shared by several vehicles, so that the last of them is done as early as possible.

One tour through all viewpoints is cut into as many runs as there are vehicles (`order_split`), stops are handed from
the longest run to others (`run_exchange`), and each run is put into a better order of its own. The flights are then
scheduled so that vehicles stay apart (`fleet_schedule`), which is proved over all time (`separation`). The proof is
about vehicles that keep to the common clock; one that falls behind has to be held, or the others have to wait for it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.dynamics.energy import energy_wh
from gcs.planning.flights.battery_flights import Flight
from gcs.planning.flights.fleet_pads import pads_of_fleet
from gcs.planning.flights.fleet_schedule import schedule_fleet
from gcs.planning.flights.partial_inspection import part_of_faces, part_of_scenario
from gcs.planning.flights.separation import Separation, least_separation
from gcs.planning.paths.string_pulling import path_length
from gcs.planning.planner import SAMPLES_OF_PARTS, Stopwatch, build_flight, plan_of_flight, prepare_scene
from gcs.planning.tours.leg_table import LegTable
from gcs.planning.tours.order_split import OrderCosts, share_order
from gcs.planning.tours.run_exchange import HOME, exchange_stops
from gcs.planning.tours.tour import find_tour
from gcs.planning.trajectories.time_allocation import FlightLimits
from gcs.planning.trajectories.trajectory_builder import estimated_leg_time_s
from gcs.planning.views.coverage import certify_coverage
from gcs.planning.views.viewing_angles import HOLD_S, SETTLE_S
from gcs.planning.views.viewpoints import find_viewpoints

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.plan import FaceCoverage, Plan
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.core.surface_coverage import SurfaceCoverage
    from gcs.planning.planner import Scene
    from gcs.planning.tours.tour import Tour
    from gcs.planning.views.viewpoint_pose import ViewpointPose


VISIT_S = SETTLE_S + HOLD_S
"""Time that a visit takes at least."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """Plans that are flown at the same time.

    Attributes:
        plans: of each vehicle, complete, on its own time from take-off.
        starts_s: when each takes off, on the fleet's clock; the first at 0.
        separation: the nearest that two of them come, on the fleet's clock.
        lower_bound_s: no sharing of these viewpoints ends before this.
        coverage: what all of them see together, when a surface was asked for.
    """

    plans: tuple[Plan, ...]
    starts_s: tuple[float, ...]
    separation: Separation
    lower_bound_s: float
    coverage: SurfaceCoverage | None

    @property
    def end_s(self) -> float:
        """When the last one has landed."""
        return max(s + p.trajectory.duration_s for s, p in zip(self.starts_s, self.plans, strict=True))


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
    first = _of_one(scenario, scenario.home_m)
    scene = prepare_scene(first, structure, progress)
    found = find_viewpoints(first, structure, scene.space, scene.distance, progress)
    poses = found.poses
    if count > len(poses):
        raise InputError(
            f"{count} vehicles for {len(poses)} viewpoints: use {len(poses)} at most", field="vehicle.count"
        )
    pads = pads_of_fleet(scenario, scene.distance, np.mean([p.position_m for p in poses], axis=0))
    scenarios = [first, *(_of_one(scenario, (float(x), float(y), float(z))) for x, y, z in pads[1:])]
    scenes = [scene, *(prepare_scene(one, structure, progress) for one in scenarios[1:])]
    sharing = _Sharing(scenarios, scenes, poses, progress)
    tours = sharing.tours()
    watch = Stopwatch()
    built = [
        build_flight(one, scene.space, tour, poses, progress, watch)
        for one, scene, tour in zip(scenarios, scenes, tours, strict=True)
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
        Flight(tour, flight.built, energy_wh(flight.built.trajectory, scenario.vehicle))
        for tour, flight in zip(tours, schedule, strict=True)
    ]
    plans = _plans(scenarios, structure, scenes, flights, poses, found.faces, progress)
    earliest = min(flight.start_s for flight in schedule)
    return Fleet(
        plans=plans,
        starts_s=tuple(flight.start_s - earliest for flight in schedule),
        separation=replace(separation, time_s=separation.time_s - earliest),
        lower_bound_s=sharing.lower_bound_s,
        coverage=certify_coverage(
            first,
            structure,
            [view for plan in plans for view in plan.viewpoints],
            scene.space.model.fence,
            scene.distance,
            progress,
        ),
    )


def _of_one(scenario: Scenario, home_m: tuple[float, float, float]) -> Scenario:
    """The scenario of one vehicle of the fleet."""
    vehicle = scenario.vehicle.model_copy(update={"count": 1, "pads_m": ()})
    return scenario.model_copy(update={"vehicle": vehicle, "home_m": home_m})


def _plans(
    scenarios: Sequence[Scenario],
    structure: Structure,
    scenes: Sequence[Scene],
    flights: Sequence[Flight],
    poses: Sequence[ViewpointPose],
    faces: tuple[FaceCoverage, ...],
    progress: Progress,
) -> tuple[Plan, ...]:
    plans: list[Plan] = []
    for number, (scenario, scene, flight) in enumerate(zip(scenarios, scenes, flights, strict=True), start=1):
        mine = {poses[int(k)].name for k in flight.tour.order}
        plans.append(
            plan_of_flight(
                part_of_scenario(scenario, mine, f"vehicle {number} of {len(flights)}"),
                structure,
                scene,
                flight,
                poses,
                part_of_faces(scenario, faces, mine),
                progress,
                Stopwatch(),
                first_id=sum(len(plan.viewpoints) for plan in plans),
                samples=SAMPLES_OF_PARTS,
            )
        )
    return tuple(plans)


class _Sharing:
    """Who visits what, by estimated times."""

    def __init__(
        self, scenarios: Sequence[Scenario], scenes: Sequence[Scene], poses: Sequence[ViewpointPose], progress: Progress
    ) -> None:
        self._scenarios = scenarios
        self._scenes = scenes
        self._names = [p.name for p in poses]
        self._places = np.array([p.position_m for p in poses])
        self._progress = progress
        self.lower_bound_s = 0.0
        vehicle = scenarios[0].vehicle
        self._limits = FlightLimits(vehicle.max_speed_m_s, vehicle.max_acceleration_m_s2, vehicle.max_jerk_m_s3)
        self._tables = [
            LegTable(
                scene.space,
                np.asarray(one.home_m, dtype=np.float64),
                self._places,
                lambda path: float(self._leg_time(np.array(path_length(path)))) + VISIT_S,
                lambda _: 0.0,  # batteries are asked when the flights are there
                progress,
            )
            for one, scene in zip(scenarios, scenes, strict=True)
        ]

    def tours(self) -> list[Tour]:
        """The tour of each vehicle; their `order` numbers all viewpoints."""
        whole = self._tour(0, range(len(self._places)))
        self.lower_bound_s = self._lower_bound_s(whole)
        there = whole.order.tolist()
        runs = min((self._cut(order) for order in (there, there[::-1])), key=self._longest)
        if self._scenarios[0].planner.tour != "given":
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
        times = [self._order_times(number, order) for number in range(len(self._tables))]
        return [order[run] for run in share_order(times)]

    def _longest(self, runs: list[list[int]]) -> float:
        return max(self._tables[number].cost(run) for number, run in enumerate(runs))

    def _order_times(self, number: int, order: Sequence[int]) -> OrderCosts:
        table = self._tables[number]
        return OrderCosts(
            out=np.array([table.least_cost(HOME, stop) for stop in order]),
            between=np.array([table.least_cost(a, b) for a, b in itertools.pairwise(order)]),
            back=np.array([table.least_cost(stop, HOME) for stop in order]),
        )

    def _tour(self, number: int, run: Sequence[int]) -> Tour:
        scenario = self._scenarios[number]
        tour = find_tour(
            self._scenes[number].space,
            scenario.home_m,
            self._places[list(run)],
            scenario.planner,
            self._leg_time,
            self._progress,
            names=[self._names[k] for k in run],
        )
        return replace(tour, order=np.array([run[int(k)] for k in tour.order], dtype=np.int64))

    def _leg_time(self, lengths: NDArray[np.float64]) -> NDArray[np.float64]:
        return estimated_leg_time_s(lengths, self._limits)
