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

STEP_S = 0.04


@dataclass(frozen=True)
class MovingClearance:
    """What has to be kept from moving obstacles.

    Attributes:
        keep_m: between the vehicle's centre and the obstacle's disc: vehicle, errors and clearance.
        sigmas: as many deviations of the predicted place come on top ...
        most_unsure_m: ... but no more than this: predictions are renewed before they matter.
        horizon_s: so far ahead predictions count.
    """

    keep_m: float
    sigmas: float = 2.0
    most_unsure_m: float = 1.2
    horizon_s: float = 5.0


@dataclass(frozen=True, eq=False)
class Predictions:
    """Where moving obstacles will be, and what has to be kept from them, in every step of `STEP_S`.

    Between two looks the distance changes by no more than both speeds allow, and the deviation counts as at the later
    one: what is kept is a proof for the whole step, not a matter of samples.

    Attributes:
        middles_s: of the steps, from now, shape (N,).
        places_m: expected then, shape (K, N, 2).
        needed_m: from there, with what the obstacle itself moves in a step, shape (K, N).
    """

    middles_s: NDArray[np.float64]
    places_m: NDArray[np.float64]
    needed_m: NDArray[np.float64]

    @classmethod
    def of(cls, tracks: Sequence[Track], begin_s: float, clearance: MovingClearance) -> Predictions:
        """Predict.

        Args:
            tracks: obstacles that reach through all heights.
            begin_s: now, on the tracks' clock.
            clearance: what has to be kept.
        """
        times = np.arange(0.0, clearance.horizon_s + STEP_S, STEP_S)
        middles = times[:-1] + STEP_S / 2
        places, needed = np.empty((len(tracks), len(middles), 2)), np.empty((len(tracks), len(middles)))
        for k, track in enumerate(tracks):
            places[k] = track.positions(begin_s + middles)
            unsure = clearance.sigmas * track.deviations_m(begin_s + times[1:])
            needed[k] = clearance.keep_m + track.radius_m + np.minimum(unsure, clearance.most_unsure_m)
            needed[k] += track.speed_m_s * STEP_S / 2
        return cls(middles, places, needed)

    def margins_m(self, curve: PiecewisePolynomial) -> NDArray[np.float64]:
        """How much more than asked a curve keeps, at least, in every step.

        Args:
            curve: in scene ENU, on its own time from 0; it rests at its end.

        Returns:
            Shape (N,) up to the horizon; infinity without obstacles, negative in conflict.
        """
        if not len(self.places_m):
            return np.full(len(self.middles_s), np.inf)
        horizon = len(self.middles_s) * STEP_S
        if curve.duration_s > horizon:
            curve = part_of_curve(curve, 0.0, horizon)
        places = curve.value(self.middles_s)[:, :2]
        quickest = float(peaks(control_from_monomial(curve.coefficients), curve.durations_s)[0])
        away = np.linalg.norm(places - self.places_m, axis=2) - self.needed_m
        return np.asarray(away.min(axis=0) - quickest * STEP_S / 2)

    def least_margin_m(self, curve: PiecewisePolynomial) -> float:
        """The least of them."""
        return float(self.margins_m(curve).min())


def first_conflict_s(margins: NDArray[np.float64]) -> float | None:
    """When a curve with such margins first comes too near to a moving obstacle; None when it does not."""
    conflict = margins < 0
    return STEP_S * float(conflict.argmax()) if conflict.any() else None
