"""What both kinds of simulated vehicle have in common: clocks, dispatch of messages, arming, streams, camera, gimbal.

A vehicle does no input or output of its own. It is handed messages and told how much time has passed, on its own clock
and on the wall's, and it sends through channels. Flight timers run on the vehicle's clock; link timers (mission
transfer, loss of the ground station) on wall time.
"""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from random import Random

from sitl_mocks.airframe import BODIES, Airframe, FlightLimits
from sitl_mocks.camera import Camera, CameraFolder
from sitl_mocks.channel import Channel
from sitl_mocks.commands import (
    ACCEPTED,
    DENIED,
    FORCE_ARM_MAGIC,
    UNSUPPORTED,
    Command,
    command_of_message,
)
from sitl_mocks.dialect import AUTOPILOT_COMPONENT, CAMERA_COMPONENT, LIDAR_COMPONENT, Message, mavlink
from sitl_mocks.encounters import Encounters
from sitl_mocks.file_server import FileServer
from sitl_mocks.flight_control import FlightControl
from sitl_mocks.flight_kernel import STEP_S
from sitl_mocks.gimbal import Gimbal
from sitl_mocks.image_sender import ImageSender
from sitl_mocks.lidar import Lidar
from sitl_mocks.message_streams import MessageStreams
from sitl_mocks.mission_fault import MissionDoor
from sitl_mocks.mission_faults import make_faults
from sitl_mocks.mission_server import MissionServer
from sitl_mocks.obstacles import Obstacles
from sitl_mocks.parameters import ParameterServer
from sitl_mocks.picture import Exposure
from sitl_mocks.position_cascade import CascadeGains
from sitl_mocks.positioning import Positioning
from sitl_mocks.replanning import Replanner
from sitl_mocks.routing import Router
from sitl_mocks.scene_frame import SceneFrame
from sitl_mocks.setpoints import Setpoint, setpoint_of_message
from sitl_mocks.signing import VehicleKey
from sitl_mocks.telemetry import Telemetry
from sitl_mocks.vehicle_options import Counters, VehicleOptions

LOGIC_STEPS = 5
LOGIC_S = LOGIC_STEPS * STEP_S

STANDBY, ACTIVE, CRITICAL = 3, 4, 5


class SimulatedVehicle(ABC):
    """One vehicle.

    Args:
        options: how it is set up.
    """

    kind: str
    autopilot: int
    capabilities: int
    software_version: int
    gps_fix = 3
    fix_texts: tuple[str, str]
    """What it says when its receiver has lost its fix, and when it has it again."""
    ready_after_s: float
    """Wall time from the start until it can be armed."""
    real_ready_after_s: float
    """The same of the real one."""
    announces_captures = True
    """Whether the camera component tells of its files."""
    unknown_stream_result = DENIED
    """Its answer when a rate is asked for of a message that it does not have."""

    def __init__(self, options: VehicleOptions) -> None:
        self.options = options
        self.system_id = options.system_id
        self.uid = options.uid
        if options.real_start:
            self.ready_after_s = self.real_ready_after_s
        self.frame = SceneFrame(options.anchor, options.home)
        self.home = options.home
        self.home_m = self.frame.origin_m.copy()
        self.parameters = self._make_parameters()
        for name, value in options.parameters:
            self.parameters.override(name, value)
        self._speed_overrides: dict[int, float] = {}
        self._prepare()
        self.airframe = Airframe(
            self.home_m,
            self.base_limits(),
            wind_m_s=options.wind_m_s,
            gust_m_s=options.gust_m_s,
            seed=options.seed,
            parameters=BODIES[options.body],
            battery_wh=options.battery_wh,
            cascade=self.setpoint_gains(),
        )
        self.positioning = Positioning(self, options.hidden, options.seed) if options.hidden else None
        self.flight = FlightControl(self.airframe, self.base_limits)
        self.gimbal = Gimbal()
        self.folder = CameraFolder()
        self.camera = Camera(
            expose=self._expose,
            draw=options.draw,
            folder=self.folder,
            boot_ms=lambda: self.boot_ms,
            announce=self._announce_picture,
            taken=self._picture_taken,
            tells_files=options.serves_pictures,
        )
        self.image_sender = ImageSender(self.camera.newest_file)
        self.files = FileServer(self.folder)
        self.telemetry = Telemetry(self, options.seed)
        self.missions = self._make_mission_server()
        self._mission_door = MissionDoor(
            self.missions, make_faults(options.faults, self.missions, Random(options.seed))
        )
        self.autopilot_files = self._make_autopilot_files()
        self.replanner = Replanner(self, enabled=options.replan, boot_id=int.from_bytes(os.urandom(4), "little"))
        obstacles = Obstacles(options.obstacles)
        self.encounters = Encounters(obstacles)
        self.lidar = Lidar(self.airframe, obstacles, options.lidar, self._tell_companion)
        self._router = Router(self.system_id, (AUTOPILOT_COMPONENT, CAMERA_COMPONENT, LIDAR_COMPONENT))
        self.channels: list[Channel] = []
        self.signing_key = VehicleKey()
        self.counters = Counters()
        self.time_s = 0.0
        self.wall_s = 0.0
        self._start_wall_s: float | None = None
        self._debt_s = 0.0
        self.armed = False
        self._station_heard_s: float | None = None
        self.station_lost = False
        self.streams = MessageStreams(self)
        self._commands = self._command_table()

    # What differs ----------------------------------------------------------------------------------------------------

    @abstractmethod
    def _make_parameters(self) -> ParameterServer: ...

    @abstractmethod
    def _prepare(self) -> None:
        """Set up what the kind of vehicle needs; the parameters exist by then, the rest does not."""

    @abstractmethod
    def _make_mission_server(self) -> MissionServer: ...

    @abstractmethod
    def _make_autopilot_files(self) -> FileServer: ...

    @abstractmethod
    def base_limits(self) -> FlightLimits:
        """Limits of the position modes from the parameters."""

    @abstractmethod
    def setpoint_gains(self) -> CascadeGains:
        """Gains from the parameters, by which it flies setpoints."""

    @abstractmethod
    def heartbeat(self) -> Message:
        """HEARTBEAT of the autopilot."""

    @abstractmethod
    def default_streams(self) -> dict[int, float]:
        """Message id -> rate (Hz) of what is sent without being asked for."""

    @abstractmethod
    def mission_current(self) -> tuple[int, int, int, int]:
        """Fields of MISSION_CURRENT: sequence, total, state, mode."""

    @abstractmethod
    def mode_name(self) -> str:
        """Name of the present mode."""

    @abstractmethod
    def set_mode_by_name(self, name: str) -> bool:
        """What a pilot's switch does; False for a mode that does not exist."""

    @abstractmethod
    def flight_item(self) -> int:
        """Sequence of the mission item that is being flown to, -1 when none is."""

    @abstractmethod
    def follows_plan(self) -> bool:
        """Whether it flies a mission or a stream of setpoints."""

    @abstractmethod
    def _tick(self) -> None:
        """Modes, tasks, missions and flight failsafes, every `LOGIC_S` of the vehicle's clock."""

    @abstractmethod
    def _arming_refusal(self) -> str | None:
        """Why it cannot be armed now; None if it can."""

    @abstractmethod
    def _arming_refused_result(self) -> int: ...

    @abstractmethod
    def _after_disarm(self) -> None: ...

    @abstractmethod
    def _set_mode(self, base_mode: int, custom_mode: int, sub_mode: int, channel: Channel) -> int:
        """DO_SET_MODE."""

    @abstractmethod
    def _take_setpoint(self, setpoint: Setpoint) -> None: ...

    @abstractmethod
    def _station_loss_timeout_s(self) -> float:
        """Wall time without a ground station after which it counts as lost."""

    @abstractmethod
    def _on_station_lost(self) -> None: ...

    # Clocks ----------------------------------------------------------------------------------------------------------

    @property
    def boot_ms(self) -> int:
        """The vehicle's clock in milliseconds."""
        return round(self.time_s * 1e3) % 2**32

    @property
    def unix_s(self) -> float:
        """UTC as the vehicle counts it."""
        return self.options.unix_start_s + self.time_s

    @property
    def up_s(self) -> float:
        """Wall time since the start."""
        return 0.0 if self._start_wall_s is None else self.wall_s - self._start_wall_s

    def step(self, dt_s: float, wall_s: float) -> None:
        """Let time pass.

        Args:
            dt_s: on the vehicle's clock.
            wall_s: the wall's clock now (monotonic).
        """
        if self._start_wall_s is None:
            self._start_wall_s = wall_s
        self.wall_s = wall_s
        self._debt_s += dt_s
        while self._debt_s >= LOGIC_S - 1e-9:
            self._debt_s -= LOGIC_S
            self.encounters.fly(self.airframe, LOGIC_STEPS, self.time_s, watched=self.in_air)
            self.time_s += LOGIC_S
            if self.positioning is not None:
                self.positioning.tick(LOGIC_S)
            self.gimbal.step(LOGIC_S)
            self.flight.watch_ground(LOGIC_S)
            self._tick()
            self.replanner.tick(LOGIC_S)
            self.camera.step(self.time_s, self.airframe.true_position_m)
            self.lidar.tick(self.time_s)
        self.parameters.step(wall_s)
        self.missions.step(wall_s)
        self._mission_door.step(wall_s)
        self.files.step()
        self.autopilot_files.step()
        self.image_sender.step()
        self.replanner.resend(wall_s)
        self._watch_station(wall_s)
        self.streams.send_due(wall_s)

    def _watch_station(self, wall_s: float) -> None:
        if self._station_heard_s is None:
            return
        lost = wall_s - self._station_heard_s > self._station_loss_timeout_s()
        if lost and not self.station_lost:
            self.station_lost = True
            self._on_station_lost()

    # Links -----------------------------------------------------------------------------------------------------------

    def add_channel(self, channel: Channel) -> None:
        """Send on a link from now on."""
        self.streams.begin(channel)
        self.signing_key.apply(channel.signing)
        self.channels.append(channel)

    def remove_channel(self, channel: Channel) -> None:
        """A link is gone."""
        if channel in self.channels:
            self.channels.remove(channel)
            self._router.forget(channel)

    def broadcast(self, message: Message | None, component: int = AUTOPILOT_COMPONENT) -> None:
        """Send to everybody."""
        if message is not None:
            for channel in self.channels:
                channel.send(message, component)

    def _tell_companion(self, message: Message) -> None:
        for channel in self.channels:
            if channel.leads_to_companion:
                channel.send(message, LIDAR_COMPONENT)

    def say(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT to those who hear such."""
        for channel in self.channels:
            if self._hears_texts(channel):
                channel.send(mavlink.MAVLink_statustext_message(severity, text.encode()[:50]), AUTOPILOT_COMPONENT)

    def _hears_texts(self, channel: Channel) -> bool:
        del channel
        return True

    # Messages in -----------------------------------------------------------------------------------------------------

    def handle(self, message: Message, channel: Channel) -> None:
        """Take a message that came in on a link."""
        if self._router.is_own(message):
            return
        self._router.pass_on(message, channel, self.channels)
        if not self._router.is_for_vehicle(message):
            return
        kind = message.get_type()
        component = getattr(message, "target_component", 0)
        if kind == "HEARTBEAT":
            if message.type == mavlink.MAV_TYPE_GCS:
                channel.peer_is_station = True
                if self._counts_as_station(message):
                    self._station_heard_s = self.wall_s
                    self.station_lost = False
        elif kind == "FILE_TRANSFER_PROTOCOL":
            if component == CAMERA_COMPONENT and self.options.serves_pictures:
                self.files.handle(message, lambda m: channel.send(m, CAMERA_COMPONENT))
            elif component == AUTOPILOT_COMPONENT:
                self.autopilot_files.handle(message, lambda m: channel.send(m, AUTOPILOT_COMPONENT))
        elif kind == "DATA_TRANSMISSION_HANDSHAKE":
            if not self.options.serves_pictures:
                self.image_sender.handle(message, lambda m: channel.send(m, CAMERA_COMPONENT), channel)
        elif kind == "SETUP_SIGNING":
            if not self.armed:
                self.signing_key.set_up(message)
                for each in self.channels:
                    self.signing_key.apply(each.signing)
        elif kind in {"COMMAND_LONG", "COMMAND_INT"}:
            self._handle_command(message, channel, component)
        elif kind == "TIMESYNC":
            if message.tc1 == 0:
                now_ns = round(self.time_s * 1e9)
                channel.send(mavlink.MAVLink_timesync_message(now_ns, message.ts1), AUTOPILOT_COMPONENT)
        elif kind == "TUNNEL":
            self.replanner.handle(message, lambda m: channel.send(m, AUTOPILOT_COMPONENT))
        elif component in {0, AUTOPILOT_COMPONENT}:
            self._handle_autopilot(kind, message, channel)

    def _counts_as_station(self, message: Message) -> bool:
        del message
        return True

    def _handle_autopilot(self, kind: str, message: Message, channel: Channel) -> None:
        def send(reply: Message, component: int = AUTOPILOT_COMPONENT, system_id: int | None = None) -> None:
            channel.send(reply, component, system_id)

        if self._mission_door.handle(message, send, self.wall_s) or self.parameters.handle(message, send, channel):
            return
        if self.positioning is not None and self.positioning.handle(message):
            return
        if kind == "SET_MODE":
            self._set_mode(message.base_mode, message.custom_mode, 0, channel)
        elif kind == "MISSION_SET_CURRENT":
            self._set_current_item(message.seq)
            self.broadcast(self.telemetry.build(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT))
        elif kind in {"SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"}:
            self.counters.setpoints += 1
            self.counters.last_setpoint_wall_s = self.wall_s
            setpoint = setpoint_of_message(message, self.frame, self.home)
            if setpoint is None:
                self.say(mavlink.MAV_SEVERITY_ERROR, "Setpoint refused: frame or mask not supported")
            else:
                self._take_setpoint(setpoint)
        elif kind == "REQUEST_DATA_STREAM":
            self._request_data_stream(message, channel)

    def _request_data_stream(self, message: Message, channel: Channel) -> None:
        """Old way to ask for groups of messages; by default unknown."""
        del message, channel

    def _handle_command(self, message: Message, channel: Channel, component: int) -> None:
        command = command_of_message(message)
        self.counters.commands[command.number] = self.counters.commands.get(command.number, 0) + 1
        if component == CAMERA_COMPONENT:

            def reply(message: Message) -> None:
                channel.send(message, CAMERA_COMPONENT)

            answering, result = CAMERA_COMPONENT, self.camera.run_command(command, self.time_s, reply)
        elif component in {0, AUTOPILOT_COMPONENT}:
            answering = AUTOPILOT_COMPONENT
            handler = self._commands.get(command.number)
            result = UNSUPPORTED if handler is None else handler(command, channel)
        else:
            return
        self.acknowledge(command, result, channel, answering)

    @staticmethod
    def acknowledge(command: Command, result: int, channel: Channel, component: int = AUTOPILOT_COMPONENT) -> None:
        """Send a COMMAND_ACK."""
        channel.send(mavlink.MAVLink_command_ack_message(command.number, result, 0, 0, *command.sender), component)

    # Commands --------------------------------------------------------------------------------------------------------

    def _command_table(self) -> dict[int, Callable[[Command, Channel], int]]:
        m = mavlink
        return {
            m.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            **self.streams.commands(),
            m.MAV_CMD_DO_SET_MODE: lambda c, channel: self._set_mode(
                int(c.params[0]), int(c.params[1]), int(c.params[2]), channel
            ),
            m.MAV_CMD_DO_SET_MISSION_CURRENT: lambda c, _: (
                ACCEPTED if self._set_current_item(int(c.params[0])) else DENIED
            ),
            m.MAV_CMD_DO_CHANGE_SPEED: lambda c, _: self.change_speed(c),
            m.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: lambda c, _: self.point_gimbal(c),
            m.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: lambda _c, _: ACCEPTED,
            m.MAV_CMD_DO_MOUNT_CONTROL: lambda c, _: self.point_gimbal(c),
        }

    @abstractmethod
    def _set_current_item(self, sequence: int) -> bool:
        """Make a mission item the next one."""

    def _arm_disarm(self, command: Command, channel: Channel) -> int:
        del channel
        forced = command.params[1] == FORCE_ARM_MAGIC
        self.counters.forced_arms += forced and command.params[0] == 1.0
        if command.params[0] == 1.0:
            if self.armed:
                return ACCEPTED
            refusal = None if forced else self._arming_refusal()
            if refusal is not None:
                self.say(mavlink.MAV_SEVERITY_CRITICAL, refusal)
                return self._arming_refused_result()
            self.arm()
            return ACCEPTED
        if self.armed and not self.flight.landed and not forced:
            return self._arming_refused_result()
        if self.armed:
            self.disarm("Disarmed by external command")
        return ACCEPTED

    def arm(self) -> None:
        """Start a flight: home is here, the motors may run."""
        self.armed = True
        self.flight.landed = True
        self.camera.begin_flight()
        self.home_m = self.airframe.position_m
        self.home = self.frame.geo(self.home_m)
        self.flight.refresh_limits()

    def disarm(self, text: str) -> None:
        """End a flight."""
        self.armed = False
        self._speed_overrides.clear()
        self.flight.reset()
        self.say(mavlink.MAV_SEVERITY_INFO, text)
        self._after_disarm()

    def change_speed(self, command: Command) -> int:
        """DO_CHANGE_SPEED: 0 and 1 along the ground, 2 climb, 3 descent, in m/s; until the end of the flight."""
        kind, speed = int(command.params[0]), command.params[1]
        if not math.isfinite(speed) or kind not in {0, 1, 2, 3}:
            return DENIED
        if speed > 0.0:
            self._speed_overrides[max(kind, 1)] = speed
            self.flight.refresh_limits()
        return ACCEPTED

    def point_gimbal(self, command: Command) -> int:
        """DO_GIMBAL_MANAGER_PITCHYAW and DO_MOUNT_CONTROL: pitch in degrees; NaN leaves it as it is."""
        self.gimbal.point(math.radians(command.params[0]))
        return ACCEPTED

    # Flight ----------------------------------------------------------------------------------------------------------

    @property
    def has_position(self) -> bool:
        """Whether the estimator has a position."""
        return self.up_s >= 0.5 * self.ready_after_s

    @property
    def hears_satellites(self) -> bool:
        """Whether its own receiver has a fix."""
        return self.has_position and (self.positioning is None or not self.positioning.blocked)

    @property
    def ready_to_arm(self) -> bool:
        """Whether the checks before arming pass in the present mode."""
        return self.armed or self._arming_refusal() is None

    @property
    def in_air(self) -> bool:
        """Whether it has left the ground."""
        return self.armed and not self.flight.landed

    def override_speed(self, kind: int, default_m_s: float, most_m_s: float = math.inf) -> float:
        """A speed that DO_CHANGE_SPEED may have changed, within the autopilot's own limit."""
        return min(self._speed_overrides.get(kind, default_m_s), most_m_s)

    # Camera ----------------------------------------------------------------------------------------------------------

    def _expose(self, index: int, sequence: int) -> Exposure:
        return Exposure(
            index=index,
            sequence=sequence,
            position_m=self.airframe.true_position_m,
            place=self.frame.geo(self.airframe.position_m),
            home_altitude_m=self.home.altitude_m,
            yaw_rad=self.airframe.yaw_rad,
            pitch_rad=self.gimbal.pitch_rad,
            roll_rad=self.airframe.roll_pitch_rad[0],
            boot_s=self.time_s,
            unix_s=self.unix_s,
        )

    def camera_command(self, command: Command) -> int:
        """What the autopilot itself passes on to its camera."""
        return self.camera.run_command(command, self.time_s, lambda _: None)

    def _picture_taken(self, exposure: Exposure) -> None:
        """Told at each exposure."""
        del exposure

    def _announce_picture(self, message: Message | None) -> None:
        if self.announces_captures:
            self.broadcast(message, CAMERA_COMPONENT)
