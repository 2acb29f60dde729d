"""A vehicle that behaves like ArduPilot's copter: modes, arming, missions, guided flight, failsafes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import wrap_angle, yaw_from_heading
from sitl_mocks.airframe import FlightLimits
from sitl_mocks.ardupilot_failsafes import ArduPilotFailsafes
from sitl_mocks.ardupilot_files import ArduPilotFiles
from sitl_mocks.ardupilot_mission_run import ArduPilotMissionRun
from sitl_mocks.ardupilot_mission_server import ArduPilotMissionServer
from sitl_mocks.ardupilot_modes import Mode
from sitl_mocks.ardupilot_parameters import ARDUPILOT_PARAMETERS, mission_room
from sitl_mocks.camera import feedback_message
from sitl_mocks.channel import Channel
from sitl_mocks.commands import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Command
from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.fence_rally import ARDUPILOT_MISSION, with_room
from sitl_mocks.file_server import FileServer
from sitl_mocks.file_tree import FileTree
from sitl_mocks.flight_tasks import DescentProfile, Hold, Land, ReturnAlong
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.mission_server import MissionServer
from sitl_mocks.parameters import ParameterServer
from sitl_mocks.path_memory import PathMemory
from sitl_mocks.position_cascade import CascadeGains
from sitl_mocks.scene_frame import e7
from sitl_mocks.setpoints import Setpoint, lead_by_setpoint
from sitl_mocks.vehicle import ACTIVE, CRITICAL, LOGIC_S, STANDBY, SimulatedVehicle
from sitl_mocks.ways_home import ardupilot_return

if TYPE_CHECKING:
    from sitl_mocks.picture import Exposure


_WITHOUT_ARMING = {Mode.AUTO, Mode.RTL, Mode.LAND, Mode.BRAKE, Mode.SMART_RTL}
_NEEDS_POSITION = {Mode.AUTO, Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.POSHOLD, Mode.BRAKE, Mode.SMART_RTL}
_READY_WITHOUT_POSITION = 24 / 41
"""Share of the time until it is ready after which it can be armed in a mode that needs no position."""
_STORAGE_AFTER_S, _REAL_STORAGE_AFTER_S = 0.5, 2.0
"""Wall time until the mission storage has been opened, here and on the real one."""
_HOME_BELOW_ORIGIN_M = 0.02
"""The estimator's origin and home differ by so much in height, as on the real one."""

_ROOT = ("/.", "/..", "/terrain", "/@ROMFS", "/@SYS")
"""What it lists of its files."""
_CAMERA_COMMANDS = (
    mavlink.MAV_CMD_IMAGE_START_CAPTURE,
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
)

_DATA_STREAMS = {
    2: ("SYS_STATUS", "GPS_RAW_INT", "MISSION_CURRENT"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE",),
    11: ("VFR_HUD",),
    12: ("SYSTEM_TIME", "BATTERY_STATUS", "GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_STATUS"),
}


class ArduPilotVehicle(SimulatedVehicle):
    """ArduCopter-like."""

    kind = "ardupilot"
    autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    capabilities = 0xFBEF
    software_version = 0x04070000
    gps_fix = 6
    fix_texts = ("GPS Glitch or Compass error", "Glitch cleared")
    ready_after_s = 2.0
    real_ready_after_s = 41.0
    announces_captures = False
    unknown_stream_result = FAILED

    missions: ArduPilotMissionServer

    def _make_parameters(self) -> ParameterServer:
        table = dict(ARDUPILOT_PARAMETERS)
        table["SYSID_THISMAV"] = (self.options.system_id, table["SYSID_THISMAV"][1])
        return ParameterServer(table, bytewise=False, listed_per_s=2000.0, least=self.options.parameter_count)

    def _prepare(self) -> None:
        self.mode = Mode.STABILIZE
        self._failsafe: str | None = None
        self._position_told = False
        self._guided: Setpoint | None = None
        self._guided_s = -math.inf
        self._guided_idle = True
        self._mission_started = False
        self._failsafes = ArduPilotFailsafes(self)
        self._timesync_s = 0.0
        self._memory: PathMemory | None = None
        self.run = ArduPilotMissionRun(self)

    def _make_mission_server(self) -> MissionServer:
        return ArduPilotMissionServer(
            self.say,
            self.run.mission_changed,
            self._home_item,
            lambda: self._storage_is_open,
            with_room(ARDUPILOT_MISSION, self.options.mission_items or mission_room(self.parameters["BRD_SD_MISSION"])),
        )

    @property
    def _storage_is_open(self) -> bool:
        return self.up_s >= (_REAL_STORAGE_AFTER_S if self.options.real_start else _STORAGE_AFTER_S)

    def _make_autopilot_files(self) -> FileServer:
        files = ArduPilotFiles(lambda: self.parameters, self.missions.by_type)
        return FileServer(FileTree(folders=_ROOT), sessions=1, virtual=files)

    def _home_item(self) -> StoredItem:
        if not self.has_position:
            return StoredItem(0, 16, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0)
        home = self.home
        altitude = int(home.altitude_m * 100.0) / 100.0
        return StoredItem(0, 16, (0.0, 0.0, 0.0, 0.0), e7(home.latitude_deg), e7(home.longitude_deg), altitude)

    # Telemetry -------------------------------------------------------------------------------------------------------

    def default_streams(self) -> dict[int, float]:
        """Nothing but the heartbeat comes unasked (STATUSTEXT and TIMESYNC are no streams)."""
        return {mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0}

    def heartbeat(self) -> Message:
        """HEARTBEAT with ArduPilot's flags."""
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        flags |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if self.mode in {Mode.AUTO, Mode.GUIDED, Mode.RTL, Mode.LOITER, Mode.LAND, Mode.SMART_RTL}:
            flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        if self.armed:
            flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        status = STANDBY
        if self._failsafe is not None:
            status = CRITICAL
        elif self.in_air:
            status = ACTIVE
        elif not self._storage_is_open:
            status = 1
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, self.autopilot, flags, int(self.mode), status, 3
        )

    def mode_name(self) -> str:
        """See base class."""
        return self.mode.name

    def mission_current(self) -> tuple[int, int, int, int]:
        """See base class; home is not counted in the total."""
        if self.run.total == 0:
            return 0, 0, 1, 0
        mode = 1 if self.mode is Mode.AUTO else (2 if self.run.state == 4 else 0)
        return self.run.current, self.run.total, self.run.state, mode

    def flight_item(self) -> int:
        """See base class."""
        return self.run.current if self.mode is Mode.AUTO else -1

    def follows_plan(self) -> bool:
        """See base class."""
        return self.mode is Mode.AUTO or (self.mode is Mode.GUIDED and self._guided is not None)

    def say_info(self, text: str) -> None:
        """A STATUSTEXT for information."""
        self.say(mavlink.MAV_SEVERITY_INFO, text)

    def say_critical(self, text: str) -> None:
        """A STATUSTEXT that matters."""
        self.say(mavlink.MAV_SEVERITY_CRITICAL, text)

    def tell_item_reached(self, sequence: int) -> None:
        """MISSION_ITEM_REACHED."""
        self.broadcast(mavlink.MAVLink_mission_item_reached_message(sequence))

    def _request_data_stream(self, message: Message, channel: Channel) -> None:
        groups = (
            _DATA_STREAMS.values() if message.req_stream_id == 0 else [_DATA_STREAMS.get(message.req_stream_id, ())]
        )
        for name in (name for group in groups for name in group):
            message_id = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
            self.streams.set_rate(channel, message_id, message.req_message_rate if message.start_stop else 0.0)

    def _picture_taken(self, exposure: Exposure) -> None:
        self.broadcast(feedback_message(exposure, len(self.camera.shots)))

    # Limits ----------------------------------------------------------------------------------------------------------

    def base_limits(self) -> FlightLimits:
        """GUIDED setpoints are not held to the vertical limits; a plan has to see to that itself."""
        p = self.parameters
        return FlightLimits(
            horizontal_m_s=self.override_speed(1, p["WPNAV_SPEED"] * 0.01),
            climb_m_s=self.override_speed(2, p["WPNAV_SPEED_UP"] * 0.01),
            descent_m_s=self.override_speed(3, p["WPNAV_SPEED_DN"] * 0.01),
            acceleration_m_s2=p["WPNAV_ACCEL"] * 0.01,
            vertical_acceleration_m_s2=p["WPNAV_ACCEL_Z"] * 0.01,
            jerk_m_s3=p["WPNAV_JERK"],
            extrapolates_setpoints=True,
        )

    def setpoint_gains(self) -> CascadeGains:
        """See base class."""
        return CascadeGains.of_ardupilot(self.parameters)

    def descent(self) -> DescentProfile:
        """How it comes down."""
        return DescentProfile(self.parameters["LAND_ALT_LOW"] * 0.01, self.parameters["LAND_SPEED"] * 0.01)

    # Commands --------------------------------------------------------------------------------------------------------

    def _command_table(self) -> dict[int, Callable[[Command, Channel], int]]:
        m = mavlink
        return {
            **super()._command_table(),
            m.MAV_CMD_NAV_TAKEOFF: lambda c, _: self._command_take_off(c),
            m.MAV_CMD_NAV_LAND: lambda _c, _: self._command_mode(Mode.LAND),
            m.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _c, _: self._command_mode(Mode.RTL),
            m.MAV_CMD_NAV_LOITER_UNLIM: lambda _c, _: self._command_mode(Mode.LOITER),
            m.MAV_CMD_MISSION_START: lambda _c, _: self._mission_start(),
            m.MAV_CMD_DO_PAUSE_CONTINUE: lambda c, _: self._pause_continue(c),
            m.MAV_CMD_DO_REPOSITION: lambda c, _: self._reposition(c),
            m.MAV_CMD_CONDITION_YAW: lambda c, _: self._condition_yaw(c),
            m.MAV_CMD_DO_DIGICAM_CONTROL: lambda c, _: self._digicam(c),
            **dict.fromkeys(_CAMERA_COMMANDS, lambda c, _: self.camera_command(c)),
        }

    def _set_mode(self, base_mode: int, custom_mode: int, sub_mode: int, channel: Channel) -> int:
        del sub_mode, channel
        if not base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED or custom_mode not in set(Mode):
            return UNSUPPORTED
        return self._command_mode(Mode(custom_mode))

    def _command_mode(self, mode: Mode) -> int:
        if mode in _NEEDS_POSITION and not self.has_position and mode is not Mode.GUIDED:
            self.say_critical(f"Mode change to {mode.name} failed: requires position")
            return FAILED
        if mode is Mode.AUTO and self.run.total == 0:
            self.say_critical("Mode change to AUTO failed: init failed")
            return FAILED
        if mode is Mode.SMART_RTL and not self.can_retrace:
            self.say_critical("Mode change to SMART_RTL failed: init failed")
            return FAILED
        self._failsafe = None
        self._enter(mode)
        return ACCEPTED

    def set_mode_by_name(self, name: str) -> bool:
        """See base class."""
        known = {mode.name: mode for mode in Mode}
        return name.upper() in known and self._command_mode(known[name.upper()]) == ACCEPTED

    def _command_take_off(self, command: Command) -> int:
        if self.mode is not Mode.GUIDED or not self.armed or not self.flight.landed:
            return FAILED
        height = command.params[6]
        if not math.isfinite(height) or height <= 0.0:
            return FAILED
        self._guided = None
        self._guided_idle = False
        self.flight.take_off_to(float(self.home_m[2]) + height)
        return ACCEPTED

    def _mission_start(self) -> int:
        if self.mode not in {Mode.AUTO, Mode.GUIDED} or not self.armed or self.run.total == 0:
            return DENIED
        if self.mode is not Mode.AUTO:
            self._enter(Mode.AUTO)
        if not self._mission_started:
            self._mission_started = True
            self.run.start_or_resume()
        return ACCEPTED

    def _pause_continue(self, command: Command) -> int:
        if self.mode is not Mode.AUTO or not self.armed:
            return DENIED
        if command.params[0] == 0.0:
            self.run.pause()
            self.flight.hold()
        else:
            self.run.go_on()
        self.broadcast(self.telemetry.build(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT))
        return ACCEPTED

    def _reposition(self, command: Command) -> int:
        if not self.in_air or not command.place_is_given or (self.mode is not Mode.GUIDED and command.params[1] != 1):
            return DENIED
        self._command_mode(Mode.GUIDED)
        latitude, longitude, altitude = command.params[4:7]
        if command.frame in {3, 6}:
            altitude += self.home.altitude_m
        self._guided_idle = False
        self.flight.fly_to(self.frame.scene(latitude, longitude, altitude))
        return ACCEPTED

    def _condition_yaw(self, command: Command) -> int:
        if self.mode is not Mode.GUIDED or not self.in_air:
            return FAILED
        angle = math.radians(command.params[0])
        yaw = yaw_from_heading(angle)
        if command.params[3] == 1.0:
            yaw = wrap_angle(self.airframe.yaw_rad - math.copysign(1.0, command.params[2] or 1.0) * angle)
        self.airframe.turn_to(yaw)
        return ACCEPTED

    def _digicam(self, command: Command) -> int:
        if not self.parameters["CAM1_TYPE"]:
            return FAILED
        if command.params[4] == 1.0:
            self.camera.take()
        return ACCEPTED

    def camera_command(self, command: Command) -> int:
        """See base class; without a camera the items of a mission pass silently."""
        return super().camera_command(command) if self.parameters["CAM1_TYPE"] else FAILED

    def point_gimbal(self, command: Command) -> int:
        """See base class; the same without a gimbal."""
        return super().point_gimbal(command) if self.parameters["MNT1_TYPE"] else FAILED

    def run_mission_command(self, command: Command) -> None:
        """What a do command of the mission does."""
        m = mavlink
        if command.number == m.MAV_CMD_DO_CHANGE_SPEED:
            self.change_speed(command)
        elif command.number in {m.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, m.MAV_CMD_DO_MOUNT_CONTROL}:
            self.point_gimbal(command)
        elif command.number == m.MAV_CMD_DO_DIGICAM_CONTROL:
            self._digicam(command)
        elif command.number in _CAMERA_COMMANDS:
            self.camera_command(command)

    def _set_current_item(self, sequence: int) -> bool:
        return self.run.set_current(sequence)

    # Arming ----------------------------------------------------------------------------------------------------------

    def _arming_refusal(self) -> str | None:
        share = 1.0 if self.mode in _NEEDS_POSITION else _READY_WITHOUT_POSITION
        if self.up_s < share * self.ready_after_s:
            return "PreArm: Need Position Estimate"
        if self.mode in _WITHOUT_ARMING:
            return f"Arm: {self.mode.name} mode not armable"
        return None

    def _arming_refused_result(self) -> int:
        return FAILED

    def arm(self) -> None:
        """See base class."""
        super().arm()
        self.home_m = self.home_m - np.array([0.0, 0.0, _HOME_BELOW_ORIGIN_M])
        self.home = self.frame.geo(self.home_m)
        self._failsafes.reset()
        self._guided = None
        self._guided_idle = True
        self._mission_started = False
        self._memory = PathMemory(self.home_m, self.parameters["SRTL_ACCURACY"], int(self.parameters["SRTL_POINTS"]))
        self.say_info("Arming motors")
        self.broadcast(self.telemetry.build(mavlink.MAVLINK_MSG_ID_HOME_POSITION))

    def disarm(self, text: str) -> None:
        """See base class."""
        super().disarm("Disarming motors" if text.startswith("Disarmed by landing") else text)

    def _after_disarm(self) -> None:
        self._failsafe = None
        self._guided = None
        self.run.reset()

    # Modes -----------------------------------------------------------------------------------------------------------

    def _enter(self, mode: Mode) -> None:
        if self.mode is Mode.AUTO and mode is not Mode.AUTO:
            self.run.leave()
        if mode is not self.mode:
            self.counters.interrupted()
        self.mode = mode
        self._guided = None
        self._guided_idle = True
        self.flight.refresh_limits()
        self.airframe.set_cascade(self.setpoint_gains())
        self.broadcast(self.heartbeat())  # ArduPilot tells at once
        if mode is Mode.AUTO:
            # On the ground nothing happens before MISSION_START; in the air the mission goes on.
            self._mission_started = self.in_air
            if self.in_air or self.run.state != 3:
                self.run.start_or_resume()
            return
        if not self.armed:
            return
        if mode is Mode.LAND:
            self._land()
        elif mode is Mode.RTL:
            self.begin_return()
        elif mode is Mode.SMART_RTL:
            self._begin_retrace()
        else:
            self.flight.hold()

    @property
    def can_retrace(self) -> bool:
        """Whether it remembers the path that it came."""
        return self.armed and self._memory is not None and self._memory.usable

    def _begin_retrace(self) -> None:
        if self.flight.landed or self._memory is None:
            self.disarm("Disarmed by landing")
            return
        way, loiter_s = self._memory.way_back(self.airframe.position_m), self.parameters["RTL_LOIT_TIME"] * 1e-3
        self.flight.begin(ReturnAlong(self.airframe, self.base_limits(), self.descent(), way, loiter_s))

    def _land(self) -> None:
        if self.flight.landed:
            self.disarm("Disarmed by landing")
        else:
            self.flight.begin(Land(self.airframe, self.base_limits(), self.descent()))

    def begin_return(self) -> None:
        """Climb, fly to the nearest place to land at, land; also what a return item of a mission does."""
        if self.flight.landed:
            self.disarm("Disarmed by landing")
            return
        self.flight.begin(ardupilot_return(self))

    def mission_flown(self) -> None:
        """The mission's last command is done."""
        if self.flight.landed:
            self.disarm("Disarmed by landing")
        else:
            self.flight.begin(Hold(self.airframe))

    def _tick(self) -> None:
        if self.has_position and not self._position_told:
            self._position_told = True
            self.broadcast(self.telemetry.build(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN))
            self.broadcast(self.telemetry.build(mavlink.MAVLINK_MSG_ID_HOME_POSITION))
        if self.time_s - self._timesync_s >= 10.0:
            self._timesync_s = self.time_s
            self.broadcast(mavlink.MAVLink_timesync_message(0, round(self.time_s * 1e9)))
        if not self.armed:
            return
        if self.mode is not Mode.SMART_RTL and not self._remember():
            self.say_critical("SmartRTL deactivated: buffer full")
        self._failsafes.tick()
        if self.mode is Mode.AUTO and self._mission_started and self.run.state == 3:
            self.run.tick(LOGIC_S)
        elif self.mode is Mode.GUIDED and self._guided is not None:
            self._watch_guided()
        elif self.flight.run(LOGIC_S) and self.flight.landed:
            self.disarm("Disarmed by landing")

    def _remember(self) -> bool:
        return self._memory is None or self._memory.watch(self.airframe.position_m, LOGIC_S)

    # Guided ----------------------------------------------------------------------------------------------------------

    def _take_setpoint(self, setpoint: Setpoint) -> None:
        if self.mode is not Mode.GUIDED:
            return
        self.counters.followed(self.time_s)
        if not self.in_air:
            return  # GUIDED leaves the ground by NAV_TAKEOFF alone
        self.flight.follow_setpoints()
        self._guided, self._guided_s, self._guided_idle = setpoint, self.time_s, False
        lead_by_setpoint(self.airframe, setpoint)

    def _watch_guided(self) -> None:
        """Setpoints with a velocity are flown on for GUID_TIMEOUT, then it brakes."""
        if self._guided is None or self._guided.velocity_m_s is None:
            return
        if self.time_s - self._guided_s >= self.parameters["GUID_TIMEOUT"]:
            self._guided = None
            self.flight.hold()

    # Failsafes -------------------------------------------------------------------------------------------------------

    def _counts_as_station(self, message: Message) -> bool:
        return bool(message.get_srcSystem() == int(self.parameters["SYSID_MYGCS"]))

    def _station_loss_timeout_s(self) -> float:
        return self.parameters["FS_GCS_TIMEOUT"]

    def _on_station_lost(self) -> None:
        self._failsafes.station_lost()

    def fail_to(self, mode: Mode, reason: str) -> None:
        """A failsafe takes the vehicle into another mode."""
        if self.mode is not mode:
            self._enter(mode)
        self._failsafe = reason
