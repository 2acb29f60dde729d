"""Which of several possible viewpoints are taken: those that make the tour through all of them short.

The generalised tour over straight lines chooses. Its choice is taken only where the tour through it, with the ways that
are really flown, saves enough; both tours are searched at the same time, as only that tells.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import OperationCancelled
from gcs.planning.flights.flight_base import tour_from
from gcs.planning.numerics.worker_threads import in_threads
from gcs.planning.tours.generalised_tour import best_choice, generalised_tour
from gcs.planning.tours.tour_metric import EnergyMetric

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from gcs.core.progress import Progress
    from gcs.planning.flights.flight_base import FlightBase
    from gcs.planning.tours.tour import Tour
    from gcs.planning.views.viewpoint_pose import ViewpointPose

WORTHWHILE = 0.01
"""Share of the tour's cost that has to be saved: the best viewpoints look at their points most squarely."""

EFFORT = 0.2
"""Of the generalised tour: ways that are not straight make more of a difference than the rest of it."""


def choose_viewpoints(
    base: FlightBase,
    poses: Sequence[ViewpointPose],
    others: Mapping[int, Sequence[ViewpointPose]],
    progress: Progress,
) -> tuple[Sequence[ViewpointPose], Tour]:
    """Choose viewpoints and find the tour through them.

    A given order is kept. The genetic algorithm orders the best viewpoints, as it does in its paper.

    Args:
        base: where the tour starts and ends.
        poses: the best viewpoints.
        others: for some of them, by number, what may be taken instead.
        progress: told about the stage `tour`; may cancel.

    Returns:
        The viewpoints, in the order of `poses`, and the tour that numbers them.

    Raises:
        InfeasibleError: a viewpoint cannot be reached; it is named.
    """
    numbers = range(len(poses))
    chosen = poses
    if others and base.scenario.planner.tour != "genetic":
        chosen = choice_over_straight_lines(base, poses, others, progress)
    if all(a is b for a, b in zip(chosen, poses, strict=True)):
        return poses, tour_from(base, numbers, poses, progress)
    beside = _ProgressInThreads()

    def poll(_: float) -> None:
        try:
            progress.report("tour", beside.fraction)
        except BaseException:
            beside.stopped = True
            raise

    tours = in_threads(lambda views: tour_from(base, numbers, views, beside), (poses, chosen), poll)
    if tours[1].cost < (1 - WORTHWHILE) * tours[0].cost:
        return chosen, tours[1]
    return poses, tours[0]


def choice_over_straight_lines(
    base: FlightBase,
    poses: Sequence[ViewpointPose],
    others: Mapping[int, Sequence[ViewpointPose]],
    progress: Progress,
) -> list[ViewpointPose]:
    """The viewpoints of the shortest tour that is found over straight lines; arguments as in `choose_viewpoints`."""
    space, options = base.scene.space, base.scenario.planner
    home = np.asarray(base.scenario.home_m, dtype=np.float64)
    candidates = [(pose, *others.get(number, ())) for number, pose in enumerate(poses)]
    views = [view for of_one in candidates for view in of_one]
    start = np.cumsum([0, 1, *(len(of_one) for of_one in candidates)])
    points = np.array([space.take_off_m if space.in_home_column(home) else home, *(v.position_m for v in views)])
    if options.metric == "energy":
        points = EnergyMetric(options.k, options.mu).stretched(points)
    if options.tour == "given":
        taken = best_choice(points, start, np.arange(len(start) - 1))
    else:
        targets = np.repeat(np.arange(len(start) - 1), np.diff(start))
        effort = EFFORT * len(others) / len(poses)
        taken = generalised_tour(
            points, targets, seed=options.seed, effort=effort, poll=lambda: progress.report("tour", 0.0)
        ).order
    return [views[k - 1] for k in np.sort(taken)[1:]]


class _ProgressInThreads:
    """What work in threads says of its progress, for the thread that waits for it and can stop it."""

    def __init__(self) -> None:
        self.fraction = 0.0
        self.stopped = False

    def report(self, _stage: str, fraction: float) -> None:
        if self.stopped:
            raise OperationCancelled("the tour is not asked for any more")
        self.fraction = fraction
