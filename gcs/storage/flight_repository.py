"""Flights in the database: their state, their log, what was flown, reached and uploaded."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from gcs.core.clock import utc_now
from gcs.core.errors import NotFoundError
from gcs.core.mission import MissionItem
from gcs.storage.records import (
    FlightEventRecord,
    FlightOverview,
    FlightRecord,
    FlightState,
    ImageState,
    TrackPoint,
    UploadRecord,
    UploadState,
    VisitRecord,
)
from gcs.storage.rows import columns_of, plain, record_of
from gcs.storage.tables import FlightEventRow, FlightRow, ImageRow, TrackPointRow, UploadRow, VisitRow

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gcs.storage.database import Database

_OVER = [state.value for state in FlightState if state.over]


def _row(session: Session, flight_id: str) -> FlightRow:
    row = session.get(FlightRow, flight_id)
    if row is None:
        raise NotFoundError(f"there is no flight {flight_id}", field="flight_id")
    return row


def _summary(session: Session, row: FlightRow) -> FlightOverview:
    reached = session.scalar(select(func.count()).select_from(VisitRow).where(VisitRow.flight_id == row.id))
    stored = select(func.count(ImageRow.viewpoint_id.distinct())).where(
        ImageRow.flight_id == row.id, ImageRow.state == ImageState.STORED.value
    )
    return FlightOverview(record_of(FlightRecord, row), reached or 0, session.scalar(stored) or 0)


def _item_columns(item: MissionItem) -> dict[str, Any]:
    """An item as JSON has it, with null for an unset parameter (NaN)."""
    return {**asdict(item), "params": [None if math.isnan(p) else p for p in item.params]}


def _item(columns: dict[str, Any]) -> MissionItem:
    a, b, c, d = (math.nan if p is None else p for p in columns["params"])
    return MissionItem(**{**columns, "params": (a, b, c, d)})


def _upload(row: UploadRow) -> UploadRecord:
    return UploadRecord(
        id=row.id,
        flight_id=row.flight_id,
        state=UploadState(row.state),
        started_at=row.started_at,
        finished_at=row.finished_at,
        items_sent=row.items_sent,
        items_read=row.items_read,
        how=row.how,
        canonical_crc32=row.canonical_crc32,
        items=tuple(_item(columns) for columns in row.items),
        problem=row.problem,
    )


class FlightRepository:
    """Flights and what happened in them."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: FlightRecord) -> None:
        """Keep a new flight."""
        with self._database.transaction() as session:
            session.add(FlightRow(**columns_of(record)))

    def get(self, flight_id: str) -> FlightRecord:
        """One flight.

        Raises:
            NotFoundError: there is none of this name.
        """
        with self._database.transaction() as session:
            return record_of(FlightRecord, _row(session, flight_id))

    def open_flights(self) -> tuple[FlightRecord, ...]:
        """Flights that have not ended, oldest first."""
        query = select(FlightRow).where(FlightRow.state.not_in(_OVER)).order_by(FlightRow.created_at, FlightRow.id)
        with self._database.transaction() as session:
            return tuple(record_of(FlightRecord, row) for row in session.scalars(query))

    def summary(self, flight_id: str) -> FlightOverview:
        """A flight with its counts.

        Raises:
            NotFoundError: there is none of this name.
        """
        with self._database.transaction() as session:
            return _summary(session, _row(session, flight_id))

    def summaries(self) -> tuple[FlightOverview, ...]:
        """All flights with their counts, newest first."""
        query = select(FlightRow).order_by(FlightRow.created_at.desc(), FlightRow.id.desc())
        with self._database.transaction() as session:
            return tuple(_summary(session, row) for row in session.scalars(query).all())

    def update(self, flight_id: str, **changes: Any) -> FlightRecord:
        """Change fields of a flight; `updated_at` follows by itself.

        Args:
            flight_id: which one.
            changes: fields of `FlightRecord`. A state that is over sets `ended_at`.

        Raises:
            NotFoundError: there is none of this name.
        """
        fixed = {"id", "plan_id", "plan_hash", "created_at"} & changes.keys()
        unknown = changes.keys() - FlightRecord.__dataclass_fields__.keys()
        if fixed or unknown:
            raise TypeError(f"not to be changed: {', '.join(sorted(fixed | unknown))}")
        with self._database.transaction() as session:
            row = _row(session, flight_id)
            for name, value in changes.items():
                setattr(row, name, plain(value))
            row.updated_at = utc_now()
            if row.ended_at is None and FlightState(row.state).over:
                row.ended_at = row.updated_at
            return record_of(FlightRecord, row)

    def log(
        self, flight_id: str, kind: str, text: str, *, severity: int = 6, data: dict[str, Any] | None = None
    ) -> FlightEventRecord:
        """Add a line to a flight's log."""
        with self._database.transaction() as session:
            row = FlightEventRow(
                flight_id=flight_id, at=utc_now(), kind=kind, severity=severity, text=text, data=data or {}
            )
            session.add(row)
            session.flush()
            return record_of(FlightEventRecord, row)

    def has_line(self, flight_id: str, text: str) -> bool:
        """Whether a flight's log has this line already."""
        query = select(FlightEventRow.id).where(FlightEventRow.flight_id == flight_id, FlightEventRow.text == text)
        with self._database.transaction() as session:
            return session.scalar(query.limit(1)) is not None

    def events(self, flight_id: str, *, after: int = 0, limit: int = 2000) -> tuple[FlightEventRecord, ...]:
        """Lines of a flight's log with an id over `after`, oldest first.

        Raises:
            NotFoundError: there is no flight of this name.
        """
        query = (
            select(FlightEventRow)
            .where(FlightEventRow.flight_id == flight_id, FlightEventRow.id > after)
            .order_by(FlightEventRow.id)
            .limit(limit)
        )
        with self._database.transaction() as session:
            _row(session, flight_id)
            return tuple(record_of(FlightEventRecord, row) for row in session.scalars(query))

    def add_track(self, flight_id: str, points: Iterable[TrackPoint]) -> None:
        """Add points of the flown path."""
        with self._database.transaction() as session:
            session.add_all(
                TrackPointRow(
                    flight_id=flight_id,
                    at_s=p.at_s,
                    x_m=p.position_m[0],
                    y_m=p.position_m[1],
                    z_m=p.position_m[2],
                    cross_track_m=p.cross_track_m,
                )
                for p in points
            )

    def track(self, flight_id: str, *, after_s: float = 0.0) -> tuple[TrackPoint, ...]:
        """Points of the flown path after a time, oldest first.

        Raises:
            NotFoundError: there is no flight of this name.
        """
        query = (
            select(TrackPointRow)
            .where(TrackPointRow.flight_id == flight_id, TrackPointRow.at_s > after_s)
            .order_by(TrackPointRow.at_s, TrackPointRow.id)
        )
        with self._database.transaction() as session:
            _row(session, flight_id)
            return tuple(
                TrackPoint(row.at_s, (row.x_m, row.y_m, row.z_m), row.cross_track_m) for row in session.scalars(query)
            )

    def add_visit(self, flight_id: str, viewpoint_id: int, miss_m: float | None) -> bool:
        """Record that a viewpoint was reached; of several times the smallest miss stays.

        Returns:
            Whether it was reached for the first time.
        """
        with self._database.transaction() as session:
            row = session.get(VisitRow, (flight_id, viewpoint_id))
            if row is None:
                session.add(VisitRow(flight_id=flight_id, viewpoint_id=viewpoint_id, at=utc_now(), miss_m=miss_m))
                return True
            if miss_m is not None and (row.miss_m is None or miss_m < row.miss_m):
                row.miss_m = miss_m
            return False

    def visits(self, flight_id: str) -> tuple[VisitRecord, ...]:
        """Viewpoints that were reached, by id."""
        query = select(VisitRow).where(VisitRow.flight_id == flight_id).order_by(VisitRow.viewpoint_id)
        with self._database.transaction() as session:
            _row(session, flight_id)
            return tuple(record_of(VisitRecord, row) for row in session.scalars(query))

    def begin_upload(self, flight_id: str, items_sent: int) -> UploadRecord:
        """An upload begins; it counts for nothing until `end_upload`."""
        with self._database.transaction() as session:
            row = UploadRow(
                flight_id=flight_id,
                state=UploadState.RUNNING.value,
                started_at=utc_now(),
                finished_at=None,
                items_sent=items_sent,
                items_read=0,
                how="",
                canonical_crc32=None,
                items=[],
                problem=None,
            )
            session.add(row)
            session.flush()
            return _upload(row)

    def end_upload(
        self,
        upload_id: int,
        state: UploadState,
        *,
        items_read: int = 0,
        how: str = "",
        canonical_crc32: int | None = None,
        items: Iterable[MissionItem] = (),
        problem: str | None = None,
    ) -> UploadRecord:
        """How an upload ended, and what was read back.

        Raises:
            NotFoundError: there is no such upload.
        """
        with self._database.transaction() as session:
            row = session.get(UploadRow, upload_id)
            if row is None:
                raise NotFoundError(f"there is no upload {upload_id}", field="upload_id")
            row.state, row.finished_at, row.problem = state.value, utc_now(), problem
            row.items_read, row.how, row.canonical_crc32 = items_read, how, canonical_crc32
            row.items = [_item_columns(item) for item in items]
            return _upload(row)

    def latest_upload(self, flight_id: str) -> UploadRecord | None:
        """The latest upload of a flight."""
        query = select(UploadRow).where(UploadRow.flight_id == flight_id).order_by(UploadRow.id.desc()).limit(1)
        with self._database.transaction() as session:
            row = session.scalars(query).first()
            return None if row is None else _upload(row)

    def mark_uploads_interrupted(self) -> int:
        """At the start of a station: uploads that were under way proved nothing.

        Returns:
            How many it was.
        """
        with self._database.transaction() as session:
            rows = session.scalars(select(UploadRow).where(UploadRow.state == UploadState.RUNNING.value)).all()
            for row in rows:
                row.state, row.finished_at = UploadState.INTERRUPTED.value, utc_now()
                row.problem = "the station ended in mid-upload: what the vehicle holds is not known until it is read"
            return len(rows)
