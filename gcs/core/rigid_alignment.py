"""The turn and shift (and scale) that brings points nearest to where they were surveyed, and how good it is.

Least squares fit by the singular value decomposition: Kabsch (1976); with scale Umeyama (1991), "Least-squares
estimation of transformation parameters between two point patterns". The error that the residuals let expect elsewhere:
Fitzpatrick, West and Maurer (1998), "Predicting error in rigid-body point-based registration".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

LINE_SHARE = 0.02
"""Points whose second extent is less than this share of the first are on one line."""


@dataclass(frozen=True, eq=False)
class RigidAlignment:
    """x -> to_centre + scale rotation (x - from_centre).

    Attributes:
        rotation: shape (3, 3), proper (determinant 1); improper only in a fit that may mirror.
        scale: of the points.
        from_centre: middle of the points, shape (3,).
        to_centre: middle of the targets (m), shape (3,).
        targets_m: what was aimed at, shape (N, 3).
        residuals_m: distance of each point from its target, shape (N,).
        with_scale: whether the scale was fitted.
    """

    rotation: NDArray[np.float64]
    scale: float
    from_centre: NDArray[np.float64]
    to_centre: NDArray[np.float64]
    targets_m: NDArray[np.float64]
    residuals_m: NDArray[np.float64]
    with_scale: bool

    @property
    def rms_m(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt((self.residuals_m**2).mean()))

    @property
    def worst_m(self) -> float:
        """Largest residual."""
        return float(self.residuals_m.max())

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Placed points, shape (M, 3) -> (M, 3); about the middles, so that map coordinates lose nothing."""
        p = np.asarray(points, dtype=np.float64)
        return np.asarray(self.to_centre + self.scale * (p - self.from_centre) @ self.rotation.T)

    def expected_error_m(self, places_m: ArrayLike) -> NDArray[np.float64]:
        """Root mean square error to expect of placed points, if the residuals are those of survey and picking.

        Args:
            places_m: scene ENU, shape (M, 3).

        Returns:
            Shape (M,). It grows with the distance from the surveyed points' principal axes, against their own spread.
        """
        offsets = self.targets_m - self.to_centre
        n = len(offsets)
        freedom = 7 if self.with_scale else 6
        point_error_squared = self.rms_m**2 * 3 * n / (3 * n - freedom)
        _, _, axes = np.linalg.svd(offsets)
        along = offsets @ axes.T
        there = (np.asarray(places_m, dtype=np.float64).reshape(-1, 3) - self.to_centre) @ axes.T
        growth = np.ones(len(there))
        for k in range(3):
            others = [i for i in range(3) if i != k]
            spread_squared = (along[:, others] ** 2).sum(axis=1).mean()
            growth += (there[:, others] ** 2).sum(axis=1) / spread_squared / 3
        if self.with_scale:
            growth += (there**2).sum(axis=1) / (along**2).sum(axis=1).mean() / 3
        return np.asarray(np.sqrt(point_error_squared / n * growth))


def fit_alignment(
    points: ArrayLike, targets_m: ArrayLike, *, with_scale: bool = False, may_mirror: bool = False
) -> RigidAlignment:
    """The least squares fit of points to targets.

    Args:
        points: shape (N, 3), N >= 3, not on one line.
        targets_m: shape (N, 3).
        with_scale: whether the scale is found too; 1 otherwise.
        may_mirror: whether a mirror image is allowed.
    """
    p, t = np.asarray(points, dtype=np.float64), np.asarray(targets_m, dtype=np.float64)
    from_centre, to_centre = p.mean(axis=0), t.mean(axis=0)
    a, b = p - from_centre, t - to_centre
    u, stretch, vt = np.linalg.svd(b.T @ a)
    signs = np.ones(3)
    if not may_mirror and np.linalg.det(u @ vt) < 0:
        signs[2] = -1.0
    rotation = u @ np.diag(signs) @ vt
    scale = float((stretch * signs).sum() / (a**2).sum()) if with_scale else 1.0
    residuals = np.linalg.norm(scale * a @ rotation.T - b, axis=1)
    return RigidAlignment(rotation, scale, from_centre, to_centre, t, residuals, with_scale)


def are_on_one_line(points: ArrayLike) -> bool:
    """Whether points, shape (N, 3), leave the turn about a line open."""
    p = np.asarray(points, dtype=np.float64)
    extents = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    return bool(extents[1] <= LINE_SHARE * extents[0])
