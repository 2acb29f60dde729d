"""Pictures in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sqlalchemy import select

from gcs.core.errors import NotFoundError
from gcs.storage.records import ImageRecord, ImageState
from gcs.storage.rows import columns_of, plain, record_of
from gcs.storage.tables import ImageRow

if TYPE_CHECKING:
    from gcs.storage.database import Database


class ImageRepository:
    """Pictures: announced, fetched, stored."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: ImageRecord) -> ImageRecord:
        """Keep a picture; one of the same flight, source and index that is there already is returned as it is."""
        with self._database.transaction() as session:
            if record.index is not None:
                query = select(ImageRow).where(
                    ImageRow.flight_id == record.flight_id,
                    ImageRow.source == record.source,
                    ImageRow.index == record.index,
                )
                known = session.scalars(query).first()
                if known is not None:
                    return record_of(ImageRecord, known)
            session.add(ImageRow(**columns_of(record)))
            return record

    def get(self, image_id: str) -> ImageRecord:
        """One picture.

        Raises:
            NotFoundError: there is none of this name.
        """
        with self._database.transaction() as session:
            row = session.get(ImageRow, image_id)
            if row is None:
                raise NotFoundError(f"there is no image {image_id}", field="image_id")
            return record_of(ImageRecord, row)

    def update(self, image_id: str, **changes: Any) -> ImageRecord:
        """Change fields of a picture.

        Args:
            image_id: which one.
            changes: fields of `ImageRecord`.

        Raises:
            NotFoundError: there is none of this name.
        """
        unknown = changes.keys() - ImageRecord.__dataclass_fields__.keys()
        if unknown:
            raise TypeError(f"not fields of a picture: {', '.join(sorted(unknown))}")
        with self._database.transaction() as session:
            row = session.get(ImageRow, image_id)
            if row is None:
                raise NotFoundError(f"there is no image {image_id}", field="image_id")
            for name, value in changes.items():
                setattr(row, name, plain(value))
            return record_of(ImageRecord, row)

    def of_flight(self, flight_id: str) -> tuple[ImageRecord, ...]:
        """The pictures of a flight in the order of their announcement."""
        query = select(ImageRow).where(ImageRow.flight_id == flight_id).order_by(ImageRow.announced_at, ImageRow.index)
        with self._database.transaction() as session:
            return tuple(record_of(ImageRecord, row) for row in session.scalars(query))

    def unfinished(self, flight_id: str) -> tuple[ImageRecord, ...]:
        """Pictures of a flight that were announced and are not stored, to be fetched (again)."""
        return tuple(i for i in self.of_flight(flight_id) if i.state is not ImageState.STORED)
