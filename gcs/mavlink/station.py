"""The station's MAVLink side: its links, its heartbeats, and the vehicles that are heard."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Coroutine
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Any

from gcs.core.errors import ConflictError, LinkError, NotFoundError
from gcs.core.vehicle import VehicleIdentity
from gcs.mavlink.dialect import Message
from gcs.mavlink.events import EventStream, StationEvent, TelemetryEvent, VehicleFoundEvent
from gcs.mavlink.heartbeats import INTERVAL_S, LOST_AFTER_S, autopilot_of, is_vehicle, station_heartbeat
from gcs.mavlink.link_base import Link, Peer
from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.links import make_link
from gcs.mavlink.transaction import Clock
from gcs.mavlink.vehicle import Vehicle
from gcs.mavlink.vehicle_channel import VehicleChannel

log = logging.getLogger(__name__)

TICK_S = 0.1
ROUTE_KEPT_S = 1.5
RATE_WINDOW_S = 2.0


@dataclass(frozen=True)
class LinkInfo:
    """An open link, for people.

    Attributes:
        url: in its canonical spelling.
        up: whether bytes can be sent.
        peers: addresses that messages came from, or go to.
        messages_per_s: heard, over the last seconds.
    """

    url: str
    up: bool
    peers: tuple[str, ...]
    messages_per_s: float


@dataclass
class _OpenLink:
    link: Link
    counted_from_s: float
    counted: int = 0
    messages_per_s: float = 0.0


@dataclass
class _Route:
    peer: Peer
    link: Link
    heard_s: float


class MavlinkStation:
    """Opens links, sends heartbeats to every peer, and makes a `Vehicle` of every autopilot that is heard.

    A component that is heard over several ways is listened to, and answered, on the one where it was heard first, until
    that is silent for `ROUTE_KEPT_S`.

    Args:
        system_id: of this station.
        component_id: of this station.
        clock: monotonic seconds.
        lost_after_s: without heartbeats for so long a vehicle's link counts as lost.
        only_system: the one system id that is listened to; others are neither heard nor answered, and nothing is sent
            to an address before it was heard from there. None for all.
    """

    def __init__(
        self,
        system_id: int = 255,
        component_id: int = 190,
        clock: Clock = time.monotonic,
        *,
        lost_after_s: float = LOST_AFTER_S,
        only_system: int | None = None,
    ) -> None:
        self._only_system = only_system
        self._only_peer: Peer | None = None
        self._own = (system_id, component_id)
        self._clock = clock
        self._lost_after_s = lost_after_s
        self._links: dict[str, _OpenLink] = {}
        self._routes: dict[tuple[int, int], _Route] = {}
        self._vehicles: dict[int, Vehicle] = {}
        self._events: EventStream[StationEvent] = EventStream(_newer_telemetry)
        self._ticking: asyncio.Task[None] | None = None
        self._beat_at = float("-inf")
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def vehicles(self) -> dict[int, Vehicle]:
        """The vehicles heard so far, by system id."""
        return dict(self._vehicles)

    @property
    def links(self) -> tuple[LinkInfo, ...]:
        """The open links."""
        return tuple(
            LinkInfo(url, entry.link.up, tuple(peer.name for peer in entry.link.peers), entry.messages_per_s)
            for url, entry in self._links.items()
        )

    def vehicle(self, name: str) -> Vehicle:
        """A vehicle by its name, such as `px4-1`, or its system id.

        Raises:
            NotFoundError: none of that name was heard.
        """
        for vehicle in self._vehicles.values():
            if name.strip() in (vehicle.identity.name, str(vehicle.identity.system_id)):
                return vehicle
        heard = ", ".join(vehicle.identity.name for vehicle in self._vehicles.values()) or "none"
        raise NotFoundError(f"no such vehicle; heard so far: {heard}", field=name)

    def keep_to(self, vehicle: Vehicle) -> None:
        """From now on listen and send to nobody but the address that this vehicle was heard from.

        A system id can be anybody's; who is behind the address is the caller's to have found out.
        """
        route = self._routes.get((vehicle.identity.system_id, vehicle.identity.component_id))
        if route is not None:
            self._only_peer = route.peer
            self._routes = {who: way for who, way in self._routes.items() if way.peer is route.peer}

    async def open(self, url: str) -> str:
        """Open a link; returns its URL in the canonical spelling, with the port that was really bound.

        Raises:
            InputError: not a link URL.
            ConflictError: it is open already.
            LinkError: it cannot be opened.
        """
        address = parse_link_url(url)
        if address.url in self._links:
            raise ConflictError("this link is open already", field=address.url)
        link = make_link(address, self._own, self._heard, self._clock)
        await link.open()
        self._links[link.url] = _OpenLink(link, self._clock())
        if self._ticking is None:
            self._ticking = asyncio.ensure_future(self._tick())
        self._beat(link)
        return link.url

    async def close(self, url: str) -> None:
        """Close a link.

        Raises:
            NotFoundError: it is not open.
        """
        canonical = parse_link_url(url).url
        entry = self._links.pop(canonical, None)
        if entry is None:
            raise NotFoundError("no such link is open", field=url)
        self._routes = {who: route for who, route in self._routes.items() if route.link is not entry.link}
        await entry.link.close()

    async def close_all(self) -> None:
        """Close everything; nothing is sent afterwards, and vehicles are left to themselves."""
        ticking, self._ticking = self._ticking, None
        if ticking is not None:
            ticking.cancel()
            await asyncio.gather(ticking, return_exceptions=True)
        for vehicle in self._vehicles.values():
            await vehicle.close()
        for url in list(self._links):
            await self.close(url)

    def events(self) -> AbstractAsyncContextManager[AsyncIterator[StationEvent]]:
        """Hear of new vehicles and of what happens to each, inside an `async with` block."""
        return self._events.read()

    async def wait_for_vehicle(self, timeout_s: float, system_id: int | None = None) -> Vehicle:
        """Wait until a vehicle is heard; at once when one is connected already.

        Args:
            timeout_s: how long.
            system_id: which; any by default.

        Raises:
            LinkError: nobody answers; names the links.
        """
        async with self.events() as heard:
            try:
                async with asyncio.timeout(timeout_s):
                    while True:
                        for vehicle in self._vehicles.values():
                            if vehicle.connected and system_id in (None, vehicle.identity.system_id):
                                return vehicle
                        await anext(heard)
            except TimeoutError:
                pass
        who = "no vehicle answers" if system_id is None else f"no vehicle with system id {system_id} answers"
        urls = ", ".join(self._links) or "any link, as none is open"
        raise LinkError(f"{who} within {timeout_s:g} s on {urls}; check that it runs and that the URL is right")

    # ---- inside ----

    def _heard(self, link: Link, peer: Peer, message: Message) -> None:
        entry = self._links.get(link.url)
        if entry is not None:
            entry.counted += 1
        system_id, component_id = message.get_srcSystem(), message.get_srcComponent()
        if system_id in (0, self._own[0]) or self._only_system not in (None, system_id):
            return
        if not self._on_route(link, peer, system_id, component_id):
            return
        if message.get_type() == "HEARTBEAT" and is_vehicle(message):
            self._discover(message, link, peer)
        vehicle = self._vehicles.get(system_id)
        if vehicle is None:
            return
        try:
            vehicle.handle(message)
        except Exception:  # untrusted input: a message that cannot be taken must not stop the link
            log.exception("%s: a %s could not be taken", vehicle.identity.name, message.get_type())

    def _on_route(self, link: Link, peer: Peer, system_id: int, component_id: int) -> bool:
        if self._only_peer not in (None, peer):
            return False
        now = self._clock()
        route = self._routes.get((system_id, component_id))
        if route is None or (route.peer is not peer and now - route.heard_s > ROUTE_KEPT_S):
            self._routes[system_id, component_id] = _Route(peer, link, now)
            return True
        if route.peer is not peer:
            return False
        route.heard_s = now
        return True

    def _discover(self, heartbeat: Message, link: Link, peer: Peer) -> None:
        system_id = heartbeat.get_srcSystem()
        known = self._vehicles.get(system_id)
        autopilot = autopilot_of(heartbeat)
        if known is not None and (known.connected or known.identity.autopilot is autopilot):
            return
        identity = VehicleIdentity(system_id, heartbeat.get_srcComponent(), autopilot, int(heartbeat.type))
        target = (system_id, identity.component_id)

        def send(message: Message) -> None:
            wanted = (system_id, getattr(message, "target_component", 0))
            route = self._routes.get(wanted) or self._routes.get(target)
            if route is not None:
                vehicle.passed(route.peer.send(message))

        channel = VehicleChannel(target, self._own, send, self._clock)
        vehicle = Vehicle(identity, channel, lost_after_s=self._lost_after_s)
        vehicle.on_event = lambda event: self._events.publish(StationEvent(system_id, event))
        self._vehicles[system_id] = vehicle
        if known is not None:
            self._spawn(known.close())
        log.info("heard %s on %s from %s", identity.name, link.url, peer.name)
        peer.send(station_heartbeat())
        self._events.publish(StationEvent(system_id, VehicleFoundEvent()))
        vehicle.ask_for_messages()

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _tick(self) -> None:
        while True:
            now = self._clock()
            if now - self._beat_at >= INTERVAL_S:
                self._beat_at = now
                for entry in self._links.values():
                    self._beat(entry.link)
            for entry in self._links.values():
                if now - entry.counted_from_s >= RATE_WINDOW_S:
                    entry.messages_per_s = entry.counted / (now - entry.counted_from_s)
                    entry.counted, entry.counted_from_s = 0, now
            for vehicle in list(self._vehicles.values()):
                vehicle.on_time()
            await asyncio.sleep(TICK_S)

    def _beat(self, link: Link) -> None:
        heard = {id(route.peer) for route in self._routes.values()}
        for peer in link.peers:
            if self._only_peer not in (None, peer) or (self._only_system is not None and id(peer) not in heard):
                continue
            packet = peer.send(station_heartbeat())
            for vehicle in self._vehicles.values():
                route = self._routes.get((vehicle.identity.system_id, vehicle.identity.component_id))
                if route is not None and route.peer is peer:
                    vehicle.passed(packet)


def _newer_telemetry(event: StationEvent, waiting: StationEvent) -> bool:
    same = event.system_id == waiting.system_id
    return same and isinstance(event.event, TelemetryEvent) and isinstance(waiting.event, TelemetryEvent)
