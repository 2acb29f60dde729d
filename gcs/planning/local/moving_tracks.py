"""Tracks of moving obstacles: Kalman filters of constant velocity over the discs that scans show.

The velocity wanders with white acceleration noise, so a prediction is the less sure the further ahead it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

GATE = 13.8
"""Largest squared Mahalanobis distance of a disc from the track it may belong to: 99.9 % of two degrees of freedom."""

NO_MATCH = 1e6

SURELY = 9.0
"""A velocity that is three deviations from zero, squared, is motion."""

STILL_MOVING = 0.6
"""What was moving needs only this share of speed and deviations to be moving still."""


@dataclass(frozen=True)
class TrackingOptions:
    """How obstacles move, and how well they are seen.

    Attributes:
        measurement_m: standard deviation of a disc's middle on each axis, where it is not given.
        wander_m2_s3: spectral density of the acceleration's white noise.
        first_speed_m_s: standard deviation of a new track's velocity on each axis.
        confirmed_after: sightings before a track counts.
        forgotten_after_s: time without a sighting after which a track ends.
        least_speed_m_s: what is slower stands.
    """

    measurement_m: float = 0.15
    wander_m2_s3: float = 0.1
    first_speed_m_s: float = 3.0
    confirmed_after: int = 4
    forgotten_after_s: float = 1.5
    least_speed_m_s: float = 0.4


@dataclass(frozen=True, eq=False)
class Track:
    """One obstacle as it is known at one time.

    Attributes:
        number: stays the same as long as it is followed.
        time_s: of the state.
        state: x, y (m), and their velocities (m/s), scene ENU, shape (4,).
        covariance: of the state, shape (4, 4).
        wander_m2_s3: as in the options.
        radius_m: largest disc seen lately.
        sightings: how often it was seen.
        seen_s: when last.
    """

    number: int
    time_s: float
    state: NDArray[np.float64]
    covariance: NDArray[np.float64]
    wander_m2_s3: float
    radius_m: float
    sightings: int
    seen_s: float

    @property
    def speed_m_s(self) -> float:
        """How fast it is."""
        return float(np.linalg.norm(self.state[2:]))

    def positions(self, times_s: ArrayLike) -> NDArray[np.float64]:
        """Where it is expected, shape (N, 2)."""
        ahead = np.asarray(times_s, dtype=np.float64) - self.time_s
        return np.asarray(self.state[:2] + ahead[:, None] * self.state[2:])

    def deviations_m(self, times_s: ArrayLike) -> NDArray[np.float64]:
        """Standard deviation of that place in its worst direction, shape (N,): it grows with time."""
        ahead = np.asarray(times_s, dtype=np.float64) - self.time_s
        place, cross, velocity = self.covariance[:2, :2], self.covariance[:2, 2:], self.covariance[2:, 2:]
        t = ahead[:, None, None]
        spread = place + t * (cross + cross.T) + t**2 * velocity + self.wander_m2_s3 * np.abs(t) ** 3 / 3 * np.eye(2)
        xx, yy, xy = spread[:, 0, 0], spread[:, 1, 1], spread[:, 0, 1]
        return np.asarray(np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)))

    def at(self, time_s: float) -> Track:
        """The same at a later time, without having been seen."""
        dt = time_s - self.time_s
        move = np.eye(4)
        move[0, 2] = move[1, 3] = dt
        noise = self.wander_m2_s3 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        covariance = move @ self.covariance @ move.T + np.kron(noise, np.eye(2))
        return replace(self, time_s=time_s, state=move @ self.state, covariance=covariance)


class Tracker:
    """Follows discs from scan to scan.

    Args:
        options: how obstacles move, and how well they are seen.
    """

    def __init__(self, options: TrackingOptions | None = None) -> None:
        self._options = options or TrackingOptions()
        self._tracks: list[Track] = []
        self._moving: set[int] = set()
        self._made = 0
        self._time_s = -math.inf

    def see(self, discs: NDArray[np.float64], time_s: float, covariances: NDArray[np.float64] | None = None) -> None:
        """Enter what a scan shows.

        Args:
            discs: rows of x, y and radius (K, 3), m, scene ENU.
            time_s: when; not before the last.
            covariances: of their middles, m^2, shape (K, 2, 2); those of the options when not given.

        Raises:
            InputError: discs that are not finite numbers, or an older time.
        """
        if covariances is None:
            covariances = np.tile(self._options.measurement_m**2 * np.eye(2), (len(discs), 1, 1))
        if discs.ndim != 2 or discs.shape[1] != 3 or not np.isfinite(discs).all():
            raise InputError("discs are rows of three finite numbers", field="discs")
        if not self._time_s <= time_s < math.inf:
            raise InputError(f"discs of {time_s:g} s are older than the tracks of {self._time_s:g} s", field="time_s")
        self._time_s = time_s
        options = self._options
        tracks = [track.at(time_s) for track in self._tracks if time_s - track.seen_s <= options.forgotten_after_s]
        matches = _matches(tracks, discs, covariances)
        seen = [
            _updated(track, discs[matches[k]], covariances[matches[k]]) if k in matches else track
            for k, track in enumerate(tracks)
        ]
        new = [self._new(discs[k], covariances[k]) for k in range(len(discs)) if k not in matches.values()]
        self._tracks = seen + new
        self._moving = {track.number for track in self.confirmed() if self._moves(track)}

    def confirmed(self) -> list[Track]:
        """Tracks that were seen often enough."""
        return [track for track in self._tracks if track.sightings >= self._options.confirmed_after]

    def moving(self) -> list[Track]:
        """Confirmed tracks whose velocity is surely not zero and worth the name, as of the last scan.

        What moved a moment ago need not be as sure.
        """
        return [track for track in self._tracks if track.number in self._moving]

    def _moves(self, track: Track) -> bool:
        velocity = track.state[2:]
        surprise = float(velocity @ np.linalg.solve(track.covariance[2:, 2:], velocity))
        share = STILL_MOVING if track.number in self._moving else 1.0
        return track.speed_m_s >= share * self._options.least_speed_m_s and surprise >= share**2 * SURELY

    def _new(self, disc: NDArray[np.float64], spread: NDArray[np.float64]) -> Track:
        self._made += 1
        covariance = np.diag([0.0, 0.0] + [self._options.first_speed_m_s**2] * 2)
        covariance[:2, :2] = spread
        return Track(
            number=self._made,
            time_s=self._time_s,
            state=np.array([disc[0], disc[1], 0.0, 0.0]),
            covariance=covariance,
            wander_m2_s3=self._options.wander_m2_s3,
            radius_m=float(disc[2]),
            sightings=1,
            seen_s=self._time_s,
        )


def _matches(tracks: list[Track], discs: NDArray[np.float64], covariances: NDArray[np.float64]) -> dict[int, int]:
    """Which disc belongs to which track: the assignment of least sum inside the gates."""
    if not tracks or not len(discs):
        return {}
    costs = np.empty((len(tracks), len(discs)))
    for k, track in enumerate(tracks):
        off = discs[:, :2] - track.state[:2]
        costs[k] = np.einsum("ni,nij,nj->n", off, np.linalg.inv(track.covariance[:2, :2] + covariances), off)
    costs[costs > GATE] = NO_MATCH
    rows, columns = linear_sum_assignment(costs)
    return {int(k): int(c) for k, c in zip(rows, columns, strict=True) if costs[k, c] <= GATE}


def _updated(track: Track, disc: NDArray[np.float64], spread: NDArray[np.float64]) -> Track:
    gain = track.covariance[:, :2] @ np.linalg.inv(track.covariance[:2, :2] + spread)
    covariance = track.covariance - gain @ track.covariance[:2]
    return replace(
        track,
        state=track.state + gain @ (disc[:2] - track.state[:2]),
        covariance=(covariance + covariance.T) / 2,
        # The side that is seen changes; what was seen of the size is forgotten only slowly.
        radius_m=max(float(disc[2]), 0.98 * track.radius_m),
        sightings=track.sightings + 1,
        seen_s=track.time_s,
    )
