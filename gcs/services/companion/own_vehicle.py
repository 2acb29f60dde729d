"""The vehicle that the companion sits on: what its autopilot tells, and the ways to command it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.core.vehicle import Autopilot, FlightMode, LandedState
from gcs.mavlink.camera_control import CAMERA_MESSAGES, CameraWatch
from gcs.mavlink.command_protocol import command_long
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.flight_commands import FlightCommands
from gcs.mavlink.link_quality import RoundTripMeter
from gcs.mavlink.message_rates import request_call, request_rates
from gcs.mavlink.mode_guard import ModeChange, ModeGuard, Shown
from gcs.mavlink.newest_telemetry import NewestTelemetry
from gcs.mavlink.parameter_protocol import ParameterRead
from gcs.mavlink.stepped_channel import SteppedChannel
from gcs.mavlink.telemetry_decoder import TelemetryDecoder
from gcs.mavlink.vehicle_clock import VehicleClock
from gcs.mavlink.vehicle_state import STACKS, TIME_STAMPED, TIMESYNC_EVERY_S
from gcs.services.companion.pose_history import POSE_MESSAGES, PoseHistory

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from gcs.core.vehicle import ImageReport, Telemetry
    from gcs.mavlink.command_protocol import Target
    from gcs.mavlink.dialect import Message
    from gcs.mavlink.transaction import Clock, Send

RATES_HZ = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 5.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 30.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 4.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 5.0,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 10.0,
    mavlink.MAVLINK_MSG_ID_MOUNT_STATUS: 10.0,
}
USUAL_OFFBOARD_TIMEOUT_S = 3.0
"""Taken for a vehicle that does not tell how long it flies on without setpoints: the longest that was measured."""

STICKS = ("chan1_raw", "chan2_raw", "chan3_raw", "chan4_raw")
STICK_MOVED_US = 150
STICK_RANGE_US = range(800, 2201)
FLYING = frozenset({LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING})
FRESH_S = 1.0


class OwnVehicle:
    """Everything that the companion hears from and says to its autopilot and camera.

    Args:
        autopilot: which flight stack.
        target: system and component of the autopilot.
        sender: system and component of the companion.
        send: puts a message on the link.
        clock: monotonic seconds.

    Attributes:
        pictures: how many pictures were announced as taken since the start.
        picture: the last of them.
        offboard_timeout_s: for how long it flies on when setpoints stop; None until it was asked.
    """

    def __init__(self, autopilot: Autopilot, target: Target, sender: Target, send: Send, clock: Clock) -> None:
        self.stack = STACKS[autopilot]()
        self.channel = SteppedChannel(target, sender, send, clock)
        self.guard = ModeGuard(self.stack)
        self.poses = PoseHistory()
        self.pictures = 0
        self.picture: ImageReport | None = None
        self.offboard_timeout_s: float | None = None
        self._clock = clock
        self._vehicle_clock = VehicleClock()
        self._round_trips = RoundTripMeter()
        self._timesync_at = -math.inf
        self._last_s = -math.inf
        self._newest = NewestTelemetry(TelemetryDecoder(self.stack))
        self._camera = CameraWatch(target[0], send, asks=self.stack.camera_announces)
        self._sticks: tuple[int, ...] | None = None
        self._sticks_at_start: tuple[int, ...] | None = None
        self._commands_of_pictures = 0

    @property
    def telemetry(self) -> Telemetry:
        """The newest of everything heard."""
        return self._newest.read()

    @property
    def camera_component(self) -> int | None:
        """Component id of its camera; None when none was heard."""
        return self._camera.component

    @property
    def clock_rate(self) -> float:
        """Vehicle seconds per second of our clock."""
        return self._vehicle_clock.rate

    def now_s(self) -> float | None:
        """The vehicle's clock (s since boot), estimated; it never goes back. None while it is not known."""
        now = self._vehicle_clock.at(self._clock())
        if now is None:
            return None
        self._last_s = max(self._last_s, now)
        return self._last_s

    @property
    def in_air(self) -> bool:
        """Whether it is armed and says that it flies."""
        armed, landed = self.telemetry.armed, self.telemetry.landed
        return armed is not None and armed.value and landed is not None and landed.value in FLYING

    @property
    def on_ground(self) -> bool:
        """Whether it says that it stands disarmed on the ground."""
        armed, landed = self.telemetry.armed, self.telemetry.landed
        return armed is not None and not armed.value and landed is not None and landed.value is LandedState.ON_GROUND

    def is_fresh(self, field: str, within_s: float = FRESH_S) -> bool:
        """Whether a value of the telemetry was heard lately, on our clock."""
        heard = getattr(self.telemetry, field)
        return heard is not None and heard.age_s(self._clock()) <= within_s

    @property
    def mode(self) -> FlightMode:
        """As last heard."""
        mode = self.telemetry.mode
        return FlightMode.UNKNOWN if mode is None else mode.value

    @property
    def may_be_led(self) -> bool:
        """Whether it hovers in a mode out of which a lease may begin.

        That is the mode that a station commands for a hold, not one that holds until sticks are moved (ArduPilot's
        LOITER), which is the pilot's; and ArduPilot's GUIDED, in which it hovers after a take-off.
        """
        guided = self.stack.autopilot is Autopilot.ARDUPILOT and self.mode is FlightMode.OFFBOARD
        hold, name = self.stack.custom_mode(FlightMode.HOLD), self.telemetry.mode_name
        held = hold is not None and name is not None and name.value == self.stack.flight_mode(hold)[1]
        return held or guided

    def handle(self, message: Message) -> ModeChange | None:
        """Take a message of the vehicle; returns what a heartbeat's change of mode is taken for."""
        kind, now = message.get_type(), self._clock()
        from_autopilot = (message.get_srcSystem(), message.get_srcComponent()) == self.channel.target
        self._newest.take(message, now, from_autopilot=from_autopilot)
        if kind in CAMERA_MESSAGES:
            report = self._camera.take(message)
            if report is not None and report.success:
                self.pictures, self.picture = self.pictures + 1, report
        if not from_autopilot:
            return None
        if kind in POSE_MESSAGES:
            self.poses.take(message)
        if kind in TIME_STAMPED and not self._vehicle_clock.stamped_lately(now):
            self._vehicle_clock.stamp(now, message.time_boot_ms * 1e-3)
        elif kind == "TIMESYNC" and message.tc1 != 0:
            round_trip_s = self._round_trips.answered(int(message.ts1), now)
            if round_trip_s is not None:
                self._vehicle_clock.round_trip(round_trip_s)
        elif kind == "RC_CHANNELS":
            self._sticks = sticks = tuple(int(getattr(message, name)) for name in STICKS)
            # a stick that was not told yet when it mattered is where it is first heard
            before = zip(self._sticks_at_start or sticks, sticks, strict=True)
            self._sticks_at_start = tuple(was if was in STICK_RANGE_US else now for was, now in before)
        elif kind == "HEARTBEAT":
            armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            return self.guard.on_heartbeat(Shown(int(message.custom_mode), armed, int(message.system_status)), now)
        return None

    def on_time(self) -> None:
        """Ask what is due, for lost announcements of pictures and the clock; to be called several times a second."""
        now = self._clock()
        self._camera.on_time(now)
        if now >= self._timesync_at:
            self._timesync_at = now + TIMESYNC_EVERY_S
            self.channel.send(mavlink.MAVLink_timesync_message(0, self._round_trips.ask(now)))

    def remember_sticks(self) -> None:
        """From now on sticks count as moved when they are elsewhere."""
        self._sticks_at_start = self._sticks

    def moved_stick(self) -> bool:
        """Whether somebody moves the sticks; a receiver that tells no positions says nothing."""
        if self._sticks is None or self._sticks_at_start is None:
            return False
        pairs = zip(self._sticks, self._sticks_at_start, strict=True)
        return any(
            abs(now - before) > STICK_MOVED_US
            for now, before in pairs
            if now in STICK_RANGE_US and before in STICK_RANGE_US
        )

    def commands(self, permit: Callable[[], None]) -> FlightCommands:
        """One sequence of commands.

        Args:
            permit: raises when the sequence may not go on.
        """
        return FlightCommands(self, self.stack, self.channel, self.guard, permit)

    async def introduce(self) -> None:
        """Ask for messages, and for how long the vehicle flies on without setpoints."""
        await request_rates(self.channel, RATES_HZ)
        for number in (mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, mavlink.MAVLINK_MSG_ID_HOME_POSITION):
            self.channel.send(command_long(request_call(number), self.channel.target, 0))
        try:
            readings = await self.channel.run(
                ParameterRead(
                    self.stack.stream_loss_parameters,
                    target=self.channel.target,
                    bytewise=self.stack.bytewise_parameters,
                    send=self.channel.send,
                    clock=self._clock,
                )
            )
            values = {name: None if reading is None else reading.value for name, reading in readings.items()}
            told = self.stack.limits(values).offboard_timeout_s
        except GcsError:
            told = None
        self.offboard_timeout_s = USUAL_OFFBOARD_TIMEOUT_S if told is None else told

    async def point_gimbal(self, commands: FlightCommands, pitch_rad: float) -> None:
        """Turn the camera to a pitch (rad above the horizon); only the last of the commands has to be taken."""
        *before, turn = self.stack.gimbal_commands(pitch_rad)
        for call in before:
            try:
                await commands.command(call)
            except GcsError:
                continue
        await commands.command(turn)

    async def take_picture(self, commands: FlightCommands) -> None:
        """Have one picture taken; its announcement says that it was."""
        self._commands_of_pictures += 1
        await commands.command(self.stack.picture_command(self._commands_of_pictures))

    def local_position(self, at_s: float) -> NDArray[np.float64] | None:
        """Where it was at a time of its clock, local ENU about the estimator's origin, shape (3,)."""
        return self.poses.position(at_s)
