"""The hub that tells every open dashboard what happens.

Publishing never waits: each client has its own bounded queue, states that are superseded before a client took them are
replaced in place (the latest wins), and a client that is too slow loses its queue and is told to catch up. A message is
rendered once, however many clients there are.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from gcs.services.flight_types import LeaseView
    from gcs.services.plan_service import PlanView
    from gcs.services.replan_difference import ReplanView
    from gcs.services.vehicle_service import LinkView, VehicleText, VehicleView
    from gcs.storage.records import (
        FlightEventRecord,
        FlightOverview,
        ImageRecord,
        JobRecord,
        PlanOfferRecord,
        TrackPoint,
    )

MAX_WAITING = 1000


@dataclass(frozen=True)
class TelemetryChanged:
    """The newest of one vehicle."""

    vehicle: VehicleView


@dataclass(frozen=True)
class LinkChanged:
    """A link was opened, failed or closed."""

    link: LinkView


@dataclass(frozen=True)
class VehicleSaid:
    """A vehicle says something to people."""

    text: VehicleText


@dataclass(frozen=True)
class JobChanged:
    """How far a job is."""

    job: JobRecord


@dataclass(frozen=True)
class PlanChanged:
    """A plan was asked for, made, failed or was cancelled."""

    plan: PlanView


@dataclass(frozen=True)
class PlanDeleted:
    """A plan was deleted."""

    plan_id: str


@dataclass(frozen=True)
class FlightChanged:
    """A flight's state or figures changed."""

    flight: FlightOverview


@dataclass(frozen=True)
class UploadProgressed:
    """How far a mission transfer is; `fraction` from 0 to 1."""

    flight_id: str
    phase: str
    fraction: float


@dataclass(frozen=True)
class TrackGrew:
    """New points of a flown path."""

    flight_id: str
    points: tuple[TrackPoint, ...]


@dataclass(frozen=True)
class EventLogged:
    """A new line of a flight's log."""

    event: FlightEventRecord


@dataclass(frozen=True)
class ImageChanged:
    """A picture was announced, is being fetched, is stored or failed."""

    image: ImageRecord


@dataclass(frozen=True)
class ReplanStored:
    """A detour was reported and stored."""

    replan: ReplanView


@dataclass(frozen=True)
class LeaseTold:
    """A companion tells where its lease stands."""

    lease: LeaseView


@dataclass(frozen=True)
class OfferChanged:
    """A plan for what was skipped is being made, is offered, was decided on or cannot be made."""

    offer: PlanOfferRecord


FeedEvent: TypeAlias = (
    TelemetryChanged
    | LinkChanged
    | VehicleSaid
    | JobChanged
    | PlanChanged
    | PlanDeleted
    | FlightChanged
    | UploadProgressed
    | TrackGrew
    | EventLogged
    | ImageChanged
    | ReplanStored
    | LeaseTold
    | OfferChanged
)


def superseding_key(event: FeedEvent) -> str | None:
    """Name of the state that the event carries in full; a newer event of the same name replaces it."""
    match event:
        case TelemetryChanged(vehicle):
            return f"vehicle {vehicle.identity.system_id}"
        case JobChanged(job):
            return f"job {job.id}"
        case FlightChanged(flight):
            return f"flight {flight.flight.id}"
        case UploadProgressed(flight_id):
            return f"upload {flight_id}"
        case ImageChanged(image):
            return f"image {image.id}"
        case OfferChanged(offer):
            return f"offer {offer.id}"
        case LeaseTold(lease):
            return f"lease {lease.flight_id}"
        case _:
            return None


class LiveClient:
    """One reader of the feed."""

    def __init__(self, limit: int) -> None:
        self._waiting: OrderedDict[str, str] = OrderedDict()
        self._limit = limit
        self._number = 0
        self._ready = asyncio.Event()
        self._overflowed = False

    def offer(self, key: str | None, text: str) -> None:
        """Put a message into the queue; replaces one of the same key where it stands."""
        if self._overflowed:
            return
        self._number += 1
        self._waiting[key or f"#{self._number}"] = text
        if len(self._waiting) > self._limit:
            self._waiting.clear()
            self._overflowed = True
        self._ready.set()

    async def next(self, timeout_s: float) -> str | None:
        """The next message, or None when there was none for `timeout_s`.

        Raises:
            QueueOverflowError: messages were lost; a new snapshot is needed. The queue starts afresh.
        """
        if not self._waiting and not self._overflowed:
            self._ready.clear()
            try:
                await asyncio.wait_for(self._ready.wait(), timeout_s)
            except TimeoutError:
                return None
        if self._overflowed:
            self._overflowed = False
            raise QueueOverflowError
        return self._waiting.popitem(last=False)[1]


class QueueOverflowError(Exception):
    """A client was too slow, and messages to it were dropped."""


class LiveFeed:
    """The hub.

    Args:
        limit: messages that may wait for one client.
    """

    def __init__(self, limit: int = MAX_WAITING) -> None:
        self._limit = limit
        self._clients: list[LiveClient] = []
        self._listeners: list[Callable[[FeedEvent], None]] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._render: Callable[[FeedEvent], str] | None = None

    def open(self, render: Callable[[FeedEvent], str]) -> None:
        """Begin to deliver, in the running event loop; `render` makes the text that is sent."""
        self._loop = asyncio.get_running_loop()
        self._render = render

    def listen(self, listener: Callable[[FeedEvent], None]) -> None:
        """Tell a part of the station of every event, in its event loop."""
        self._listeners.append(listener)

    @property
    def clients(self) -> int:
        """How many are reading."""
        return len(self._clients)

    @contextmanager
    def subscribe(self) -> Iterator[LiveClient]:
        """Read the feed for the time of a `with` block."""
        client = LiveClient(self._limit)
        self._clients.append(client)
        try:
            yield client
        finally:
            self._clients.remove(client)

    def publish(self, event: FeedEvent) -> None:
        """Tell all clients; from any thread, and without effect while nobody listens."""
        if self._loop is None or not (self._clients or self._listeners):
            return
        try:
            running: asyncio.AbstractEventLoop | None = asyncio.get_running_loop()
        except RuntimeError:
            running = None
        if running is self._loop:
            self._deliver(event)
        elif not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._deliver, event)

    def _deliver(self, event: FeedEvent) -> None:
        assert self._render is not None
        for listener in self._listeners:
            listener(event)
        if not self._clients:
            return
        key, text = superseding_key(event), self._render(event)
        for client in self._clients:
            client.offer(key, text)
