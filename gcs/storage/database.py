"""The station's SQLite database: opened, migrated, and its repositories."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import Engine, create_engine, event
from sqlalchemy.orm import Session, sessionmaker

from gcs.storage.errors import database_errors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.storage.dynamics_repository import DynamicsRepository
    from gcs.storage.flight_repository import FlightRepository
    from gcs.storage.image_repository import ImageRepository
    from gcs.storage.job_repository import JobRepository
    from gcs.storage.link_repository import LinkRepository
    from gcs.storage.offer_repository import OfferRepository
    from gcs.storage.plan_repository import PlanRepository
    from gcs.storage.replan_repository import ReplanRepository
    from gcs.storage.structure_repository import StructureRepository

FILE_NAME = "gcs.sqlite3"
BUSY_TIMEOUT_MS = 10_000


def _set_up_connection(connection: Any, record: object) -> None:
    """SQLite's own settings, for each connection: write-ahead log, foreign keys, patience."""
    del record
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.execute(f"PRAGMA busy_timeout={BUSY_TIMEOUT_MS}")
    cursor.close()


class Database:
    """An open database in a data directory; usable from any thread.

    Every call of a repository is one transaction. With the write-ahead log a killed process loses nothing that was
    committed.

    Args:
        directory: the data directory.

    Raises:
        StorageError: the database cannot be opened or migrated.
    """

    def __init__(self, directory: Path) -> None:
        from gcs.storage.dynamics_repository import DynamicsRepository
        from gcs.storage.flight_repository import FlightRepository
        from gcs.storage.image_repository import ImageRepository
        from gcs.storage.job_repository import JobRepository
        from gcs.storage.link_repository import LinkRepository
        from gcs.storage.offer_repository import OfferRepository
        from gcs.storage.plan_repository import PlanRepository
        from gcs.storage.replan_repository import ReplanRepository
        from gcs.storage.structure_repository import StructureRepository

        self.path = directory / FILE_NAME
        self._engine: Engine = create_engine(f"sqlite:///{self.path}")
        event.listen(self._engine, "connect", _set_up_connection)
        self._sessions = sessionmaker(self._engine, expire_on_commit=False)
        with database_errors(self.path):
            migrate(self._engine)
        self.structures: StructureRepository = StructureRepository(self)
        self.plans: PlanRepository = PlanRepository(self)
        self.jobs: JobRepository = JobRepository(self)
        self.links: LinkRepository = LinkRepository(self)
        self.flights: FlightRepository = FlightRepository(self)
        self.images: ImageRepository = ImageRepository(self)
        self.replans: ReplanRepository = ReplanRepository(self)
        self.offers: OfferRepository = OfferRepository(self)
        self.dynamics: DynamicsRepository = DynamicsRepository(self)

    @contextmanager
    def transaction(self) -> Iterator[Session]:
        """One transaction: committed at the end of the `with` block, undone by an error.

        Raises:
            StorageError: the database did not take it.
        """
        with database_errors(self.path), self._sessions.begin() as session:
            yield session

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()


def migrate(engine: Engine) -> None:
    """Bring a database, also an empty one, to the newest form of its tables."""
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
