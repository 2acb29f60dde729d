"""Whether a curve comes too near to moving obstacles, in space and time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.curve_parts import part_of_curve
from gcs.planning.numerics.bernstein import control_from_monomial
from gcs.planning.trajectories.flight_limits import peaks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.moving_tracks import Track

STEP_S = 0.02


@dataclass(frozen=True)
class MovingClearance:
    """What has to be kept from moving obstacles.

    Attributes:
        keep_m: between the vehicle's centre and the obstacle's disc: vehicle, errors and clearance.
        sigmas: as many deviations of the predicted place come on top.
        horizon_s: so far ahead predictions count; later ones are renewed before they do.
    """

    keep_m: float
    sigmas: float = 2.0
    horizon_s: float = 6.0


def margins_m(
    curve: PiecewisePolynomial, begin_s: float, tracks: Sequence[Track], clearance: MovingClearance
) -> NDArray[np.float64]:
    """How much more than asked a curve keeps from moving obstacles, at least, in every step of `STEP_S`.

    Between two looks the distance changes by no more than both speeds allow, and the deviation counts as at the later
    one: what is positive is a proof for the whole step, not a matter of samples.

    Args:
        curve: in scene ENU, on its own time from 0; it rests at its end.
        begin_s: when it begins, on the tracks' clock.
        tracks: obstacles that reach through all heights.
        clearance: what has to be kept.

    Returns:
        Shape (N,) up to the horizon; infinity without obstacles, negative in conflict.
    """
    if curve.duration_s > clearance.horizon_s:
        curve = part_of_curve(curve, 0.0, clearance.horizon_s)
    times = np.arange(0.0, clearance.horizon_s + STEP_S, STEP_S)
    places = curve.value(times[:-1] + STEP_S / 2)[:, :2]
    quickest = float(peaks(control_from_monomial(curve.coefficients), curve.durations_s)[0])
    margins = np.full(len(places), np.inf)
    for track in tracks:
        away = np.linalg.norm(places - track.positions(begin_s + times[:-1] + STEP_S / 2), axis=1)
        nearer = (quickest + track.speed_m_s) * STEP_S / 2
        needed = clearance.keep_m + track.radius_m + clearance.sigmas * track.deviations_m(begin_s + times[1:])
        margins = np.minimum(margins, away - nearer - needed)
    return margins


def first_conflict_s(margins: NDArray[np.float64]) -> float | None:
    """When a curve with such margins first comes too near to a moving obstacle; None when it does not."""
    conflict = margins < 0
    return STEP_S * float(conflict.argmax()) if conflict.any() else None
