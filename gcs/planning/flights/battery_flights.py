"""How many flights a tour is with the battery there is, and flights in a row as one trajectory."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.core.plan import Sortie
from gcs.core.trajectory import DEGREE, AngleProfile, PiecewisePolynomial
from gcs.planning.dynamics.energy import energy_wh, usable_wh
from gcs.planning.dynamics.rotor_power import RotorPower
from gcs.planning.flights.sorties import BATTERY_SWAP_S, estimated_leg_energy_wh, find_sorties
from gcs.planning.tours.leg_table import LegTable
from gcs.planning.tours.tour import Tour
from gcs.planning.tours.tour_metric import tour_metric
from gcs.planning.trajectories.safe_corridor import stop_box
from gcs.planning.trajectories.trajectory_builder import BuiltTrajectory
from gcs.planning.views.viewing_angles import HOLD_S, SETTLE_S

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.tours.tour import LegTime


class Flight(NamedTuple):
    """From home through some of the stops and back.

    Attributes:
        tour: its `order` numbers the stops of the whole plan.
        built: what is flown.
        energy_wh: what that takes.
    """

    tour: Tour
    built: BuiltTrajectory
    energy_wh: float


def flights_by_battery(
    scenario: Scenario,
    space: FreeSpace,
    whole: Tour,
    stops_m: NDArray[np.float64],
    names: Sequence[str],
    leg_time: LegTime,
    find: Callable[[Sequence[int]], Tour],
    build: Callable[[Tour], BuiltTrajectory],
    progress: Progress,
) -> list[Flight]:
    """Fly a tour at once if the battery lets it, else in sorties.

    Args:
        scenario: vehicle, battery, home, metric.
        space: where the centre may be.
        whole: the tour through all stops.
        stops_m: shape (N, 3).
        names: of the stops.
        leg_time: time of rest-to-rest legs.
        find: the tour through some of the stops, its `order` numbering those that were given.
        build: the trajectory of a tour whose `order` numbers all stops.
        progress: told about the stage `sorties`; may cancel.

    Raises:
        InfeasibleError: a flight to one viewpoint alone takes more than the battery may give; it is named.
    """
    vehicle = scenario.vehicle
    at_once = Flight(whole, built := build(whole), energy_wh(built.trajectory, vehicle))
    if vehicle.battery is None or at_once.energy_wh <= usable_wh(vehicle.battery):
        return [at_once]
    power = RotorPower.of(vehicle)
    metric = tour_metric(scenario.planner, leg_time)
    table = LegTable(
        space,
        np.asarray(scenario.home_m, dtype=np.float64),
        stops_m,
        metric.of_path,
        lambda path: estimated_leg_energy_wh(path, power, leg_time, SETTLE_S + HOLD_S),
        progress,
    )
    order = [int(k) for k in whole.order]
    table.know(order, whole.legs_m)

    def found(run: Sequence[int]) -> Tour:
        tour = find(run)
        renamed = [run[int(k)] for k in tour.order]
        table.know(renamed, tour.legs_m)
        return replace(tour, order=np.array(renamed, dtype=np.int64))

    def as_tour(run: Sequence[int]) -> Tour:
        """The tour in this very order; its lower bound is that of any order of the same stops."""
        best = found(sorted(run))
        legs = [leg.path_m for leg in table.legs(run)]
        total = table.cost(run)
        return replace(
            best, order=np.array(run, dtype=np.int64), legs_m=legs, cost=total, lower_bound=min(best.lower_bound, total)
        )

    given = scenario.planner.tour == "given"
    runs = find_sorties(
        table,
        order,
        usable_wh(vehicle.battery),
        lambda run: (tour := as_tour(run), build(tour)),
        lambda pair: energy_wh(pair[1].trajectory, vehicle),
        names,
        raised=at_once.energy_wh / table.energy_wh(order),
        sortie_cost=BATTERY_SWAP_S if metric.name == "time" else 0.0,
        resequence=None if given else lambda run: found(run).order.tolist(),
    )
    return [Flight(*run.built, run.energy_wh) for run in runs]


def join_flights(
    flights: Sequence[Flight], lower_bound: float, half_width_m: float, space: FreeSpace
) -> tuple[Flight, tuple[Sortie, ...]]:
    """Flights one after the other as one, at rest at home between them.

    Args:
        flights: two or more.
        lower_bound: of a tour through all stops; coming home between does not make it cheaper.
        half_width_m: of the corridor.
        space: for the box about home.
    """
    home = flights[0].tour.legs_m[0][0]
    rest = np.zeros((1, DEGREE + 1, 3))
    rest[0, 0] = home
    box = stop_box(home, half_width_m, space)[None]
    legs: list[NDArray[np.float64]] = []
    coefficients, durations, boxes, exposures = [], [], [], []
    knots: dict[str, list[NDArray[np.float64]]] = {"times": [], "yaw": [], "pitch": []}
    first_pieces: list[int] = []
    start = 0.0
    for number, flight in enumerate(flights):
        built, tour = flight.built, flight.tour
        if number:
            coefficients.append(rest)
            durations.append(np.array([BATTERY_SWAP_S]))
            boxes.append(box)
            start += BATTERY_SWAP_S
            legs[-1] = np.concatenate([legs[-1], tour.legs_m[0][1:]])
            legs.extend(tour.legs_m[1:])
        else:
            legs.extend(tour.legs_m)
        coefficients.append(built.trajectory.coefficients)
        durations.append(built.trajectory.durations_s)
        boxes.append(built.corridor_m)
        exposures.append(built.exposures_s + start)
        knots["times"].append(built.yaw.times_s + start)
        knots["yaw"].append(built.yaw.angles_rad)
        knots["pitch"].append(built.gimbal_pitch.angles_rad)
        first_pieces.append(sum(len(d) for d in durations[:-1]))
        start += built.trajectory.duration_s
    times = np.concatenate(knots["times"])
    total = sum(flight.tour.cost for flight in flights)
    joined = Flight(
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
