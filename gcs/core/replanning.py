"""What a vehicle tells of a departure from its plan."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs.core.frames import GeoPoint


class ReplanReason(IntEnum):
    """Why a vehicle left its plan; the values are those on the wire."""

    STANDING_OBSTACLE = 1
    MOVING_OBSTACLE = 2
    HELD = 3
    BACKED_OFF = 4
    VIEWPOINT_BLOCKED = 5
    NO_PICTURE = 6
    LEASE_ENDED = 7

    @property
    def words(self) -> str:
        """For people."""
        return _WORDS[self]


_WORDS = {
    ReplanReason.STANDING_OBSTACLE: "an obstacle that is not in the plan's scene",
    ReplanReason.MOVING_OBSTACLE: "a moving obstacle",
    ReplanReason.HELD: "it waited in place, there was no safe way",
    ReplanReason.BACKED_OFF: "it gave way to something that came closer",
    ReplanReason.VIEWPOINT_BLOCKED: "a viewpoint could not be reached",
    ReplanReason.NO_PICTURE: "no picture was announced",
    ReplanReason.LEASE_ENDED: "the flight ended before the plan did",
}


class ViewpointFate(IntEnum):
    """What became of a viewpoint that was not taken as planned; the values are those on the wire."""

    SKIPPED = 1
    MOVED = 2


@dataclass(frozen=True)
class SeenObstacle:
    """An upright cylinder that the vehicle saw in its way.

    Attributes:
        place: its middle, at the height at which it was seen.
        radius_m: of the cylinder.
        velocity_m_s: to the east and to the north.
    """

    place: GeoPoint
    radius_m: float
    velocity_m_s: tuple[float, float]


@dataclass(frozen=True)
class ViewpointChange:
    """A viewpoint that was not taken as planned.

    Attributes:
        viewpoint: its id in the plan.
        fate: what became of it.
        place: where the picture was taken instead; None when it was skipped.
    """

    viewpoint: int
    fate: ViewpointFate
    place: GeoPoint | None


@dataclass(frozen=True)
class ReplanReport:
    """One departure from the plan, from leaving it until it was joined again (docs/replan_report.md).

    Attributes:
        boot_id: random number that the reporter drew at start, so that the numbers of two starts are told apart.
        number: running number of its reports in this boot, from 1.
        plan_hash: SHA-256 of what it was flying, 64 hex digits: of plan.json, or `plan_hash_after` of the report
            before; all zeros when it was told no plan.
        plan_hash_after: SHA-256 over `plan_hash` and this report's geometry, so that a missing report shows.
        reason: why.
        mission_item: sequence of the mission item it was flying to; -1 when it flies no mission.
        left_at_s: the vehicle's clock (s since boot) when it left the plan.
        rejoined_at_s: the same when it was back on it; None when it did not come back.
        obstacle: what was in the way; None when that is not known.
        path: the piece that was flown instead, from where it left to where it came back.
        viewpoints: those that were not taken as planned.
    """

    boot_id: int
    number: int
    plan_hash: str
    plan_hash_after: str
    reason: ReplanReason
    mission_item: int
    left_at_s: float
    rejoined_at_s: float | None
    obstacle: SeenObstacle | None
    path: tuple[GeoPoint, ...]
    viewpoints: tuple[ViewpointChange, ...]
