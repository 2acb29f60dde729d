"""A vehicle that behaves like PX4: modes, arming, missions, offboard, failsafes."""

from __future__ import annotations

import math
from collections.abc import Callable

from gcs.core.frames import yaw_from_heading
from sitl_mocks.airframe import FlightLimits
from sitl_mocks.channel import Channel
from sitl_mocks.commands import ACCEPTED, DENIED, REJECTED, UNSUPPORTED, Command
from sitl_mocks.dialect import AUTOPILOT_COMPONENT, CAMERA_COMPONENT, Message, mavlink
from sitl_mocks.fence_rally import FENCE, PX4_MISSION, outside, with_room
from sitl_mocks.file_server import FileServer
from sitl_mocks.flight_tasks import DescentProfile, Land, Sink
from sitl_mocks.mission_server import MissionServer
from sitl_mocks.parameters import ParameterServer
from sitl_mocks.position_cascade import CascadeGains
from sitl_mocks.px4_events import ITEM_REFUSED, Px4Events
from sitl_mocks.px4_failsafes import Px4Failsafes
from sitl_mocks.px4_feasibility import MissionCheck
from sitl_mocks.px4_files import Px4Files
from sitl_mocks.px4_mission_run import Px4MissionRun
from sitl_mocks.px4_mission_server import Px4MissionServer
from sitl_mocks.px4_modes import AUTO_MODES, NAMES, PILOT_MODES, Mode, mode_number
from sitl_mocks.px4_parameters import PX4_AT_MOST, PX4_PARAMETERS
from sitl_mocks.setpoints import Setpoint, lead_by_setpoint
from sitl_mocks.vehicle import ACTIVE, CRITICAL, LOGIC_S, STANDBY, SimulatedVehicle
from sitl_mocks.ways_home import px4_return

_SINK_M_S = 0.7
_BY_DISTANCE = 4
"""TRIG_MODE in which DO_SET_CAM_TRIGG_DIST takes pictures."""
STREAM_LOSS = "offboard loss"
_STREAM_ALIVE_S = 0.5


class Px4Vehicle(SimulatedVehicle):
    """PX4-like."""

    kind = "px4"
    autopilot = mavlink.MAV_AUTOPILOT_PX4
    capabilities = 0xE8FF
    software_version = 0x011000FF
    fix_texts = ("GNSS data fusion stopped", "GNSS data fusion started")
    ready_after_s = 1.5
    real_ready_after_s = 5.0

    missions: Px4MissionServer

    def _make_parameters(self) -> ParameterServer:
        table = dict(PX4_PARAMETERS)
        table["MAV_SYS_ID"] = (self.options.system_id, table["MAV_SYS_ID"][1])
        return ParameterServer(
            table,
            bytewise=True,
            answers_unknown=lambda name: self.say(mavlink.MAV_SEVERITY_ERROR, f"unknown param: {name}"),
            at_most=PX4_AT_MOST,
            clamped=lambda name: self.say(mavlink.MAV_SEVERITY_WARNING, f"{name} clamped to its maximum"),
            least=self.options.parameter_count,
        )

    def _prepare(self) -> None:
        self.mode = Mode.LOITER
        self._intended = Mode.LOITER
        self.failsafe: str | None = None
        self._setpoint: Setpoint | None = None
        self._setpoint_s = -math.inf
        self._failsafes = Px4Failsafes(self)
        self._events = Px4Events(self.broadcast, lambda: self.boot_ms)
        self._check = MissionCheck()
        self.run = Px4MissionRun(self)

    def _make_mission_server(self) -> MissionServer:
        return Px4MissionServer(
            self.say,
            self._mission_changed,
            lambda: self.run.current,
            fence_changed=self._fence_changed,
            item_refused=lambda: self._events.tell(ITEM_REFUSED),
            kind=with_room(PX4_MISSION, self.options.mission_items),
        )

    def _make_autopilot_files(self) -> FileServer:
        files = Px4Files(self.parameters)
        return FileServer(files, sessions=1, writable=files)

    # Telemetry -------------------------------------------------------------------------------------------------------

    def default_streams(self) -> dict[int, float]:
        """See base class."""
        m = mavlink
        return {
            m.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
            m.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
            m.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
            m.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
            m.MAVLINK_MSG_ID_ATTITUDE: 20.0,
            m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 20.0,
            m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 20.0,
            m.MAVLINK_MSG_ID_VFR_HUD: 4.0,
            m.MAVLINK_MSG_ID_ALTITUDE: 1.0,
            m.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
            m.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
            m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
            m.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
            m.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 10.0,
        }

    def heartbeat(self) -> Message:
        """HEARTBEAT with the flags that PX4 derives from the mode."""
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if self.mode in AUTO_MODES:
            flags |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED
            flags |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        elif self.mode is not Mode.OFFBOARD:
            flags |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        else:
            flags |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if self.armed:
            flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, self.autopilot, flags, int(self.mode), self._system_status(), 3
        )

    def _system_status(self) -> int:
        if self.failsafe is not None:
            return CRITICAL
        if self.armed:
            return ACTIVE
        return STANDBY if self.has_position else 0

    def mode_name(self) -> str:
        """See base class."""
        return NAMES[self.mode]

    def mission_current(self) -> tuple[int, int, int, int]:
        """See base class; state 1 stands for "no flyable mission"."""
        mode = 1 if self.mode is Mode.MISSION else 2
        if not self.run.mission:
            return 0, 65535, 1, mode
        total = len(self.run.mission)
        if not self._mission_is_flyable():
            state = 1
        elif self.run.complete:
            state = 5
        elif self.mode is Mode.MISSION:
            state = 3
        else:
            state = 4 if self.run.current > 0 else 2
        return self.run.current, total, state, mode

    def flight_item(self) -> int:
        """See base class."""
        return self.run.current if self.mode is Mode.MISSION else -1

    def follows_plan(self) -> bool:
        """See base class."""
        return self.mode in {Mode.MISSION, Mode.OFFBOARD}

    def _hears_texts(self, channel: Channel) -> bool:
        return channel.peer_is_station

    def say_info(self, text: str) -> None:
        """A STATUSTEXT for information."""
        self.say(mavlink.MAV_SEVERITY_INFO, text)

    def tell_item_reached(self, sequence: int) -> None:
        """MISSION_ITEM_REACHED."""
        self.broadcast(mavlink.MAVLink_mission_item_reached_message(sequence))

    # Limits ----------------------------------------------------------------------------------------------------------

    def base_limits(self) -> FlightLimits:
        """Auto modes fly with the cruise speeds, offboard is clipped to the maxima."""
        p = self.parameters
        offboard = self.mode is Mode.OFFBOARD
        return FlightLimits(
            horizontal_m_s=p["MPC_XY_VEL_MAX"]
            if offboard
            else self.override_speed(1, p["MPC_XY_CRUISE"], p["MPC_XY_VEL_MAX"]),
            climb_m_s=p["MPC_Z_VEL_MAX_UP"]
            if offboard
            else self.override_speed(2, p["MPC_Z_V_AUTO_UP"], p["MPC_Z_VEL_MAX_UP"]),
            descent_m_s=p["MPC_Z_VEL_MAX_DN"]
            if offboard
            else self.override_speed(3, p["MPC_Z_V_AUTO_DN"], p["MPC_Z_VEL_MAX_DN"]),
            acceleration_m_s2=p["MPC_ACC_HOR"],
            vertical_acceleration_m_s2=min(p["MPC_ACC_UP_MAX"], p["MPC_ACC_DOWN_MAX"]),
            jerk_m_s3=p["MPC_JERK_AUTO"],
            yaw_rate_rad_s=math.radians(p["MPC_YAWRAUTO_MAX"]),
            clips_setpoints=offboard,
        )

    def setpoint_gains(self) -> CascadeGains:
        """See base class."""
        return CascadeGains.of_px4(self.parameters)

    def descent(self) -> DescentProfile:
        """How it comes down."""
        return DescentProfile(self.parameters["MPC_LAND_ALT2"], self.parameters["MPC_LAND_SPEED"])

    # Commands --------------------------------------------------------------------------------------------------------

    def _command_table(self) -> dict[int, Callable[[Command, Channel], int]]:
        m = mavlink
        return {
            **super()._command_table(),
            m.MAV_CMD_NAV_TAKEOFF: lambda c, _: self._command_take_off(c),
            m.MAV_CMD_NAV_LAND: lambda _c, _: self._command_mode(Mode.LAND),
            m.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _c, _: self._command_mode(Mode.RTL),
            m.MAV_CMD_MISSION_START: lambda _c, _: self._mission_start(),
            m.MAV_CMD_DO_REPOSITION: lambda c, _: self._reposition(c),
            m.MAV_CMD_IMAGE_START_CAPTURE: lambda c, _: self.camera_command(c),
            m.MAV_CMD_IMAGE_STOP_CAPTURE: lambda c, _: self.camera_command(c),
            m.MAV_CMD_DO_DIGICAM_CONTROL: lambda c, _: self._digicam(c),
        }

    def _set_mode(self, base_mode: int, custom_mode: int, sub_mode: int, channel: Channel) -> int:
        if not base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return UNSUPPORTED
        number = custom_mode if custom_mode > 0xFFFF else mode_number(custom_mode, sub_mode)
        # The first of two acknowledgements is always this one, whatever comes of the command.
        acknowledgement = mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
        channel.send(acknowledgement, AUTOPILOT_COMPONENT)
        if number not in set(Mode):
            return DENIED
        return self._command_mode(Mode(number))

    def _command_mode(self, mode: Mode) -> int:
        """A mode asked for by somebody; the end of a failsafe, if it can be had."""
        if mode is Mode.MISSION and not self._mission_is_flyable():
            return REJECTED
        if mode is Mode.OFFBOARD and not self._stream_is_alive():
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "Switching to mode 'Offboard' is currently not available")
            return REJECTED
        if mode is Mode.TAKEOFF and not self.has_position:
            return REJECTED
        self._intended = mode
        self.failsafe = None
        self._failsafes.reset()
        self._enter(mode)
        return ACCEPTED

    def set_mode_by_name(self, name: str) -> bool:
        """See base class."""
        for mode, known in NAMES.items():
            if name.upper() in {known, mode.name}:
                return self._command_mode(mode) == ACCEPTED
        return False

    def _command_take_off(self, command: Command) -> int:
        altitude = command.params[6]
        if not self.has_position:
            return REJECTED
        if not math.isfinite(altitude):
            altitude = self.home.altitude_m + self.parameters["MIS_TAKEOFF_ALT"]
        self._take_off_up_m = float(self.home_m[2]) + altitude - self.home.altitude_m
        return self._command_mode(Mode.TAKEOFF)

    _take_off_up_m: float | None = None

    def _mission_start(self) -> int:
        if self._command_mode(Mode.MISSION) != ACCEPTED:
            return DENIED
        if not self.armed:
            if self._arming_refusal() is not None:
                return DENIED
            self.arm()
        return ACCEPTED

    def _reposition(self, command: Command) -> int:
        if not self.in_air:
            return DENIED
        target = self.airframe.position_m
        if command.place_is_given:
            latitude, longitude, altitude = command.params[4:7]
            if not math.isfinite(altitude):
                altitude = self.frame.geo(target).altitude_m
            target = self.frame.scene(latitude, longitude, altitude)
        self._command_mode(Mode.LOITER)
        yaw = yaw_from_heading(command.params[3]) if math.isfinite(command.params[3]) else None
        self.flight.fly_to(target, yaw)
        return ACCEPTED

    def _digicam(self, command: Command) -> int:
        if command.params[4] == 1.0:
            self.camera.take()
        return ACCEPTED

    def _set_current_item(self, sequence: int) -> bool:
        return self.run.set_current(sequence)

    def forward_mission_command(self, command: Command) -> None:
        """What an instant mission item does; the command shows on the link, as on the real one."""
        m = mavlink
        to_camera = command.number in {m.MAV_CMD_IMAGE_START_CAPTURE, m.MAV_CMD_IMAGE_STOP_CAPTURE}
        component = CAMERA_COMPONENT if to_camera else 0
        self.broadcast(m.MAVLink_command_long_message(self.system_id, component, command.number, 0, *command.params))
        if to_camera:
            self.camera_command(command)
        elif command.number == m.MAV_CMD_DO_CHANGE_SPEED:
            self.change_speed(command)
        elif command.number in {m.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, m.MAV_CMD_DO_MOUNT_CONTROL}:
            self.point_gimbal(command)
        elif command.number == m.MAV_CMD_DO_DIGICAM_CONTROL:
            self._digicam(command)
        elif command.number == m.MAV_CMD_DO_SET_CAM_TRIGG_DIST and self.parameters["TRIG_MODE"] == _BY_DISTANCE:
            self.camera_command(command)

    # Arming ----------------------------------------------------------------------------------------------------------

    def _arming_refusal(self) -> str | None:
        reason = None
        if self.up_s < self.ready_after_s:
            reason = "system not ready"
        elif self.mode in PILOT_MODES | {Mode.RTL, Mode.LAND}:
            reason = f"mode {NAMES[self.mode]} not armable"
        elif self.mode is Mode.OFFBOARD and not self._stream_is_alive():
            reason = "no offboard signal"
        elif self.mode is Mode.MISSION and not self._mission_is_flyable():
            reason = "no valid mission available"
        return None if reason is None else f"Arming denied: {reason}"

    def _arming_refused_result(self) -> int:
        return REJECTED

    def arm(self) -> None:
        """See base class."""
        super().arm()
        self._failsafes.battery_changed()
        self.say_info("Armed by external command")
        self._enter(self.mode)

    def _after_disarm(self) -> None:
        self.run.leave()
        self.failsafe = None
        self._failsafes.reset()

    # Modes -----------------------------------------------------------------------------------------------------------

    def _enter(self, mode: Mode) -> None:
        if mode is not self.mode and self.failsafe is None:
            self.counters.interrupted()
        self.mode = mode
        self.run.leave()
        self.flight.refresh_limits()
        if not self.armed:
            return
        if mode in PILOT_MODES or mode is Mode.LOITER:
            self.flight.hold()
        elif mode is Mode.TAKEOFF:
            default = float(self.home_m[2]) + self.parameters["MIS_TAKEOFF_ALT"]
            self.flight.take_off_to(default if self._take_off_up_m is None else self._take_off_up_m)
            self._take_off_up_m = None
        elif mode is Mode.LAND:
            self._begin_descent(Land(self.airframe, self.base_limits(), self.descent()))
        elif mode is Mode.RTL:
            self._return()
        elif mode is Mode.MISSION:
            self.say_info("Executing Mission")
            self.flight.hold()
        elif mode is Mode.OFFBOARD:
            self.airframe.set_cascade(self.setpoint_gains())
            self.flight.follow_setpoints()

    def _begin_descent(self, task: Land) -> None:
        if self.flight.landed:
            self.disarm("Disarmed by landing")
        else:
            self.flight.begin(task)

    def _return(self) -> None:
        """Climb, fly to the nearest place to land at, land."""
        if self.flight.landed:
            self.disarm("Disarmed by landing")
            return
        self.flight.begin(px4_return(self))

    def return_from_mission(self) -> None:
        """A return item is, as on the real one, a change to the return mode."""
        self._intended = Mode.RTL
        self._enter(Mode.RTL)

    def mission_landed(self) -> None:
        """The mission's landing is done."""
        self.say_info("Landing detected")
        self.say_info("Mission finished, landed")
        self.disarm("Disarmed by landing")

    def mission_flown(self) -> None:
        """The last item is done, in the air."""
        self.say_info("Mission finished, loitering")
        self._intended = Mode.LOITER
        self._enter(Mode.LOITER)

    def _mission_changed(self) -> None:
        self.run.mission_replaced()
        self._check.begin(self.wall_s)
        flaw = self.run.flaw()
        if flaw is not None:
            self._events.tell(flaw)
        if self.mode is Mode.MISSION and not self.run.mission:
            self._intended = Mode.LOITER
            self._enter(Mode.LOITER)

    def _mission_is_flyable(self) -> bool:
        if self.in_air and self.mode is Mode.MISSION:
            self._check.end()
        return self._check.is_over(self.wall_s) and bool(self.run.mission) and self.run.flaw() is None

    def _fence_changed(self) -> None:
        """A fence with home outside is taken all the same; the text's words were not recorded."""
        fence = self.missions.others[FENCE].items
        if fence and outside(fence, self.home.latitude_deg, self.home.longitude_deg, of_all=False):
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "Geofence: home is outside")

    def _tick(self) -> None:
        self.run.repeat_reached()
        if not self.armed:
            return
        self._failsafes.tick()
        if self.mode is Mode.MISSION and self._mission_is_flyable():
            self.run.tick(LOGIC_S)
        elif self.mode is Mode.OFFBOARD or self._intended is Mode.OFFBOARD:
            self._follow_stream()
        elif self.flight.run(LOGIC_S):
            if self.flight.landed:
                self.say_info("Landing detected")
                self.disarm("Disarmed by landing")
            elif self.mode is Mode.TAKEOFF:
                self._intended = Mode.LOITER
                self._enter(Mode.LOITER)

    # Offboard --------------------------------------------------------------------------------------------------------

    def _take_setpoint(self, setpoint: Setpoint) -> None:
        self._setpoint, self._setpoint_s = setpoint, self.time_s
        if self.mode is Mode.OFFBOARD or self.failsafe == STREAM_LOSS:
            self.counters.followed(self.time_s)
        if self.mode is Mode.OFFBOARD and self.armed:
            lead_by_setpoint(self.airframe, setpoint)

    def _stream_is_alive(self) -> bool:
        return self.time_s - self._setpoint_s < max(_STREAM_ALIVE_S, self.parameters["COM_OF_LOSS_T"])

    def _follow_stream(self) -> None:
        """Offboard while setpoints come, the failsafe while they do not; PX4 goes back by itself."""
        lost = self.time_s - self._setpoint_s >= self.parameters["COM_OF_LOSS_T"]
        if lost and self.mode is Mode.OFFBOARD:
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "Failsafe activated")
            self.failsafe = STREAM_LOSS
            action = int(self.parameters["COM_OBL_RC_ACT"])
            mode = {0: Mode.POSCTL, 1: Mode.ALTCTL, 2: Mode.STABILIZED, 3: Mode.RTL, 4: Mode.LAND}.get(action)
            self._enter(Mode.LOITER if mode is None else mode)
            if self.mode in PILOT_MODES and self.armed and not self.flight.landed:
                self.flight.begin(Sink(self.airframe, self.base_limits(), _SINK_M_S))
        elif not lost and self.mode is not Mode.OFFBOARD and self.failsafe == STREAM_LOSS:
            self.failsafe = None
            self._enter(Mode.OFFBOARD)
        grounded_s = self.flight.grounded_s
        if grounded_s is not None and grounded_s >= self.parameters["COM_DISARM_LAND"]:
            self.say_info("Landing detected")
            self.disarm("Disarmed by landing")
        elif self.mode is Mode.OFFBOARD:
            if not self.airframe.running and self._setpoint is not None:
                lead_by_setpoint(self.airframe, self._setpoint)
        elif self.flight.run(LOGIC_S) and self.flight.landed:
            self.say_info("Landing detected")
            self.disarm("Disarmed by landing")

    # Failsafes -------------------------------------------------------------------------------------------------------

    def _station_loss_timeout_s(self) -> float:
        return self.parameters["COM_DL_LOSS_T"]

    def _on_station_lost(self) -> None:
        self.say(mavlink.MAV_SEVERITY_WARNING, "Connection to ground control lost")
        self._failsafes.station_lost()

    def fail_to(self, mode: Mode, reason: str) -> None:
        """A failsafe takes the vehicle into another mode for good."""
        if self.mode is mode:
            return
        self.say(mavlink.MAV_SEVERITY_CRITICAL, "Failsafe activated")
        self.failsafe = reason
        self._intended = mode
        self._enter(mode)

    def hold_in_failsafe(self, reason: str) -> None:
        """A failsafe holds the vehicle before it acts; the mode that was wanted is not forgotten."""
        self.say(mavlink.MAV_SEVERITY_CRITICAL, "Failsafe activated")
        self.failsafe = reason
        self._enter(Mode.LOITER)

    def end_failsafe(self) -> None:
        """The reason has gone: back to the mode that was wanted."""
        self.failsafe = None
        self._enter(self._intended)
