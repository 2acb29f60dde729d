"""From a scenario and its structure to a certified plan: the stages, in order."""

from __future__ import annotations

import itertools
import time
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.plan import Plan, Viewpoint
from gcs.planning.certificates import CertificateError, certify
from gcs.planning.dynamics.energy import energy_wh, require_battery
from gcs.planning.flights.battery_flights import flights_by_battery, join_flights
from gcs.planning.flights.flight_base import FlightBase, rally_bases
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.flights.partial_inspection import part_of_faces, part_of_scenario
from gcs.planning.flights.plan_group import SortieSeries
from gcs.planning.flights.rally_points import check_rally_points
from gcs.planning.flights.sorties import BATTERY_SWAP_S
from gcs.planning.flights.viewpoint_choice import choose_viewpoints
from gcs.planning.paths.path_search import find_path
from gcs.planning.paths.string_pulling import path_length
from gcs.planning.tours.tour import Tour
from gcs.planning.trajectories.trajectory_builder import build_trajectory
from gcs.planning.variant_advice import variant_advice
from gcs.planning.views.bound_beside import bound_beside
from gcs.planning.views.coverage import SAMPLES, certify_coverage
from gcs.planning.views.image_sharpness import passing_speeds_m_s
from gcs.planning.views.viewpoints import find_viewpoints
from gcs.planning.views.viewpoints_spots import count_spots

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from gcs.core.plan import FaceCoverage, Sortie
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.core.surface_coverage import SurfaceCoverage
    from gcs.planning.flights.battery_flights import Flight
    from gcs.planning.flights.flight_scene import Scene
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.trajectories.trajectory_builder import BuiltTrajectory
    from gcs.planning.views.cover_bound import CoverBound
    from gcs.planning.views.viewpoint_pose import ViewpointPose

BACK_BENDS_M = 0.02
"""How much nearer than the hover itself the curve back into the free space may come."""

MOST_DRIFT_M = 2.0
"""A hovering vehicle that is further than this from where it may be has to be flown clear by hand."""

OPEN_SKY_STEP_S = 0.1

SAMPLES_OF_PARTS = SAMPLES // 4
"""Points of the surface that one of several flights is judged by; all of them together are judged by more."""


@dataclass
class Stopwatch:
    """Seconds of each stage, from when it starts to when the next one does."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """The time of a `with` block."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = time.perf_counter() - started


def make_plan(scenario: Scenario, structure: Structure, progress: Progress) -> Plan | SortieSeries:
    """Plan an inspection.

    Args:
        scenario: what is asked.
        structure: the placed structure.
        progress: told of every stage; may cancel.

    Returns:
        A plan whose certificates hold; several of them when a battery is not enough and some flights are to start from
        rally points.

    Raises:
        InputError: the scenario contradicts the structure; names the field.
        InfeasibleError: there is no plan; says why and what would help.
        OperationCancelled: the progress said so.
    """
    watch = Stopwatch()
    with watch.stage("scene"):
        scene = prepare_scene(scenario, structure, progress)
        check_rally_points(scenario, scene.distance)
    with watch.stage("viewpoints"):
        found = find_viewpoints(scenario, structure, scene.space, scene.distance, progress)
    with bound_beside(found.cover, progress) as bound:
        planned = plan_tour(
            scenario, structure, scene, found.poses, progress, watch=watch, faces=found.faces, others=found.others
        )
        if found.cover is None:
            return planned
        return _with_bound(planned, bound(), fixed=len(found.poses) - len(found.cover.chosen))


def _with_bound(plan: Plan | SortieSeries, bound: CoverBound | None, fixed: int) -> Plan | SortieSeries:
    """The plan with the bound on its viewpoints, those that are fixed counted in."""
    if bound is None:
        return plan
    least = bound.views + fixed
    if isinstance(plan, SortieSeries):
        count = sum(len(part.viewpoints) for part in plan.plans)
        return replace(plan, plans=tuple(_with_part_of_bound(part, least, count) for part in plan.plans))
    certificates = replace(plan.certificates, viewpoints_lower_bound=least, viewpoints_bound_solved=bound.solved)
    parts = tuple(_with_part_of_bound(part, least, len(plan.viewpoints)) for part in plan.parts)
    return replace(plan, certificates=certificates, parts=parts, stages_s={**plan.stages_s, "bound": bound.seconds})


def _with_part_of_bound(part: Plan, least: float, viewpoints: int) -> Plan:
    """A part with its bound: with the viewpoints of the other parts, what covers as much as it covers the whole."""
    own = max(1.0, least - (viewpoints - len(part.viewpoints)))
    certificates = replace(part.certificates, viewpoints_lower_bound=own, viewpoints_bound_solved=False)
    return replace(part, certificates=certificates)


def plan_tour(
    scenario: Scenario,
    structure: Structure,
    scene: Scene,
    poses: Sequence[ViewpointPose],
    progress: Progress,
    *,
    watch: Stopwatch | None = None,
    faces: tuple[FaceCoverage, ...] = (),
    others: Mapping[int, Sequence[ViewpointPose]] | None = None,
) -> Plan | SortieSeries:
    """Order the viewpoints, fly them from home and back, and certify the whole.

    Args:
        scenario: what is asked.
        structure: the placed structure.
        scene: as `prepare_scene` makes it.
        poses: the viewpoints.
        progress: told of every stage; may cancel.
        watch: takes the stages' times.
        faces: what became of the cells of faces; carried into the plan.
        others: for some of the viewpoints, by number, what may be taken instead where it shortens the tour.

    Returns:
        The plan, with its sorties when one battery is not enough; sorties alone when some are not from home.

    Raises:
        InfeasibleError: a viewpoint cannot be reached, a certificate does not hold, or the battery is too small.
    """
    watch = watch or Stopwatch()
    home = FlightBase(scenario, scene)
    with watch.stage("tour"):
        poses, whole = choose_viewpoints(home, poses, others or {}, progress)
    places = np.array([p.position_m for p in poses]).reshape(-1, 3)
    with watch.stage("trajectory"):
        flights, lower_bound = flights_by_battery(
            home,
            lambda: rally_bases(scenario, structure, places, progress),
            whole,
            poses,
            lambda base, tour: build_flight(base.scenario, base.scene.space, tour, poses, progress, watch),
            progress,
        )
    if any(flight.base is not home for flight in flights):
        plans = plans_of_flights(flights, "sortie", structure, poses, faces, progress)
        ends = itertools.accumulate(plan.trajectory.duration_s + BATTERY_SWAP_S for plan in plans[:-1])
        return SortieSeries(
            plans=plans,
            starts_s=(0.0, *ends),
            coverage=coverage_together(home, plans, structure, progress),
            rally=tuple(flight.base.rally for flight in flights),
            tour_cost=sum(flight.tour.cost for flight in flights),
            tour_lower_bound=lower_bound,
        )
    if len(flights) == 1:
        return plan_of_flight(scenario, structure, scene, flights[0], poses, faces, progress, watch)
    joined, sorties = join_flights(flights, lower_bound)
    plan = plan_of_flight(scenario, structure, scene, joined, poses, faces, progress, watch, sorties=sorties)
    with watch.stage("sorties"):
        parts = plans_of_flights(flights, "sortie", structure, poses, faces, progress)
    return replace(plan, parts=parts)


def plans_of_flights(
    flights: Sequence[Flight],
    kind: str,
    structure: Structure,
    poses: Sequence[ViewpointPose],
    faces: tuple[FaceCoverage, ...],
    progress: Progress,
) -> tuple[Plan, ...]:
    """A complete plan for each of several flights, with its part of the inspection; viewpoints are numbered through.

    Args:
        flights: their tours number the poses.
        kind: of flight, for the plans' names.
        structure: the placed structure.
        poses: of all flights.
        faces: what became of the cells of faces in all of them.
        progress: told of every stage; may cancel.

    Raises:
        InfeasibleError: a certificate does not hold, or the battery is too small.
    """
    plans: list[Plan] = []
    for number, flight in enumerate(flights, start=1):
        scenario, mine = flight.base.scenario, {poses[int(k)].name for k in flight.tour.order}
        plans.append(
            plan_of_flight(
                part_of_scenario(scenario, mine, f"{kind} {number} of {len(flights)}"),
                structure,
                flight.base.scene,
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


def coverage_together(
    base: FlightBase, plans: Sequence[Plan], structure: Structure, progress: Progress
) -> SurfaceCoverage | None:
    """What several plans see of the surface together; None when none was asked for."""
    viewpoints = [view for plan in plans for view in plan.viewpoints]
    fence = base.scene.space.model.fence
    return certify_coverage(base.scenario, structure, viewpoints, fence, base.scene.distance, progress)


def plan_of_flight(
    scenario: Scenario,
    structure: Structure,
    scene: Scene,
    flight: Flight,
    poses: Sequence[ViewpointPose],
    faces: tuple[FaceCoverage, ...],
    progress: Progress,
    watch: Stopwatch,
    *,
    first_id: int = 0,
    sorties: tuple[Sortie, ...] = (),
    samples: int = SAMPLES,
) -> Plan:
    """The plan of a flight through some of the poses, with what they cover.

    Args:
        scenario: what this flight is asked for.
        structure: the placed structure.
        scene: with the flight's home.
        flight: its tour numbers the poses.
        poses: all of them.
        faces: what became of their cells in this flight.
        progress: told of the stages `coverage` and `certificates`; may cancel.
        watch: takes the stages' times.
        first_id: of its first viewpoint.
        sorties: when it is several in a row.
        samples: points of the surface that the coverage is judged by.

    Raises:
        InfeasibleError: a certificate does not hold, or the battery is too small.
    """
    tour, built = flight.tour, flight.built
    viewpoints = tuple(_visited(first_id + k, k, poses[int(n)], built) for k, n in enumerate(tour.order))
    with watch.stage("coverage"):
        coverage = certify_coverage(
            scenario, structure, viewpoints, scene.space.model.fence, scene.distance, progress, samples=samples
        )
    plan = _certified(scenario, structure, scene, tour, built, viewpoints, coverage, progress, watch, sorties)
    return replace(plan, faces=faces)


def plan_rest(
    scenario: Scenario,
    structure: Structure,
    scene: Scene,
    remaining: Sequence[Viewpoint],
    start_m: ArrayLike,
    progress: Progress,
) -> Plan:
    """Plan the rest of a tour from a hover: the remaining viewpoints in their order, then home.

    Args:
        scenario: what is asked.
        structure: the placed structure.
        scene: as `prepare_scene` makes it.
        remaining: viewpoints still to be visited, in order; they keep their ids.
        start_m: where the vehicle hovers, shape (3,). When it has drifted out of the free space a little, the plan
            begins with the straight way back into it; the certificates decide whether that is acceptable.
        progress: told of every stage; may cancel.

    Raises:
        InfeasibleError: there is no plan from there.
    """
    start = np.asarray(start_m, dtype=np.float64)
    inside = _into_free_space(scene.space, start)
    stops = [inside, *(v.position_m for v in remaining), np.asarray(scenario.home_m)]
    legs = [find_path(scene.space, a, b) for a, b in itertools.pairwise(stops)]
    if not np.array_equal(inside, start):
        legs[0] = np.vstack([start, legs[0]])
    length = sum(path_length(leg) for leg in legs)
    tour = Tour(np.arange(len(remaining)), legs, length, length, "length", len(legs))
    watch = Stopwatch()
    built = build_flight(scenario, scene.space, tour, remaining, progress, watch)
    viewpoints = tuple(_visited(v.id, k, v, built) for k, v in enumerate(remaining))
    return _certified(
        _with_drift(scenario, scene, start), structure, scene, tour, built, viewpoints, None, progress, watch
    )


def _with_drift(scenario: Scenario, scene: Scene, start: NDArray[np.float64]) -> Scenario:
    """The scenario less the part of the tracking error that a hover has already used up.

    A viewpoint may stand at the bare clearance, and a hovering vehicle drifts. The way back begins where it is, so the
    certificate cannot ask for more there; what is asked is never less than the budget without the tracking error. Home
    has not been drifted to: it stands on the ground, and is not judged by the distance to it.
    """
    if np.array_equal(start, scenario.home_m):
        return scenario
    safety = scenario.safety
    room = float(scene.distance.distance(start[None])[0]) - scenario.vehicle.radius_m
    drifted = safety.hull_clearance_m - room
    used = min(max(drifted + BACK_BENDS_M, 0.0), safety.tracking_m)
    return scenario.model_copy(update={"safety": safety.model_copy(update={"tracking_m": safety.tracking_m - used})})


def _into_free_space(space: FreeSpace, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """The point itself if it is free, else the nearest reachable cell's centre within a short way."""
    if space.is_reachable(point[None])[0]:
        return point
    cells = np.argwhere(space.wide_mask)
    centres = space.centre_of(cells)
    distance = np.linalg.norm(centres - point, axis=1)
    nearest = int(distance.argmin())
    if distance[nearest] > MOST_DRIFT_M:
        raise InfeasibleError(
            f"the vehicle is {distance[nearest]:.1f} m inside the space that the plan keeps clear: fly it clear by hand"
        )
    return np.asarray(centres[nearest])


def build_flight(
    scenario: Scenario,
    space: FreeSpace,
    tour: Tour,
    poses: Sequence[ViewpointPose | Viewpoint],
    progress: Progress,
    watch: Stopwatch,
) -> BuiltTrajectory:
    """The trajectory of a tour that numbers the poses."""
    ordered = [poses[int(k)] for k in tour.order]
    with watch.stage("trajectory"):
        return build_trajectory(
            tour.legs_m,
            np.array([p.yaw_rad for p in ordered]),
            np.array([p.gimbal_pitch_rad for p in ordered]),
            scenario,
            progress,
            space=space,
            passing_speeds_m_s=passing_speeds_m_s(ordered, scenario),
            holds_s=np.array([p.hold_s for p in ordered]),
        )


def _certified(
    scenario: Scenario,
    structure: Structure,
    scene: Scene,
    tour: Tour,
    built: BuiltTrajectory,
    viewpoints: tuple[Viewpoint, ...],
    coverage: SurfaceCoverage | None,
    progress: Progress,
    watch: Stopwatch,
    sorties: tuple[Sortie, ...] = (),
) -> Plan:
    with watch.stage("certificates"):
        ends = [(s.start_s, s.end_s) for s in sorties] or [(0.0, built.trajectory.duration_s)]
        energies = [energy_wh(built.trajectory, scenario.vehicle, start, end) for start, end in ends]
        require_battery(max(energies), scenario.vehicle.battery)
        path, stops = _joined(tour)
        try:
            certificates = certify(
                built,
                path,
                viewpoints,
                scenario,
                scene.distance,
                progress,
                coverage=coverage,
                tour_cost=tour.cost,
                tour_lower_bound=tour.lower_bound,
                energy_wh=sum(energies),
                open_sky=_open_sky_share(scene.space, built),
                spots=count_spots(scenario, structure, viewpoints, scene.space.model.fence, scene.distance, progress),
            )
        except CertificateError as error:
            advice = variant_advice(scenario, tour.legs_m, viewpoints, sorties, scene.distance, scene.space, progress)
            raise CertificateError(f"{error.message}{advice}") from None
    return Plan(
        scenario=scenario,
        cables=structure.cables,
        viewpoints=viewpoints,
        path_m=path,
        path_stops=stops,
        corridor_m=built.corridor_m,
        corridor_planes=built.corridor_planes,
        trajectory=built.trajectory,
        yaw=built.yaw,
        gimbal_pitch=built.gimbal_pitch,
        coverage=coverage,
        certificates=certificates,
        stages_s=watch.seconds,
        sorties=sorties,
    )


def _visited(number: int, place: int, pose: ViewpointPose | Viewpoint, built: BuiltTrajectory) -> Viewpoint:
    return Viewpoint(
        id=number,
        name=pose.name,
        position_m=pose.position_m,
        direction=pose.direction,
        up=pose.up,
        gsd_m=pose.gsd_m,
        time_s=float(built.exposures_s[place]),
        yaw_rad=pose.yaw_rad,
        gimbal_pitch_rad=pose.gimbal_pitch_rad,
        stops=bool(built.stops[place]),
        hold_s=pose.hold_s,
    )


def _joined(tour: Tour) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The legs as one polyline, and where in it the stops are."""
    stops = np.concatenate([[0], np.cumsum([len(leg) - 1 for leg in tour.legs_m])])
    return np.concatenate([tour.legs_m[0][:1], *(leg[1:] for leg in tour.legs_m)]), stops.astype(np.int64)


def _open_sky_share(space: FreeSpace, built: BuiltTrajectory) -> float:
    duration = built.trajectory.duration_s
    times = np.linspace(0.0, duration, max(2, int(duration / OPEN_SKY_STEP_S)))
    return float(space.is_open_sky(built.trajectory.value(times)).mean())
