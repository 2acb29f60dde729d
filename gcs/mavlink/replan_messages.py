"""A replanning report as messages of the dialect, and back (docs/replan_report.md)."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Iterable, Sequence
from dataclasses import replace

from gcs.core.errors import InputError
from gcs.core.frames import GeoPoint
from gcs.core.replanning import ReplanReason, ReplanReport, SeenObstacle, ViewpointChange, ViewpointFate
from gcs.mavlink.dialect import Message
from gcs.mavlink.tunnel_carrier import replanning

MOST_POINTS = 400
MOST_VIEWPOINTS = 2000
_POINTS_EACH = 9
_VIEWPOINTS_EACH = 6
_NEVER_MS = 0xFFFF_FFFF
_COUNTS = struct.Struct("<HH")
_POINT = struct.Struct("<iif")
_VIEWPOINT = struct.Struct("<HBiif")
_MOST_LATITUDE_E7 = 900_000_000
_MOST_LONGITUDE_E7 = 1_800_000_000

WirePoint = tuple[int, int, float]
"""Latitude and longitude (1e-7 deg), altitude above mean sea level (m)."""
WireViewpoint = tuple[int, int, int, int, float]
"""Id, fate, and a `WirePoint` (zeros when there is no place)."""


class MalformedReportError(ValueError):
    """What came is no report; the text says why, in plain words."""


def hash_after(plan_hash: str, path: Sequence[GeoPoint], viewpoints: Sequence[ViewpointChange]) -> str:
    """The chain's next link: `plan_hash_after` of a report with this geometry.

    Args:
        plan_hash: of what was flown before, 64 hex digits.
        path: the piece that was flown instead.
        viewpoints: those that were not taken as planned.
    """
    return _chained(bytes.fromhex(plan_hash), map(_wire_point, path), map(_wire_viewpoint, viewpoints)).hex()


def _chained(before: bytes, points: Iterable[WirePoint], viewpoints: Iterable[WireViewpoint]) -> bytes:
    packed_points = [_POINT.pack(*point) for point in points]
    packed_viewpoints = [_VIEWPOINT.pack(*viewpoint) for viewpoint in viewpoints]
    counts = _COUNTS.pack(len(packed_points), len(packed_viewpoints))
    return hashlib.sha256(b"".join([before, counts, *packed_points, *packed_viewpoints])).digest()


def thinned(report: ReplanReport) -> ReplanReport:
    """The report with no more points than fit on the wire, evenly chosen; both ends stay."""
    path = report.path
    if len(path) <= MOST_POINTS:
        return report
    chosen = (round(k * (len(path) - 1) / (MOST_POINTS - 1)) for k in range(MOST_POINTS))
    return replace(report, path=tuple(path[index] for index in chosen))


def report_messages(report: ReplanReport) -> list[Message]:
    """The messages of a report, to be sent in this order.

    Raises:
        InputError: it does not fit into them.
    """
    if len(report.path) > MOST_POINTS or len(report.viewpoints) > MOST_VIEWPOINTS:
        raise InputError(f"a report has at most {MOST_POINTS} points and {MOST_VIEWPOINTS} viewpoints", field="report")
    obstacle = report.obstacle
    place = (0, 0, 0.0) if obstacle is None else _wire_point(obstacle.place)
    shape = (math.nan, 0.0, 0.0) if obstacle is None else (obstacle.radius_m, *obstacle.velocity_m_s)
    rejoined = report.rejoined_at_s
    messages = [
        replanning.MAVLink_replan_report_message(
            report.boot_id,
            report.number,
            list(bytes.fromhex(report.plan_hash)),
            list(bytes.fromhex(report.plan_hash_after)),
            report.reason,
            report.mission_item,
            round(report.left_at_s * 1e3),
            _NEVER_MS if rejoined is None else round(rejoined * 1e3),
            len(report.path),
            len(report.viewpoints),
            *place,
            *shape,
        )
    ]
    key = report.boot_id, report.number
    points = [_wire_point(point) for point in report.path]
    for first in range(0, len(points), _POINTS_EACH):
        some = points[first : first + _POINTS_EACH]
        columns = _columns(some, _POINTS_EACH)
        messages.append(replanning.MAVLink_replan_piece_message(*key, first, len(some), *columns))
    changes = [_wire_viewpoint(change) for change in report.viewpoints]
    for first in range(0, len(changes), _VIEWPOINTS_EACH):
        chosen = changes[first : first + _VIEWPOINTS_EACH]
        columns = _columns(chosen, _VIEWPOINTS_EACH)
        messages.append(replanning.MAVLink_replan_viewpoints_message(*key, first, len(chosen), *columns))
    return messages


def piece_points(message: Message) -> dict[int, WirePoint]:
    """The points in a REPLAN_PIECE, by their places in the piece."""
    rows = zip(message.lat, message.lon, message.alt, strict=True)
    return dict(zip(range(message.first, message.first + message.count), rows, strict=False))


def changed_viewpoints(message: Message) -> dict[int, WireViewpoint]:
    """The changes in a REPLAN_VIEWPOINTS, by their places in the list."""
    rows = zip(message.viewpoint, message.fate, message.lat, message.lon, message.alt, strict=True)
    return dict(zip(range(message.first, message.first + message.count), rows, strict=False))


def report_of(head: Message, points: Sequence[WirePoint], viewpoints: Sequence[WireViewpoint]) -> ReplanReport:
    """The report of a REPLAN_REPORT and all of its geometry.

    Raises:
        MalformedReportError: something of it is impossible.
    """
    before, after = bytes(head.plan_hash_before), bytes(head.plan_hash_after)
    if _chained(before, points, viewpoints) != after:
        raise MalformedReportError("its geometry is not that of its hash")
    rejoined_ms = None if head.rejoined_ms == _NEVER_MS else head.rejoined_ms
    if rejoined_ms is not None and rejoined_ms < head.left_ms:
        raise MalformedReportError("it ends before it begins")
    try:
        reason = ReplanReason(head.reason)
    except ValueError:
        raise MalformedReportError(f"{head.reason} is no reason") from None
    return ReplanReport(
        boot_id=head.boot_id,
        number=head.number,
        plan_hash=before.hex(),
        plan_hash_after=after.hex(),
        reason=reason,
        mission_item=head.mission_item,
        left_at_s=head.left_ms * 1e-3,
        rejoined_at_s=None if rejoined_ms is None else rejoined_ms * 1e-3,
        obstacle=_obstacle(head),
        path=tuple(_place(point) for point in points),
        viewpoints=tuple(_change(viewpoint) for viewpoint in viewpoints),
    )


def _obstacle(head: Message) -> SeenObstacle | None:
    if math.isnan(head.obstacle_radius):
        return None
    if not (0.0 <= head.obstacle_radius < math.inf) or not math.isfinite(head.obstacle_east + head.obstacle_north):
        raise MalformedReportError("its obstacle is impossible")
    place = _place((head.obstacle_lat, head.obstacle_lon, head.obstacle_alt))
    return SeenObstacle(place, head.obstacle_radius, (head.obstacle_east, head.obstacle_north))


def _change(viewpoint: WireViewpoint) -> ViewpointChange:
    try:
        fate = ViewpointFate(viewpoint[1])
    except ValueError:
        raise MalformedReportError(f"{viewpoint[1]} is no fate of a viewpoint") from None
    return ViewpointChange(viewpoint[0], fate, _place(viewpoint[2:]) if fate is ViewpointFate.MOVED else None)


def _place(point: WirePoint) -> GeoPoint:
    latitude, longitude, altitude_m = point
    if abs(latitude) > _MOST_LATITUDE_E7 or abs(longitude) > _MOST_LONGITUDE_E7 or not math.isfinite(altitude_m):
        raise MalformedReportError("a place in it is impossible")
    return GeoPoint(latitude / 1e7, longitude / 1e7, altitude_m)


def _wire_point(place: GeoPoint) -> WirePoint:
    return round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7), place.altitude_m


def _wire_viewpoint(change: ViewpointChange) -> WireViewpoint:
    place = (0, 0, 0.0) if change.place is None else _wire_point(change.place)
    return change.viewpoint, change.fate, *place


def _columns(rows: Sequence[tuple[float, ...]], count: int) -> list[list[float]]:
    """The arrays of a message: its rows, and zeros up to `count`."""
    filled = [*rows, *([(0,) * len(rows[0])] * (count - len(rows)))]
    return [list(column) for column in zip(*filled, strict=True)]
