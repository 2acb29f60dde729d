"""What happens to a vehicle or a link, as typed events, and the streams in which they are heard."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeAlias, TypeVar

from gcs.core.replanning import ReplanReport
from gcs.core.vehicle import FlightMode, ImageReport, StatusText, Telemetry
from gcs.mavlink.companion_lease import LeaseStatus
from gcs.mavlink.mission_protocol import MissionType


@dataclass(frozen=True)
class TelemetryEvent:
    """Something of the telemetry changed; a slow reader gets the newest only.

    Told to those who read the vehicle's own events, since telemetry is decoded when it is looked at.
    """

    telemetry: Telemetry


@dataclass(frozen=True)
class StatusTextEvent:
    """The vehicle says something to people."""

    status: StatusText


@dataclass(frozen=True)
class ModeEvent:
    """The vehicle shows another flight mode.

    Attributes:
        commanded: whether this station asked for it.
    """

    mode: FlightMode
    mode_name: str
    commanded: bool


@dataclass(frozen=True)
class ArmedEvent:
    """The vehicle was armed or disarmed, by whomever."""

    armed: bool


@dataclass(frozen=True)
class ImageEvent:
    """The vehicle reports a picture; one that it repeats is told again, with the same index."""

    image: ImageReport


@dataclass(frozen=True)
class ReplanEvent:
    """The vehicle reports that it left its path; complete, checked and not yet acknowledged.

    Whoever stored it answers with `Vehicle.acknowledge_replan`; until then the vehicle sends it again.
    """

    report: ReplanReport


@dataclass(frozen=True)
class LeaseEvent:
    """The vehicle's companion tells where its lease stands; it does so twice a second."""

    status: LeaseStatus


@dataclass(frozen=True)
class ItemReachedEvent:
    """MISSION_ITEM_REACHED; the autopilots repeat some and leave out others."""

    sequence: int


@dataclass(frozen=True)
class CommandProgressEvent:
    """The vehicle is still carrying out a command of the station.

    Attributes:
        command: its name.
        share: that is done, 0 to 1; None when the vehicle does not tell.
    """

    command: str
    share: float | None


@dataclass(frozen=True)
class ListChangedEvent:
    """Somebody else changed one of its lists after the station had proved or read it: what it holds is unknown now."""

    mission_type: MissionType


@dataclass(frozen=True)
class LinkLostEvent:
    """No heartbeat for longer than the time limit; values from before keep their time stamps."""

    silent_s: float


@dataclass(frozen=True)
class LinkBackEvent:
    """Heartbeats are heard again."""

    silent_s: float


@dataclass(frozen=True)
class IdClashEvent:
    """Two vehicles use its system id (`reason` says how that shows), or one does so no more (None)."""

    reason: str | None


@dataclass(frozen=True)
class PilotTookOverEvent:
    """The mode changed without a command of the station, which keeps its hands off until an operator takes back."""

    reason: str


class OffboardEnd(Enum):
    """Why a stream of setpoints ended."""

    STOPPED = "stopped by its owner"
    FINISHED = "its source has no more setpoints"
    COMMANDED = "the station commanded another mode"
    MODE_CHANGED = "the vehicle left the mode without a command of the station"
    DISARMED = "the vehicle is disarmed"
    DEADMAN = "its owner stopped feeding it"
    LINK_LOST = "the vehicle is not heard any more"
    ID_CLASH = "two vehicles use its system id"
    SOURCE_FAILED = "its source of setpoints failed"


@dataclass(frozen=True)
class OffboardEndedEvent:
    """A stream of setpoints ended; no setpoint of it follows."""

    owner: str
    end: OffboardEnd
    detail: str


VehicleEvent: TypeAlias = (
    TelemetryEvent
    | StatusTextEvent
    | ModeEvent
    | ArmedEvent
    | ImageEvent
    | ReplanEvent
    | LeaseEvent
    | ItemReachedEvent
    | CommandProgressEvent
    | ListChangedEvent
    | LinkLostEvent
    | LinkBackEvent
    | IdClashEvent
    | PilotTookOverEvent
    | OffboardEndedEvent
)


@dataclass(frozen=True)
class VehicleFoundEvent:
    """A vehicle was heard for the first time."""


@dataclass(frozen=True)
class StationEvent:
    """An event of one of the station's vehicles."""

    system_id: int
    event: VehicleEvent | VehicleFoundEvent


T = TypeVar("T")
MAX_WAITING = 10_000
"""Events that may wait for a reader; then the oldest are dropped: a flood from outside must not eat the memory."""


class EventStream(Generic[T]):
    """Hands every published event to every open reader.

    Args:
        replaces: tells whether a new event makes the newest waiting one superfluous.
    """

    __slots__ = ("_readers", "_replaces")

    def __init__(self, replaces: Callable[[T, T], bool] | None = None) -> None:
        self._readers: tuple[tuple[deque[T], asyncio.Event], ...] = ()
        self._replaces = replaces

    @property
    def has_readers(self) -> bool:
        """Whether anybody hears."""
        return bool(self._readers)

    def publish(self, event: T) -> None:
        """Hand out an event; to be called in the event loop."""
        for waiting, ready in self._readers:
            if waiting and self._replaces is not None and self._replaces(event, waiting[-1]):
                waiting.pop()
            waiting.append(event)
            ready.set()

    @asynccontextmanager
    async def read(self) -> AsyncIterator[AsyncIterator[T]]:
        """Hear all that is published inside the `async with` block."""
        reader: tuple[deque[T], asyncio.Event] = (deque(maxlen=MAX_WAITING), asyncio.Event())
        self._readers += (reader,)
        try:
            yield self._iterate(*reader)
        finally:
            self._readers = tuple(each for each in self._readers if each is not reader)

    @staticmethod
    async def _iterate(waiting: deque[T], ready: asyncio.Event) -> AsyncIterator[T]:
        while True:
            while waiting:
                yield waiting.popleft()
            ready.clear()
            await ready.wait()


def newer_telemetry(event: object, waiting: object) -> bool:
    """Whether `event` carries all that the waiting one does."""
    return isinstance(event, TelemetryEvent) and isinstance(waiting, TelemetryEvent)
