"""Whether the pictures of a finished plan show the cells of its faces, with samples of their own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.certificates import Check
from gcs.planning.views.camera_footprint import faces_camera, in_image
from gcs.planning.views.face_grid import face_cells, lifted_onto_surface, outward_normal, surface_tolerance_m

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.inspection import FaceTask
    from gcs.core.plan import FaceCoverage, Plan, Viewpoint
    from gcs.core.scenario import Scenario
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.planning.scene.visibility import SightLines
    from gcs.planning.views.face_grid import FaceCell

SAMPLES = 400
WHOLE = 0.97
"""Share of a cell's random samples that have to be in sight: thin things may hide what lies between the samples that
a viewpoint was chosen by."""

SEED = 20_012
SLACK = 1 + 1e-6
EDGES = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def recheck_faces(plan: Plan, sight: SightLines, distance: SceneDistance) -> list[Check]:
    """Look at every cell that counts as covered from the viewpoint of its name.

    Args:
        plan: what was written.
        sight: what hides the faces.
        distance: exact distances.

    Returns:
        A check for every face that was asked for: its value is how many cells are seen whole, its limit how many were
        told.
    """
    tasks = plan.scenario.inspection.faces if plan.scenario.inspection else ()
    told = {face.name: face for face in plan.faces}
    by_name = {v.name: v for v in plan.viewpoints}
    return [_recheck(task, told.get(task.name), plan.scenario, by_name, sight, distance) for task in tasks]


def _recheck(
    task: FaceTask,
    told: FaceCoverage | None,
    scenario: Scenario,
    by_name: dict[str, Viewpoint],
    sight: SightLines,
    distance: SceneDistance,
) -> Check:
    cells = face_cells(task)
    if told is None or told.cells != len(cells):
        return Check(task.name, False, 0.0, float(len(cells)), "face: the plan does not say what became of its cells")
    excused = {note.cell for note in told.not_covered}
    wanted = [cell for cell in cells if cell.name not in excused]
    shares = np.random.default_rng(SEED).uniform(-1, 1, (SAMPLES, 2))
    missed = [
        cell.name
        for cell in wanted
        if (view := by_name.get(cell.name)) is None or not _shows(view, cell, shares, task, scenario, sight, distance)
    ]
    seen = len(wanted) - len(missed)
    ok = not missed and len(wanted) == told.covered
    what = f"face: {seen} of {len(cells)} cells are seen whole, reported {told.covered}"
    message = f"{what}; not seen: {', '.join(missed[:5])}" if missed else what
    return Check(task.name, ok, float(seen), float(told.covered), message)


def _shows(
    view: Viewpoint,
    cell: FaceCell,
    shares: NDArray[np.float64],
    task: FaceTask,
    scenario: Scenario,
    sight: SightLines,
    distance: SceneDistance,
) -> bool:
    """Whether a picture shows the cell, the position error around it, as near and as straight as asked."""
    camera, normal, corners = scenario.camera, outward_normal(task), cell.at(EDGES)
    reach = math.inf if task.gsd_mm is None else camera.distance_for_gsd(task.gsd_mm / 1000) * SLACK
    incidence = math.radians(task.max_incidence_deg) * SLACK
    right = np.cross(view.direction, view.up)
    error = scenario.safety.position_m / SLACK
    shifts = [x * right + y * view.up for x in (-error, error) for y in (-error, error)]
    held = all(
        in_image(camera, view.position_m + shift, view.direction, view.up, corners, reach).all() for shift in shifts
    )
    straight = faces_camera(view.position_m, corners, np.broadcast_to(normal, corners.shape), incidence).all()
    if not (held and straight):
        return False
    targets = lifted_onto_surface(cell.at(shares), normal, distance, surface_tolerance_m(scenario))
    return targets is not None and bool(sight.clear(view.position_m, targets).mean() >= WHOLE)
