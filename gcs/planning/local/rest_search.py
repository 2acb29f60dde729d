"""Curves that bring the vehicle to rest at many places, all tried in one compiled search.

A curve of degree 5 goes from the present position, velocity and acceleration to rest at a place. Each place gets the
shortest of some times that the limits allow; what the curve keeps from standing and moving obstacles is then bounded
over the whole of it: between two looks no distance changes by more than speed allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import DEGREE, PiecewisePolynomial
from gcs.planning.local.space_time import STEP_S
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.local.room import Room
    from gcs.planning.local.space_time import Predictions
    from gcs.planning.trajectories.flight_limits import FlightLimits

STRETCH, STRETCHES = 1.12, 18
"""Tried multiples of the shortest time that could do: powers of this, so many."""

LOOKS = 24
"""So often a curve is held against the limits; its winner is proved on the true extrema."""

SHARE_OF_LIMITS = 0.99

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, eq=False)
class RestCurves:
    """One curve to each place.

    Attributes:
        coefficients: on the curve's own time from 0 to 1, shape (K, 6, 3).
        durations_s: infinite where the limits allow none, shape (K,).
        rooms_m: least distance from what stands, as a lower bound, shape (K,).
        end_rooms_m: the same at the end alone, shape (K,).
        margins_m: how much more than asked is kept from what moves, at least, up to the horizon, shape (K,).
    """

    coefficients: NDArray[np.float64]
    durations_s: NDArray[np.float64]
    rooms_m: NDArray[np.float64]
    end_rooms_m: NDArray[np.float64]
    margins_m: NDArray[np.float64]

    def curve(self, k: int) -> PiecewisePolynomial:
        """One of them."""
        coefficients = np.zeros((1, DEGREE + 1, 3))
        coefficients[0, :6] = self.coefficients[k]
        return PiecewisePolynomial(coefficients, self.durations_s[k : k + 1])


def search_rest(
    state: NDArray[np.float64],
    places_m: NDArray[np.float64],
    limits: FlightLimits,
    room: Room,
    predictions: Predictions,
    delay_s: float = 0.0,
) -> RestCurves:
    """Try some places.

    Args:
        state: position, velocity and acceleration at the curves' begin (further rows are not used), shape (>= 3, 3).
        places_m: where to rest, shape (K, 3).
        limits: the curves hold them at the samples.
        room: what stands.
        predictions: what moves.
        delay_s: the curves begin so long after the predictions.
    """
    jerk = math.inf if limits.jerk_m_s3 is None else limits.jerk_m_s3
    most = SHARE_OF_LIMITS * np.array([limits.speed_m_s, limits.acceleration_m_s2, jerk])
    # What is flown now may be at a limit: no curve could begin below it.
    most[:2] = np.maximum(most[:2], np.linalg.norm(state[1:3], axis=1) * (1 + 1e-9))
    first = round(delay_s / STEP_S)
    return RestCurves(
        *_search(
            np.ascontiguousarray(state[:3]),
            places_m,
            most,
            room.room_m,
            room.origin_m,
            room.cell_m,
            np.ascontiguousarray(predictions.places_m[:, first:]),
            np.ascontiguousarray(predictions.needed_m[:, first:]),
            STEP_S,
        )
    )


@compiled
def _search(
    state: Floats,
    places: Floats,
    most: Floats,
    room: Floats,
    origin: Floats,
    cell: float,
    moving: Floats,
    needed: Floats,
    step: float,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    count = len(places)
    coefficients = np.zeros((count, 6, 3))
    durations, rooms = np.full(count, np.inf), np.full(count, -np.inf)
    end_rooms, margins = np.full(count, -np.inf), np.full(count, -np.inf)
    speed = math.sqrt((state[1] ** 2).sum())
    for k in range(count):
        away = math.sqrt(((places[k] - state[0]) ** 2).sum())
        shortest = max(away / most[0], speed / most[1], math.sqrt(away / most[1]), 0.2)
        for power in range(STRETCHES):
            duration = shortest * STRETCH**power
            _towards_rest(coefficients[k], state, places[k], duration)
            if not _holds(coefficients[k], duration, most):
                continue
            durations[k] = duration
            end_rooms[k] = _room_at(places[k, 0], places[k, 1], room, origin, cell)
            rooms[k], margins[k] = _kept(coefficients[k], duration, room, origin, cell, moving, needed, step)
            break
    return coefficients, durations, rooms, end_rooms, margins


@compiled
def _towards_rest(c: Floats, state: Floats, place: Floats, duration: float) -> None:
    """Coefficients (6, 3) of the curve of degree 5 to rest at a place."""
    for d in range(3):
        c[0, d], c[1, d], c[2, d] = state[0, d], state[1, d] * duration, state[2, d] * duration**2 / 2
        gap = place[d] - c[0, d] - c[1, d] - c[2, d]
        slope = -c[1, d] - 2 * c[2, d]
        bend = -2 * c[2, d]
        c[3, d] = 10 * gap - 4 * slope + bend / 2
        c[4, d] = -15 * gap + 7 * slope - bend
        c[5, d] = 6 * gap - 3 * slope + bend / 2


@compiled
def _holds(c: Floats, duration: float, most: Floats) -> bool:
    for look in range(LOOKS + 1):
        u = look / LOOKS
        speed, acceleration, jerk = 0.0, 0.0, 0.0
        for d in range(3):
            speed += (c[1, d] + u * (2 * c[2, d] + u * (3 * c[3, d] + u * (4 * c[4, d] + u * 5 * c[5, d])))) ** 2
            acceleration += (2 * c[2, d] + u * (6 * c[3, d] + u * (12 * c[4, d] + u * 20 * c[5, d]))) ** 2
            jerk += (6 * c[3, d] + u * (24 * c[4, d] + u * 60 * c[5, d])) ** 2
        if math.sqrt(speed) > most[0] * duration or math.sqrt(acceleration) > most[1] * duration**2:
            return False
        if math.sqrt(jerk) > most[2] * duration**3:
            return False
    return True


@compiled
def _kept(
    c: Floats,
    duration: float,
    room: Floats,
    origin: Floats,
    cell: float,
    moving: Floats,
    needed: Floats,
    step: float,
) -> tuple[float, float]:
    """Least room along a curve, and least margin from what moves, which still counts after the curve's end."""
    least, margin = _room_at(c[0, 0], c[0, 1], room, origin, cell), np.inf
    looks = max(needed.shape[1], math.ceil(duration / step))
    before_x, before_y = c[0, 0], c[0, 1]
    for look in range(looks):
        u = min((look + 0.5) * step / duration, 1.0)
        x = c[0, 0] + u * (c[1, 0] + u * (c[2, 0] + u * (c[3, 0] + u * (c[4, 0] + u * c[5, 0]))))
        y = c[0, 1] + u * (c[1, 1] + u * (c[2, 1] + u * (c[3, 1] + u * (c[4, 1] + u * c[5, 1]))))
        # As far as from the look before is nearly as far as within this step on either side.
        moved = math.hypot(x - before_x, y - before_y)
        before_x, before_y = x, y
        if (look - 0.5) * step <= duration:
            least = min(least, _room_at(x, y, room, origin, cell) - moved / 2)
        if look < needed.shape[1]:
            for k in range(len(needed)):
                away = math.hypot(x - moving[k, look, 0], y - moving[k, look, 1])
                margin = min(margin, away - needed[k, look] - moved / 2)
    return least, margin


@compiled
def _room_at(x: float, y: float, room: Floats, origin: Floats, cell: float) -> float:
    i, j = math.floor((x - origin[0]) / cell), math.floor((y - origin[1]) / cell)
    if i < 0 or j < 0 or i >= room.shape[0] or j >= room.shape[1]:
        return -np.inf
    return float(room[i, j])
