"""Benchmark `coverage`: viewpoints for a surface, what they cover, and how many any choice needs.

Every case has overlap 0, and with `-overlap-0.3` after its name overlap 0.3. `seconds` is from the mesh to the selected
viewpoints, reading it included; `views_lower_bound` the relaxation of the cover over the same candidates, and
`bound_seconds` its own time; `peak_memory_mb` of the process so far. The case `scaling` plans a lattice whose triangles
are cut finer and finer, so that only the mesh grows; `exponent` is b in `seconds ~ (n log n)^b`.

A mesh of the user's own is seen with the sample crane's camera at a GSD of a ten-thousandth of its size (2 to 10 mm),
on flat ground at its lowest point, from a home 20 m off its corner.
"""

from __future__ import annotations

import math
import resource
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.inspection import Inspection, SurfaceTask
from gcs.core.progress import SilentProgress
from gcs.core.scenario import Scenario, parse_scenario
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.cover_bound import cover_bound
from gcs.planning.views.coverage import SAMPLES, certify_coverage
from gcs.planning.views.surface_samples import sample_surface
from gcs.planning.views.viewpoints import find_viewpoints
from gcs.services.benchmarks.lattice import lattice_mast
from gcs.services.benchmarks.row import Row
from gcs.services.warm_up import SCENARIO, tower
from gcs.storage.mesh_files import load_structure, sample_scenario
from gcs.storage.sample_scenes import SAMPLE_BUILDERS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.structure import Structure

OVERLAPS = {0.0: "", 0.3: "-overlap-0.3"}
CRANE_GSD_MM = 5.0
"""For sample scenes that ask for points only."""

FINEST_GSD_MM, COARSEST_GSD_MM = 2.0, 10.0
GSD_SHARE = 1e-4
HOME_OFF_M = 20.0

BOUND_LIMIT_S, QUICK_BOUND_LIMIT_S = 40.0, 3.0
QUICK_GSD_MM = 20.0
QUICK_SAMPLES = 5000
SEGMENTS, SEGMENT_ENDS = 2_000_000, 50_000
SPLITS, QUICK_SPLITS = (1, 2, 3, 5, 10), (1, 2)
SCALING_GSD_MM = 8.0


@dataclass(frozen=True)
class _Effort:
    """How much is put into a case."""

    samples: int
    bound_limit_s: float
    segments: int


def run(quick: bool, mesh: Path | None = None) -> list[Row]:
    """Measure.

    Args:
        quick: the sample crane at a coarse GSD and overlap 0, and the two smallest lattices.
        mesh: a file of the user's own, instead of the sample scenes and the lattices.
    """
    effort = (
        _Effort(QUICK_SAMPLES, QUICK_BOUND_LIMIT_S, SEGMENTS // 10)
        if quick
        else _Effort(SAMPLES, BOUND_LIMIT_S, SEGMENTS)
    )
    if mesh is not None:
        scenario = mesh_scenario(mesh)
        _compile()
        return [
            row for overlap, end in OVERLAPS.items() for row in _case(mesh.stem + end, scenario, mesh, overlap, effort)
        ]
    _compile()
    rows = []
    for name in ("gantry-crane",) if quick else tuple(SAMPLE_BUILDERS):
        scenario = scene_scenario(name, QUICK_GSD_MM if quick else None)
        for overlap, end in list(OVERLAPS.items())[: 1 if quick else None]:
            rows += _case(name + end, scenario, None, overlap, effort)
    return rows + _scaling(QUICK_SPLITS if quick else SPLITS)


def scene_scenario(name: str, gsd_mm: float | None = None) -> Scenario:
    """The scenario of a sample scene with all its surface, or its own regions.

    Args:
        name: of the sample.
        gsd_mm: instead of the scenario's own.
    """
    scenario = parse_scenario(sample_scenario(name))
    own = scenario.inspection.surface if scenario.inspection else None
    task = own or SurfaceTask(gsd_mm=CRANE_GSD_MM)
    if gsd_mm is not None:
        task = task.model_copy(update={"gsd_mm": gsd_mm})
    return scenario.model_copy(update={"inspection": Inspection(surface=task)})


def mesh_scenario(mesh: Path) -> Scenario:
    """A scenario for a mesh that nobody has written one for.

    Raises:
        InputError: it is not a mesh, or of an unlikely size.
    """
    data: dict[str, Any] = {**sample_scenario("gantry-crane"), "name": mesh.stem}
    data |= {"structure": {"meshes": [{"file": mesh.name}]}, "inspection": {"surface": {"gsd_mm": COARSEST_GSD_MM}}}
    structure, source = load_structure(parse_scenario(data).structure, mesh.parent)
    low, high = structure.bounds_m
    gsd = float(np.clip(1000 * GSD_SHARE * (high - low).max(), FINEST_GSD_MM, COARSEST_GSD_MM))
    data |= {
        "structure": source.model_dump(mode="json", exclude_none=True),
        "inspection": {"surface": {"gsd_mm": gsd}},
        "ground_m": float(low[2]),
        "home_m": [float(low[0]) - HOME_OFF_M, float(low[1]) - HOME_OFF_M, float(low[2])],
    }
    return parse_scenario(data)


def _case(case: str, scenario: Scenario, mesh: Path | None, overlap: float, effort: _Effort) -> list[Row]:
    scenario = _with_overlap(scenario, overlap)
    progress = SilentProgress()
    begin = time.perf_counter()
    structure, _ = load_structure(scenario.structure, mesh.parent if mesh else Path())
    scene = prepare_scene(scenario, structure, progress)
    found = find_viewpoints(scenario, structure, scene.space, scene.distance, progress)
    seconds = time.perf_counter() - begin
    memory = _peak_memory_mb()
    if found.cover is None:
        raise AssertionError("a surface was asked for")
    bound = cover_bound(found.cover, effort.bound_limit_s)
    begin = time.perf_counter()
    fence = scene.space.model.fence
    coverage = certify_coverage(
        scenario, structure, found.poses, fence, scene.distance, progress, samples=effort.samples
    )
    certificate_seconds = time.perf_counter() - begin
    if coverage is None:
        raise AssertionError("a surface was asked for")
    views = len(found.cover.chosen)
    reach = scenario.camera.distance_for_gsd(_task(scenario).gsd_mm / 1000)
    places = np.array([p.position_m for p in found.poses])
    return [
        Row(case, "triangles", float(len(structure.faces)), "1"),
        Row(case, "coverage", coverage.share_seen, "1"),
        Row(case, "coverable", coverage.share_coverable, "1"),
        Row(case, "views", float(views), "1", "lower bound", bound.views),
        Row(case, "views_lower_bound", bound.views, "1", "value of the relaxation", bound.relaxation),
        Row(case, "views_over_bound", views / bound.views if bound.views else 1.0, "1"),
        Row(case, "bound_solved", float(bound.solved), "1"),
        Row(case, "seconds", seconds, "s"),
        Row(case, "bound_seconds", bound.seconds, "s"),
        Row(case, "certificate_seconds", certificate_seconds, "s"),
        Row(case, "peak_memory_mb", memory, "MB"),
        Row(case, "segment_tests_per_s", _segment_tests_per_s(structure, places, reach, effort.segments), "1/s"),
    ]


def _scaling(splits: tuple[int, ...]) -> list[Row]:
    rows, sizes, times = [], [], []
    scenario = _with_overlap(scene_scenario("gantry-crane", SCALING_GSD_MM), 0.0)
    home = (-HOME_OFF_M, -HOME_OFF_M, 0.0)
    scenario = scenario.model_copy(update={"home_m": home})
    for split in splits:
        structure = lattice_mast(split)
        begin = time.perf_counter()
        scene = prepare_scene(scenario, structure, SilentProgress())
        find_viewpoints(scenario, structure, scene.space, scene.distance, SilentProgress())
        sizes.append(len(structure.faces))
        times.append(time.perf_counter() - begin)
        rows.append(Row("scaling", f"seconds.{sizes[-1]}", times[-1], "s"))
        rows.append(Row("scaling", f"peak_memory_mb.{sizes[-1]}", _peak_memory_mb(), "MB"))
    return [*rows, Row("scaling", "exponent", fitted_exponent(np.array(sizes), np.array(times)), "1", "n log n", 1.0)]


def fitted_exponent(sizes: NDArray[np.int64], seconds: NDArray[np.float64]) -> float:
    """The exponent b of the least-squares fit `log seconds = a + b log(n log n)`."""
    n = sizes.astype(np.float64)
    return float(np.polyfit(np.log(n * np.log(n)), np.log(seconds), 1)[0])


def _compile() -> None:
    """Plan something small first: compiling is not what is measured."""
    scenario, structure, progress = parse_scenario(SCENARIO), tower(), SilentProgress()
    scene = prepare_scene(scenario, structure, progress)
    found = find_viewpoints(scenario, structure, scene.space, scene.distance, progress)
    if found.cover is not None:
        cover_bound(found.cover, 1.0)
    certify_coverage(
        scenario, structure, found.poses, scene.space.model.fence, scene.distance, progress, samples=QUICK_SAMPLES
    )


def _task(scenario: Scenario) -> SurfaceTask:
    if scenario.inspection is None or scenario.inspection.surface is None:
        raise AssertionError("a surface was asked for")
    return scenario.inspection.surface


def _with_overlap(scenario: Scenario, overlap: float) -> Scenario:
    task = _task(scenario).model_copy(update={"overlap": overlap})
    return scenario.model_copy(update={"inspection": Inspection(surface=task)})


def _segment_tests_per_s(structure: Structure, places_m: NDArray[np.float64], reach_m: float, segments: int) -> float:
    """Lines of sight tested in a second on all processors: from viewpoints to random sides that are near enough."""
    rng = np.random.default_rng(0)
    sides = sample_surface(structure, SEGMENT_ENDS, rng).lifted_m
    each = math.ceil(segments / len(places_m))
    origins, targets = np.repeat(places_m, each, axis=0), []
    for place in places_m:
        near = np.flatnonzero(((sides - place) ** 2).sum(axis=1) <= reach_m**2)
        targets.append(sides[rng.choice(near if len(near) else len(sides), each)])
    ends = np.concatenate(targets)
    sight = SightLines(structure)
    begin = time.perf_counter()
    sight.clear(origins, ends)
    return len(origins) / (time.perf_counter() - begin)


def _peak_memory_mb() -> float:
    """Largest memory of the process so far: kilobytes on Linux, bytes on macOS."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
