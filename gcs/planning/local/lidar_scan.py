"""One scan of a lidar in the plane: ranges along evenly spaced bearings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

ONCE_ROUND = 2 * math.pi * (1 + 1e-6)

FINEST_RAD = math.radians(1.3)
"""Sectors that are wider are spread: at 10 m two beams this far apart are nearly a cell of 0.2 m from each other."""


@dataclass(frozen=True, eq=False)
class LidarScan:
    """What a lidar measured at one moment.

    Attributes:
        ranges_m: shape (N,), from the sensor: infinity, or more than `most_m`, where nothing is within reach, and 0
            where something touches the sensor.
        first_rad: bearing of beam 0 from the vehicle's nose, counter-clockwise.
        step_rad: from each beam to the next, counter-clockwise; negative for a sensor that turns the other way.
        most_m: reach of the sensor.
        known: which beams were measured at all, shape (N,); all when not given.

    Raises:
        InputError: no beams, a known range that is negative or not a number, nothing but zeros, no beam that is known,
            or a sector that is none; it names the field.
    """

    ranges_m: NDArray[np.float64]
    first_rad: float
    step_rad: float
    most_m: float
    known: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        if self.ranges_m.ndim != 1 or not len(self.ranges_m):
            raise InputError(f"a scan is a row of ranges, not of shape {self.ranges_m.shape}", field="ranges_m")
        if self.known is not None and self.known.shape != self.ranges_m.shape:
            raise InputError(f"give one mark for each of {len(self.ranges_m)} ranges", field="known")
        if not 0 < self.most_m < math.inf:
            raise InputError(f"a reach must be positive and finite, not {self.most_m:g}", field="most_m")
        self._check_sector()
        if not self.measured.any():
            raise InputError("no beam was measured: the lidar is blind", field="known")
        ranges = self.ranges_m[self.measured]
        bad = self.measured & ~(self.ranges_m >= 0)
        if bad.any():
            beam = int(bad.argmax())
            raise InputError(f"beam {beam} says {self.ranges_m[beam]:g} m: the scan is not used", field="ranges_m")
        if not ranges.any():
            raise InputError("every range is 0: the lidar is covered or broken, the scan is not used", field="ranges_m")

    def _check_sector(self) -> None:
        if not (math.isfinite(self.first_rad) and math.isfinite(self.step_rad)):
            raise InputError("the sector's angles are not finite numbers", field="first_rad")
        if self.step_rad == 0 or abs(self.step_rad) * len(self.ranges_m) > ONCE_ROUND:
            raise InputError(
                f"{len(self.ranges_m)} beams every {math.degrees(self.step_rad):g} degrees are no sector",
                field="step_rad",
            )

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Which beams were measured, shape (N,)."""
        return np.ones(len(self.ranges_m), dtype=np.bool_) if self.known is None else self.known

    def spread(self) -> tuple[LidarScan, int]:
        """The same as beams at most `FINEST_RAD` apart, for ranges that are the least within their step.

        Returns:
            The finer scan, and how many of its beams there are for each.
        """
        parts = math.ceil(abs(self.step_rad) / FINEST_RAD)
        if parts == 1:
            return self, 1
        step = self.step_rad / parts
        finer = LidarScan(
            np.repeat(self.ranges_m, parts),
            self.first_rad - (parts - 1) / 2 * step,
            step,
            self.most_m,
            np.repeat(self.measured, parts),
        )
        return finer, parts

    def rays(
        self, position_m: NDArray[np.float64], heading_rad: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Where the measured beams end in the scene.

        Args:
            position_m: of the sensor, shape (2,), scene ENU.
            heading_rad: of the vehicle's nose, counter-clockwise from east.

        Returns:
            Their ends, cut off at the reach, shape (M, 2), and which of them hit something, shape (M,).
        """
        measured = self.measured
        ranges = self.ranges_m[measured]
        bearings = heading_rad + self.first_rad + self.step_rad * np.flatnonzero(measured)
        reached = np.minimum(ranges, self.most_m)[:, None]
        ends = position_m + reached * np.column_stack([np.cos(bearings), np.sin(bearings)])
        return ends, ranges <= self.most_m
