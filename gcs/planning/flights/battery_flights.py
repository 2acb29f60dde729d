"""How many flights a tour is with the battery there is, and flights in a row as one trajectory."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.core.plan import Sortie
from gcs.core.trajectory import DEGREE, AngleProfile, PiecewisePolynomial
from gcs.planning.dynamics.energy import energy_wh, usable_wh
from gcs.planning.dynamics.rotor_power import RotorPower
from gcs.planning.flights.flight_base import leg_time_of, tour_from
from gcs.planning.flights.sorties import BATTERY_SWAP_S, estimated_leg_energy_wh, find_sorties
from gcs.planning.tours.bound_from_bases import bound_from_bases
from gcs.planning.tours.leg_table import LegTable
from gcs.planning.tours.tour import Tour
from gcs.planning.tours.tour_metric import tour_metric
from gcs.planning.trajectories.box_corridor import stop_box
from gcs.planning.trajectories.convex_set import box_planes
from gcs.planning.trajectories.trajectory_builder import BuiltTrajectory
from gcs.planning.views.viewing_angles import HOLD_S, SETTLE_S

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.planning.flights.flight_base import FlightBase
    from gcs.planning.views.viewpoint_pose import ViewpointPose


class Flight(NamedTuple):
    """From a base through some of the stops and back.

    Attributes:
        base: where it takes off and lands.
        tour: its `order` numbers the stops of the whole plan.
        built: what is flown.
        energy_wh: what that takes.
    """

    base: FlightBase
    tour: Tour
    built: BuiltTrajectory
    energy_wh: float


class BatteryFlights(NamedTuple):
    """The flights of a tour.

    Attributes:
        flights: in the order in which they are flown, one battery each.
        lower_bound: of the cost of all tours together.
    """

    flights: list[Flight]
    lower_bound: float


def flights_by_battery(
    home: FlightBase,
    other_bases: Callable[[], Sequence[FlightBase]],
    whole: Tour,
    poses: Sequence[ViewpointPose],
    build: Callable[[FlightBase, Tour], BuiltTrajectory],
    progress: Progress,
) -> BatteryFlights:
    """Fly a tour at once if the battery lets it, else in sorties from home and other bases, whatever costs least.

    Args:
        home: where the tour begins and ends.
        other_bases: where sorties may take off and land as well; asked for only when there are sorties.
        whole: the tour through all poses.
        poses: the stops.
        build: the trajectory of a tour from a base; the tour's `order` numbers all poses.
        progress: told about the stage `sorties`; may cancel.

    Raises:
        InfeasibleError: a flight to one viewpoint alone takes more than the battery may give; it is named.
    """
    scenario = home.scenario
    vehicle = scenario.vehicle
    at_once = Flight(home, whole, built := build(home, whole), energy_wh(built.trajectory, vehicle))
    if vehicle.battery is None or at_once.energy_wh <= usable_wh(vehicle.battery):
        return BatteryFlights([at_once], whole.lower_bound)
    bases = [home, *other_bases()]
    search = _BatterySearch(bases, poses, progress)
    order, given = [int(k) for k in whole.order], scenario.planner.tour == "given"
    search.tables[0].know(order, whole.legs_m)
    others = () if given else (search.shortest(base, order).order.tolist() for base in range(1, len(bases)))

    def flight(base: int, run: Sequence[int]) -> Flight:
        tour = search.in_order(base, run)
        built = build(bases[base], tour)
        return Flight(bases[base], tour, built, energy_wh(built.trajectory, vehicle))

    runs = find_sorties(
        search.tables,
        [order, *others],
        usable_wh(vehicle.battery),
        flight,
        lambda flown: flown.energy_wh,
        [pose.name for pose in poses],
        raised=at_once.energy_wh / search.tables[0].energy_wh(order),
        sortie_cost=BATTERY_SWAP_S if search.metric.name == "time" else 0.0,
        resequence=None if given else lambda base, run: search.shortest(base, run).order.tolist(),
    )
    bound = whole.lower_bound
    if any(run.base for run in runs):
        least = [table.least_costs(search.metric.of_steps) for table in search.tables]
        bound = bound_from_bases(least, order, search.tables[0].poll)
    total = sum(run.built.tour.cost for run in runs)
    return BatteryFlights([run.built for run in runs], min(bound, total))


class _BatterySearch:
    """Legs and tours from each of several bases."""

    def __init__(self, bases: Sequence[FlightBase], poses: Sequence[ViewpointPose], progress: Progress) -> None:
        scenario = bases[0].scenario
        power, leg_time = RotorPower.of(scenario.vehicle), leg_time_of(scenario.vehicle)
        self.metric = tour_metric(scenario.planner, leg_time)
        self._bases = bases
        self._poses = poses
        self._progress = progress
        self._tours: dict[tuple[int, tuple[int, ...]], Tour] = {}
        self.tables = [
            LegTable(
                base.scene.space,
                np.asarray(base.scenario.home_m, dtype=np.float64),
                np.array([pose.position_m for pose in poses]),
                self.metric.of_path,
                lambda path: estimated_leg_energy_wh(path, power, leg_time, SETTLE_S + HOLD_S),
                progress,
            )
            for base in bases
        ]

    def shortest(self, base: int, run: Sequence[int]) -> Tour:
        """The tour from a base through some of the stops, in whatever order they are given."""
        key = base, tuple(sorted(run))
        if key not in self._tours:
            self._tours[key] = tour = tour_from(self._bases[base], key[1], self._poses, self._progress)
            self.tables[base].know(tour.order.tolist(), tour.legs_m)
        return self._tours[key]

    def in_order(self, base: int, run: Sequence[int]) -> Tour:
        """The tour in this very order; its lower bound is that of any order of the same stops."""
        best, table = self.shortest(base, run), self.tables[base]
        legs = [leg.path_m for leg in table.legs(run)]
        total = table.cost(run)
        return replace(
            best, order=np.array(run, dtype=np.int64), legs_m=legs, cost=total, lower_bound=min(best.lower_bound, total)
        )


def join_flights(flights: Sequence[Flight], lower_bound: float) -> tuple[Flight, tuple[Sortie, ...]]:
    """Flights one after the other as one, at rest at home between them.

    Args:
        flights: two or more from one base.
        lower_bound: of a tour through all stops; coming home between does not make it cheaper.
    """
    base = flights[0].base
    half_width_m, space = base.scenario.safety.corridor_half_width_m, base.scene.space
    home = flights[0].tour.legs_m[0][0]
    rest = np.zeros((1, DEGREE + 1, 3))
    rest[0, 0] = home
    box = stop_box(home, half_width_m, space)[None]
    legs: list[NDArray[np.float64]] = []
    coefficients, durations, boxes, exposures = [], [], [], []
    planes: list[NDArray[np.float64]] = []
    knots: dict[str, list[NDArray[np.float64]]] = {"times": [], "yaw": [], "pitch": []}
    first_pieces: list[int] = []
    start = 0.0
    for number, flight in enumerate(flights):
        built, tour = flight.built, flight.tour
        if number:
            coefficients.append(rest)
            durations.append(np.array([BATTERY_SWAP_S]))
            boxes.append(box)
            planes.append(box_planes(box[0]))
            start += BATTERY_SWAP_S
            legs[-1] = np.concatenate([legs[-1], tour.legs_m[0][1:]])
            legs.extend(tour.legs_m[1:])
        else:
            legs.extend(tour.legs_m)
        coefficients.append(built.trajectory.coefficients)
        durations.append(built.trajectory.durations_s)
        boxes.append(built.corridor_m)
        planes += built.corridor_planes
        exposures.append(built.exposures_s + start)
        knots["times"].append(built.yaw.times_s + start)
        knots["yaw"].append(built.yaw.angles_rad)
        knots["pitch"].append(built.gimbal_pitch.angles_rad)
        first_pieces.append(sum(len(d) for d in durations[:-1]))
        start += built.trajectory.duration_s
    times = np.concatenate(knots["times"])
    total = sum(flight.tour.cost for flight in flights)
    joined = Flight(
        base,
        Tour(
            order=np.concatenate([flight.tour.order for flight in flights]),
            legs_m=legs,
            cost=total,
            lower_bound=min(lower_bound, total),
            metric=flights[0].tour.metric,
            searched=sum(flight.tour.searched for flight in flights),
        ),
        BuiltTrajectory(
            trajectory=PiecewisePolynomial(np.concatenate(coefficients), np.concatenate(durations)),
            corridor_m=np.concatenate(boxes),
            yaw=AngleProfile(times, _unwrapped(knots["yaw"])),
            gimbal_pitch=AngleProfile(times, np.concatenate(knots["pitch"])),
            exposures_s=np.concatenate(exposures),
            stops=np.concatenate([flight.built.stops for flight in flights]),
            corridor_planes=tuple(planes) if flights[0].built.corridor_planes else (),
        ),
        sum(flight.energy_wh for flight in flights),
    )
    return joined, _sorties(flights, joined.built.trajectory, first_pieces)


def _sorties(
    flights: Sequence[Flight], trajectory: PiecewisePolynomial, first_pieces: Sequence[int]
) -> tuple[Sortie, ...]:
    """The flights on the time of the joined trajectory, viewpoints numbered through."""
    sorties: list[Sortie] = []
    visited = 0
    for flight, first in zip(flights, first_pieces, strict=True):
        count = len(flight.tour.order)
        end = first + len(flight.built.trajectory.durations_s)
        sorties.append(
            Sortie(
                tuple(range(visited, visited + count)),
                float(trajectory.starts_s[first]),
                float(trajectory.starts_s[end]),
                flight.energy_wh,
            )
        )
        visited += count
    return tuple(sorties)


def _unwrapped(parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Yaw angles with no more than half a turn from one flight to the next."""
    shifted = [parts[0]]
    for part in parts[1:]:
        turns = np.round((shifted[-1][-1] - part[0]) / (2 * np.pi))
        shifted.append(part + 2 * np.pi * turns)
    return np.concatenate(shifted)
