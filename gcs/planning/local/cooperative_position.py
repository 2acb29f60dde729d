"""Cooperative positioning: where a vehicle is, as another one with a good fix sees it (yard paper, equations 8-10).

From the observer the inspecting vehicle is at the distance d, the pitch mu above the horizon and the azimuth tau:

    dx = d cos(mu) cos(tau),  dy = d cos(mu) sin(tau),  dz = d sin(mu)

With angles that err by Gaussian noise of deviations s_mu and s_tau the printed form is too short on average, by
`exp(-s_mu^2 / 2)` in z and `exp(-(s_mu^2 + s_tau^2) / 2)` in x and y (Longbin and others 1998); here it is divided by
these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

WIDEST_RAD = 0.5
"""Angles that err by more than this are no measurement."""


@dataclass(frozen=True)
class Sighting:
    """What the observer's sensors say of the inspecting vehicle, in the scene's axes.

    Attributes:
        range_m: distance d.
        pitch_rad: mu, above the horizon.
        azimuth_rad: tau, from east, counter-clockwise.
        range_deviation_m: standard deviation of the range.
        pitch_deviation_rad: of the pitch, the observer's own attitude error included.
        azimuth_deviation_rad: of the azimuth, likewise.

    Raises:
        InputError: a number that cannot be; it names it.
    """

    range_m: float
    pitch_rad: float
    azimuth_rad: float
    range_deviation_m: float
    pitch_deviation_rad: float
    azimuth_deviation_rad: float

    def __post_init__(self) -> None:
        _check("range_m", self.range_m, 0.0, math.inf)
        # Noise may carry the pitch of a vehicle straight below a little past the vertical.
        _check("pitch_rad", self.pitch_rad, -math.pi / 2 - WIDEST_RAD, math.pi / 2 + WIDEST_RAD)
        _check("azimuth_rad", self.azimuth_rad, -math.inf, math.inf)
        _check("range_deviation_m", self.range_deviation_m, 0.0, math.inf)
        _check("pitch_deviation_rad", self.pitch_deviation_rad, 0.0, WIDEST_RAD)
        _check("azimuth_deviation_rad", self.azimuth_deviation_rad, 0.0, WIDEST_RAD)


def _check(field: str, value: float, above: float, below: float) -> None:
    if not above < value < below:
        raise InputError(f"{value:g} is not between {above:g} and {below:g}: the sighting is not used", field=field)


@dataclass(frozen=True, eq=False)
class PositionFix:
    """A position and how sure it is.

    Attributes:
        position_m: scene ENU, shape (3,).
        covariance_m2: symmetric and positive definite, shape (3, 3).

    Raises:
        InputError: not numbers of this kind.
    """

    position_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.position_m.shape != (3,) or not np.isfinite(self.position_m).all():
            raise InputError("a position needs three finite coordinates", field="position_m")
        covariance = self.covariance_m2
        good = covariance.shape == (3, 3) and bool(np.isfinite(covariance).all())
        if not (good and np.allclose(covariance, covariance.T) and np.linalg.eigvalsh(covariance)[0] > 0):
            raise InputError("a covariance is symmetric and positive definite, shape (3, 3)", field="covariance_m2")


def sighted_position(observer: PositionFix, sighting: Sighting) -> PositionFix:
    """Where the sighted vehicle is.

    Args:
        observer: where the observer is, by its own fix.
        sighting: made from there.

    Returns:
        The position without the printed form's bias, and its covariance from the errors of both.
    """
    shorter_up = math.exp(-(sighting.pitch_deviation_rad**2) / 2)
    shorter_level = shorter_up * math.exp(-(sighting.azimuth_deviation_rad**2) / 2)
    scale = np.array([1 / shorter_level, 1 / shorter_level, 1 / shorter_up])
    distance = sighting.range_m
    cos_pitch, sin_pitch = math.cos(sighting.pitch_rad), math.sin(sighting.pitch_rad)
    cos_azimuth, sin_azimuth = math.cos(sighting.azimuth_rad), math.sin(sighting.azimuth_rad)
    towards = np.array([cos_pitch * cos_azimuth, cos_pitch * sin_azimuth, sin_pitch])
    up = np.array([-sin_pitch * cos_azimuth, -sin_pitch * sin_azimuth, cos_pitch])
    aside = np.array([-cos_pitch * sin_azimuth, cos_pitch * cos_azimuth, 0.0])
    spread = np.column_stack(
        [
            math.hypot(sighting.range_deviation_m, _bent_m(sighting)) * towards,
            sighting.pitch_deviation_rad * distance * up,
            sighting.azimuth_deviation_rad * distance * aside,
        ]
    )
    return PositionFix(observer.position_m + distance * scale * towards, observer.covariance_m2 + spread @ spread.T)


def _bent_m(sighting: Sighting) -> float:
    """What the angles' errors do to the distance along the measured sight line, root mean square (m).

    The true place lies on a sphere, so an angle's error e moves the measured one by `d e^2 / 2` along the line, and
    the bias that is taken out adds `d s^2 / 2`.
    """
    pitch = sighting.pitch_deviation_rad**2
    azimuth = (math.cos(sighting.pitch_rad) * sighting.azimuth_deviation_rad) ** 2
    return sighting.range_m * math.sqrt(1.5 * pitch**2 + 1.5 * azimuth**2 + 2 * pitch * azimuth)
