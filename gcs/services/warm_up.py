"""Compiles the kernels of planner and simulator into numba's cache, so that the first plan is as quick as the second.

Run by `make install` as `python -m gcs.services.warm_up`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.lidar_scan import LidarScan
from gcs.planning.local.navigator import LocalNavigator
from gcs.planning.local.navigator_options import NavigatorOptions
from gcs.planning.planner import make_plan
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.tours.generalised_tour import generalised_tour
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.optimal_times import times_at_limits
from gcs.services.mission_fitting import predict_usual_flights
from gcs.services.simulation import Simulator, SimulatorOptions
from gcs.services.tracking_forecast import forecast_tracking

if TYPE_CHECKING:
    from gcs.core.plan import Plan

SCENARIO = {
    "name": "warm-up",
    "structure": {"meshes": [{"file": "in memory"}]},
    "anchor": {"latitude_deg": 0.0, "longitude_deg": 0.0, "altitude_m": 0.0},
    "ground_m": 0.0,
    "camera": {
        "sensor_width_mm": 13.2,
        "sensor_height_mm": 8.8,
        "focal_length_mm": 8.8,
        "image_width_px": 5472,
        "image_height_px": 3648,
    },
    "inspection": {
        "surface": {"gsd_mm": 3.0, "overlap": 0.0},
        "points": [{"name": "P", "position_m": [2.0, 0.0, 10.0], "normal": [1.0, 0.0, 0.0]}],
    },
    "home_m": [-15.0, -15.0, 0.0],
    "fence": {"include": [[[-60, -60], [60, -60], [60, 60], [-60, 60]]]},
}


def tower() -> Structure:
    """A column of 4 m x 4 m x 20 m with a stay."""
    corners = np.array(
        [[x, y, z] for z in (0.0, 20.0) for x, y in ((-2, -2), (2, -2), (2, 2), (-2, 2))], dtype=np.float64
    )
    sides = [[k, (k + 1) % 4, 4 + (k + 1) % 4] for k in range(4)] + [[k, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    faces = np.array([*sides, [4, 5, 6], [4, 6, 7]], dtype=np.int64)
    return Structure(corners, faces, cables=(Cable(from_m=(0, 0, 20), to_m=(12, 0, 1), radius_m=0.1),))


def evade_something() -> None:
    """Fly a few seconds towards something that stands while something else crosses."""
    limits = FlightLimits(4.0, 2.5, 10.0)
    trajectory = times_at_limits(np.array([[0.0, 0.0, 10.0], [20.0, 0.0, 10.0]]), limits).piecewise_polynomial()
    known = BinaryMap(np.zeros((80, 80), dtype=np.bool_), np.array([-20.0, -20.0]), 0.5)
    navigator = LocalNavigator(trajectory, (), limits, NavigatorOptions(known=known))
    for clock_s in np.arange(0.0, 4.0, 0.1):
        ranges = np.full(72, np.inf)
        place = navigator.motion(clock_s)[0]
        ranges[71:] = ranges[:2] = 12.0 - place[0]
        ranges[10] = 12.0 - 2.5 * clock_s
        navigator.see(LidarScan(ranges, 0.0, np.radians(5.0), 20.0), place, 0.0, clock_s)
        navigator.decide(clock_s)


def main() -> None:
    """Plan a small scene in each corridor, predict flights, choose between viewpoints, evade, start a vehicle."""
    structure = tower()
    plan = cast("Plan", make_plan(parse_scenario(SCENARIO), structure, SilentProgress()))  # no battery, no sorties
    for corridor in ("tubes", "polytopes"):
        make_plan(parse_scenario(SCENARIO | {"planner": {"corridor": corridor}}), structure, SilentProgress())
    forecast_tracking(plan)
    predict_usual_flights(plan, SceneDistance(structure, plan.scenario.ground_m))
    times_at_limits(np.eye(3), FlightLimits(5.0, 2.5))
    generalised_tour(np.arange(36.0).reshape(12, 3), np.arange(12) // 2)
    evade_something()
    with Simulator(SimulatorOptions(port=9, extra=("--tcp-base", "none"))):
        pass


if __name__ == "__main__":
    main()
