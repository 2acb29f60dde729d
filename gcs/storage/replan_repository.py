"""Reported detours in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import select

from gcs.storage.records import ReplanRecord
from gcs.storage.rows import plain, record_of
from gcs.storage.tables import ReplanRow

if TYPE_CHECKING:
    from gcs.core.vehicle import ReplanReport
    from gcs.storage.database import Database


class ReplanRepository:
    """Detours, each stored once."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(
        self,
        flight_id: str,
        system_id: int,
        report: ReplanReport,
        *,
        received_at: str,
        path_m: tuple[tuple[float, float, float], ...],
        matches_plan: bool,
    ) -> tuple[ReplanRecord, bool]:
        """Keep a report; one that is there already (same flight, vehicle, boot and number) is not stored again.

        Returns:
            The stored record and whether it is new.
        """
        query = select(ReplanRow).where(
            ReplanRow.flight_id == flight_id,
            ReplanRow.system_id == system_id,
            ReplanRow.boot_id == report.boot_id,
            ReplanRow.number == report.number,
        )
        with self._database.transaction() as session:
            row = session.scalars(query).first()
            if row is not None:
                return record_of(ReplanRecord, row), False
            row = ReplanRow(
                flight_id=flight_id,
                system_id=system_id,
                boot_id=report.boot_id,
                number=report.number,
                received_at=received_at,
                plan_hash=report.plan_hash,
                reason=report.reason,
                mission_item=report.mission_item,
                left_at_s=report.left_at_s,
                rejoined_at_s=report.rejoined_at_s,
                path_m=plain(path_m),
                matches_plan=matches_plan,
            )
            session.add(row)
            session.flush()
            return record_of(ReplanRecord, row), True

    def of_flight(self, flight_id: str) -> tuple[ReplanRecord, ...]:
        """The detours of a flight, oldest first."""
        query = select(ReplanRow).where(ReplanRow.flight_id == flight_id).order_by(ReplanRow.id)
        with self._database.transaction() as session:
            return tuple(record_of(ReplanRecord, row) for row in session.scalars(query))
