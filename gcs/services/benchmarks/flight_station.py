"""The station of one simulated flight by lease: takes off, orders, waits for the end, and answers reports."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.core.replanning import ReplanReport
from gcs.core.vehicle import Autopilot, FlightMode
from gcs.mavlink.companion_lease import (
    OVER,
    LeaseOrder,
    LeaseOrdering,
    LeaseState,
    LeaseStatus,
    OrderKind,
    lease_status,
)
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.message_rates import request_rates
from gcs.mavlink.report_assembler import (
    AnsweredReport,
    MalformedReport,
    ReportAssembler,
    ReportStatus,
    report_ack,
)
from gcs.mavlink.stepped_channel import SteppedTask
from gcs.mavlink.tunnel_carrier import carried
from gcs.services.companion.own_vehicle import OwnVehicle

if TYPE_CHECKING:
    from gcs.mavlink.dialect import Message
    from gcs.mavlink.transaction import Clock, Send

STATION = (255, 190)
AUTOPILOT = (1, 1)
HEARTBEAT_S = 1.0
READY_S = 4.0
LONGEST_FLIGHT_S = 300.0
LANDED_WITHIN_S = 90.0
REPORTED_WITHIN_S = 30.0
LEASE = 7
RATES_HZ = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 2.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 2.0,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 1.0,
}


class FlightStation:
    """A state machine as the companion is one: told of messages and of time.

    Args:
        autopilot: of the vehicle.
        take_off_amsl_m: where the lease begins.
        plan_hash: what is to be flown.
        send: puts a message on the link.
        clock: seconds of the simulated world.

    Attributes:
        reports: all that came, as often as they were given out.
        by_hand: why the flight had to be ended by hand; None when the lease came to its end.
        over: whether there is nothing more to wait for.
    """

    def __init__(self, autopilot: Autopilot, take_off_amsl_m: float, plan_hash: str, send: Send, clock: Clock) -> None:
        self.reports: list[ReplanReport] = []
        self.by_hand: str | None = None
        self._vehicle = OwnVehicle(autopilot, AUTOPILOT, STATION, send, clock)
        self._take_off_amsl_m = take_off_amsl_m
        self._plan_hash = plan_hash
        self._send, self._clock = send, clock
        self._assembler = ReportAssembler()
        self._lease = LeaseStatus()
        self._beat_at = clock()
        self._task = SteppedTask(self._fly())

    @property
    def over(self) -> bool:
        """See class."""
        return self._task.finished

    @property
    def deadline(self) -> float:
        """When `on_time` wants to be called next."""
        return min(self._beat_at, self._task.deadline)

    def on_time(self) -> None:
        """Called when `deadline` has passed."""
        now = self._clock()
        if now >= self._beat_at:
            self._beat_at = now + HEARTBEAT_S
            kind, none = mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID
            self._send(mavlink.MAVLink_heartbeat_message(kind, none, 0, 0, mavlink.MAV_STATE_ACTIVE, 3))
        if now >= self._task.deadline:
            self._task.on_time()

    def handle(self, message: Message) -> None:
        """Take a message."""
        if message.get_type() == "TUNNEL":
            self._lease = lease_status(message) or self._lease
            self._take_report(message)
        else:
            self._vehicle.handle(message)
        self._task.handle(message)

    def _take_report(self, message: Message) -> None:
        inner = carried(message)
        given = None if inner is None else self._assembler.take(inner)
        if given is None:
            return
        status = ReportStatus.STORED
        if isinstance(given, ReplanReport):
            self.reports.append(given)
        elif isinstance(given, MalformedReport):
            status = ReportStatus.REFUSED
        if not isinstance(given, AnsweredReport):
            self._assembler.answered(given.boot_id, given.number, status)
        self._send(report_ack(given.boot_id, given.number, status, message.get_srcSystem()))

    async def _fly(self) -> None:
        vehicle = self._vehicle
        channel, commands = vehicle.channel, vehicle.commands(lambda: None)
        try:
            await channel.sleep(READY_S)
            await request_rates(channel, RATES_HZ)
            await channel.until(lambda: vehicle.telemetry.home is not None, READY_S, "its home")
            await vehicle.stack.take_off(commands, self._take_off_amsl_m)
            await channel.until(lambda: vehicle.may_be_led, REPORTED_WITHIN_S, "the hover")
            order = LeaseOrder(LEASE, OrderKind.FLY, self._plan_hash)
            await channel.run(LeaseOrdering(order, AUTOPILOT[0], self._send, self._clock))
            await channel.until(lambda: self._lease.state in OVER, LONGEST_FLIGHT_S, "the lease's end")
            if self._lease.state is not LeaseState.FINISHED:
                self.by_hand = self._lease.text
        except GcsError as error:
            self.by_hand = error.message
        try:
            if self.by_hand is not None:
                number = vehicle.stack.custom_mode(FlightMode.RETURN)
                assert number is not None  # both stacks have one
                vehicle.guard.take_back()  # the modes that the companion commanded are another's for this station
                await commands.switch_mode(number)
            await channel.until(self._disarmed, LANDED_WITHIN_S, "the landing")
            await channel.until(lambda: not self._lease.reports_pending, REPORTED_WITHIN_S, "the last report")
        except GcsError as error:
            self.by_hand = self.by_hand or error.message

    def _disarmed(self) -> bool:
        armed = self._vehicle.telemetry.armed
        return armed is not None and not armed.value
