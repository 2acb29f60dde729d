"""Flights under a crane's beam, where no satellites are received, with and without another vehicle that looks on.

Two simulated vehicles on fake time; the station's side is what runs in flight, on that time.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import LinkError
from gcs.core.frames import GeoPoint, rigid_between
from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.core.vehicle import Autopilot, VehicleIdentity
from gcs.mavlink.autopilots.base import CommandCall
from gcs.mavlink.command_protocol import command_long
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.external_position import external_position_lag
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.message_rates import RATES_HZ, interval_call
from gcs.mavlink.offboard import Setpoint, setpoint_message
from gcs.mavlink.vehicle import Vehicle
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.paths.path_search import find_path
from gcs.planning.trajectories.trajectory_builder import build_trajectory
from gcs.services.benchmarks.lockstep_worlds import STATION, LockstepWorlds, Order
from gcs.services.sighted_flight import SightedFlight
from gcs.storage.mesh_files import load_structure, sample_scenario

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.mavlink.dialect import Message

STOPS_M = ((-14.0, 0.0, 6.0), (-3.0, 0.0, 6.0), (3.0, 1.0, 8.0), (3.0, -1.0, 5.0), (14.0, 0.0, 6.0))
"""Under the portal of the sample gantry crane and out on its other side."""

HIDDEN_M = ((-7.0, -7.0, 0.0), (7.0, 7.0, 12.2))
"""Below the portal's beams."""

OBSERVER_M = (0.0, -24.0, 9.0)
SETTINGS = {
    "px4": {"EKF2_EV_CTRL": 3.0, "EKF2_EV_DELAY": 0.0},
    "ardupilot": {"GPS2_TYPE": 14.0, "GPS_AUTO_SWITCH": 1.0, "GPS2_DELAY_MS": 0.0},
}
OFFBOARD_MODE = {"px4": 6.0, "ardupilot": 4.0}
SPEED_M_S, ACCELERATION_M_S2 = 2.0, 1.0
"""Slower than in the open."""

INSPECTOR, OBSERVER = 1, 2
STREAM_S = 0.05
SETTLE_S = 3.0
LOSS = 0.05
"""Of packets, each way."""

TRIES = 4
"""How often what must get through is said."""


@dataclass(frozen=True)
class FlownUnderBeam:
    """What came of a flight.

    Attributes:
        deviation_m: largest distance from where the plan has the vehicle at that time.
        cross_track_m: largest distance from the plan's curve.
        estimate_m: largest error of what the vehicle took its position to be.
        told: how many positions it was sent.
        said: what the operator was told.
        mode: that it ended in.
    """

    deviation_m: float
    cross_track_m: float
    estimate_m: float
    told: int
    said: tuple[str, ...]
    mode: str


def beam_plan() -> tuple[PiecewisePolynomial, GeoPoint, float]:
    """A trajectory under the sample gantry crane's portal, the scene's anchor, and the corridor's half width (m)."""
    scenario = parse_scenario(sample_scenario("gantry-crane"))
    slow = scenario.vehicle.model_copy(update={"max_speed_m_s": SPEED_M_S, "max_acceleration_m_s2": ACCELERATION_M_S2})
    scenario = scenario.model_copy(update={"vehicle": slow})
    structure, _ = load_structure(scenario.structure, Path())
    scene = prepare_scene(scenario, structure, SilentProgress())
    stops = np.array(STOPS_M)
    legs = [find_path(scene.space, a, b) for a, b in itertools.pairwise(stops)]
    views = np.zeros(len(stops) - 2)
    built = build_trajectory(legs, views, views, scenario, SilentProgress(), space=scene.space)
    anchor = scenario.anchor
    place = GeoPoint(anchor.latitude_deg, anchor.longitude_deg, anchor.altitude_m)
    return built.trajectory, place, scenario.safety.corridor_half_width_m


class Flight:
    """The station's side of one flight.

    Args:
        number: of the world.
        autopilot: px4 or ardupilot.
        seed: of all that is left to chance.
        sighted: whether the observer's sightings are used.
        plan: what is flown, and its anchor.
    """

    def __init__(
        self, number: int, autopilot: str, seed: int, *, sighted: bool, plan: tuple[PiecewisePolynomial, GeoPoint]
    ) -> None:
        self._number = number
        self._autopilot = autopilot
        self._seed = seed
        self._trajectory, self._anchor = plan
        self._packer = FramePacker(*STATION)
        self._outbox: list[str] = []
        self._told = 0
        self._said: list[str] = []
        self.now_s = 0.0
        self._vehicles = {system: self._vehicle(system) for system in (INSPECTOR, OBSERVER)}
        self._positioning: SightedFlight | None = None
        if sighted:
            inspector, observer = self._vehicles[INSPECTOR], self._vehicles[OBSERVER]
            self._positioning = SightedFlight(observer, inspector, self._said.append, lambda: self.now_s)
            self._positioning.lag_s = external_position_lag(Autopilot(autopilot), SETTINGS[autopilot])

    async def fly(self) -> FlownUnderBeam:
        """Fly the plan."""
        anchor = self._anchor
        spec = {
            "autopilot": self._autopilot,
            "anchor": (anchor.latitude_deg, anchor.longitude_deg, anchor.altitude_m),
            "inspector_m": STOPS_M[0],
            "observer_m": OBSERVER_M,
            "hidden": [HIDDEN_M],
            "seed": self._seed,
            "parameters": list(SETTINGS[self._autopilot].items()),
            "loss": LOSS,
        }
        await Order("open-cooperative", self._number, spec)
        for _ in range(TRIES):
            for vehicle in self._vehicles.values():
                target = vehicle.identity.system_id, 1
                for message, rate_hz in RATES_HZ.items():
                    self._send(command_long(interval_call(message, rate_hz), target, 0))
            await self._pass(self.now_s + 1.0)
        begin_s = self.now_s + 1.0
        flags = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        mode = CommandCall(mavlink.MAV_CMD_DO_SET_MODE, (flags, OFFBOARD_MODE[self._autopilot]))
        for _ in range(TRIES):
            await self._stream(begin_s, self.now_s + 1.0 / TRIES)
            self._send(command_long(mode, (INSPECTOR, 1), 0))
        await self._stream(begin_s, begin_s + self._trajectory.duration_s + SETTLE_S)
        truth = await Order("truth", self._number, None)
        return self._flown(np.array(truth["track"]), str(truth["mode"]), begin_s)

    async def _stream(self, plan_begins_s: float, until_s: float) -> None:
        """Send the plan's setpoints."""
        vehicle = self._vehicles[INSPECTOR]
        origin = vehicle.telemetry.origin
        if origin is None:
            raise LinkError("it does not tell its origin", field=vehicle.identity.name)
        rotation, shift = rigid_between(self._anchor, origin.value)
        while self.now_s < until_s - 1e-9:
            at = np.clip([self.now_s - plan_begins_s], 0.0, self._trajectory.duration_s)
            position, velocity, acceleration = (self._trajectory.value(at, k)[0] for k in range(3))
            point = Setpoint(rotation @ position + shift, rotation @ velocity, rotation @ acceleration, 0.0)
            self._send(setpoint_message(point, self.now_s, (INSPECTOR, 1)))
            await self._pass(self.now_s + STREAM_S)

    async def _pass(self, until_s: float) -> None:
        """Let time pass, and take what is heard."""
        outbox, self._outbox = self._outbox, []
        self.now_s, packets = await Order("pass", self._number, until_s, outbox)
        for packet in packets:
            for message in FrameParser().feed(bytes.fromhex(packet)):
                self._vehicles[message.get_srcSystem()].handle(message, self.now_s)
                if self._positioning is not None:
                    self._positioning.watch()
                    if message.get_srcSystem() == OBSERVER:
                        self._positioning.take(message)
        for vehicle in self._vehicles.values():
            vehicle.on_time()

    def _vehicle(self, system: int) -> Vehicle:
        identity = VehicleIdentity(system, 1, Autopilot(self._autopilot), int(mavlink.MAV_TYPE_QUADROTOR))
        return Vehicle(identity, VehicleChannel((system, 1), STATION, self._send, lambda: self.now_s))

    def _send(self, message: Message) -> None:
        self._told += message.get_type() in {"GPS_INPUT", "VISION_POSITION_ESTIMATE"}
        self._outbox.append(self._packer.pack(message).hex())

    def _flown(self, track: NDArray[np.float64], mode: str, begin_s: float) -> FlownUnderBeam:
        duration_s = self._trajectory.duration_s
        flying = track[(track[:, 0] >= begin_s) & (track[:, 0] <= begin_s + duration_s + SETTLE_S)]
        at = np.clip(flying[:, 0] - begin_s, 0.0, duration_s)
        curve = self._trajectory.value(np.linspace(0.0, duration_s, 4000), 0)
        true, believed = flying[:, 1:4], flying[:, 4:7]
        apart = np.linalg.norm(true[:, None] - curve[None], axis=2).min(axis=1)
        return FlownUnderBeam(
            float(np.linalg.norm(true - self._trajectory.value(at, 0), axis=1).max()),
            float(apart.max()),
            float(np.linalg.norm(believed - true, axis=1).max()),
            self._told,
            tuple(self._said),
            mode,
        )


def flights_under_beam(
    cases: Sequence[tuple[str, int, bool]], plan: tuple[PiecewisePolynomial, GeoPoint]
) -> list[FlownUnderBeam]:
    """Fly the plan several times.

    Args:
        cases: autopilot, seed, and whether the observer's sightings are used, of each flight.
        plan: what is flown, and its anchor.

    Returns:
        What came of each, in the order of the cases.
    """

    async def fly(number: int) -> tuple[int, FlownUnderBeam]:
        autopilot, seed, sighted = cases[number]
        return number, await Flight(number, autopilot, seed, sighted=sighted, plan=plan).fly()

    with LockstepWorlds() as worlds:
        flown = dict(worlds.run_all(fly(number) for number in range(len(cases))))
    return [flown[number] for number in range(len(cases))]
