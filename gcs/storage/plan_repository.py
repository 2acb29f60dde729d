"""Plans in the database."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from gcs.core.errors import ConflictError, NotFoundError
from gcs.storage.records import Failure, PlanRecord, PlanState
from gcs.storage.rows import columns_of
from gcs.storage.tables import FlightRow, PlanRow

if TYPE_CHECKING:
    from gcs.storage.database import Database


def _record(row: PlanRow) -> PlanRecord:
    return PlanRecord(
        id=row.id,
        name=row.name,
        created_at=row.created_at,
        scenario=row.scenario,
        state=PlanState(row.state),
        plan_hash=row.plan_hash,
        report=row.report,
        failure=None if row.failure is None else Failure(**row.failure),
    )


def _row(session: Session, plan_id: str) -> PlanRow:
    row = session.get(PlanRow, plan_id)
    if row is None:
        raise NotFoundError(f"there is no plan {plan_id}", field="plan_id")
    return row


class PlanRepository:
    """Plans that were asked for."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: PlanRecord) -> None:
        """Keep a new plan."""
        with self._database.transaction() as session:
            session.add(PlanRow(**columns_of(record)))

    def all(self) -> tuple[PlanRecord, ...]:
        """Newest first."""
        with self._database.transaction() as session:
            rows = session.scalars(select(PlanRow).order_by(PlanRow.created_at.desc(), PlanRow.id.desc()))
            return tuple(_record(row) for row in rows)

    def get(self, plan_id: str) -> PlanRecord:
        """One plan.

        Raises:
            NotFoundError: there is none of this name.
        """
        with self._database.transaction() as session:
            return _record(_row(session, plan_id))

    def with_hash(self, plan_hash: str) -> PlanRecord:
        """The newest plan whose plan.json has a SHA-256.

        Raises:
            NotFoundError: there is none.
        """
        with self._database.transaction() as session:
            chosen = select(PlanRow).where(PlanRow.plan_hash == plan_hash).order_by(PlanRow.created_at.desc()).limit(1)
            row = session.scalars(chosen).first()
            if row is None:
                raise NotFoundError("there is no plan with this hash", field="plan_hash")
            return _record(row)

    def mark_ready(self, plan_id: str, plan_hash: str, report: dict[str, Any]) -> PlanRecord:
        """Its files are in place."""
        with self._database.transaction() as session:
            row = _row(session, plan_id)
            row.state, row.plan_hash, row.report = PlanState.READY.value, plan_hash, report
            return _record(row)

    def narrow(self, plan_id: str, name: str, scenario: dict[str, Any]) -> PlanRecord:
        """It does a part of what was asked only."""
        with self._database.transaction() as session:
            row = _row(session, plan_id)
            row.name, row.scenario = name, scenario
            return _record(row)

    def mark_ended(self, plan_id: str, state: PlanState, failure: Failure) -> PlanRecord:
        """It will not become ready."""
        with self._database.transaction() as session:
            row = _row(session, plan_id)
            row.state, row.failure = state.value, asdict(failure)
            return _record(row)

    def delete(self, plan_id: str) -> None:
        """Forget a plan.

        Raises:
            NotFoundError: there is none of this name.
            ConflictError: a flight used it, and the flight's records need it.
        """
        with self._database.transaction() as session:
            row = _row(session, plan_id)
            if session.scalars(select(FlightRow.id).where(FlightRow.plan_id == plan_id).limit(1)).first() is not None:
                raise ConflictError("flights of this plan are on record, so it stays", field="plan_id")
            session.delete(row)
