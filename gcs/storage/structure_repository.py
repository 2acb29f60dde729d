"""Structures in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import select

from gcs.core.errors import NotFoundError
from gcs.storage.records import StructureRecord
from gcs.storage.rows import columns_of, record_of
from gcs.storage.tables import StructureRow

if TYPE_CHECKING:
    from gcs.storage.database import Database


class StructureRepository:
    """Meshes that were brought in."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: StructureRecord) -> None:
        """Keep a new structure."""
        with self._database.transaction() as session:
            session.add(StructureRow(**columns_of(record)))

    def all(self) -> tuple[StructureRecord, ...]:
        """Newest first."""
        with self._database.transaction() as session:
            rows = session.scalars(select(StructureRow).order_by(StructureRow.created_at.desc()))
            return tuple(record_of(StructureRecord, row) for row in rows)

    def get(self, structure_id: str) -> StructureRecord:
        """One structure.

        Raises:
            NotFoundError: there is none of this name.
        """
        with self._database.transaction() as session:
            row = session.get(StructureRow, structure_id)
            if row is None:
                raise NotFoundError(f"there is no structure {structure_id}", field="structure_id")
            return record_of(StructureRecord, row)

    def delete(self, structure_id: str) -> None:
        """Forget a structure."""
        with self._database.transaction() as session:
            row = session.get(StructureRow, structure_id)
            if row is not None:
                session.delete(row)
