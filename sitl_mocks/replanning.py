"""A detour, flown once, and its report: the vehicle's side of `docs/replan_report.md`.

The detour is an upward bump over a stretch of the first long leg after take-off. Deciding on detours is not simulated:
this one is given, so that everything behind a report can be tried.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from sitl_mocks.dialect import AUTOPILOT_COMPONENT, Message, mavlink
from sitl_mocks.scene_frame import e7

if TYPE_CHECKING:
    from sitl_mocks.vehicle import SimulatedVehicle

PAYLOAD_TYPE = 0x8247
HEAD = struct.Struct("<HB")
REPORT, PIECE, ACK = (62470, 153), (62471, 128), (62473, 228)
"""Message number and CRC_EXTRA."""
PLAN_ANNOUNCE, PLAN_ANNOUNCE_ACK = (62474, 63), (62475, 242)
REPORT_BODY = struct.Struct("<IIIiiffffHhHH32s32sB")
PIECE_BODY = struct.Struct("<I9i9i9fHHB")
ACK_BODY = struct.Struct("<IHB")
HASH_BYTES = 32
POINTS_EACH = 9
STANDING_OBSTACLE = 1
RESEND_S = 1.0

HEIGHT_M = 2.0
RISE_S = 1.8
_MAX_LEVEL_S = 1.5
_MIN_SPEED_M_S = 2.0
_MIN_HEIGHT_M = 3.0
_LONG_LEG_M = 10.0
_STEEPEST = 0.8
"""Steeper than this (sine of the slope) a leg is a climb or a descent, and a detour upward would be none."""
_SAMPLE_S = 0.2


class Replanner:
    """Flies the detour, and reports it until the station has acknowledged.

    Args:
        vehicle: that flies it.
        enabled: whether there is a detour at all.
        boot_id: tells the reports of two starts apart.
    """

    def __init__(self, vehicle: SimulatedVehicle, *, enabled: bool, boot_id: int) -> None:
        self._vehicle = vehicle
        self.boot_id = boot_id
        self.plan_hash = bytes(32)
        self._wanted = enabled
        self._phase = "waiting"
        self._phase_s = 0.0
        self._mode = ""
        self._peak_m_s = 0.0
        self._fast_s = 0.0
        self._path: list[Any] = []
        self._left_s = 0.0
        self._item = -1
        self._sampled_s = 0.0
        self._number = 0
        self._pending: dict[int, list[bytes]] = {}
        self._sent_s = 0.0
        self.acknowledged: list[int] = []

    @property
    def on_detour(self) -> bool:
        """Whether the vehicle is off its path now."""
        return self._phase not in {"waiting", "done"}

    def state(self) -> dict[str, Any]:
        """For tests."""
        return {
            "boot_id": self.boot_id,
            "phase": self._phase,
            "reports": self._number,
            "pending": sorted(self._pending),
            "acknowledged": list(self.acknowledged),
            "plan_hash": self.plan_hash.hex(),
        }

    # Flying ----------------------------------------------------------------------------------------------------------

    def tick(self, dt_s: float) -> None:
        """Begin, go on with or end the detour."""
        if not self._wanted and self._phase == "waiting":
            return
        vehicle, airframe = self._vehicle, self._vehicle.airframe
        if self._phase == "waiting":
            if self._long_leg(dt_s):
                self._wanted = False
                self._begin()
            return
        if self._phase == "done":
            return
        self._phase_s += dt_s
        if vehicle.time_s - self._sampled_s >= _SAMPLE_S:
            self._sample()
        if vehicle.mode_name() != self._mode:
            airframe.end_detour()
            self._finish()
            return
        speed = float(np.linalg.norm(airframe.reference_velocity_m_s))
        self._peak_m_s = max(self._peak_m_s, speed)
        slowing = speed < 0.85 * self._peak_m_s
        if self._phase == "rising" and self._phase_s >= RISE_S:
            self._enter("level")
            airframe.level_detour()
        if self._phase == "level" and (slowing or self._phase_s >= _MAX_LEVEL_S):
            self._enter("falling")
            airframe.leave_detour()
        elif self._phase == "falling" and self._phase_s >= RISE_S:
            airframe.end_detour()
            self._finish()

    def _long_leg(self, dt_s: float) -> bool:
        """Whether the vehicle is under way on a leg that is long enough for a detour, as far as it can know."""
        vehicle, airframe = self._vehicle, self._vehicle.airframe
        velocity = airframe.reference_velocity_m_s
        speed = float(np.linalg.norm(velocity))
        onward = abs(float(velocity[2])) < _STEEPEST * speed
        flying = vehicle.in_air and airframe.height_m > _MIN_HEIGHT_M and vehicle.follows_plan()
        if not flying or not onward or speed < _MIN_SPEED_M_S:
            self._fast_s = 0.0
            return False
        if vehicle.flight_item() >= 0:
            return float(np.linalg.norm(airframe.target_m - airframe.position_m)) > _LONG_LEG_M
        # Offboard the leg is not known: fast for a moment and not slowing down is what there is to go by.
        self._fast_s += dt_s
        self._peak_m_s = max(self._peak_m_s, speed)
        return self._fast_s >= 0.3 and speed >= 0.95 * self._peak_m_s

    def _begin(self) -> None:
        vehicle = self._vehicle
        self._mode = vehicle.mode_name()
        self._item = vehicle.flight_item()
        self._left_s = vehicle.time_s
        self._peak_m_s = 0.0
        self._path = []
        self._sample()
        self._enter("rising")
        vehicle.airframe.begin_detour(HEIGHT_M, RISE_S)

    def _enter(self, phase: str) -> None:
        self._phase, self._phase_s = phase, 0.0

    def _sample(self) -> None:
        self._sampled_s = self._vehicle.time_s
        if len(self._path) < 399:
            self._path.append(self._vehicle.airframe.position_m)

    def _finish(self) -> None:
        vehicle = self._vehicle
        self._phase = "done"
        self._path.append(vehicle.airframe.position_m)
        self._number += 1
        points = [vehicle.frame.geo(point) for point in self._path]
        rows = [(e7(p.latitude_deg), e7(p.longitude_deg), p.altitude_m) for p in points]
        self._pending[self._number] = self._report(rows)
        self._sent_s = -RESEND_S

    # Reporting -------------------------------------------------------------------------------------------------------

    def _report(self, rows: list[tuple[int, int, float]]) -> list[bytes]:
        """The payloads of the report; `rows` are latitude and longitude (1e-7 deg) and altitude (m)."""
        before = self.plan_hash
        geometry = struct.pack("<HH", len(rows), 0) + b"".join(struct.pack("<iif", *row) for row in rows)
        after = hashlib.sha256(before + geometry).digest()
        times_ms = round(self._left_s * 1e3), round(self._vehicle.time_s * 1e3)
        no_obstacle = 0, 0, 0.0, math.nan, 0.0, 0.0
        counts = self._number, self._item, len(rows), 0
        payloads = [
            HEAD.pack(*REPORT)
            + REPORT_BODY.pack(self.boot_id, *times_ms, *no_obstacle, *counts, before, after, STANDING_OBSTACLE)
        ]
        for first in range(0, len(rows), POINTS_EACH):
            some = rows[first : first + POINTS_EACH]
            filled = some + [(0, 0, 0.0)] * (POINTS_EACH - len(some))
            columns = (value for column in zip(*filled, strict=True) for value in column)
            body = PIECE_BODY.pack(self.boot_id, *columns, self._number, first, len(some))
            payloads.append(HEAD.pack(*PIECE) + body)
        return payloads

    def resend(self, wall_s: float) -> None:
        """Send all messages of what is not acknowledged, once a second of wall time."""
        if not self._pending or wall_s - self._sent_s < RESEND_S:
            return
        self._sent_s = wall_s
        for payloads in self._pending.values():
            for payload in payloads:
                self._vehicle.broadcast(_tunnel(0, 0, payload), AUTOPILOT_COMPONENT)

    def handle(self, message: Message, send: Callable[[Message], None]) -> None:
        """Take an acknowledgement or the announcement of a plan."""
        payload = bytes(message.payload)[: message.payload_length]
        if message.payload_type != PAYLOAD_TYPE or len(payload) <= HEAD.size:
            return
        kind, body = HEAD.unpack_from(payload), payload[HEAD.size :]
        if kind == ACK:
            boot_id, number, _status = ACK_BODY.unpack_from(body.ljust(ACK_BODY.size, b"\0"))
            if boot_id == self.boot_id and self._pending.pop(number, None) is not None:
                self.acknowledged.append(number)
        elif kind == PLAN_ANNOUNCE:
            self.plan_hash = body.ljust(HASH_BYTES, b"\0")[:HASH_BYTES]
            answer = HEAD.pack(*PLAN_ANNOUNCE_ACK) + self.plan_hash
            send(_tunnel(message.get_srcSystem(), message.get_srcComponent(), answer))


def _tunnel(system: int, component: int, payload: bytes) -> Message:
    return mavlink.MAVLink_tunnel_message(
        system, component, PAYLOAD_TYPE, len(payload), list(payload.ljust(128, b"\0"))
    )
