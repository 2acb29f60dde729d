"""Links in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import delete, select

from gcs.core.clock import new_id, utc_now
from gcs.storage.records import LinkRecord
from gcs.storage.rows import record_of
from gcs.storage.tables import LinkRow

if TYPE_CHECKING:
    from gcs.storage.database import Database


class LinkRepository:
    """Links that the operator opened."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, url: str) -> LinkRecord:
        """Keep a link; a URL that is there already keeps its record."""
        with self._database.transaction() as session:
            row = session.scalars(select(LinkRow).where(LinkRow.url == url)).first()
            if row is None:
                row = LinkRow(id=new_id("link"), url=url, created_at=utc_now())
                session.add(row)
            return record_of(LinkRecord, row)

    def all(self) -> tuple[LinkRecord, ...]:
        """Oldest first."""
        with self._database.transaction() as session:
            rows = session.scalars(select(LinkRow).order_by(LinkRow.created_at, LinkRow.id))
            return tuple(record_of(LinkRecord, row) for row in rows)

    def delete(self, link_id: str) -> None:
        """Forget a link."""
        with self._database.transaction() as session:
            session.execute(delete(LinkRow).where(LinkRow.id == link_id))
