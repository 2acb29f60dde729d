"""What is wrong with a corridor, said before anything is solved in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.trajectories.convex_set import inner_ball, room_m

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.trajectories.safe_corridor import LegCorridor

NARROWEST_M = 1e-5
"""Boxes, and what neighbouring boxes share, must be wider than this on every axis; a ball must have room in others."""

STOP_TOLERANCE_M = 1e-9
"""How far a stop may be outside its set: by rounding, no more."""


def check_corridor(leg: LegCorridor) -> None:
    """Refuse a corridor that no curve can be in.

    Raises:
        InputError: a number is not finite, or a segment has no length; it names the segment.
        InfeasibleError: a set is empty, or two neighbouring sets or a stop and its set do not meet with more room than
            the solver's tolerance; it names the segment.
    """
    joints, boxes = leg.joints_m, leg.boxes_m
    finite = np.isfinite(joints[:-1]).all(1) & np.isfinite(joints[1:]).all(1) & np.isfinite(boxes).all((1, 2))
    if leg.planes:
        finite = finite & np.array([np.isfinite(planes).all() for planes in leg.planes])
    if not finite.all():
        raise InputError(
            f"segment {int(finite.argmin())} of the corridor has a number that is not finite", field="corridor"
        )
    length = leg.lengths_m
    if not (length > 0).all():
        bad = int((length > 0).argmin())
        raise InputError(f"segment {bad} of the corridor has no length: its ends are one place", field="corridor")
    if leg.planes:
        outside = [-room_m(leg.planes[k], joints[k]) for k in (0, -1)]
        width, shared = _widths_of_sets(leg)
    else:
        outside = np.maximum(boxes[[0, -1], 0] - joints[[0, -1]], joints[[0, -1]] - boxes[[0, -1], 1]).max(axis=1)
        width = (boxes[:, 1] - boxes[:, 0]).min(axis=1)
        shared = (leg.shared_m[:, 1] - leg.shared_m[:, 0]).min(axis=1)
    name = "its set" if leg.planes else "the box"
    for end, segment in enumerate((0, len(boxes) - 1)):
        if outside[end] > STOP_TOLERANCE_M:
            raise InfeasibleError(
                f"segment {segment} of the corridor does not hold its stop: it is {outside[end]:.3g} m outside {name}"
            )
    if not (width > NARROWEST_M).all():
        bad = int((width > NARROWEST_M).argmin())
        raise InfeasibleError(
            f"segment {bad} of the corridor is {width[bad]:.3g} m wide, and {NARROWEST_M:g} m are needed: widen it"
        )
    if not (shared > NARROWEST_M).all():
        bad = int((shared > NARROWEST_M).argmin())
        what = "do not meet" if shared[bad] < 0 else f"share only {shared[bad]:.3g} m"
        raise InfeasibleError(
            f"segments {bad} and {bad + 1} of the corridor are not connected: they {what}, and {NARROWEST_M:g} m are "
            "needed"
        )


def _widths_of_sets(leg: LegCorridor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Diameters (m) of balls in each set, shape (n,), and in what neighbours share, shape (n - 1,), negative for none.

    They are those about the joints where these have room enough, and the largest ones elsewhere.
    """
    shared = 2 * leg.joint_room_m
    for k in np.flatnonzero(shared <= NARROWEST_M):
        shared[k] = 2 * inner_ball(np.concatenate(leg.planes[k : k + 2]))[1]
    width = np.maximum(np.append(shared, -np.inf), np.insert(shared, 0, -np.inf))
    for k in np.flatnonzero(width <= NARROWEST_M):
        width[k] = 2 * inner_ball(leg.planes[k])[1]
    return width, shared


def check_corridors(legs: Sequence[LegCorridor]) -> None:
    """`check_corridor` of all legs; the errors name the leg too."""
    for index, leg in enumerate(legs):
        try:
            check_corridor(leg)
        except (InputError, InfeasibleError) as error:
            raise type(error)(f"leg {index}: {error.message}", field=error.field) from None
