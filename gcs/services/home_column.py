"""The column over home, in which the autopilot takes off and lands by itself, and the stream of setpoints between."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import geodetic_from_enu

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.plan import Plan

COLUMN_M = 0.2
"""Within this of home, seen from above, the vehicle is in the take-off and landing column."""

SLEW = 0.4
"""Change of the plan clock's rate per second; from full rate it stops within 1 / (2 SLEW) s of plan time."""


def column_times(plan: Plan) -> tuple[float, float]:
    """When the plan leaves the take-off column over home, and when it has entered the landing column (plan time, s).

    A plan that begins in the air leaves at 0.
    """
    t = np.arange(0.0, plan.trajectory.duration_s, 0.02)
    p = plan.trajectory.value(t)
    aside = np.hypot(*(p - np.asarray(plan.scenario.home_m))[:, :2].T)
    outside = np.flatnonzero(aside > COLUMN_M)
    if len(outside) == 0:
        return 0.0, 0.0
    first, last = int(outside[0]), int(outside[-1])
    return float(t[max(first - 1, 0)]), float(t[min(last + 1, len(t) - 1)])


def column_top_amsl_m(plan: Plan, leave_s: float) -> float:
    """Height above mean sea level at which the plan leaves the take-off column, at a plan time."""
    scenario, top_m = plan.scenario, float(plan.trajectory.value(leave_s)[2])
    return float(geodetic_from_enu([*scenario.home_m[:2], top_m], scenario.anchor.point)[2])


def streamed_times(plan: Plan, step_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """When an undisturbed stream sends what; it starts and stops with the plan clock's slew.

    Args:
        plan: what is streamed.
        step_s: between setpoints, at most.

    Returns:
        Time of each setpoint since the first, its plan time, and the rate of the plan clock then; each of shape (K,),
        K >= 2.
    """
    leave, enter = column_times(plan)
    way = max(enter - leave, 2.0 * step_s)
    ramp = min(1.0 / SLEW, np.sqrt(way / SLEW))
    whole = way / (SLEW * ramp) + ramp
    t = np.linspace(0.0, whole, max(2, int(np.ceil(whole / step_s)) + 1))
    rate = SLEW * np.minimum(np.minimum(t, whole - t), ramp)
    rising, falling = np.minimum(t, ramp), np.maximum(t - (whole - ramp), 0.0)
    done = SLEW * (rising**2 / 2 + ramp * np.clip(t - ramp, 0.0, whole - 2 * ramp))
    done += SLEW * (ramp * falling - falling**2 / 2)
    return t, leave + done, rate
