"""Rows `container-yard` of the benchmark `paths`: viewpoints along the yard's rails, their tour and all its paths."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.planning.flights.flight_base import FlightBase, tour_from
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.views.viewpoints import find_viewpoints
from gcs.services.benchmarks.row import Row
from gcs.storage.mesh_files import load_structure, sample_scenario

if TYPE_CHECKING:
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure

RUNS = 3
ASKED_S = 5.0


def yard_tour(quick: bool) -> list[Row]:
    """Measure the stages up to the tour, the best of several runs.

    Args:
        quick: one rail instead of four.
    """
    scenario = parse_scenario(sample_scenario("container-yard"))
    structure, _ = load_structure(scenario.structure, Path())
    if quick:
        scenario = _one_rail(scenario)
    runs = [_rows(scenario, structure) for _ in range(RUNS)]
    return min(runs, key=lambda rows: rows[-1].value)


def _one_rail(scenario: Scenario) -> Scenario:
    inspection = scenario.inspection
    if inspection is None or inspection.surface is None:
        raise ValueError("the sample yard inspects its rails")
    surface = inspection.surface.model_copy(update={"regions": inspection.surface.regions[:1]})
    return scenario.model_copy(update={"inspection": inspection.model_copy(update={"surface": surface})})


def _rows(scenario: Scenario, structure: Structure) -> list[Row]:
    progress, marks = SilentProgress(), [time.perf_counter()]
    scene = prepare_scene(scenario, structure, progress)
    marks.append(time.perf_counter())
    poses = find_viewpoints(scenario, structure, scene.space, scene.distance, progress).poses
    marks.append(time.perf_counter())
    tour = tour_from(FlightBase(scenario, scene), range(len(poses)), poses, progress)
    marks.append(time.perf_counter())
    case = "container-yard"
    return [
        Row(case, "viewpoints", float(len(poses)), "1"),
        Row(case, "tour_gap", tour.cost / tour.lower_bound - 1, "1"),
        Row(case, "scene_s", marks[1] - marks[0], "s"),
        Row(case, "viewpoints_s", marks[2] - marks[1], "s"),
        Row(case, "tour_and_paths_s", marks[3] - marks[2], "s"),
        Row(case, "total_s", marks[3] - marks[0], "s", "asked", ASKED_S),
    ]
