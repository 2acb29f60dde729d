"""Background jobs in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import select

from gcs.core.clock import utc_now
from gcs.core.errors import NotFoundError
from gcs.storage.records import JobRecord, JobState, PlanState
from gcs.storage.rows import columns_of, record_of
from gcs.storage.tables import JobRow, PlanRow

if TYPE_CHECKING:
    from gcs.storage.database import Database

_NOT_OVER = [state.value for state in JobState if not state.over]


class JobRepository:
    """Jobs, and what became of them."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: JobRecord) -> None:
        """Keep a new job."""
        with self._database.transaction() as session:
            session.add(JobRow(**columns_of(record)))

    def running(self) -> tuple[JobRecord, ...]:
        """Jobs that are queued or running."""
        with self._database.transaction() as session:
            rows = session.scalars(select(JobRow).where(JobRow.state.in_(_NOT_OVER)))
            return tuple(record_of(JobRecord, row) for row in rows)

    def latest(self) -> dict[str, JobRecord]:
        """The latest job of every plan, by plan id."""
        with self._database.transaction() as session:
            rows = session.scalars(select(JobRow).order_by(JobRow.created_at, JobRow.id))
            return {row.plan_id: record_of(JobRecord, row) for row in rows}

    def latest_of_plan(self, plan_id: str) -> JobRecord | None:
        """The latest job of a plan."""
        query = select(JobRow).where(JobRow.plan_id == plan_id).order_by(JobRow.created_at.desc(), JobRow.id.desc())
        with self._database.transaction() as session:
            row = session.scalars(query.limit(1)).first()
            return None if row is None else record_of(JobRecord, row)

    def update(self, job_id: str, state: JobState, stage: str, fraction: float) -> JobRecord:
        """Set how far a job is; one that is over gets the time of its end.

        Raises:
            NotFoundError: there is none of this name.
        """
        with self._database.transaction() as session:
            row = session.get(JobRow, job_id)
            if row is None:
                raise NotFoundError(f"there is no job {job_id}", field="job_id")
            row.state, row.stage, row.fraction = state.value, stage, fraction
            if state.over:
                row.finished_at = utc_now()
            return record_of(JobRecord, row)

    def mark_interrupted(self) -> int:
        """At the start of a station: what was running when the last one ended is not running any more.

        Returns:
            How many jobs it was.
        """
        failure = {
            "title": "Interrupted",
            "message": "the station ended while this was planned: plan it again",
            "field": None,
        }
        with self._database.transaction() as session:
            rows = session.scalars(select(JobRow).where(JobRow.state.in_(_NOT_OVER))).all()
            for row in rows:
                row.state, row.finished_at = JobState.INTERRUPTED.value, utc_now()
            for plan in session.scalars(select(PlanRow).where(PlanRow.state == PlanState.PLANNING.value)):
                plan.state, plan.failure = PlanState.INTERRUPTED.value, failure
            return len(rows)
