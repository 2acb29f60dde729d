"""What a flight may reach, and how near a curve comes to it on its true extrema.

Speed and jerk are limited in norm. Three things limit the acceleration a: its norm, the tilt and the thrust. Hovering
takes the specific thrust g upwards, so flying takes `a + g e_z`; air resistance is left out. When all times of a curve
are stretched by c, its accelerations shrink by c^2, and

    tilt at most theta:   c^2 >= (|a_xy| / tan theta - a_z) / g
    thrust at most F:     c^2 >= (g a_z + sqrt(g^2 a_z^2 + (F^2 - g^2) |a|^2)) / (F^2 - g^2)

Both right sides are convex and homogeneous in a, like the norm. So over a piece they are at most their largest value on
the Bernstein control points of the acceleration, and subdivision closes the bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.numerics.bernstein import derivative
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.scenario import VehicleSpec

LIMIT_MARGIN = 0.001
"""Share of each limit that is left unused."""

GRAVITY_M_S2 = 9.80665

TOLERANCE = 1e-7
"""How far, as a share, the bound of an extremum is over the true one."""

_NO_LIMIT = 1e9
"""A limit of the acceleration that is never the nearest."""

_SAMPLES = 13
_DEEPEST = 60

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


@dataclass(frozen=True)
class FlightLimits:
    """What the motion may reach: norms over the three axes.

    Attributes:
        speed_m_s: largest speed.
        acceleration_m_s2: largest acceleration.
        jerk_m_s3: largest jerk; None for no limit.
    """

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float | None = None

    def check(self) -> None:
        """Refuse limits that cannot be met.

        Raises:
            InputError: it names the limit.
        """
        for name in ("speed_m_s", "acceleration_m_s2", "jerk_m_s3"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise InputError(f"a limit must be positive and finite, not {value:g}", field=name)

    def stretch(self, peaks: NDArray[np.float64]) -> NDArray[np.float64]:
        """Factor on all times that brings peaks of speed, acceleration and jerk to their limits.

        Args:
            peaks: shape (..., 3); for the acceleration see `acceleration_peaks`.

        Returns:
            Shape (...): the largest of the three factors.
        """
        jerk = math.inf if self.jerk_m_s3 is None else self.jerk_m_s3
        limits = np.array([self.speed_m_s, self.acceleration_m_s2, jerk]) * (1 - LIMIT_MARGIN)
        factor: NDArray[np.float64] = ((peaks / limits) ** (1.0 / np.array([1.0, 2.0, 3.0]))).max(axis=-1)
        return factor

    @property
    def _gauge(self) -> tuple[float, float]:
        """Cotangent of the tilt, and `F^2 - g^2`; zero and infinity without these limits."""
        return 0.0, math.inf

    def worst_peaks(
        self, first: NDArray[np.int64], control: NDArray[np.float64], durations_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Largest speed, acceleration and jerk of each of several curves, bounded over the whole of them.

        The acceleration's is that of the norm which is as near to its limit as the nearest of norm, tilt and thrust.

        Args:
            first: curve i has the pieces `first[i]` to `first[i + 1] - 1`, shape (L + 1,).
            control: control points of all pieces, shape (S, 8, 3).
            durations_s: shape (S,).

        Returns:
            Shape (L, 3); at most `TOLERANCE` of itself over the true extrema.
        """
        cotangent, above = self._gauge
        norm = (0.0, math.inf)
        columns = []
        for order in (1, 2, 3):
            vectors = derivative(control, order) / durations_s[:, None, None] ** order
            limits = (cotangent, above) if order == 2 else norm
            columns.append(_largest_over_curves(first, vectors, self.acceleration_m_s2, *limits))
        return np.stack(columns, axis=1)

    def acceleration_peaks(self, accelerations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Norm that is as near to its limit as the nearest of norm, tilt and thrust; shape (N, K, 3) -> (N,)."""
        return _largest_of_points(accelerations, self.acceleration_m_s2, *self._gauge)

    def use(self, control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Factor on the time of each piece that its own sampled peaks ask for, shape (S,); above 1 is too quick."""
        peaks = segment_peaks(control, durations_s)
        cotangent, above = self._gauge
        if cotangent > 0 or above < math.inf:
            peaks[:, 1] = self.acceleration_peaks(_at_samples(2) @ control / durations_s[:, None, None] ** 2)
        return self.stretch(peaks)


@dataclass(frozen=True)
class RotorLimits(FlightLimits):
    """Flight limits, and what the rotors and the autopilot allow.

    Attributes:
        tilt_rad: largest angle of the thrust from the vertical; None for no limit.
        thrust_m_s2: largest thrust over mass; None for no limit.
    """

    tilt_rad: float | None = None
    thrust_m_s2: float | None = None

    def check(self) -> None:
        """As of `FlightLimits`."""
        super().check()
        if self.tilt_rad is not None and not 0 < self.tilt_rad < math.pi / 2:
            raise InputError(
                f"the tilt's limit must be between 0 and 90 degrees, not {math.degrees(self.tilt_rad):g}",
                field="tilt_rad",
            )
        if self.thrust_m_s2 is not None and not GRAVITY_M_S2 < self.thrust_m_s2 < math.inf:
            raise InputError(
                f"a thrust of {self.thrust_m_s2:g} m/s^2 does not lift the vehicle: {GRAVITY_M_S2:g} is its weight",
                field="thrust_m_s2",
            )

    @property
    def _gauge(self) -> tuple[float, float]:
        cotangent = 0.0 if self.tilt_rad is None else 1 / math.tan(self.tilt_rad)
        above = math.inf if self.thrust_m_s2 is None else self.thrust_m_s2**2 - GRAVITY_M_S2**2
        return cotangent, above


def limits_of(vehicle: VehicleSpec) -> FlightLimits:
    """What a scenario's vehicle may reach."""
    if vehicle.max_tilt_deg is None and vehicle.max_thrust_ratio is None:
        return FlightLimits(vehicle.max_speed_m_s, vehicle.max_acceleration_m_s2, vehicle.max_jerk_m_s3)
    return RotorLimits(
        vehicle.max_speed_m_s,
        vehicle.max_acceleration_m_s2,
        vehicle.max_jerk_m_s3,
        tilt_rad=None if vehicle.max_tilt_deg is None else math.radians(vehicle.max_tilt_deg),
        thrust_m_s2=None if vehicle.max_thrust_ratio is None else vehicle.max_thrust_ratio * GRAVITY_M_S2,
    )


def largest_tilt_rad(control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> float:
    """Bound of the thrust's angle (rad) from the vertical over the whole of a curve; pi / 2 or more counts as pi / 2.

    Args:
        control: shape (n, 8, 3).
        durations_s: shape (n,).
    """
    accelerations = derivative(control, 2) / durations_s[:, None, None] ** 2
    first = np.array([0, len(durations_s)])
    low, high = 0.0, math.pi / 2
    while high - low > 1e-6:
        middle = (low + high) / 2
        kept = _largest_over_curves(first, accelerations, _NO_LIMIT, 1 / math.tan(middle), math.inf)[0] <= _NO_LIMIT
        low, high = (low, middle) if kept else (middle, high)
    return high


def largest_thrust_ratio(control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> float:
    """Bound of thrust over weight over the whole of a curve.

    Args:
        control: shape (n, 8, 3).
        durations_s: shape (n,).
    """
    thrust = derivative(control, 2) / durations_s[:, None, None] ** 2 + np.array([0.0, 0.0, GRAVITY_M_S2])
    first = np.array([0, len(durations_s)])
    return float(_largest_over_curves(first, thrust, 1.0, 0.0, math.inf)[0]) / GRAVITY_M_S2


def peaks(control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bounds of speed (m/s), acceleration (m/s^2) and jerk (m/s^3) over the whole of a curve, shape (3,).

    Args:
        control: shape (n, 8, 3).
        durations_s: shape (n,).
    """
    found: NDArray[np.float64] = FlightLimits(1.0, 1.0).worst_peaks(
        np.array([0, len(durations_s)]), control, durations_s
    )[0]
    return found


def segment_peaks(control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sampled largest speed, acceleration and jerk of each piece, shape (n, 3); a little under the true ones."""
    columns = []
    for order in (1, 2, 3):
        value = _at_samples(order) @ control
        columns.append(np.sqrt((value * value).sum(axis=2).max(axis=1)) / durations_s**order)
    return np.stack(columns, axis=1)


@cache
def _at_samples(order: int) -> NDArray[np.float64]:
    """Matrix from control points to a derivative on the unit interval at evenly spaced samples, shape (13, 8)."""
    u = np.linspace(0.0, 1.0, _SAMPLES)
    n = 7 - order
    basis = np.array([[math.comb(n, i) * x**i * (1 - x) ** (n - i) for i in range(n + 1)] for x in u])
    return np.ascontiguousarray(basis @ derivative(np.eye(8), order))


@compiled
def _value(x: float, y: float, z: float, limit: float, cotangent: float, above: float) -> float:
    """The norm that is as near to `limit` as the nearest of norm, tilt and thrust."""
    level = x * x + y * y
    worst = math.sqrt(level + z * z)
    if cotangent > 0.0:
        worst = max(worst, limit * (math.sqrt(level) * cotangent - z) / GRAVITY_M_S2)
    if above < math.inf:
        upward = GRAVITY_M_S2 * z
        worst = max(worst, limit * (upward + math.sqrt(upward * upward + above * (level + z * z))) / above)
    return worst


@compiled
def _largest_of_points(points: Floats, limit: float, cotangent: float, above: float) -> Floats:
    """Largest `_value` of the points of each row; shape (N, K, 3) -> (N,)."""
    result = np.zeros(len(points))
    for row in range(len(points)):
        for k in range(points.shape[1]):
            v = points[row, k]
            result[row] = max(result[row], _value(v[0], v[1], v[2], limit, cotangent, above))
    return result


@compiled
def _largest_over_curves(first: Ints, vectors: Floats, limit: float, cotangent: float, above: float) -> Floats:
    """Bound of the largest value over curves of vectors in Bernstein form, by subdivision.

    Args:
        first: curve i has the pieces `first[i]` to `first[i + 1] - 1`, shape (L + 1,).
        vectors: control points, shape (S, n + 1, 3).
        limit: see `_value`.
        cotangent: of the largest tilt, 0 without a limit.
        above: `F^2 - g^2`, infinite without a limit.

    Returns:
        Shape (L,).
    """
    size = vectors.shape[1]
    result = np.zeros(len(first) - 1)
    stack, depths = np.empty((_DEEPEST + 2, size, 3)), np.empty(_DEEPEST + 2, dtype=np.int64)
    left, right = np.empty((size, 3)), np.empty((size, 3))
    for curve in range(len(result)):
        best = 0.0
        for piece in range(first[curve], first[curve + 1]):
            for k in (0, size - 1):
                v = vectors[piece, k]
                best = max(best, _value(v[0], v[1], v[2], limit, cotangent, above))
        for piece in range(first[curve], first[curve + 1]):
            stack[0] = vectors[piece]
            depths[0] = 0
            top = 1
            while top > 0:
                top -= 1
                part, depth = stack[top], depths[top]
                hull = 0.0
                for k in range(size):
                    hull = max(hull, _value(part[k, 0], part[k, 1], part[k, 2], limit, cotangent, above))
                if hull <= best * (1.0 + TOLERANCE) + 1e-300 or depth == _DEEPEST:
                    continue
                right[:] = part
                for k in range(size):
                    left[k] = right[0]
                    for i in range(size - 1 - k):
                        for d in range(3):
                            right[i, d] = 0.5 * (right[i, d] + right[i + 1, d])
                # What is left of the scheme, from its end to its start, is the right half.
                v = right[0]
                best = max(best, _value(v[0], v[1], v[2], limit, cotangent, above))
                stack[top] = right
                stack[top + 1] = left
                depths[top] = depths[top + 1] = depth + 1
                top += 2
        result[curve] = best * (1.0 + TOLERANCE)
    return result
