"""What one vehicle tells: its messages folded into telemetry, clock, link quality and events."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import AbstractAsyncContextManager
from dataclasses import replace
from typing import Any, TypeVar

from gcs.core.errors import GcsError, LinkError
from gcs.core.motion import MotionSample
from gcs.core.vehicle import (
    Autopilot,
    FlightMode,
    LandedState,
    StatusText,
    Telemetry,
    VehicleIdentity,
)
from gcs.mavlink import events
from gcs.mavlink.autopilots.ardupilot import ArduPilot
from gcs.mavlink.autopilots.base import FlightStack
from gcs.mavlink.autopilots.generic import GenericAutopilot
from gcs.mavlink.autopilots.px4 import Px4
from gcs.mavlink.camera_control import CAMERA_MESSAGES, CameraWatch
from gcs.mavlink.command_protocol import command_long
from gcs.mavlink.companion_lease import COMPANION, OVER, LeaseState, LeaseStatus, lease_status
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.events import EventStream, VehicleEvent
from gcs.mavlink.link_quality import LinkQuality, RoundTripMeter, SequenceMeter
from gcs.mavlink.list_watch import ListWatch, told_marks
from gcs.mavlink.message_rates import RATES_HZ, request_call, request_rates
from gcs.mavlink.mode_guard import ModeChange, ModeGuard, Shown
from gcs.mavlink.motion_samples import MOTION_MESSAGES, MotionSampler
from gcs.mavlink.newest_telemetry import NewestTelemetry
from gcs.mavlink.received_message import MARKER_V1, ReceivedMessage
from gcs.mavlink.report_assembler import (
    AnsweredReport,
    MalformedReport,
    ReportAssembler,
    ReportStatus,
    report_ack,
)
from gcs.mavlink.routing import unit_number
from gcs.mavlink.status_text import StatusTextAssembler
from gcs.mavlink.telemetry_decoder import TelemetryDecoder, mission_progress
from gcs.mavlink.tunnel_carrier import carried
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.mavlink.vehicle_clock import VehicleClock

log = logging.getLogger(__name__)
R = TypeVar("R")

STACKS: dict[Autopilot, type[FlightStack]] = {
    Autopilot.PX4: Px4,
    Autopilot.ARDUPILOT: ArduPilot,
    Autopilot.GENERIC: GenericAutopilot,
}
DECODERS = {autopilot: TelemetryDecoder(stack()) for autopilot, stack in STACKS.items()}
"""They hold no state, so all vehicles of a flight stack share one."""
TEXTS_KEPT = 50
TIMESYNC_EVERY_S = 1.0
ASK_AGAIN_S = 15.0
ASK_ONCE_TRIES = 5
ASK_ONCE_PAUSE_S = 1.0
TIME_STAMPED = frozenset({"ATTITUDE", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "SYSTEM_TIME"})
ALSO_WANTED = frozenset({"TIMESYNC", "MISSION_ITEM_REACHED", "AUTOPILOT_VERSION", "STATUSTEXT", "TUNNEL"})
"""Besides telemetry, motion and pictures; other messages are counted, logged, and handed to whoever waits for one."""
WANTED = DECODERS[Autopilot.GENERIC].kinds | MOTION_MESSAGES | CAMERA_MESSAGES | ALSO_WANTED
ONLY_MAVLINK_1 = (
    "it sends MAVLink 1 and may not understand MAVLink 2, which missions, files and signing need: set it to MAVLink 2 "
    "(PX4: MAV_PROTO_VER 2; ArduPilot: SERIALn_PROTOCOL 2)"
)
CLEARLY_UP_M = 1.5
FLYING = frozenset({LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING})


class VehicleState:
    """The listening half of a `Vehicle`.

    Args:
        identity: who it is.
        channel: to it.
        lost_after_s: without heartbeats for so long the link counts as lost.
    """

    # What every message needs lies together: a hundred large dictionaries would never stay in the processor's cache.
    __slots__ = (
        "__dict__",
        "_channel",
        "_events",
        "_meter",
        "_newest",
        "_reboots",
        "clock",
        "identity",
        "on_motion",
        "on_packet",
    )

    def __init__(self, identity: VehicleIdentity, channel: VehicleChannel, *, lost_after_s: float) -> None:
        self.identity = identity
        self.clock = VehicleClock()
        self.uid: str | None = None
        self.capabilities: int | None = None
        self.mavlink_version: int | None = None
        """Of its last heartbeat; one that sends MAVLink 1 is heard, but may not understand what is sent to it."""
        self.on_event: Callable[[VehicleEvent], None] | None = None
        self.on_motion: Callable[[MotionSample], None] | None = None
        self.on_packet: Callable[[bytes], None] | None = None
        """Told of every packet of the vehicle that is heard or sent, from any thread; must not wait."""
        self._channel = channel
        self._now = channel.clock
        self._lost_after_s = lost_after_s
        self._stack = STACKS[identity.autopilot]()
        self._newest = NewestTelemetry(DECODERS[identity.autopilot])
        self._motion = MotionSampler()
        self._guard = ModeGuard(self._stack)
        self._lent_lease: int | None = None
        self._lists = ListWatch()
        self._meter = SequenceMeter()
        self._round_trips = RoundTripMeter()
        self._texts = StatusTextAssembler()
        self._recent_texts: deque[tuple[float, StatusText]] = deque(maxlen=TEXTS_KEPT)
        self._camera = CameraWatch(identity.system_id, channel.send, asks=self._stack.camera_announces)
        self._reports = ReportAssembler()
        self._events: EventStream[VehicleEvent] = EventStream(events.newer_telemetry)
        self._tasks: set[asyncio.Task[None]] = set()
        self._asking: asyncio.Task[None] | None = None
        self._ask_again_at: float | None = None
        self._timesync_at = float("-inf")
        self._reboots = 0
        self._id_clash: str | None = None
        self._last_heartbeat_s = self._now()
        self._armed_before: bool | None = None
        self._connected = True
        self._closed = False

    @property
    def telemetry(self) -> Telemetry:
        """The newest of everything heard; safe from any thread."""
        return self._newest.read()

    @property
    def connected(self) -> bool:
        """Whether its heartbeats are heard."""
        return self._connected

    @property
    def last_heard_s(self) -> float:
        """Station time of its last heartbeat."""
        return self._last_heartbeat_s

    @property
    def link_quality(self) -> LinkQuality:
        """Messages per second, the share lost, and the round trip."""
        now = self._now()
        return replace(self._meter.quality(now), round_trip_s=self._round_trips.median_s(now))

    @property
    def camera_component(self) -> int | None:
        """Component id of its camera; None when none was heard."""
        return self._camera.component

    @property
    def pilot_in_control(self) -> bool:
        """Whether somebody else took over: the station then neither commands it nor streams, until `take_back`."""
        return self._guard.hands_off is not None

    @property
    def hands_off_reason(self) -> str | None:
        """Who took over and how; None while the station may command."""
        return self._guard.hands_off

    @property
    def id_clash(self) -> str | None:
        """How two vehicles with its system id were told apart; None while there is but one."""
        return self._id_clash

    def tell_id_clash(self, reason: str | None) -> None:
        """Two vehicles use its system id, or one does so no more; called by the station."""
        if (reason is None) == (self._id_clash is None):
            return
        self._id_clash = reason
        system_id = self.identity.system_id
        self._channel.refusal = reason and (
            f"two vehicles use system id {system_id} ({reason}): nothing is sent to either until one has another id"
        )
        if reason is not None:
            self._id_clashes()
        self._publish(events.IdClashEvent(reason))

    def way_changed(self) -> None:
        """Its messages come another way from now on, with other numbers; called by the station."""
        self._meter.restart()

    @property
    def takes_acceleration_forward(self) -> bool:
        """Whether the acceleration of a setpoint is only added to what its controller asks for."""
        return self._stack.takes_acceleration_forward

    @property
    def in_air(self) -> bool:
        """Whether it is armed and says that it flies; if it does not say, whether it is well above its home."""
        armed, landed = self.telemetry.armed, self.telemetry.landed
        if armed is None or not armed.value:
            return False
        if landed is not None and landed.value is not LandedState.UNKNOWN:
            return landed.value in FLYING
        position, home = self.telemetry.position, self.telemetry.home
        if position is None or home is None:
            return False
        return position.value.altitude_m > home.value.altitude_m + CLEARLY_UP_M

    @property
    def recent_texts(self) -> tuple[StatusText, ...]:
        """Its last messages for people, oldest first."""
        return tuple(text for _, text in self._recent_texts)

    def vehicle_now(self) -> float:
        """The vehicle's clock now (s since boot), estimated; safe from any thread.

        Raises:
            LinkError: too few time stamps of the vehicle were heard yet.
        """
        return self.vehicle_at(self._now())

    def vehicle_at(self, station_s: float) -> float:
        """The vehicle's clock at a time of the station's, likewise."""
        vehicle_s = self.clock.at(station_s)
        if vehicle_s is None:
            raise LinkError("its clock is not known yet; wait a second", field=self.identity.name)
        return vehicle_s

    def events(self) -> AbstractAsyncContextManager[AsyncIterator[VehicleEvent]]:
        """Hear what happens to it, inside an `async with` block."""
        return self._events.read()

    def messages(self) -> AbstractAsyncContextManager[AsyncIterator[Message]]:
        """Hear its raw messages, inside an `async with` block."""
        return self._channel.messages()

    async def until(self, holds: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Wait until something of its state holds.

        Raises:
            LinkError: it did not hold in time; names what was awaited.
        """
        await self._named(self._channel.until(holds, timeout_s, what))

    async def close(self) -> None:
        """Stop whatever is under way; nothing is sent afterwards."""
        self._closed = True
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def passed(self, packet: bytes) -> None:
        """A packet to it or from it passed a link; safe from any thread."""
        on_packet = self.on_packet
        if on_packet is not None:
            on_packet(packet)

    def handle(self, message: ReceivedMessage, now: float) -> None:
        """Take a message of any of its components that was heard just now; called by the station."""
        if self.on_packet is not None:
            self.passed(message.packet)
        kind, component = message.layout.name, message.from_component
        self._meter.count(component, message.running_number, now)
        if kind in WANTED:
            self._take(kind, message, now, from_autopilot=component == self.identity.component_id)
        self._channel.publish(message)

    def _take(self, kind: str, message: Message, now: float, *, from_autopilot: bool) -> None:
        changed = self._newest.take(message, now, from_autopilot=from_autopilot)
        if changed and self._events.has_readers:
            self._publish(events.TelemetryEvent(self.telemetry))
        if from_autopilot:
            self._handle_autopilot(kind, message, now)
            if self.on_motion is not None:
                sample = self._motion.take(message)
                if sample is not None:
                    self.on_motion(sample)
        if kind in CAMERA_MESSAGES:
            report = self._camera.take(message)
            if report is not None:
                self._publish(events.ImageEvent(report))
        elif kind == "STATUSTEXT":
            for text in self._texts.take(message):
                self._recent_texts.append((now, text))
                self._publish(events.StatusTextEvent(text))
        elif kind == "TUNNEL":
            self._handle_tunnel(message)

    def _handle_autopilot(self, kind: str, message: Message, now: float) -> None:
        if kind == "HEARTBEAT":
            self._handle_heartbeat(message, now)
        elif kind in TIME_STAMPED:
            if self.clock.stamped_lately(now):
                return
            self.clock.stamp(now, message.boot_s)
            if self.clock.reboots != self._reboots:
                self._reboots = self.clock.reboots
                self.ask_for_messages()
        elif kind == "TIMESYNC" and message.tc1 != 0:
            round_trip_s = self._round_trips.answered(int(message.ts1), now)
            if round_trip_s is not None:
                self.clock.round_trip(round_trip_s)
        elif kind == "MISSION_ITEM_REACHED":
            self._publish(events.ItemReachedEvent(int(message.seq)))
        elif kind == "MISSION_CURRENT":
            self._guard.on_mission(mission_progress(message))
            if not self._lists.idle:
                for changed in self._lists.take(told_marks(message, self.identity.autopilot), now):
                    self._publish(events.ListChangedEvent(changed))
        elif kind == "AUTOPILOT_VERSION":
            self.capabilities = int(message.capabilities)
            self.uid = unit_number(message)

    def _handle_heartbeat(self, message: Message, now: float) -> None:
        silent_s = now - self._last_heartbeat_s
        self._last_heartbeat_s = now
        self.mavlink_version = 1 if message.get_msgbuf()[0] == MARKER_V1 else 2
        if not self._connected:
            self._connected = True
            self._publish(events.LinkBackEvent(silent_s))
            self.ask_for_messages()
        was_armed = self._armed_before
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self._armed_before = armed
        change = self._guard.on_heartbeat(Shown(int(message.custom_mode), armed, int(message.system_status)), now)
        if change is not None:
            mode, name = self._stack.flight_mode(int(message.custom_mode))
            self._mode_changed(change, mode, name)
            self._publish(events.ModeEvent(mode, name, change is ModeChange.COMMANDED))
            self._tell_take_over(change)
        if was_armed is not None and was_armed != armed:
            if not armed:
                self._disarmed()
            self._publish(events.ArmedEvent(armed))

    def _tell_take_over(self, change: ModeChange | None) -> None:
        if change is ModeChange.TAKEN_OVER and self._guard.hands_off is not None:
            self._publish(events.PilotTookOverEvent(self._guard.hands_off))

    def _handle_lease(self, status: LeaseStatus) -> None:
        if status.lease == self._lent_lease and status.state in OVER:
            self._tell_take_over(self._guard.let_go(taken_over=status.state is LeaseState.TAKEN_OVER))
        self._publish(events.LeaseEvent(status))

    def _handle_tunnel(self, message: Message) -> None:
        status = lease_status(message) if message.get_srcComponent() == COMPANION else None
        if status is not None:
            self._handle_lease(status)
            return
        inner = carried(message)
        report = None if inner is None else self._reports.take(inner)
        if isinstance(report, MalformedReport):
            log.warning("%s sent a replanning report that cannot be read: %s", self.identity.name, report.problem)
            self._answer_report(report.boot_id, report.number, ReportStatus.REFUSED)
        elif isinstance(report, AnsweredReport):
            self._answer_report(report.boot_id, report.number, report.status)
        elif report is not None:
            self._publish(events.ReplanEvent(report))

    def _answer_report(self, boot_id: int, number: int, status: ReportStatus) -> None:
        self._reports.answered(boot_id, number, status)
        self._channel.send(report_ack(boot_id, number, status, self.identity.system_id))

    def on_time(self) -> None:
        """Notice what did not come, and ask for it; called by the station several times a second."""
        now = self._now()
        silent_s = now - self._last_heartbeat_s
        if self._connected and silent_s > self._lost_after_s:
            self._connected = False
            self._link_lost()
            self._publish(events.LinkLostEvent(silent_s))
        self._tell_take_over(self._guard.on_time(now))
        if not self._connected:
            return
        self._camera.on_time(now)
        if now - self._timesync_at >= TIMESYNC_EVERY_S:
            self._timesync_at = now
            self._channel.send(mavlink.MAVLink_timesync_message(0, self._round_trips.ask(now)))
        if self._ask_again_at is not None and now >= self._ask_again_at:
            self.ask_for_messages()

    def ask_for_messages(self) -> None:
        """Ask in the background for message rates, version, home and origin."""
        self._ask_again_at = None
        if self._asking is None or self._asking.done():
            self._asking = self._spawn(self._ask())

    async def _ask(self) -> None:
        if not await request_rates(self._channel, RATES_HZ):
            self._ask_again_at = self._now() + ASK_AGAIN_S
        for _ in range(ASK_ONCE_TRIES):
            known = {
                mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.capabilities,
                mavlink.MAVLINK_MSG_ID_HOME_POSITION: self.telemetry.home,
                mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self.telemetry.origin,
            }
            for number, value in known.items():
                if value is None:
                    self._channel.send(command_long(request_call(number), self._channel.target, 0))
            await asyncio.sleep(ASK_ONCE_PAUSE_S)

    def _mode_changed(self, change: ModeChange, mode: FlightMode, name: str) -> None:
        """For the flying half."""

    def _disarmed(self) -> None:
        """For the flying half."""

    def _link_lost(self) -> None:
        """For the flying half."""

    def _id_clashes(self) -> None:
        """For the flying half."""

    def _heard_since(self, field: str, since_s: float) -> bool:
        heard = getattr(self.telemetry, field)
        return heard is not None and heard.at_s > since_s

    def _publish(self, event: VehicleEvent) -> None:
        self._events.publish(event)
        if self.on_event is not None:
            self.on_event(event)

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _about_this(self, error: GcsError) -> GcsError:
        """The error, naming the vehicle unless it names something else."""
        if error.field is None:
            error.field = self.identity.name
        if isinstance(error, LinkError) and self.mavlink_version == 1 and ONLY_MAVLINK_1 not in error.message:
            error.message += f"; {ONLY_MAVLINK_1}"
        return error

    async def _named(self, work: Awaitable[R]) -> R:
        try:
            return await work
        except GcsError as error:
            raise self._about_this(error) from error.__cause__
