"""Replanning reports in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import select

from gcs.storage.records import ReplanObstacle, ReplanRecord, ViewpointFateName, ViewpointFateRecord
from gcs.storage.rows import columns_of, frozen
from gcs.storage.tables import ReplanRow

if TYPE_CHECKING:
    from gcs.storage.database import Database


def _record(row: ReplanRow) -> ReplanRecord:
    obstacle = row.obstacle
    return ReplanRecord(
        id=row.id,
        flight_id=row.flight_id,
        system_id=row.system_id,
        boot_id=row.boot_id,
        number=row.number,
        received_at=row.received_at,
        plan_hash=row.plan_hash,
        reason=row.reason,
        mission_item=row.mission_item,
        left_at_s=row.left_at_s,
        rejoined_at_s=row.rejoined_at_s,
        path_m=frozen(row.path_m),
        plan_hash_after=row.plan_hash_after,
        obstacle=None if obstacle is None else ReplanObstacle(**{k: frozen(v) for k, v in obstacle.items()}),
        viewpoints=tuple(
            ViewpointFateRecord(v["viewpoint_id"], ViewpointFateName(v["fate"]), frozen(v["position_m"]))
            for v in row.viewpoints
        ),
    )


class ReplanRepository:
    """Reports, each stored once."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: ReplanRecord) -> tuple[ReplanRecord, bool]:
        """Keep a report, under a new id; one of the same vehicle, boot and number is not stored again, in no flight.

        Returns:
            The stored record and whether it is new.
        """
        query = select(ReplanRow).where(
            ReplanRow.system_id == record.system_id,
            ReplanRow.boot_id == record.boot_id,
            ReplanRow.number == record.number,
        )
        with self._database.transaction() as session:
            row = session.scalars(query).first()
            if row is not None:
                return _record(row), False
            columns = columns_of(record)
            del columns["id"]
            row = ReplanRow(**columns)
            session.add(row)
            session.flush()
            return _record(row), True

    def of_flight(self, flight_id: str) -> tuple[ReplanRecord, ...]:
        """The reports of a flight, as they came."""
        query = select(ReplanRow).where(ReplanRow.flight_id == flight_id).order_by(ReplanRow.id)
        with self._database.transaction() as session:
            return tuple(_record(row) for row in session.scalars(query))

    def of_boot(self, system_id: int, boot_id: int) -> tuple[ReplanRecord, ...]:
        """The reports of one boot of a vehicle, of all its flights, by their numbers."""
        query = select(ReplanRow).where(ReplanRow.system_id == system_id, ReplanRow.boot_id == boot_id)
        with self._database.transaction() as session:
            return tuple(_record(row) for row in session.scalars(query.order_by(ReplanRow.number)))
