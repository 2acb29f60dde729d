"""Pictures from a card: brought to a flight, matched with its viewpoints, and accounted for.

Names on a card are untrusted and used for nothing but telling people; only regular files that lie directly in the
folder, or in folders below it, are read. A picture that the flight has already, by its CRC-32 and size, is not kept
twice: so a card can be brought again, and pictures that came over the link are recognised.
"""

from __future__ import annotations

import os
import re
import zlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gcs.core.clock import new_id, utc_now
from gcs.core.errors import InputError, NotFoundError
from gcs.services.flight_recorder import NOTICE, FlightRecorder
from gcs.services.image_account import ImageAccounting, scene_position
from gcs.services.image_metadata import read_metadata
from gcs.services.live_feed import LiveFeed
from gcs.storage.data_directory import default_data_directory, owned_data_directory
from gcs.storage.database import Database
from gcs.storage.image_store import ImageStore
from gcs.storage.plan_files import read_plan
from gcs.storage.records import FlightState, ImageRecord, ImageState

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.services.image_account import ImageAccount

MAX_BYTES = 200_000_000
"""A larger file is not a picture of any camera that is flown."""

_NUMBER = re.compile(r"(\d+)\D*$")


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


@dataclass(frozen=True)
class _CardPicture:
    """A whole picture on the card."""

    path: Path
    shown: str
    taken_at: datetime | None
    number: int | None
    position_m: tuple[float, float, float] | None


def import_folder(flight_id: str, folder: Path, data_dir: Path | None) -> ImportResult:
    """Bring the pictures in a folder to a flight.

    Args:
        flight_id: which flight.
        folder: the card, or a copy of it.
        data_dir: of the station; None for the default. No station may be running on it.

    Raises:
        NotFoundError: there is no such flight.
        InputError: there is no such folder, or the flight's plan is not there any more.
        ConflictError: a station is running on the data directory, or the flight is not over.
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
    for number, picture in enumerate(_in_order(folder, plan, skipped)):
        data = _read(picture.path)
        if data is None:
            skipped.append((picture.shown, "it cannot be read"))
        elif _is_here(recorder, data):
            known += 1
        else:
            _store(recorder, picture, number, data)
            stored += 1
    account = ImageAccounting(plan, recorder).settle()
    text = f"{stored} pictures brought from a card, {known} were here already, {len(skipped)} files skipped"
    recorder.log("image", text, severity=NOTICE)
    completed = _complete(recorder, account, {v.viewpoint_id for v in database.flights.visits(flight_id)})
    return ImportResult(
        flight_id, stored, known, tuple(skipped), account.expected, account.missing, account.unmatched, completed
    )


def _in_order(folder: Path, plan: Plan, skipped: list[tuple[str, str]]) -> list[_CardPicture]:
    """The whole pictures in the order they were taken: by the camera's clock, then by the number in the name."""
    pictures = []
    for path in _files(folder):
        shown = _printable(str(path.relative_to(folder)))
        data = _read(path)
        if data is None:
            skipped.append((shown, "it cannot be read, or is too large"))
            continue
        try:
            told = read_metadata(data, shown)
        except InputError as error:
            skipped.append((shown, error.message))
            continue
        number = _NUMBER.search(path.stem)
        position = scene_position(plan, told.position)
        pictures.append(_CardPicture(path, shown, told.taken_at, int(number[1]) if number else None, position))
    by_clock = all(p.taken_at is not None for p in pictures)

    def order(picture: _CardPicture) -> tuple[float, int, str]:
        at = picture.taken_at.timestamp() if by_clock and picture.taken_at is not None else 0.0
        return at, picture.number if picture.number is not None else 0, picture.shown

    return sorted(pictures, key=order)


def _files(folder: Path) -> Iterator[Path]:
    """Regular files, no links, no hidden ones."""
    for parent, folders, names in os.walk(folder):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        for name in sorted(names):
            path = folder.__class__(parent) / name
            if not name.startswith(".") and path.is_file() and not path.is_symlink():
                yield path


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes() if path.stat().st_size <= MAX_BYTES else None
    except OSError:
        return None


def _is_here(recorder: FlightRecorder, data: bytes) -> bool:
    own = (zlib.crc32(data), len(data))
    images = recorder.database.images.of_flight(recorder.flight_id)
    return any(i.state is ImageState.STORED and (i.crc32, i.size_bytes) == own for i in images)


def _store(recorder: FlightRecorder, picture: _CardPicture, number: int, data: bytes) -> None:
    """Keep a picture; a link's record of the same picture, whose file never came, is filled instead of doubled."""
    name = picture.path.name
    waiting = [
        i
        for i in recorder.database.images.unfinished(recorder.flight_id)
        if i.vehicle_path is not None and i.vehicle_path.rsplit("/", 1)[-1] == name
    ]
    image = waiting[0] if len(waiting) == 1 else None
    if image is None:
        image = ImageRecord(
            id=new_id("image"),
            flight_id=recorder.flight_id,
            index=None,
            viewpoint_id=None,
            viewpoint_name=None,
            state=ImageState.ANNOUNCED,
            source="card",
            announced_at=utc_now(),
            vehicle_path=picture.shown,
            vehicle_time_s=None,
            position_m=picture.position_m,
        )
        recorder.image(image)
    recorder.store_image(image, data)


def _complete(recorder: FlightRecorder, account: ImageAccount, reached: set[int]) -> bool:
    """Whether the flight is complete now and was not before; its problems of missing images are then solved."""
    flight = recorder.flight
    if not account.complete or flight.state is not FlightState.INCOMPLETE:
        return False
    recorder.change(problems=tuple(p for p in flight.problems if not p.endswith(".")) if False else flight.problems)
    if len(reached) < flight.viewpoints:
        return False
    recorder.enter(FlightState.COMPLETED, f"{account.received} of {account.expected} images are here, from the card")
    return True


def _printable(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name)[:120]
