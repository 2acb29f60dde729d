"""The station's side of replanning reports: their messages put together, each report given out until it is answered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TypeVar

from gcs.core.replanning import ReplanReport
from gcs.mavlink.dialect import Message
from gcs.mavlink.replan_messages import (
    MOST_POINTS,
    MOST_VIEWPOINTS,
    MalformedReportError,
    WirePoint,
    WireViewpoint,
    changed_viewpoints,
    piece_points,
    report_of,
)
from gcs.mavlink.tunnel_carrier import replanning, tunnelled

ReportKey = tuple[int, int]
"""Boot id and number."""
T = TypeVar("T")

_OPEN_AT_ONCE = 16
_ANSWERS_KEPT = 256


class ReportStatus(IntEnum):
    """What an acknowledgement of a report says."""

    STORED = 0
    REFUSED = 1


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


@dataclass(frozen=True)
class AnsweredReport:
    """A report that was answered already and comes again: the answer was lost.

    Attributes:
        boot_id: of the report.
        number: of the report.
        status: the answer, to be sent again.
    """

    boot_id: int
    number: int
    status: ReportStatus


def report_ack(boot_id: int, number: int, status: ReportStatus, target_system: int) -> Message:
    """REPLAN_ACK, to whichever component of the vehicle reported; as stored only when the report is in the store."""
    return tunnelled(replanning.MAVLink_replan_ack_message(boot_id, number, status), target_system, 0)


@dataclass
class _Assembly:
    head: Message | None = None
    points: dict[int, WirePoint] = field(default_factory=dict)
    viewpoints: dict[int, WireViewpoint] = field(default_factory=dict)


class ReportAssembler:
    """Puts the messages of one vehicle's reports together, in whatever order they come.

    A report is given out each time it is whole, until `answered` is told. At most 16 reports are under way at once and
    the oldest gives way; what was answered is remembered for the last 256.
    """

    def __init__(self) -> None:
        self._open: dict[ReportKey, _Assembly] = {}
        self._answers: dict[ReportKey, ReportStatus] = {}

    def answered(self, boot_id: int, number: int, status: ReportStatus) -> None:
        """A report was acknowledged: it is not given out any more."""
        self._answers[boot_id, number] = status
        if len(self._answers) > _ANSWERS_KEPT:
            del self._answers[next(iter(self._answers))]

    def take(self, message: Message) -> ReplanReport | MalformedReport | AnsweredReport | None:
        """Take a message of the dialect.

        Returns:
            A report when the message completes one; an answered one when its first message comes again.
        """
        kind = message.get_type()
        if kind not in {"REPLAN_REPORT", "REPLAN_PIECE", "REPLAN_VIEWPOINTS"} or message.number == 0:
            return None
        key = message.boot_id, message.number
        status = self._answers.get(key)
        if status is not None:
            return AnsweredReport(*key, status) if kind == "REPLAN_REPORT" else None
        assembly = self._assembly(key)
        if kind == "REPLAN_PIECE":
            assembly.points.update(_below(MOST_POINTS, piece_points(message)))
        elif kind == "REPLAN_VIEWPOINTS":
            assembly.viewpoints.update(_below(MOST_VIEWPOINTS, changed_viewpoints(message)))
        else:
            assembly.head = message
        return self._given_out(key, assembly)

    def _assembly(self, key: ReportKey) -> _Assembly:
        assembly = self._open.get(key)
        if assembly is None:
            while len(self._open) >= _OPEN_AT_ONCE:
                del self._open[next(iter(self._open))]
            assembly = self._open[key] = _Assembly()
        return assembly

    def _given_out(self, key: ReportKey, assembly: _Assembly) -> ReplanReport | MalformedReport | None:
        head = assembly.head
        if head is None:
            return None
        if head.points > MOST_POINTS or head.viewpoints > MOST_VIEWPOINTS:
            del self._open[key]
            return MalformedReport(*key, "it has too many points or viewpoints")
        points, viewpoints = _all(head.points, assembly.points), _all(head.viewpoints, assembly.viewpoints)
        if points is None or viewpoints is None:
            return None
        del self._open[key]
        try:
            return report_of(head, points, viewpoints)
        except MalformedReportError as error:
            return MalformedReport(*key, str(error))


def _below(most: int, entries: Mapping[int, T]) -> dict[int, T]:
    return {place: entry for place, entry in entries.items() if place < most}


def _all(count: int, entries: Mapping[int, T]) -> list[T] | None:
    """The entries 0 to `count`; None while one of them is missing."""
    if any(place not in entries for place in range(count)):
        return None
    return [entries[place] for place in range(count)]
