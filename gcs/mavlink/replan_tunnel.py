"""Replanning reports in TUNNEL messages, as docs/replan_report.md describes them."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, field
from enum import IntEnum

from gcs.core.errors import OperationCancelled
from gcs.core.frames import GeoPoint
from gcs.core.vehicle import ReplanReport
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.transaction import Clock, Send, Transaction

PAYLOAD_TYPE = 0x8247
_MAGIC = b"GR"
_VERSION = 1
_HEADER = struct.Struct("<2sBBIHBB")
_BODY_HEAD = struct.Struct("<32shddB")
_POINT = struct.Struct("<iif")
_MOST_FRAGMENTS = 64
_MOST_REASON = 200
_MOST_POINTS = 400
_TUNNEL_BYTES = 128
_REPORTS_AT_ONCE = 16


class Kind(IntEnum):
    """What a payload is."""

    REPORT = 1
    REPORT_ACK = 2
    PLAN_ANNOUNCE = 3
    PLAN_ANNOUNCE_ACK = 4


class ReportStatus(IntEnum):
    """What an acknowledgement of a report says."""

    STORED = 0
    REFUSED = 1


@dataclass(frozen=True)
class TunnelHeader:
    """The 12 bytes before every payload."""

    kind: int
    boot_id: int = 0
    number: int = 0
    fragment: int = 0
    fragments: int = 1

    def encode(self) -> bytes:
        """The bytes."""
        return _HEADER.pack(_MAGIC, _VERSION, self.kind, self.boot_id, self.number, self.fragment, self.fragments)


@dataclass(frozen=True)
class MalformedReport:
    """A report that came whole and cannot be read; it is to be acknowledged as refused.

    Attributes:
        boot_id: of the report.
        number: of the report.
        problem: what is wrong, in plain words.
    """

    boot_id: int
    number: int
    problem: str


def split_payload(message: Message) -> tuple[TunnelHeader, bytes] | None:
    """Header and rest of a TUNNEL message; None when it is not one of these or malformed."""
    if message.get_type() != "TUNNEL" or message.payload_type != PAYLOAD_TYPE:
        return None
    length = message.payload_length
    if not _HEADER.size <= length <= _TUNNEL_BYTES:
        return None
    raw = bytes(message.payload)[:length]
    magic, version, kind, boot_id, number, fragment, fragments = _HEADER.unpack_from(raw)
    if magic != _MAGIC or version != _VERSION:
        return None
    return TunnelHeader(kind, boot_id, number, fragment, fragments), raw[_HEADER.size :]


def tunnel_message(header: TunnelHeader, body: bytes, target_system: int, target_component: int) -> Message:
    """TUNNEL with a header and a body of at most 116 bytes."""
    raw = header.encode() + body
    return mavlink.MAVLink_tunnel_message(
        target_system, target_component, PAYLOAD_TYPE, len(raw), list(raw.ljust(_TUNNEL_BYTES, b"\0"))
    )


def report_ack(boot_id: int, number: int, status: ReportStatus, target_system: int, target_component: int) -> Message:
    """REPORT_ACK: to be sent as stored only when the report is in the store."""
    header = TunnelHeader(Kind.REPORT_ACK, boot_id, number)
    return tunnel_message(header, bytes([status]), target_system, target_component)


@dataclass
class _Assembly:
    fragments: int
    parts: dict[int, bytes] = field(default_factory=dict)


class ReportAssembler:
    """Puts the fragments of one vehicle's reports together.

    A report is given out every time it is complete: a vehicle that did not hear the acknowledgement sends it again, and
    is to be acknowledged again. At most 16 reports are under way at once, the oldest gives way.
    """

    def __init__(self) -> None:
        self._open: dict[tuple[int, int], _Assembly] = {}

    def take(self, message: Message) -> ReplanReport | MalformedReport | None:
        """Take a message; returns a report when it completes one."""
        split = split_payload(message)
        if split is None:
            return None
        header, part = split
        if header.kind != Kind.REPORT or header.number == 0:
            return None
        if not (1 <= header.fragments <= _MOST_FRAGMENTS and header.fragment < header.fragments and part):
            return None
        key = (header.boot_id, header.number)
        assembly = self._open.get(key)
        if assembly is None or assembly.fragments != header.fragments:
            self._open.pop(key, None)
            while len(self._open) >= _REPORTS_AT_ONCE:
                del self._open[next(iter(self._open))]
            assembly = self._open[key] = _Assembly(header.fragments)
        assembly.parts[header.fragment] = part
        if len(assembly.parts) < assembly.fragments:
            return None
        del self._open[key]
        return decode_report(*key, b"".join(assembly.parts[i] for i in range(assembly.fragments)))


def decode_report(boot_id: int, number: int, body: bytes) -> ReplanReport | MalformedReport:
    """Read the whole body of a report."""

    def malformed(problem: str) -> MalformedReport:
        return MalformedReport(boot_id, number, problem)

    if len(body) < _BODY_HEAD.size + 2 + 4:
        return malformed("it is too short")
    if zlib.crc32(body[:-4]) != struct.unpack("<I", body[-4:])[0]:
        return malformed("its checksum does not agree")
    plan_hash, item, left_at_s, rejoined_at_s, reason_length = _BODY_HEAD.unpack_from(body)
    points_at = _BODY_HEAD.size + reason_length
    if reason_length > _MOST_REASON or len(body) < points_at + 2 + 4:
        return malformed("its reason is too long")
    try:
        reason = body[_BODY_HEAD.size : points_at].decode()
    except UnicodeDecodeError:
        return malformed("its reason is not UTF-8")
    (count,) = struct.unpack_from("<H", body, points_at)
    if not 2 <= count <= _MOST_POINTS or len(body) != points_at + 2 + count * _POINT.size + 4:
        return malformed("the number of points does not fit")
    if not (math.isfinite(left_at_s) and math.isfinite(rejoined_at_s) and 0 <= left_at_s <= rejoined_at_s):
        return malformed("its times are impossible")
    path = []
    for latitude, longitude, altitude_m in _POINT.iter_unpack(body[points_at + 2 : -4]):
        if abs(latitude) > 900_000_000 or abs(longitude) > 1_800_000_000 or not math.isfinite(altitude_m):
            return malformed("a point is impossible")
        path.append(GeoPoint(latitude / 1e7, longitude / 1e7, altitude_m))
    return ReplanReport(
        boot_id=boot_id,
        number=number,
        plan_hash=plan_hash.hex(),
        reason="".join(c if c.isprintable() else " " for c in reason),
        mission_item=item,
        left_at_s=left_at_s,
        rejoined_at_s=rejoined_at_s,
        path=tuple(path),
    )


class PlanAnnouncement(Transaction[bool]):
    """Tell a vehicle the hash of the plan that it is about to fly.

    Ends with True when the vehicle acknowledged it, with False when it did not answer five times: most vehicles know
    no replanning, and fly all the same.

    Args:
        plan_hash: SHA-256 of plan.json, 64 hex digits.
        target_system: system id of the vehicle.
        target_component: its autopilot.
        send: puts a message on the link.
        clock: monotonic seconds.
        retry_s: pause between two tries.
        tries: how often it is sent.
    """

    def __init__(
        self,
        plan_hash: str,
        target_system: int,
        target_component: int,
        send: Send,
        clock: Clock,
        *,
        retry_s: float = 1.0,
        tries: int = 5,
    ) -> None:
        super().__init__(send, clock)
        self._hash = bytes.fromhex(plan_hash)
        if len(self._hash) != 32:
            raise ValueError("a plan hash has 64 hex digits")
        self._target = (target_system, target_component)
        self._retry_s = retry_s
        self._left = tries
        self._deadline = clock()

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        return self._deadline

    def start(self) -> None:
        """Send it."""
        self._left -= 1
        self._send(tunnel_message(TunnelHeader(Kind.PLAN_ANNOUNCE), self._hash, *self._target))
        self._deadline = self._clock() + self._retry_s

    def handle(self, message: Message) -> None:
        """Take the acknowledgement, if it is of this plan."""
        if self.finished or message.get_srcSystem() != self._target[0]:
            return
        split = split_payload(message)
        if split is not None and split[0].kind == Kind.PLAN_ANNOUNCE_ACK and split[1][:32] == self._hash:
            self._succeed(True)

    def on_time(self) -> None:
        """Send it again, or go on without."""
        if self.finished:
            return
        if self._left <= 0:
            self._succeed(False)
        else:
            self.start()

    def cancel(self) -> None:
        """Stop asking."""
        self._fail(OperationCancelled("announcing the plan was cancelled"))
