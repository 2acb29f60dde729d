"""The papers' experiments on the sample scenes: seeded runs, each with its path and every variant of the curve.

Yard: the rails of the sample yard from end to end, as the yard paper inspects them. Crane: points L3 to L8 of the
sample crane. The papers give neither home, limits nor width of the corridor: limits are the samples', the corridor's
half width is `HALF_WIDTH_M`, and home is the sample's in the first run and drawn about it in the others, because with
one home all runs would be the same flight.

A variant is flown as plans fly it, at rest at every viewpoint (`plain`, ...), and as the papers fly it, in one curve
through all of them (`plain_through`, ...); in a corridor it still stops where the path bends back at a viewpoint, see
`paper_corridor`. Standing still at viewpoints is not counted: durations are those of the curves. Vertical take-off and
landing are moves of their own wherever there is no corridor.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np

from gcs.core.inspection import Inspection
from gcs.core.progress import SilentProgress
from gcs.core.scenario import Scenario, parse_scenario
from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
from gcs.planning.flights.flight_scene import Scene, prepare_scene
from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.qp_solver import default_solvers
from gcs.planning.tours.tour import find_tour
from gcs.planning.trajectories.curve_figures import CurveFigures, measure
from gcs.planning.trajectories.time_allocation import FlightLimits, time_legs
from gcs.planning.trajectories.trajectory_builder import (
    BuiltTrajectory,
    build_trajectory,
    estimated_leg_time_s,
    leg_curves,
)
from gcs.planning.trajectories.waypoint_curves import LegEnds, hull_boxes, waypoint_curves
from gcs.planning.views.viewpoints import find_viewpoints
from gcs.services.benchmarks.paper_corridor import passing_corridors
from gcs.storage.mesh_files import load_structure, sample_scenario

if TYPE_CHECKING:
    from numpy.typing import NDArray

Case = Literal["yard", "crane"]
Variant = Literal["plain", "corrected", "geometric", "corridor"]
VARIANTS: tuple[Variant, ...] = get_args(Variant)

RUNS = 5
HALF_WIDTH_M = 0.25
HOME_SPREAD_M = 5.0
"""Home is drawn within this of the sample's, east and north each."""

CRANE_POINTS = tuple(f"L{number}" for number in range(3, 9))
QUICK_X_M = 60.0
"""The quick version inspects the yard's first rail up to here."""

SAME_M = 1e-9
"""Viewpoints nearer to each other than this are one place."""

_QUIET = SilentProgress()


class Curve(NamedTuple):
    """One variant's curve and its figures; the duration is without dwells."""

    built: BuiltTrajectory
    figures: CurveFigures


@dataclass(frozen=True, eq=False)
class Run:
    """One seeded run.

    Attributes:
        scenario: with this run's home and seed.
        scene: about it.
        legs_m: polylines (K, 3) from stop to stop, home first and last.
        yaw_rad: vehicle yaw at each viewpoint, in visiting order, shape (V,).
        gimbal_pitch_rad: camera pitch there, shape (V,).
    """

    scenario: Scenario
    scene: Scene
    legs_m: list[NDArray[np.float64]]
    yaw_rad: NDArray[np.float64]
    gimbal_pitch_rad: NDArray[np.float64]

    @property
    def path_m(self) -> NDArray[np.float64]:
        """The whole path, shape (N, 3)."""
        return np.concatenate([self.legs_m[0][:1], *(leg[1:] for leg in self.legs_m)])

    @property
    def limits(self) -> FlightLimits:
        """What all variants keep."""
        vehicle = self.scenario.vehicle
        return FlightLimits(vehicle.max_speed_m_s, vehicle.max_acceleration_m_s2, vehicle.max_jerk_m_s3)

    def stopping(self, variant: Variant) -> Curve:
        """The curve of a variant that is at rest at every viewpoint."""
        curves = leg_curves(self.legs_m, _with_variant(self.scenario, variant), _QUIET, space=self.scene.space)
        flown = [curve for curve in curves if curve is not None]
        coefficients, durations, boxes = (
            np.concatenate(parts) for parts in zip(*(curve[:3] for curve in flown), strict=True)
        )
        return self._measured(coefficients, durations, boxes)

    def through(self, variant: Variant) -> Curve:
        """One curve of a variant through all viewpoints without a stop; in a corridor with as few as need be."""
        half_width = self.scenario.safety.corridor_half_width_m
        if variant == "corridor":
            legs = [leg for leg in self.legs_m if np.ptp(leg, axis=0).max() > SAME_M]
            corridors = passing_corridors(legs, self.limits, half_width, self.scene.space)
            timed = time_legs(corridors, self.limits, default_solvers(), _QUIET)
            return self._measured(
                np.concatenate([monomial_from_control(leg.control) for leg in timed]),
                np.concatenate([leg.durations_s for leg in timed]),
                np.concatenate([corridor.boxes_m for corridor in corridors]),
            )
        path = self.path_m
        passed = np.zeros(len(path), dtype=np.bool_)
        passed[np.cumsum([len(leg) - 1 for leg in self.legs_m])] = True
        path, passed = _without_repeats(path, passed)
        (curve,) = waypoint_curves(
            variant, [path], [LegEnds(True, True)], self.limits, half_width, _QUIET, self.scene.space, [passed]
        )
        return self._measured(curve.coefficients, curve.durations_s, hull_boxes(curve.coefficients))

    def planned(self, variant: Variant) -> BuiltTrajectory:
        """What a plan of this variant flies, dwells and turns included."""
        return build_trajectory(
            self.legs_m,
            self.yaw_rad,
            self.gimbal_pitch_rad,
            _with_variant(self.scenario, variant),
            _QUIET,
            space=self.scene.space,
        )

    def _measured(
        self, coefficients: NDArray[np.float64], durations_s: NDArray[np.float64], boxes_m: NDArray[np.float64]
    ) -> Curve:
        trajectory = PiecewisePolynomial(coefficients, durations_s)
        still = AngleProfile(np.array([0.0, trajectory.duration_s]), np.zeros(2))
        built = BuiltTrajectory(trajectory, boxes_m, still, still, np.empty(0), np.empty(0, dtype=np.bool_))
        return Curve(built, measure(built, self.path_m, (), self.scenario, self.scene.distance, _QUIET))


def prepare_run(case: Case, seed: int, quick: bool = False) -> Run:
    """Find viewpoints and path of one run.

    Args:
        case: which experiment.
        seed: of the run; 0 has the sample's home.
        quick: only a corner of the yard.
    """
    scenario = _scenario(case, seed, quick)
    structure, _ = load_structure(scenario.structure, Path())
    if case == "crane":
        points = tuple(point for point in structure.named_points if point.name in CRANE_POINTS)
        scenario = scenario.model_copy(update={"inspection": Inspection(points=points)})
    scene = prepare_scene(scenario, structure, _QUIET)
    poses = find_viewpoints(scenario, structure, scene.space, scene.distance, _QUIET).poses
    limits = FlightLimits(scenario.vehicle.max_speed_m_s, scenario.vehicle.max_acceleration_m_s2)
    tour = find_tour(
        scene.space,
        scenario.home_m,
        np.array([pose.position_m for pose in poses]),
        scenario.planner,
        lambda lengths: estimated_leg_time_s(lengths, limits),
        _QUIET,
        names=[pose.name for pose in poses],
    )
    ordered = [poses[int(k)] for k in tour.order]
    return Run(
        scenario,
        scene,
        list(tour.legs_m),
        np.array([pose.yaw_rad for pose in ordered]),
        np.array([pose.gimbal_pitch_rad for pose in ordered]),
    )


def _scenario(case: Case, seed: int, quick: bool) -> Scenario:
    scenario = parse_scenario(sample_scenario({"yard": "container-yard", "crane": "gantry-crane"}[case]))
    home = np.array(scenario.home_m)
    if seed:
        home[:2] += np.random.default_rng(seed).uniform(-HOME_SPREAD_M, HOME_SPREAD_M, 2)
    update: dict[str, object] = {
        "home_m": tuple(home.tolist()),
        "planner": scenario.planner.model_copy(update={"seed": seed}),
        "safety": scenario.safety.model_copy(update={"corridor_half_width_m": HALF_WIDTH_M}),
    }
    inspection = scenario.inspection
    if quick and inspection is not None and inspection.surface is not None:
        rail = inspection.surface.regions[0]
        corner = rail.model_copy(update={"max_m": (QUICK_X_M, *rail.max_m[1:])})
        fewer = inspection.surface.model_copy(update={"regions": (corner,)})
        update["inspection"] = inspection.model_copy(update={"surface": fewer})
    return scenario.model_copy(update=update)


def _with_variant(scenario: Scenario, variant: Variant) -> Scenario:
    planner = scenario.planner.model_copy(update={"trajectory": variant})
    return scenario.model_copy(update={"planner": planner})


def _without_repeats(
    path_m: NDArray[np.float64], passed: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The path with pictures from one place passed once."""
    new = [True, *(bool(np.linalg.norm(b - a) > SAME_M) for a, b in itertools.pairwise(path_m))]
    groups = np.cumsum(new) - 1
    return path_m[np.array(new)], np.bincount(groups, weights=passed) > 0
