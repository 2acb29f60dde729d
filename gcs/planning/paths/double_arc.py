"""Double-arc avoidance of stay cables (Xu, Yan, Zhao, Zhu, Li 2019), for a leg that is cut by a stay.

Between two places A1 and A2 of one height, d apart, stays come down. In the plane through A1A2 that is inclined as the
lowest stay is, at theta_max, B1 and B2 lie d/2 down the plane from A1 and A2. The paper asks for the one point where
two circles about B1 and B2 touch: with radius d/2 that is T, d/2 down the plane from the middle of A1A2. It prints the
radius d, with which they cross in two points, (1 +- sqrt 3) d/2 down the plane. A1-T-A2 is smoothed by a B-spline.

T passes a stay through the middle of A1A2, inclined at theta_c, by `(d/2) sin(theta_max - theta_c)`: by nothing at all
if that is the lowest one. So the construction is tried with A1A2 widened, too, and given up where no T keeps clear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from gcs.core.progress import SilentProgress
from gcs.core.trajectory import DEGREE
from gcs.planning.numerics.curve_bounds import least, lipschitz_bounds

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from scipy.interpolate import BSpline

Reading = Literal["touching", "crossing"]

WIDENED = (1.0, 1.25, 1.5, 2.0, 3.0)
"""How much longer A1A2 is taken, in the order of trial."""

STEEPEST = 0.25
"""Of a leg that still counts as being of one height: rise over distance."""

PIECES = 16
"""Straight pieces of the flown polyline."""

TOLERANCE_M = 0.005
"""How far the proved clearance may be under the true one."""

APEXES: dict[Reading, tuple[float, ...]] = {
    "touching": (0.5,),
    "crossing": (0.5 * (1 + math.sqrt(3)), 0.5 * (1 - math.sqrt(3))),
}
"""How far down the plane from the middle of A1A2 the circles meet, in lengths of A1A2; negative is up."""


_RAISED = np.array(
    [
        [math.comb(2, k) * math.comb(DEGREE - 2, i - k) / math.comb(DEGREE, i) if i - k >= 0 else 0.0 for k in range(3)]
        for i in range(DEGREE + 1)
    ]
)
"""Control points of degree 7 of a piece of degree 2, shape (8, 3)."""


@dataclass(frozen=True, eq=False)
class DoubleArc:
    """A way past the stays.

    Attributes:
        curve: quadratic B-spline through A1, T and A2 over [0, 1].
        apex_m: T, shape (3,).
        reading: of the circles' radius.
        widened: how much longer A1A2 was taken.
        clearance_m: least distance of the whole curve from the cables' hulls; a proved lower bound.
        polyline_m: chords of the curve, shape (PIECES + 1, 3).
    """

    curve: BSpline
    apex_m: NDArray[np.float64]
    reading: Reading
    widened: float
    clearance_m: float
    polyline_m: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InclinedPlane:
    """The plane of the construction.

    Attributes:
        middle_m: of A1A2, shape (3,).
        down: unit, square to A1A2, down the plane and away from the tower, shape (3,).
        length_m: of A1A2.
        theta_max_rad: inclination of the lowest stay.
    """

    middle_m: NDArray[np.float64]
    down: NDArray[np.float64]
    length_m: float
    theta_max_rad: float

    def apex_m(self, reading: Reading, which: int = 0, widened: float = 1.0) -> NDArray[np.float64]:
        """Where the circles meet, shape (3,)."""
        return self.middle_m + APEXES[reading][which] * widened * self.length_m * self.down


def cut_by_cable(
    start_m: ArrayLike, goal_m: ArrayLike, cable_ends_m: NDArray[np.float64], kept_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which cables a straight leg comes nearer to than what is kept from their axes.

    Args:
        start_m: one end, shape (3,).
        goal_m: the other.
        cable_ends_m: shape (C, 2, 3).
        kept_m: distance kept from each axis, shape (C,).

    Returns:
        Shape (C,).
    """
    a, b = np.asarray(start_m, dtype=np.float64), np.asarray(goal_m, dtype=np.float64)
    return _between_segments(a, b, cable_ends_m[:, 0], cable_ends_m[:, 1]) < kept_m


def inclined_plane(start_m: ArrayLike, goal_m: ArrayLike, cable_ends_m: NDArray[np.float64]) -> InclinedPlane | str:
    """The plane of the construction, or why there is none.

    Args:
        start_m: A1, shape (3,).
        goal_m: A2.
        cable_ends_m: the stays about them, shape (C, 2, 3), C >= 1.
    """
    a, b = np.asarray(start_m, dtype=np.float64), np.asarray(goal_m, dtype=np.float64)
    along = b - a
    length = float(np.linalg.norm(along))
    if length < 1e-6:
        return "the leg has no length"
    if abs(along[2]) > STEEPEST * length:
        return "the two places are not of one height"
    top = cable_ends_m[:, :, 2].argmax(axis=1)
    rows = np.arange(len(cable_ends_m))
    slope = cable_ends_m[rows, 1 - top] - cable_ends_m[rows, top]
    level = np.array([-along[1], along[0], 0.0]) / math.hypot(along[0], along[1])
    away = slope @ level
    if np.abs(away).max() < 1e-6:
        return "the stays come down along the leg, not across it"
    side = 1.0 if away[np.abs(away).argmax()] > 0 else -1.0
    same = side * away > 1e-6
    inclination = np.arctan2(-slope[same, 2], np.hypot(slope[same, 0], slope[same, 1]))
    theta = float(inclination.max())
    down = side * math.cos(theta) * level - np.array([0.0, 0.0, math.sin(theta)])
    down -= (down @ along) / length**2 * along
    return InclinedPlane((a + b) / 2, down / np.linalg.norm(down), length, theta)


def double_arc(
    start_m: ArrayLike,
    goal_m: ArrayLike,
    cable_ends_m: NDArray[np.float64],
    cable_radii_m: NDArray[np.float64],
    clearance_m: float,
    *,
    readings: tuple[Reading, ...] = ("touching", "crossing"),
    widened: tuple[float, ...] = WIDENED,
    longest_m: float = math.inf,
) -> DoubleArc | str:
    """Find the double arc past stay cables.

    Args:
        start_m: A1, scene ENU, shape (3,).
        goal_m: A2, of nearly the same height.
        cable_ends_m: axes of the stays about them, shape (C, 2, 3), C >= 1.
        cable_radii_m: shape (C,).
        clearance_m: kept between the curve and the cables' hulls.
        readings: of the circles' radius, in the order of trial.
        widened: how much longer A1A2 may be taken, in the order of trial.
        longest_m: longer curves are of no use.

    Returns:
        The first that keeps the clearance all along, or in words why there is none.
    """
    plane = inclined_plane(start_m, goal_m, cable_ends_m)
    if isinstance(plane, str):
        return plane
    a, b = np.asarray(start_m, dtype=np.float64), np.asarray(goal_m, dtype=np.float64)
    best = -math.inf
    for factor in widened:
        for reading in readings:
            for which in range(len(APEXES[reading])):
                apex = plane.apex_m(reading, which, factor)
                if float(np.linalg.norm(apex - a) + np.linalg.norm(b - apex)) > longest_m:
                    continue
                arc = _arc(a, b, apex, reading, factor, cable_ends_m, cable_radii_m, clearance_m)
                if isinstance(arc, DoubleArc):
                    return arc
                best = max(best, arc)
    if best == -math.inf:
        return f"each of its curves is longer than {longest_m:.2f} m"
    return f"the best of its curves comes to {max(best, 0.0):.2f} m of a stay, and {clearance_m:.2f} m are kept"


def _arc(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    apex: NDArray[np.float64],
    reading: Reading,
    widened: float,
    cable_ends_m: NDArray[np.float64],
    cable_radii_m: NDArray[np.float64],
    clearance_m: float,
) -> DoubleArc | float:
    """The arc over T if it keeps the clearance, else the clearance that it comes to."""
    from scipy.interpolate import make_interp_spline

    curve = make_interp_spline([0.0, 0.5, 1.0], np.stack([a, apex, b]), k=2)
    polyline = curve(np.linspace(0.0, 1.0, PIECES + 1))
    polyline[0], polyline[-1] = a, b

    def clear(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return cable_distance(points, cable_ends_m, cable_radii_m)

    met = float(clear(polyline).min())
    if met < clearance_m:
        return met
    piece = _RAISED @ curve.c  # three points make a single piece, whose coefficients are Bernstein's
    nearest = least(piece[None], np.ones(1), lipschitz_bounds(clear), TOLERANCE_M, SilentProgress()).value
    return DoubleArc(curve, apex, reading, widened, nearest, polyline) if nearest >= clearance_m else nearest


def cable_distance(
    points_m: NDArray[np.float64], cable_ends_m: NDArray[np.float64], cable_radii_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Signed distance of points (N, 3) from the nearest cable's hull, shape (N,)."""
    first, along = cable_ends_m[:, 0], cable_ends_m[:, 1] - cable_ends_m[:, 0]
    share = ((points_m[:, None] - first) * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12)
    nearest = first + np.clip(share, 0.0, 1.0)[..., None] * along
    off = np.linalg.norm(points_m[:, None] - nearest, axis=2) - cable_radii_m
    return np.asarray(off.min(axis=1))


def _between_segments(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], d: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance of one segment a-b (3,) from others c-d (C, 3), shape (C,) (Ericson, Real-Time Collision Detection)."""
    u, v, w = b - a, d - c, a - c
    uu, vv = max(float(u @ u), 1e-12), np.maximum((v * v).sum(axis=1), 1e-12)
    uv, uw, vw = v @ u, w @ u, (v * w).sum(axis=1)
    square = uu * vv - uv**2
    s = np.where(square > 1e-12, (uv * vw - vv * uw) / np.maximum(square, 1e-12), 0.0).clip(0.0, 1.0)
    t = ((uv * s + vw) / vv).clip(0.0, 1.0)
    s = ((uv * t - uw) / uu).clip(0.0, 1.0)
    return np.asarray(np.linalg.norm(a + s[:, None] * u - c - t[:, None] * v, axis=1))
