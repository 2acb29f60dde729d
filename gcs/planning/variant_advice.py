"""What to say when a trajectory of one variant is refused: which other variant holds on the same tour."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, get_args

import numpy as np

from gcs.core.errors import GcsError, OperationCancelled
from gcs.core.scenario import PlannerOptions
from gcs.planning.certificates import check_figures
from gcs.planning.trajectories.curve_figures import measure
from gcs.planning.trajectories.trajectory_builder import build_trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.plan import Sortie, Viewpoint
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.scene.point_distance import SceneDistance

VARIANTS: tuple[str, ...] = get_args(PlannerOptions.model_fields["trajectory"].annotation)
"""In the order in which each keeps nearer to the path than the one before."""


def variant_advice(
    scenario: Scenario,
    legs_m: Sequence[NDArray[np.float64]],
    viewpoints: Sequence[Viewpoint],
    sorties: Sequence[Sortie],
    distance: SceneDistance,
    space: FreeSpace,
    progress: Progress,
) -> str:
    """The end of a message: the first of the variants after the scenario's with which this tour's curve holds.

    They are built and measured, not guessed; none is taken in the place of what was asked.

    Args:
        scenario: with the variant that was refused.
        legs_m: the tour's polylines (K, 3) from stop to stop.
        viewpoints: in visiting order.
        sorties: when the tour is several flights in a row; the legs between them pass through home.
        distance: exact distance to the scene.
        space: where the tour is free.
        progress: told of the stages `trajectory` and `certificates`; may cancel.

    Returns:
        Text that begins with a semicolon; empty for `corridor`, or when none holds.

    Raises:
        OperationCancelled: the progress said so.
    """
    flights = _flights(legs_m, viewpoints, sorties, np.asarray(scenario.home_m))
    for variant in VARIANTS[VARIANTS.index(scenario.planner.trajectory) + 1 :]:
        planner = scenario.planner.model_copy(update={"trajectory": variant})
        other = scenario.model_copy(update={"planner": planner})
        try:
            holds = all(_holds(other, legs, seen, distance, space, progress) for legs, seen in flights)
        except OperationCancelled:
            raise
        except GcsError:
            continue  # this one cannot even be built
        if holds:
            return f"; planner.trajectory: {variant} would do"
    return ""


def _flights(
    legs_m: Sequence[NDArray[np.float64]],
    viewpoints: Sequence[Viewpoint],
    sorties: Sequence[Sortie],
    home_m: NDArray[np.float64],
) -> list[tuple[list[NDArray[np.float64]], Sequence[Viewpoint]]]:
    """Legs and viewpoints of each flight, cut where the tour comes home between two."""
    if not sorties:
        return [(list(legs_m), viewpoints)]
    flights = []
    for sortie in sorties:
        first, last = sortie.viewpoints[0], sortie.viewpoints[-1]
        legs = list(legs_m[first : last + 2])
        legs[0] = legs[0][_at(legs[0], home_m)[-1] :]
        legs[-1] = legs[-1][: _at(legs[-1], home_m)[0] + 1]
        flights.append((legs, viewpoints[first : last + 1]))
    return flights


def _at(leg_m: NDArray[np.float64], place_m: NDArray[np.float64]) -> NDArray[np.intp]:
    """Which corners of a leg are at a place."""
    return np.flatnonzero((leg_m == place_m).all(axis=1))


def _holds(
    scenario: Scenario,
    legs_m: Sequence[NDArray[np.float64]],
    viewpoints: Sequence[Viewpoint],
    distance: SceneDistance,
    space: FreeSpace,
    progress: Progress,
) -> bool:
    yaw = np.array([v.yaw_rad for v in viewpoints])
    pitch = np.array([v.gimbal_pitch_rad for v in viewpoints])
    holds = np.array([v.hold_s for v in viewpoints])
    built = build_trajectory(legs_m, yaw, pitch, scenario, progress, space=space, holds_s=holds)
    timed = [replace(v, time_s=float(t)) for v, t in zip(viewpoints, built.exposures_s, strict=True)]
    path = np.concatenate([legs_m[0][:1], *(leg[1:] for leg in legs_m)])
    figures = measure(built, path, timed, scenario, distance, progress)
    return all(check.ok for check in check_figures(figures, scenario))
