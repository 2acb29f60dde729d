"""Row `plan-700` of the benchmark `trajectories`: a whole plan of the sample container yard, from legs to certificates.

Viewpoints are drawn in the free space, visited to and fro in strips, and looked from at random directions; the search
for their legs is not counted.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.plan import Viewpoint
from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.planning.certificates import certify
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.paths.path_search import find_path
from gcs.planning.trajectories.trajectory_builder import build_trajectory
from gcs.planning.views.viewpoint_pose import camera_axes
from gcs.services.benchmarks.row import Row, milliseconds
from gcs.storage.mesh_files import load_structure, sample_scenario

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.scenario import Scenario
    from gcs.planning.flights.flight_scene import Scene
    from gcs.planning.trajectories.trajectory_builder import BuiltTrajectory

VIEWPOINTS, QUICK_VIEWPOINTS = 700, 20
STRIP_M = 6.0
RUNS = 3


def whole_plan_rows(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few viewpoints, once.
    """
    count = QUICK_VIEWPOINTS if quick else VIEWPOINTS
    scenario = parse_scenario(sample_scenario("container-yard"))
    structure, _ = load_structure(scenario.structure, Path())
    scene = prepare_scene(scenario, structure, SilentProgress())
    rng = np.random.default_rng(scenario.planner.seed)
    stops = _stops(scene, count, rng)
    yaw, pitch = rng.uniform(-np.pi, np.pi, count), rng.uniform(-1.4, 0.2, count)
    home = np.asarray(scenario.home_m)
    legs = [find_path(scene.space, a, b) for a, b in itertools.pairwise([home, *stops, home])]
    best = {"trajectory": np.inf, "certificates": np.inf}
    built: list[BuiltTrajectory] = []
    for _ in range(1 if quick else RUNS):
        spent = {
            "trajectory": milliseconds(
                lambda: built.append(build_trajectory(legs, yaw, pitch, scenario, SilentProgress(), space=scene.space))
            ),
            "certificates": milliseconds(lambda: _certify(built[-1], legs, stops, yaw, pitch, scenario, scene)),
        }
        best = min(best, spent, key=lambda times: sum(times.values()))
    case = f"plan-{count}"
    rows = [Row(case, f"{stage}_s", value / 1e3, "s") for stage, value in best.items()]
    return [
        *rows,
        Row(case, "total_s", sum(best.values()) / 1e3, "s", "asked", 2.0),
        Row(case, "pieces", float(len(built[-1].trajectory.durations_s)), "1"),
        Row(case, "flight_s", built[-1].trajectory.duration_s, "s"),
    ]


def _stops(scene: Scene, count: int, rng: np.random.Generator) -> list[NDArray[np.float64]]:
    """Centres of free cells, in strips to and fro."""
    cells = np.argwhere(scene.space.wide_mask)
    centres = scene.space.centre_of(cells[rng.choice(len(cells), count, replace=False)])
    strip = np.floor(centres[:, 1] / STRIP_M).astype(np.int64)
    along = np.where(strip % 2 == 0, centres[:, 0], -centres[:, 0])
    return list(centres[np.lexsort((along, strip))])


def _certify(
    built: BuiltTrajectory,
    legs: list[NDArray[np.float64]],
    stops: list[NDArray[np.float64]],
    yaw: NDArray[np.float64],
    pitch: NDArray[np.float64],
    scenario: Scenario,
    scene: Scene,
) -> None:
    direction, up = camera_axes(yaw, pitch)
    viewpoints = [
        Viewpoint(k, f"V{k}", stop, direction[k], up[k], 1e-3, float(built.exposures_s[k]), yaw[k], pitch[k])
        for k, stop in enumerate(stops)
    ]
    path = np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])
    certify(
        built,
        path,
        viewpoints,
        scenario,
        scene.distance,
        SilentProgress(),
        coverage=None,
        tour_cost=0.0,
        tour_lower_bound=0.0,
        energy_wh=0.0,
        open_sky=1.0,
    )
