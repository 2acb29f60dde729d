"""From where each picture of a plan can be taken instead, as far as plan and structure tell before the flight."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.local.moved_view import MovedViews, moved_places, target_of
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.viewpoints import points_to_inspect
from gcs.planning.views.viewpoints_points import TARGET_GAP_M, TILTS_DEG

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.core.plan import Plan, Viewpoint
    from gcs.core.structure import Structure


class _Asked(NamedTuple):
    """What was asked of a picture: GSD (m), and the surface's normal with the largest incidence (degrees) to it."""

    gsd_m: float | None = None
    normal: tuple[float, float, float] | None = None
    max_incidence_deg: float = 90.0


def moved_views(plan: Plan, structure: Structure | None) -> dict[int, MovedViews]:
    """By viewpoint id, for those at which the vehicle stops.

    Args:
        plan: what is flown.
        structure: what may hide a target; None for nothing.
    """
    asked_of = _asked_of(plan, structure)
    sight = None if structure is None else SightLines(structure)
    found: dict[int, MovedViews] = {}
    for viewpoint in plan.viewpoints:
        if not viewpoint.stops:
            continue
        asked, target = asked_of(viewpoint), target_of(viewpoint, plan.scenario.camera)
        places = moved_places(viewpoint, plan.scenario.camera, asked.gsd_m)
        if asked.normal is not None:
            outwards = (places - target) / np.linalg.norm(places - target, axis=1, keepdims=True)
            places = places[outwards @ asked.normal >= math.cos(math.radians(asked.max_incidence_deg))]
        if sight is not None:
            places = places[sight.clear(places, np.broadcast_to(target, places.shape), TARGET_GAP_M)]
        found[viewpoint.id] = MovedViews(places, target)
    return found


def _asked_of(plan: Plan, structure: Structure | None) -> Callable[[Viewpoint], _Asked]:
    """What the scenario asked of a viewpoint's picture: named points and faces' cells lend viewpoints their names."""
    inspection = plan.scenario.inspection
    surface = None if inspection is None else inspection.surface
    of_surface = _Asked() if surface is None else _Asked(surface.gsd_mm / 1000)
    by_name: dict[str, _Asked] = {}
    for face in () if inspection is None else inspection.faces:
        of_face = _Asked(_metres(face.gsd_mm), face.normal, face.max_incidence_deg)
        by_name |= {face.cell_name(row, column): of_face for row in range(face.rows) for column in range(face.columns)}
    if structure is not None:
        points = points_to_inspect(plan.scenario, structure)
        by_name |= {point.name: _Asked(_metres(point.gsd_mm), point.normal, TILTS_DEG[-1]) for point in points}
    return lambda viewpoint: by_name.get(viewpoint.name, of_surface)


def _metres(gsd_mm: float | None) -> float | None:
    return None if gsd_mm is None else gsd_mm / 1000
