"""What a replanning report changed of its plan: which piece was left out, for what, and whether the plan is known."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.paths.string_pulling import path_length
from gcs.storage.records import ReplanRecord, ViewpointFateName

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from gcs.core.plan import Plan
    from gcs.storage.database import Database
    from gcs.storage.records import FlightRecord, ViewpointFateRecord

SAMPLE_S = 0.1
NEAR_M = 1.0
"""Times at which the plan passes where it was left are all looked at, as long as they are this near to the nearest."""
SECOND_M = 0.05
"""What a second of difference between the piece left out and the piece flown weighs beside metres off the plan."""
DRAWN_POINTS = 120


class Chain(StrEnum):
    """What is known of the plan that a report says it left."""

    KNOWN = "known"
    """The flight's plan, or what an earlier report made of it."""
    GAP = "gap"
    """What a report made of it that is not here (yet)."""
    UNKNOWN = "unknown"
    """A plan that the station does not have."""


@dataclass(frozen=True, eq=False)
class PlanPiece:
    """A piece of a plan.

    Attributes:
        from_s: plan time at its beginning.
        to_s: plan time at its end.
        path_m: scene ENU, shape (N, 3).
        length_m: along the plan's curve.
    """

    from_s: float
    to_s: float
    path_m: NDArray[np.float64]
    length_m: float

    @property
    def duration_s(self) -> float:
        """How long the plan takes for it."""
        return self.to_s - self.from_s


@dataclass(frozen=True)
class ReplanView:
    """A stored report as a difference from its plan.

    Attributes:
        record: as it is stored.
        chain: what is known of the plan that was left.
        left_out: the piece of the plan that was not flown; None when the plan is not known.
        flown_length_m: of the piece that was flown instead.
        viewpoint_names: of the viewpoints that the report names, in its order; None for one that the plan has not, and
            for those of a plan that is not known.
    """

    record: ReplanRecord
    chain: Chain
    left_out: PlanPiece | None
    flown_length_m: float
    viewpoint_names: tuple[str | None, ...]

    @property
    def flown_duration_s(self) -> float | None:
        """How long the piece took; None when the vehicle did not come back to the plan."""
        r = self.record
        return None if r.rejoined_at_s is None else r.rejoined_at_s - r.left_at_s


def differences(
    plan: Plan, plan_hash: str, records: Sequence[ReplanRecord], is_stored: Callable[[int, int], bool]
) -> list[ReplanView]:
    """All reports of a flight as differences from its plan.

    Args:
        plan: of the flight.
        plan_hash: SHA-256 of its plan.json.
        records: in the order in which they came.
        is_stored: whether the report of a boot id and number is here, in whatever flight.
    """
    names = {v.id: v.name for v in plan.viewpoints}
    views: list[ReplanView] = []
    finder = _PieceFinder(plan)
    since_s = 0.0
    previous: ReplanView | None = None
    for record in _in_order(records):
        chain = _chain(record, previous, plan_hash, is_stored)
        comparable = chain is not Chain.UNKNOWN and record.path_m
        left_out = finder.find(record, since_s) if comparable else None
        if left_out is not None:
            since_s = left_out.to_s
        previous = ReplanView(
            record,
            chain,
            left_out,
            path_length(np.array(record.path_m).reshape(-1, 3)),
            tuple(None if chain is Chain.UNKNOWN else names.get(v.viewpoint_id) for v in record.viewpoints),
        )
        views.append(previous)
    return views


def differences_of_flight(database: Database, plan: Plan, flight: FlightRecord) -> list[ReplanView]:
    """The stored reports of a flight as differences from its plan."""
    records = database.replans.of_flight(flight.id)
    boots = {record.boot_id for record in records}
    stored = {(boot, r.number) for boot in boots for r in database.replans.of_boot(records[0].system_id, boot)}
    return differences(plan, flight.plan_hash, records, lambda boot, number: (boot, number) in stored)


def viewpoint_fates(views: Iterable[ReplanView]) -> dict[int, ViewpointFateName]:
    """What became of viewpoints of the plan, as last told; reports of a plan that nobody knows tell nothing of this."""
    return {viewpoint: change.fate for viewpoint, change in _last_told(views).items()}


def moved_places(database: Database, plan: Plan, flight: FlightRecord) -> dict[int, tuple[float, float, float]]:
    """By viewpoint id from where pictures were taken instead, scene ENU (m), as far as the flight's reports tell."""
    told = (change.fate for record in database.replans.of_flight(flight.id) for change in record.viewpoints)
    if ViewpointFateName.MOVED not in told:
        return {}
    last = _last_told(differences_of_flight(database, plan, flight))
    return {v: c.position_m for v, c in last.items() if c.fate is ViewpointFateName.MOVED and c.position_m is not None}


def _last_told(views: Iterable[ReplanView]) -> dict[int, ViewpointFateRecord]:
    known = [view.record for view in views if view.chain is not Chain.UNKNOWN]
    return {change.viewpoint_id: change for record in known for change in record.viewpoints}


def _in_order(records: Sequence[ReplanRecord]) -> list[ReplanRecord]:
    """By boots as they began to tell, and by numbers in each: one that came late stands where it belongs."""
    boots = list(dict.fromkeys(record.boot_id for record in records))
    return sorted(records, key=lambda r: (boots.index(r.boot_id), r.number))


def _chain(
    record: ReplanRecord, previous: ReplanView | None, plan_hash: str, is_stored: Callable[[int, int], bool]
) -> Chain:
    if record.plan_hash == plan_hash:
        return Chain.KNOWN
    if previous is not None and previous.record.plan_hash_after == record.plan_hash:
        return Chain.UNKNOWN if previous.chain is Chain.UNKNOWN else Chain.KNOWN
    if record.number > 1 and not is_stored(record.boot_id, record.number - 1):
        return Chain.GAP
    return Chain.UNKNOWN


class _PieceFinder:
    """Finds where on a plan a detour left it and came back, by place, and by time where the plan passes twice."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        duration_s = plan.trajectory.duration_s
        self._times = np.linspace(0.0, duration_s, max(2, int(np.ceil(duration_s / SAMPLE_S)) + 1))
        self._curve = plan.trajectory.value(self._times)

    def find(self, record: ReplanRecord, since_s: float) -> PlanPiece:
        """The piece that a report leaves out, none of it before `since_s` (where an earlier one came back)."""
        times, curve = self._times, self._curve
        changed = {v.viewpoint_id for v in record.viewpoints}
        changed_s = [v.time_s for v in self._plan.viewpoints if v.id in changed]
        latest_start = min([times[-1], *changed_s])
        first = int(np.searchsorted(times, min(since_s, latest_start)))
        last = max(int(np.searchsorted(times, latest_start, side="right")), first + 1)
        earliest_end = max([0.0, *changed_s])
        off_start = np.linalg.norm(curve - np.array(record.path_m[0]), axis=1)
        off_end = np.linalg.norm(curve - np.array(record.path_m[-1]), axis=1)
        end = len(times) - 1
        best = (np.inf, first, end)
        for start in _nearest_passes(off_start[first:last]) + first:
            if record.rejoined_at_s is not None:
                k = max(int(np.searchsorted(times, earliest_end)), start)
                flown_s = record.rejoined_at_s - record.left_at_s
                cost = off_end[k:] + SECOND_M * np.abs(times[k:] - times[start] - flown_s)
                end = k + int(np.argmin(cost))
                best = min(best, (float(off_start[start] + cost[end - k]), int(start), end))
            else:
                best = min(best, (float(off_start[start]), int(start), end))
        _, start, end = best
        shown = np.linspace(times[start], times[end], min(DRAWN_POINTS, max(end - start + 1, 2)))
        return PlanPiece(
            float(times[start]),
            float(times[end]),
            self._plan.trajectory.value(shown),
            path_length(curve[start : end + 1]),
        )


def _nearest_passes(distances: NDArray[np.float64]) -> NDArray[np.intp]:
    """Where a distance along a curve has a minimum that is about as small as the smallest."""
    padded = np.concatenate([[np.inf], distances, [np.inf]])
    minima = (distances <= padded[:-2]) & (distances <= padded[2:])
    return np.flatnonzero(minima & (distances <= distances.min() + NEAR_M))
