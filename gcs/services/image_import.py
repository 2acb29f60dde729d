"""Pictures from a card: brought to a flight, matched with its viewpoints, and accounted for.

Names on a card are untrusted: they are shown to people and used for nothing else. Only regular files in the folder and
below it are read, links are not followed. A picture that the flight has already, by size and CRC-32, is not kept twice,
so a card can be brought again after pictures came over the link.
"""

from __future__ import annotations

import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.core.clock import new_id, utc_now
from gcs.core.errors import InputError
from gcs.services.flight_recorder import NOTICE, FlightRecorder
from gcs.services.image_account import (
    ImageAccounting,
    complete_by_pictures,
    count_pictures_as_visits,
    scene_position,
)
from gcs.services.image_metadata import read_metadata
from gcs.services.live_feed import LiveFeed
from gcs.storage.data_directory import default_data_directory, owned_data_directory
from gcs.storage.database import Database
from gcs.storage.image_store import ImageStore
from gcs.storage.plan_files import read_plan
from gcs.storage.records import ImageRecord, ImageState

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.core.plan import Plan
    from gcs.services.image_metadata import ImageMetadata

MAX_BYTES = 200_000_000
"""A larger file is no picture of any camera that is flown."""
SHOWN_NAME = 120


@dataclass(frozen=True)
class ImportResult:
    """How an import came out.

    Attributes:
        flight_id: the flight.
        stored: pictures that were kept now.
        known: pictures that were there already.
        skipped: file and why, of those that cannot be used.
        expected: pictures that the plan asks for.
        missing: names of the viewpoints that have no picture.
        unmatched: pictures of the flight that belong to no viewpoint.
        completed: whether the flight became complete by it.
    """

    flight_id: str
    stored: int
    known: int
    skipped: tuple[tuple[str, str], ...]
    expected: int
    missing: tuple[str, ...]
    unmatched: int
    completed: bool

    def lines(self) -> list[str]:
        """What to tell the operator."""
        lines = [f"skipped {name}: {why}" for name, why in self.skipped]
        lines.append(f"{self.stored} pictures brought to {self.flight_id}, {self.known} were there already")
        if self.unmatched:
            lines.append(f"{self.unmatched} pictures belong to no viewpoint; they are kept")
        lines.append(f"{self.expected - len(self.missing)} of {self.expected} viewpoints have their picture")
        if self.completed:
            lines.append("the flight is complete")
        return lines


def import_folder(flight_id: str, folder: Path, data_dir: Path | None) -> ImportResult:
    """Bring the pictures in a folder to a flight.

    Args:
        flight_id: which flight.
        folder: the card, or a copy of it.
        data_dir: of the station; None for the default. No station may be running on it.

    Raises:
        NotFoundError: there is no such flight.
        InputError: there is no such folder, or the flight's plan is not there any more.
        ConflictError: a station is running on the data directory.
        StorageError: the disk did not take a picture; what was kept before stays, and the import can be repeated.
    """
    if not folder.is_dir():
        raise InputError("there is no such folder", field=str(folder))
    directory = data_dir or default_data_directory()
    with owned_data_directory(directory):
        database = Database(directory)
        try:
            return _import(flight_id, folder, directory, database)
        finally:
            database.close()


def _import(flight_id: str, folder: Path, directory: Path, database: Database) -> ImportResult:
    flight = database.flights.get(flight_id)
    plan = read_plan(directory / "plans" / flight.plan_id)
    recorder = FlightRecorder(flight_id, database, ImageStore(directory), LiveFeed())
    skipped: list[tuple[str, str]] = []
    stored = known = 0
    for path in _files(folder):
        name = _printable(str(path.relative_to(folder)))
        try:
            data = _read(path)
            metadata = read_metadata(data, name)
        except InputError as error:
            skipped.append((name, error.message))
            continue
        if _is_here(recorder, data):
            known += 1
        else:
            _store(recorder, plan, name, data, metadata)
            stored += 1
    account = ImageAccounting(plan, recorder).settle()
    text = f"{stored} pictures brought from a card, {known} were here already, {len(skipped)} files skipped"
    recorder.log("image", text, severity=NOTICE)
    count_pictures_as_visits(account, plan, recorder)
    return ImportResult(
        flight_id=flight_id,
        stored=stored,
        known=known,
        skipped=tuple(skipped),
        expected=account.expected,
        missing=account.missing,
        unmatched=account.unmatched,
        completed=complete_by_pictures(account, recorder),
    )


def _files(folder: Path) -> Iterator[Path]:
    """Regular files by name; no links, nothing hidden."""
    for parent, folders, names in os.walk(folder):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        for name in sorted(names):
            path = Path(parent) / name
            if not name.startswith(".") and path.is_file() and not path.is_symlink():
                yield path


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"larger than {MAX_BYTES // 10**6} MB")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}") from error


def _is_here(recorder: FlightRecorder, data: bytes) -> bool:
    own = (zlib.crc32(data), len(data))
    images = recorder.database.images.of_flight(recorder.flight_id)
    return any(i.state is ImageState.STORED and (i.crc32, i.size_bytes) == own for i in images)


def _store(recorder: FlightRecorder, plan: Plan, name: str, data: bytes, metadata: ImageMetadata) -> None:
    """Keep a picture; one that was announced over the link and never came is filled instead of doubled."""
    base = name.rsplit("/", 1)[-1]
    unfinished = recorder.database.images.unfinished(recorder.flight_id)
    waiting = [i for i in unfinished if i.vehicle_path is not None and i.vehicle_path.rsplit("/", 1)[-1] == base]
    if len(waiting) == 1:
        image = waiting[0]
    else:
        image = recorder.image(
            ImageRecord(
                id=new_id("image"),
                flight_id=recorder.flight_id,
                index=None,
                viewpoint_id=None,
                viewpoint_name=None,
                state=ImageState.ANNOUNCED,
                source="card",
                announced_at=utc_now(),
                vehicle_path=name,
                position_m=scene_position(plan, metadata.position),
            )
        )
    recorder.store_image(image, data)


def _printable(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name)[-SHOWN_NAME:]
