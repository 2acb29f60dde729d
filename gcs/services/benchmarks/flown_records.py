"""Recorded flights of one smooth curve on both autopilots, and what was sent for each.

A folder of records has `ardupilot/dense` and `px4/dense`, each with `curve.csv` (50 Hz, about home) and `results.json`
(time and deviation of each flight). The missions and setpoints are made again from the curve as they were then.
"""

from __future__ import annotations

import csv
import json
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.errors import InputError
from gcs.core.flight_law import ArduPilotLaw, Px4Law
from gcs.core.vehicle import Autopilot
from gcs.planning.dynamics.ardupilot_mission import predict_ardupilot_mission
from gcs.planning.dynamics.predicted_flight import MissionRoute, SetpointStream
from gcs.planning.dynamics.px4_mission import predict_px4_mission
from gcs.planning.dynamics.setpoint_following import predict_ardupilot_stream, predict_px4_stream
from gcs.planning.trajectories.mission_sampling import farthest_chords

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from gcs.core.flight_law import Airframe, FlightLaw
    from gcs.planning.dynamics.predicted_flight import PredictedFlight

_STREAM_HZ = 20.0
_SPEED_M_S = 4.0
_DENSE_M = 0.02


@dataclass(frozen=True)
class RecordedFlight:
    """One recorded flight.

    Attributes:
        name: as in `results.json`.
        autopilot: who flew it.
        stream: setpoints, not a mission.
        law: what the vehicle was set to.
        time_s: how long it took from the curve's start to its end.
        max_deviation_m: largest distance from the curve.
        spacing_m: of a mission's waypoints along the curve; None where they were placed for a chord error.
        chord_error_m: see above.
        radius_m: acceptance radius of each waypoint; 0 for the vehicle's own.
        speed_m_s: that the mission commanded.
        stretch: the curve's times were multiplied by this.
        acceleration: accelerations were sent too.
        lead_s: how far ahead of its time each setpoint was sent.
        drag_forward_1_s: what was added to the acceleration for each speed.
        curved: spline waypoints.
    """

    name: str
    autopilot: Autopilot
    stream: bool
    law: FlightLaw
    time_s: float
    max_deviation_m: float
    spacing_m: float | None = None
    chord_error_m: float = 0.0
    radius_m: float = 0.0
    speed_m_s: float = _SPEED_M_S
    stretch: float = 1.0
    acceleration: bool = True
    lead_s: float = 0.0
    drag_forward_1_s: float = 0.0
    curved: bool = False

    def predicted(self, curve: RecordedCurve, airframe: Airframe) -> PredictedFlight:
        """What the models make of it."""
        if self.stream:
            stream = curve.setpoints(self.stretch, self.lead_s, self.drag_forward_1_s, acceleration=self.acceleration)
            if isinstance(self.law, Px4Law):
                return predict_px4_stream(stream, self.law, airframe)
            return predict_ardupilot_stream(stream, self.law, airframe)
        points = curve.spaced(self.spacing_m) if self.spacing_m else curve.with_chord_error(self.chord_error_m)
        speed = self.speed_m_s
        route = MissionRoute(
            points, np.full(len(points), self.radius_m), np.zeros(len(points)), speed, speed, speed, self.curved
        )
        if isinstance(self.law, Px4Law):
            return predict_px4_mission(route, self.law, airframe)
        return predict_ardupilot_mission(route, self.law, airframe)


@dataclass(frozen=True, eq=False)
class RecordedCurve:
    """The curve that was flown.

    Attributes:
        time_s: shape (K,).
        position_m: shape (K, 3); likewise the next two.
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    acceleration_m_s2: NDArray[np.float64]
    way_m: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        steps = np.linalg.norm(np.diff(self.position_m, axis=0), axis=1)
        object.__setattr__(self, "way_m", np.concatenate([[0.0], np.cumsum(steps)]))

    def spaced(self, spacing_m: float) -> NDArray[np.float64]:
        """Points at equal steps along the curve, both ends among them, shape (N, 3)."""
        return self._at(np.linspace(0.0, self.way_m[-1], round(self.way_m[-1] / spacing_m) + 1))

    def with_chord_error(self, chord_error_m: float) -> NDArray[np.float64]:
        """Points from each of which the next is as far as the chord error lets it, shape (N, 3)."""
        dense = self._at(np.append(np.arange(0.0, self.way_m[-1], _DENSE_M), self.way_m[-1]))
        return dense[farthest_chords(dense, chord_error_m)]

    def setpoints(self, stretch: float, lead_s: float, drag_1_s: float, *, acceleration: bool) -> SetpointStream:
        """What was sent, and five seconds more of its end."""
        times = np.arange(0.0, stretch * self.time_s[-1] + 5.0, 1.0 / _STREAM_HZ)
        at = np.clip((times + lead_s) / stretch, 0.0, self.time_s[-1])
        position, velocity, accelerations = (
            np.stack([np.interp(at, self.time_s, values[:, k]) for k in range(3)], axis=1)
            for values in (self.position_m, self.velocity_m_s, self.acceleration_m_s2)
        )
        velocity /= stretch
        forward = accelerations / stretch**2 + drag_1_s * velocity if acceleration else np.zeros_like(velocity)
        return SetpointStream(times, position, velocity, forward)

    def _at(self, way_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(way_m, self.way_m, self.position_m[:, k]) for k in range(3)], axis=1)


def read_curve(folder: Path) -> RecordedCurve:
    """Read `curve.csv`.

    Raises:
        InputError: it is not there or not such a table.
    """
    columns = ("t", "x_e", "y_n", "z_u", "vx", "vy", "vz", "ax", "ay", "az")
    try:
        with (folder / "curve.csv").open(encoding="utf-8", newline="") as file:
            rows = [[float(row[name]) for name in columns] for row in csv.DictReader(file)]
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"is not a recorded curve: {error}", field=str(folder / "curve.csv")) from error
    table = np.array(rows)
    return RecordedCurve(table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7:10])


def read_flights(records: Path, autopilot: Autopilot) -> list[RecordedFlight]:
    """The flights of an autopilot that were complete and without stock sensor noise.

    Raises:
        InputError: there are no such records.
    """
    path = records / autopilot.value / "dense" / "results.json"
    try:
        results: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if autopilot is Autopilot.PX4:
            return [_px4_flight(case) for case in results["cases"] if _counts(case)]
        return [_ardupilot_flight(name, entry) for name, entry in results.items() if entry.get("complete")]
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"is not a list of recorded flights: {error}", field=str(path)) from error


def _counts(case: Mapping[str, Any]) -> bool:
    """A mission that reached every item, or a stream; with low sensor noise."""
    whole = case["type"] == "offboard" or case["reached"] >= case["items"]
    return whole and "stock" not in case["noise"]


def _px4_flight(case: Mapping[str, Any]) -> RecordedFlight:
    settings, stream = case["settings"], case["type"] == "offboard"
    changed = settings.get("params", {})
    # Where the vertical limits were left alone, a flight's log never climbs faster than they say.
    raised = "zdefault" not in settings and (stream or "r" in settings)
    vertical: dict[str, Any] = {}
    if raised:
        vertical = {"climb_m_s": 4.0, "descent_m_s": 4.0, "max_climb_m_s": 5.0, "max_descent_m_s": 5.0}
    usual = Px4Law()
    law = Px4Law(
        **vertical,
        position_gain_s=changed.get("MPC_XY_P", usual.position_gain_s),
        velocity_gains_s=(changed.get("MPC_XY_VEL_P_ACC", usual.velocity_gains_s[0]), *usual.velocity_gains_s[1:]),
    )
    return RecordedFlight(
        name=case["case"],
        autopilot=Autopilot.PX4,
        stream=stream,
        law=law,
        time_s=case["flight_time"],
        max_deviation_m=case["ct_max"],
        spacing_m=settings.get("ds"),
        radius_m=settings.get("r", 0.0),
        lead_s=settings.get("lead", [0.0])[0],
        drag_forward_1_s=settings.get("drag", 0.0),
    )


def _ardupilot_flight(name: str, entry: Mapping[str, Any]) -> RecordedFlight:
    set_to, usual, cm = entry["par"], ArduPilotLaw(), 0.01
    law = ArduPilotLaw(
        climb_m_s=cm * set_to.get("WPNAV_SPEED_UP", usual.climb_m_s / cm),
        descent_m_s=cm * set_to.get("WPNAV_SPEED_DN", usual.descent_m_s / cm),
        vertical_acceleration_m_s2=cm * set_to.get("WPNAV_ACCEL_Z", usual.vertical_acceleration_m_s2 / cm),
        jerk_m_s3=set_to.get("WPNAV_JERK", usual.jerk_m_s3),
    )
    curved = "spline" in name
    if curved:
        # Set before the flight before it, and told by its log.
        law = ArduPilotLaw(climb_m_s=4.0, descent_m_s=4.0, vertical_acceleration_m_s2=2.5, jerk_m_s3=5.0)
    placed = "adapt" in name
    return RecordedFlight(
        name=name,
        autopilot=Autopilot.ARDUPILOT,
        stream=entry["kind"] == "guided",
        law=law,
        time_s=entry["T"],
        max_deviation_m=entry["dev_max"],
        spacing_m=None if placed else entry.get("spacing_median"),
        chord_error_m=float(name.split("adapt")[1]) if placed else 0.0,
        speed_m_s=2.0 if name.endswith("_v2") else _SPEED_M_S,
        stretch=float(name.split("slow")[1]) if "slow" in name else 1.0,
        acceleration="_pv_" not in name,
        curved=curved,
    )


def relative_miss(predicted: float, recorded: float, absolute: float, share: float) -> float:
    """How far a figure is off, as a part of what is allowed: an absolute difference, or a share if that is more."""
    return abs(predicted - recorded) / max(absolute, share * recorded) if recorded > 0 else math.inf
