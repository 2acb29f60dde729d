"""Predicted against recorded flights: time and largest deviation, each flight left out of what it is fitted to.

Two numbers of each vehicle are not among its parameters: drag and lag of its tilt. They are fitted on a coarse grid to
the other flights of the same autopilot (least squares of what time and deviation are off, as parts of what is allowed).

Without a folder of records there is the speed of ArduPilot along dense waypoints beside the law that was measured
for it, `v = k (J L^2)^(1/3)`, and what a prediction costs.
"""

from __future__ import annotations

from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.flight_law import Airframe, ArduPilotLaw, Px4Law
from gcs.core.vehicle import Autopilot
from gcs.planning.dynamics.ardupilot_mission import predict_ardupilot_mission
from gcs.planning.dynamics.flown_path import deviation_from_curve
from gcs.planning.dynamics.predicted_flight import MissionRoute
from gcs.planning.dynamics.px4_mission import predict_px4_mission
from gcs.services.benchmarks.flown_records import read_curve, read_flights, relative_miss
from gcs.services.benchmarks.row import Row, milliseconds

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from gcs.planning.dynamics.flown_path import FlownDeviation
    from gcs.services.benchmarks.flown_records import RecordedCurve, RecordedFlight

TIME_SHARE = 0.1
STREAM_DEVIATION = (0.3, 0.25)
MISSION_DEVIATION = (0.5, 0.3)
"""What a prediction may be off: metres, or a share of what was recorded if that is more."""

_MEASURED_LAW = {1.0: 0.57, 5.0: 0.5}
"""WPNAV_JERK -> k, fitted to legs of 1 m to 8 m on a real autopilot."""
_STRAIGHT_M = 120.0

_GRIDS = {
    Autopilot.ARDUPILOT: ((0.2, 0.3, 0.4, 0.5, 0.6), (0.05, 0.1, 0.15)),
    Autopilot.PX4: ((0.6, 0.8, 1.0, 1.2), (0.07, 0.09, 0.11, 0.13)),
}
_QUICK = {
    Autopilot.ARDUPILOT: ((0.3, 0.4), (0.1,)),
    Autopilot.PX4: ((0.8, 1.0), (0.11,)),
}


def run(quick: bool, records: Path | None = None) -> list[Row]:
    """Predict dense waypoints, and every complete flight of both autopilots.

    Args:
        quick: with a smaller grid.
        records: the folder of recorded flights (see `flown_records`).

    Returns:
        For each flight its time and largest deviation, the recorded ones beside them, and both misses as a part of what
        is allowed (1 is the limit).

    Raises:
        InputError: the folder has no such records.
    """
    rows = [*_dense_waypoints(), *_cost()]
    if records is None:
        return rows
    for autopilot, grid in (_QUICK if quick else _GRIDS).items():
        curve = read_curve(records / autopilot.value / "dense")
        flights = read_flights(records, autopilot)
        for flight, airframe, found in leave_one_out(curve, flights, *grid):
            case, of = f"{autopilot.value} {flight.name}", "recorded"
            rows += [
                Row(case, "time_s", found.time_s, "s", of, flight.time_s),
                Row(case, "max_deviation_m", found.max_m, "m", of, flight.max_deviation_m),
                Row(case, "time_miss", misses(flight, found)[0], "1"),
                Row(case, "deviation_miss", misses(flight, found)[1], "1"),
                Row(case, "drag_1_s", airframe.drag_1_s, "1/s"),
                Row(case, "tilt_lag_s", airframe.tilt_lag_s, "s"),
            ]
    return rows


def _dense_waypoints() -> list[Row]:
    rows = []
    for jerk, factor in _MEASURED_LAW.items():
        for spacing in (1.0, 2.0, 4.0, 8.0):
            places = np.zeros((round(_STRAIGHT_M / spacing) + 1, 3))
            places[:, 0] = spacing * np.arange(len(places))
            nothing = np.zeros(len(places))
            flight = predict_ardupilot_mission(
                MissionRoute(places, nothing, nothing), ArduPilotLaw(jerk_m_s3=jerk), Airframe()
            )
            x = flight.position_m[:, 0]
            first, last = np.searchsorted(x, [0.3 * _STRAIGHT_M, 0.7 * _STRAIGHT_M])
            speed = float((x[last] - x[first]) / (flight.time_s[last] - flight.time_s[first]))
            law = factor * (jerk * spacing**2) ** (1 / 3)
            case = f"ardupilot every {spacing:g} m, jerk {jerk:g}"
            rows.append(Row(case, "speed_m_s", speed, "m/s", "measured", law))
    return rows


def _cost() -> list[Row]:
    """Milliseconds for a mission of 200 stops, 10 m apart."""
    places = np.array([[10.0 * (k % 20), 10.0 * (k // 20), 20.0] for k in range(200)])
    route = MissionRoute(places, np.zeros(len(places)), np.ones(len(places)))
    models: dict[str, Callable[[], object]] = {
        "ardupilot": partial(predict_ardupilot_mission, route, ArduPilotLaw(), Airframe()),
        "px4": partial(predict_px4_mission, route, Px4Law(), Airframe()),
    }
    rows = []
    for name, model in models.items():
        model()
        rows.append(Row(f"{name} 200 stops", "ms", milliseconds(model), "ms"))
    return rows


def leave_one_out(
    curve: RecordedCurve, flights: list[RecordedFlight], drags_1_s: tuple[float, ...], lags_s: tuple[float, ...]
) -> list[tuple[RecordedFlight, Airframe, FlownDeviation]]:
    """Predict each flight with the drag and the lag that fit the others best.

    Args:
        curve: what all of them flew.
        flights: of one autopilot.
        drags_1_s: drags to choose from.
        lags_s: lags to choose from.
    """
    airframes = [Airframe(drag, lag) for drag, lag in product(drags_1_s, lags_s)]
    found = [
        [deviation_from_curve(flight.predicted(curve, airframe), curve.position_m) for flight in flights]
        for airframe in airframes
    ]
    off = np.array(
        [[sum(m * m for m in misses(f, d)) for f, d in zip(flights, row, strict=True)] for row in found]
    )  # (airframes, flights)
    chosen = [int(np.argmin(off.sum(axis=1) - off[:, k])) for k in range(len(flights))]
    return [(flight, airframes[a], found[a][k]) for k, (flight, a) in enumerate(zip(flights, chosen, strict=True))]


def misses(flight: RecordedFlight, found: FlownDeviation) -> tuple[float, float]:
    """How far time and largest deviation are off, as parts of what is allowed."""
    allowed = STREAM_DEVIATION if flight.stream else MISSION_DEVIATION
    return (
        relative_miss(found.time_s, flight.time_s, 0.0, TIME_SHARE),
        relative_miss(found.max_m, flight.max_deviation_m, *allowed),
    )
