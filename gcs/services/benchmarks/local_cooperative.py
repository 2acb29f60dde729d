"""Case `cooperative`: sighted positions against the Cramer-Rao bound, and flights under a crane's beam by them.

The bound is taken from the likelihood alone: the Fisher information of range, pitch, azimuth and the observer's own
fix, by differences, in the observer's place and the sighted one together.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.cooperative_position import PositionFix, Sighting, sighted_position
from gcs.services.benchmarks.cooperative_flight import beam_plan, flights_under_beam
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from numpy.typing import NDArray

CASE = "cooperative"
OBSERVER_M, OBSERVER_DEVIATIONS_M = np.array([0.0, -24.0, 9.0]), (0.02, 0.02, 0.03)
GEOMETRIES = (
    ((0.0, 0.0, 6.0), (0.05, 0.005, 0.005)),
    ((40.0, 30.0, 5.0), (0.3, 0.02, 0.03)),
    ((-60.0, -9.0, 24.0), (0.1, 0.05, 0.08)),
    ((0.5, -23.0, 2.0), (0.05, 0.02, 0.05)),
)
"""Sighted places, scene ENU, and deviations of range, pitch and azimuth."""

DRAWS, QUICK_DRAWS = 3000, 500
SEEDS = 5
AUTOPILOTS = ("px4", "ardupilot")
_STEP = 1e-6


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few draws, one autopilot, one flight with an observer and one without.
    """
    ratio = max(
        error_over_bound(np.array(place), deviations, QUICK_DRAWS if quick else DRAWS)
        for place, deviations in GEOMETRIES
    )
    flights = _flights(AUTOPILOTS[:1], 1) if quick else _flights(AUTOPILOTS, SEEDS)
    return [Row(CASE, "error_over_bound", ratio, "1", "asked", 2.0), *flights]


def _flights(autopilots: tuple[str, ...], seeds: int) -> list[Row]:
    plan, anchor, half_width_m = beam_plan()
    cases = [(kind, seed, seen) for kind in autopilots for seen in (True, False) for seed in range(seeds)]
    flown = flights_under_beam(cases, (plan, anchor))
    rows = []
    for kind in autopilots:
        for seen, name in ((True, "deviation_m"), (False, "deviation_alone_m")):
            of_kind = [f for f, case in zip(flown, cases, strict=True) if case[0] == kind and case[2] is seen]
            # Of the worst flight with an observer, and of the best one without.
            value = (max if seen else min)(f.cross_track_m for f in of_kind)
            rows.append(Row(CASE, f"{kind}.{name}", value, "m", "corridor", half_width_m))
    return rows


def error_over_bound(place_m: NDArray[np.float64], deviations: tuple[float, float, float], draws: int) -> float:
    """Root mean square error of sighted positions over that of the bound.

    Args:
        place_m: where the sighted vehicle is, shape (3,).
        deviations: of range (m), pitch and azimuth (rad).
        draws: how many sightings.
    """
    rng = np.random.default_rng(0)
    covariance = np.diag(OBSERVER_DEVIATIONS_M) ** 2
    exact = _measured(place_m, OBSERVER_M)
    squares = []
    for _ in range(draws):
        observer = PositionFix(OBSERVER_M + rng.normal(0.0, OBSERVER_DEVIATIONS_M), covariance)
        distance, pitch, azimuth = exact + rng.normal(0.0, deviations)
        sighting = Sighting(distance, pitch, azimuth, *deviations)
        squares.append(float(((sighted_position(observer, sighting).position_m - place_m) ** 2).sum()))
    return math.sqrt(np.mean(squares) / float(np.trace(_bound(place_m, deviations))))


def _bound(place_m: NDArray[np.float64], deviations: tuple[float, float, float]) -> NDArray[np.float64]:
    """Least covariance that any unbiased estimate of the place can have, shape (3, 3)."""
    both = np.concatenate([place_m, OBSERVER_M])

    def told(places: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([_measured(places[:3], places[3:]), places[3:]])

    slope = np.stack([(told(both + e) - told(both - e)) / (2 * _STEP) for e in _STEP * np.eye(6)], axis=1)
    information = slope.T @ np.diag(np.concatenate([deviations, OBSERVER_DEVIATIONS_M]) ** -2.0) @ slope
    return np.asarray(np.linalg.inv(information)[:3, :3])


def _measured(place_m: NDArray[np.float64], observer_m: NDArray[np.float64]) -> NDArray[np.float64]:
    east, north, up = place_m - observer_m
    return np.array(
        [math.sqrt(east**2 + north**2 + up**2), math.atan2(up, math.hypot(east, north)), math.atan2(north, east)]
    )
