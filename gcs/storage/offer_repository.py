"""Offered plans in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sqlalchemy import select

from gcs.core.errors import NotFoundError
from gcs.storage.records import Failure, OfferState, PlanOfferRecord
from gcs.storage.rows import columns_of, frozen, plain
from gcs.storage.tables import PlanOfferRow

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

    from gcs.storage.database import Database


def _record(row: PlanOfferRow) -> PlanOfferRecord:
    return PlanOfferRecord(
        id=row.id,
        flight_id=row.flight_id,
        state=OfferState(row.state),
        created_at=row.created_at,
        viewpoints=frozen(row.viewpoints),
        names=frozen(row.names),
        length_m=row.length_m,
        duration_s=row.duration_s,
        decided_at=row.decided_at,
        plan_id=row.plan_id,
        failure=None if row.failure is None else Failure(**row.failure),
    )


def _row(session: Session, offer_id: str) -> PlanOfferRow:
    row = session.get(PlanOfferRow, offer_id)
    if row is None:
        raise NotFoundError(f"there is no offer {offer_id}", field="offer_id")
    return row


class OfferRepository:
    """Plans that were offered for what flights skipped."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: PlanOfferRecord) -> None:
        """Keep a new offer."""
        with self._database.transaction() as session:
            session.add(PlanOfferRow(**columns_of(record)))

    def get(self, offer_id: str) -> PlanOfferRecord:
        """One offer.

        Raises:
            NotFoundError: there is none of this name.
        """
        with self._database.transaction() as session:
            return _record(_row(session, offer_id))

    def of_flight(self, flight_id: str) -> tuple[PlanOfferRecord, ...]:
        """The offers of a flight, oldest first."""
        query = select(PlanOfferRow).where(PlanOfferRow.flight_id == flight_id)
        with self._database.transaction() as session:
            rows = session.scalars(query.order_by(PlanOfferRow.created_at, PlanOfferRow.id))
            return tuple(_record(row) for row in rows)

    def in_state(self, state: OfferState) -> tuple[PlanOfferRecord, ...]:
        """All offers that stand so."""
        query = select(PlanOfferRow).where(PlanOfferRow.state == state.value)
        with self._database.transaction() as session:
            return tuple(_record(row) for row in session.scalars(query))

    def update(self, offer_id: str, **changes: Any) -> PlanOfferRecord:
        """Change fields of an offer.

        Raises:
            NotFoundError: there is none of this name.
        """
        with self._database.transaction() as session:
            row = _row(session, offer_id)
            for name, value in changes.items():
                setattr(row, name, plain(value))
            return _record(row)
