"""Segment times of least cost: the squared snap of a rest-to-rest curve against a price for every second.

With p = 7, a curve from rest to rest costs `J(c T) = J(T) / c^p` when all its times are stretched by c. So the shares
of the whole time that are best at one price are best at every price, and best among all curves of one duration: they
minimise `J (sum T)^p`. A local minimum is sought on the logarithm of the times, where this is well scaled, by a
quasi-Newton descent along the analytic gradient.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from gcs.core.errors import InfeasibleError, InputError
from gcs.core.progress import SilentProgress
from gcs.planning.numerics.bernstein import control_from_monomial
from gcs.planning.trajectories.time_allocation import fit_limits
from gcs.planning.trajectories.unconstrained_minimum_snap import Spline, minimum_snap_spline

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.progress import Progress
    from gcs.planning.trajectories.time_allocation import FlightLimits

STRETCH_POWER = 7
"""p: the squared snap of a curve stretched c times in time is c^-p of what it was."""

WIDEST = 50.0
"""No segment takes more than this many times the mean time at the outset, or less than that share of it."""

ENOUGH = 1e4
"""A descent may end with gains and slopes so much larger where the curve is stretched to limits: no price is met."""

_ITERATIONS = 2000


def priced_times(points_m: ArrayLike, price: float, progress: Progress | None = None) -> Spline:
    """The rest-to-rest curve through points that minimises squared snap plus a price times its duration.

    Args:
        points_m: shape (S + 1, D), m.
        price: of a second, m^2/s^8: the higher, the quicker.
        progress: reports the stage `trajectory`.

    Returns:
        The curve with its times. Their cost gradient is minus the price wherever `WIDEST` does not bind.

    Raises:
        InputError: as of `minimum_snap_spline`, or a price that is not positive and finite.
        InfeasibleError: the descent does not settle.
        OperationCancelled: the progress said so.
    """
    if not 0 < price < math.inf:
        raise InputError(f"the price of time must be positive and finite, not {price:g}", field="price")
    spline, settled = _best_shares(points_m, progress or SilentProgress())
    if not settled:
        raise InfeasibleError(
            f"the times of {len(spline.durations_s)} segments do not settle in {_ITERATIONS} steps; solve the curve in "
            "parts"
        )
    # The best stretch c has p J / c^(p + 1) = price * duration.
    stretch = (STRETCH_POWER * spline.cost / (price * spline.durations_s.sum())) ** (1 / (STRETCH_POWER + 1))
    return minimum_snap_spline(points_m, stretch * spline.durations_s)


def times_at_limits(points_m: ArrayLike, limits: FlightLimits, progress: Progress | None = None) -> Spline:
    """The rest-to-rest curve through points with the shares of time of least snap, stretched to the limits.

    These shares are not those of the quickest flight: snap is what they spare. So they need not be the very best: where
    the descent does not settle, what it came to is taken.

    Args:
        points_m: shape (S + 1, 3), m.
        limits: kept on the curve's true extrema; one of them is used up (less the margin of `time_allocation`).
        progress: reports the stage `trajectory`.

    Raises:
        InputError: as of `minimum_snap_spline`.
        OperationCancelled: the progress said so.
    """
    spline, _ = _best_shares(points_m, progress or SilentProgress(), ENOUGH)
    fitted = fit_limits(control_from_monomial(spline.piecewise_polynomial().coefficients), spline.durations_s, limits)
    return minimum_snap_spline(points_m, fitted.durations_s)


def _best_shares(points_m: ArrayLike, progress: Progress, looseness: float = 1.0) -> tuple[Spline, bool]:
    """The curve with the best shares that the descent came to, and whether it settled there."""
    points = np.array(points_m, dtype=np.float64, ndmin=1)
    minimum_snap_spline(points, np.ones(max(len(points) - 1, 0)))  # refuses bad points
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    # Single rest-to-rest moves at one price take times that grow with the fourth root of their lengths.
    outset = lengths**0.25
    widest = math.log(WIDEST)
    logs = np.log(outset / outset.mean()).clip(-widest, widest)
    rounds = 0

    def objective(logs: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        nonlocal rounds
        progress.report("trajectory", min(rounds / _ITERATIONS, 1.0))
        rounds += 1
        times = np.exp(logs)
        spline = minimum_snap_spline(points, times)
        total = times.sum()
        value = math.log(spline.cost) + STRETCH_POWER * math.log(total)
        return value, times * (spline.cost_gradient / spline.cost + STRETCH_POWER / total)

    result = minimize(
        objective,
        logs,
        jac=True,
        method="L-BFGS-B",
        bounds=[(-widest, widest)] * len(logs),
        options={
            "maxiter": _ITERATIONS,
            "maxfun": 2 * _ITERATIONS,
            "maxcor": 20,
            "ftol": 1e-14 * looseness,
            "gtol": 1e-7 * looseness * STRETCH_POWER / len(logs),
        },
    )
    return minimum_snap_spline(points, np.exp(result.x)), result.status != 1
