"""What a vehicle flies on a leg of its plan: a curve, and the times on the leg that belong to those on the curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.detour import Detour
    from gcs.planning.local.stream_loss_pace import SlowedCurve

AT_REST_S = 1e-6
"""A leg that is shorter is none: the vehicle is at the stop."""

JUMP_S = 1e-6
"""A jump on the plan takes so long."""


@dataclass(eq=False)
class FlownLeg:
    """What is flown: a curve, and what it means on the plan.

    Attributes:
        curve: scene ENU, on its own time from 0; it rests at its end.
        begun_s: when it began, on the clock.
        curve_s: times on the curve, rising, shape (K,) ...
        leg_s: ... and the times on the leg that belong to them.
        joins_s: time on the curve from which it is on the leg; infinity when it leads away from it.
    """

    curve: PiecewisePolynomial
    begun_s: float
    curve_s: NDArray[np.float64]
    leg_s: NDArray[np.float64]
    joins_s: float

    def at(self, clock_s: float) -> float:
        """Time on the curve."""
        return min(max(clock_s - self.begun_s, 0.0), self.curve.duration_s)

    def leg_at(self, curve_s: float) -> float:
        """Time on the leg that belongs to one on the curve."""
        return float(np.interp(curve_s, self.curve_s, self.leg_s))

    def on_leg(self, clock_s: float) -> float:
        """Time on the leg."""
        return self.leg_at(self.at(clock_s))

    def ended(self, clock_s: float) -> bool:
        """Whether it rests at its end."""
        return clock_s - self.begun_s >= self.curve.duration_s - AT_REST_S


def detoured(flown: FlownLeg, detour: Detour, curve: PiecewisePolynomial, now_s: float, clock_s: float) -> FlownLeg:
    """What is flown with a detour in it.

    Args:
        flown: without.
        detour: on its curve.
        curve: with the detour, from now on.
        now_s: now, on the old curve.
        clock_s: now.
    """
    ends_s = flown.curve.duration_s

    def new_s(old_s: NDArray[np.float64]) -> NDArray[np.float64]:
        behind = detour.leave_s - now_s + detour.curve.duration_s
        slowed = (np.minimum(old_s, detour.own_pace_s) - detour.rejoin_s) / detour.pace
        rest = np.maximum(old_s - detour.own_pace_s, 0.0)
        return np.where(old_s <= detour.leave_s, old_s - now_s, behind + slowed + rest)

    knots = np.concatenate([flown.curve_s, [now_s, detour.leave_s, detour.rejoin_s, detour.own_pace_s, ends_s]])
    knots = np.unique(knots[(knots >= now_s) & ((knots <= detour.leave_s) | (knots >= detour.rejoin_s))])
    times, legs = new_s(knots), np.interp(knots, flown.curve_s, flown.leg_s)
    joins_s = float(new_s(np.array([max(detour.rejoin_s, flown.joins_s)]))[0])
    # Until it is joined again the time on the leg is that at which it was left.
    jump = int(np.searchsorted(knots, detour.rejoin_s))
    times = np.insert(times, jump, times[jump] - JUMP_S)
    legs = np.insert(legs, jump, legs[jump - 1])
    return FlownLeg(curve, clock_s, times, legs, min(joins_s, curve.duration_s))


def slowed(flown: FlownLeg, slow: SlowedCurve, now_s: float, clock_s: float) -> FlownLeg:
    """What is flown, slower from now on.

    Args:
        flown: as it was.
        slow: what is left of its curve, slowed.
        now_s: now, on the old curve.
        clock_s: now.
    """
    knots = np.concatenate([flown.curve_s[flown.curve_s > now_s], now_s + slow.before_s])
    knots = np.unique(knots)
    joins_s = flown.joins_s if flown.joins_s == np.inf else float(slow.time_of(np.asarray(flown.joins_s - now_s)))
    legs = np.interp(knots, flown.curve_s, flown.leg_s)
    return FlownLeg(slow.curve, clock_s, slow.time_of(knots - now_s), legs, joins_s)
