"""Everything a flight does is written down here, in the database first and then on the dashboards."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

from gcs.core.clock import utc_now
from gcs.services.live_feed import (
    EventLogged,
    FlightChanged,
    ImageChanged,
    LeaseTold,
    TrackGrew,
    UploadProgressed,
)
from gcs.storage.records import FlightState, ImageRecord, ImageState, TrackPoint

if TYPE_CHECKING:
    from gcs.services.flight_types import LeaseView
    from gcs.services.live_feed import LiveFeed
    from gcs.storage.database import Database
    from gcs.storage.image_parts import ImagePart
    from gcs.storage.image_store import ImageStore, StoredImage
    from gcs.storage.records import FlightEventRecord, FlightRecord

TRACK_INTERVAL_S = 0.2
TRACK_BATCH = 10
NOTICE, WARNING, ERROR = 5, 4, 3


def log_line(
    database: Database, feed: LiveFeed, flight_id: str, kind: str, text: str, *, severity: int = 6, **data: Any
) -> FlightEventRecord:
    """Add a line to a flight's log, and tell everybody."""
    event = database.flights.log(flight_id, kind, text, severity=severity, data=data)
    feed.publish(EventLogged(event))
    return event


class FlightRecorder:
    """The pen of one flight.

    Args:
        flight_id: which flight.
        database: where it is written.
        store: where its pictures are kept.
        feed: the dashboards.
    """

    def __init__(self, flight_id: str, database: Database, store: ImageStore, feed: LiveFeed) -> None:
        self.flight_id = flight_id
        self.database = database
        self._store = store
        self._feed = feed
        self._track: list[TrackPoint] = []
        self._last_track_s = float("-inf")

    @property
    def flight(self) -> FlightRecord:
        """The flight as it is stored."""
        return self.database.flights.get(self.flight_id)

    def log(self, kind: str, text: str, *, severity: int = 6, **data: Any) -> FlightEventRecord:
        """Add a line to the flight's log."""
        return log_line(self.database, self._feed, self.flight_id, kind, text, severity=severity, **data)

    def notice(self, text: str) -> None:
        """Add a line about something that the station changed on the vehicle."""
        self.log("command", text, severity=NOTICE)

    def change(self, **changes: Any) -> FlightRecord:
        """Change fields of the flight and tell everybody."""
        flight = self.database.flights.update(self.flight_id, **changes)
        self._feed.publish(FlightChanged(self.database.flights.summary(self.flight_id)))
        return flight

    def enter(self, state: FlightState, why: str) -> None:
        """Change the flight's state, once."""
        if self.flight.state is not state:
            self.change(state=state)
            self.log("state", f"{state.value}: {why}", severity=NOTICE)

    def problem(self, text: str) -> None:
        """Something went wrong that belongs into the flight's account; said once."""
        problems = self.flight.problems
        if text not in problems:
            self.change(problems=(*problems, text))
            self.log("problem", text, severity=ERROR)

    def upload_progress(self, phase: str, fraction: float) -> None:
        """Tell how far a mission transfer is."""
        self._feed.publish(UploadProgressed(self.flight_id, phase, fraction))

    def tell_lease(self, lease: LeaseView) -> None:
        """Tell where the companion's lease stands; it is not written down."""
        self._feed.publish(LeaseTold(lease))

    def track(self, position_m: tuple[float, float, float], cross_track_m: float) -> None:
        """A position of the vehicle, thinned to a few a second and written in small batches."""
        now = time.time()
        if now - self._last_track_s >= TRACK_INTERVAL_S:
            self._last_track_s = now
            self._track.append(TrackPoint(now, position_m, cross_track_m))
            if len(self._track) >= TRACK_BATCH:
                self.flush()

    def flush(self) -> None:
        """Write what is waiting."""
        if self._track:
            points, self._track = tuple(self._track), []
            self.database.flights.add_track(self.flight_id, points)
            self._feed.publish(TrackGrew(self.flight_id, points))

    def visit(self, viewpoint_id: int, name: str, miss_m: float) -> None:
        """A viewpoint was reached."""
        if self.database.flights.add_visit(self.flight_id, viewpoint_id, miss_m):
            self.log("viewpoint", f"reached {name}, {miss_m:.2f} m from it", viewpoint=viewpoint_id)
            self._feed.publish(FlightChanged(self.database.flights.summary(self.flight_id)))

    def image(self, record: ImageRecord) -> ImageRecord:
        """Write down a new picture; the one that is known already is returned as it is."""
        kept = self.database.images.add(record)
        self._feed.publish(ImageChanged(kept))
        return kept

    def change_image(self, image_id: str, **changes: Any) -> ImageRecord:
        """Change fields of a picture and tell everybody."""
        image = self.database.images.update(image_id, **changes)
        self._feed.publish(ImageChanged(image))
        if image.state is ImageState.STORED:
            self._feed.publish(FlightChanged(self.database.flights.summary(self.flight_id)))
        return image

    async def store_image_aside(self, image: ImageRecord, data: bytes, **announced: int | None) -> ImageRecord:
        """As `store_image`, without holding up the event loop by writing the file."""
        return self._stored(image, await asyncio.to_thread(self._store.save, image, data, **announced))

    def store_image(self, image: ImageRecord, data: bytes, **announced: int | None) -> ImageRecord:
        """Keep a picture's file.

        Args:
            image: which one.
            data: the file.
            announced: `size_bytes` and `crc32` as the vehicle says them, to be checked.

        Raises:
            IncompleteError: it is not whole.
            StorageError: the disk did not take it.
        """
        return self._stored(image, self._store.save(image, data, **announced))

    def _stored(self, image: ImageRecord, stored: StoredImage) -> ImageRecord:
        return self.change_image(
            image.id,
            state=ImageState.STORED,
            file_name=stored.file_name,
            size_bytes=stored.size_bytes,
            crc32=stored.crc32,
            stored_at=utc_now(),
            problem=None,
        )

    def image_part(self, image: ImageRecord) -> ImagePart:
        """Where the pieces of a picture are kept until it is whole."""
        return self._store.part(image)

    def remove_image_parts(self) -> None:
        """Remove the pieces of pictures that were not brought whole by the end of their flight."""
        self._store.remove_parts(but_of={flight.id for flight in self.database.flights.open_flights()})

    def image_data(self, image: ImageRecord) -> bytes:
        """The file of a stored picture."""
        return self._store.path(image).read_bytes()
