"""Places that a curve passes without a stop: exactly, not too fast, and not too soon after one another.

Stretching all times of a curve by c divides its speeds by c and multiplies the times between its places by c. So what
is asked here is met by a stretch, like the limits of the vehicle (`flight_limits`). A curve that has to be slow at one
place alone would be slow everywhere by that; so the speed there is also bounded when the curve is found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.trajectories.flight_limits import LIMIT_MARGIN

if TYPE_CHECKING:
    from numpy.typing import NDArray

PASSED_WITHIN_M = 1e-4
"""A joint that is to be passed lies this near to its place on every axis."""

ASIDE = 0.3
"""Share of the speed along the way that a joint may be passed with across it, on each axis."""

_RIGHT_OF_JOINT = 3
"""Row of the control point behind a joint in `SnapChain.rows`; its distance from the joint is the speed."""


@dataclass(frozen=True, eq=False)
class Passing:
    """What is asked of a curve of n pieces at some of its inner joints.

    Attributes:
        joints: their numbers, increasing, each between 0 and n, shape (P,).
        speeds_m_s: largest speed there, positive, shape (P,).
        least_s: how long the curve takes at least to the first of them, from each to the next, and from the last to its
            end, shape (P + 1,).
    """

    joints: NDArray[np.int64]
    speeds_m_s: NDArray[np.float64]
    least_s: NDArray[np.float64]

    def part_times_s(self, durations_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Time to the first place, from each to the next and to the end, shape (P + 1,), of pieces' times (n,)."""
        return np.add.reduceat(durations_s, np.concatenate([[0], self.joints]))

    def use(self, durations_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Factor on the time of each piece that its part's least time asks for, shape (n,); above 1 is too quick."""
        part = np.searchsorted(self.joints, np.arange(len(durations_s)), side="right")
        return np.asarray((self.least_s / self.part_times_s(durations_s))[part] / (1 - LIMIT_MARGIN))

    def stretch(self, control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> float:
        """Factor on all times that a curve needs to keep what is asked.

        Args:
            control: control points of the pieces, m, shape (n, 8, 3).
            durations_s: of the pieces, shape (n,).
        """
        steps = control[self.joints, 1] - control[self.joints, 0]
        speeds = 7 * np.linalg.norm(steps, axis=1) / durations_s[self.joints]
        too_fast = (speeds / self.speeds_m_s).max() / (1 - LIMIT_MARGIN)
        return float(max(too_fast, self.use(durations_s).max()))

    def bound_speeds(
        self, limits_m: NDArray[np.float64], joints_m: NDArray[np.float64], durations_s: NDArray[np.float64]
    ) -> None:
        """Take from the limits of the control points what would be too fast, wherever a joint is to be passed.

        Args:
            limits_m: low and high corner for each row (`SnapChain.rows`) of the inner joints, shape (n - 1, 7, 2, 3).
            joints_m: shape (n + 1, 3).
            durations_s: of the pieces, shape (n,).
        """
        units = np.diff(joints_m, axis=0)
        units /= np.linalg.norm(units, axis=1)[:, None]
        along = np.abs(units[self.joints - 1] + units[self.joints])
        shares = np.maximum(along, ASIDE * np.maximum(along.max(axis=1), 1e-9)[:, None])
        reach = (1 - 2 * LIMIT_MARGIN) * self.speeds_m_s * durations_s[self.joints] / 7 - PASSED_WITHIN_M
        reach = np.maximum(reach, PASSED_WITHIN_M)[:, None] * shares / np.linalg.norm(shares, axis=1)[:, None]
        place, row = joints_m[self.joints], limits_m[self.joints - 1, _RIGHT_OF_JOINT]
        row[:, 0] = np.maximum(row[:, 0], place - reach)
        row[:, 1] = np.minimum(row[:, 1], place + reach)
        limits_m[self.joints - 1, _RIGHT_OF_JOINT] = row

    def lengthened(self, durations_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Times of the pieces, shape (n,), with more where a part would be too short."""
        return np.asarray(durations_s * np.maximum(self.use(durations_s), 1.0))
