"""The station's MAVLink side: its links, its heartbeats, and the vehicles that are heard."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Any

from gcs.core.errors import ConflictError, LinkError, NotFoundError
from gcs.core.vehicle import VehicleIdentity
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.events import EventStream, StationEvent, TelemetryEvent, VehicleFoundEvent
from gcs.mavlink.heartbeats import INTERVAL_S, LOST_AFTER_S, autopilot_of, is_vehicle, station_heartbeat
from gcs.mavlink.id_clash import IdClashWatch
from gcs.mavlink.link_base import Link, Peer
from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.links import make_link
from gcs.mavlink.received_message import ReceivedMessage
from gcs.mavlink.routing import WAY_ANSWERS, Component, Routes, Way, WayInfo
from gcs.mavlink.signing import LinkSigning, SigningStatus
from gcs.mavlink.signing_setup import SigningProof, prove_signing, remove_signing, set_up_signing
from gcs.mavlink.transaction import Clock
from gcs.mavlink.vehicle import Vehicle
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.mavlink.vehicle_state import TIME_STAMPED

log = logging.getLogger(__name__)

TICK_S = 0.1
HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
COMPARE_S = 1.0
CLOCK_EVERY_S = 0.1
RATE_WINDOW_S = 2.0
LINK_IDS = 256


@dataclass(frozen=True)
class LinkInfo:
    """An open link, for people.

    Attributes:
        url: in its canonical spelling.
        up: whether bytes can be sent.
        peers: addresses that messages came from, or go to.
        messages_per_s: heard, over the last seconds.
        messages: heard since it was opened.
        signing: how its signing goes; None when it is not signed.
    """

    url: str
    up: bool
    peers: tuple[str, ...]
    messages_per_s: float
    messages: int = 0
    signing: SigningStatus | None = None


@dataclass
class _OpenLink:
    link: Link
    counted_from_s: float
    counted: int = 0
    messages_per_s: float = 0.0


class MavlinkStation:
    """Opens links, sends heartbeats to every peer, and makes a `Vehicle` of every autopilot that is heard.

    A vehicle may be heard over several links (`routing`); what is sent to it goes the best of these ways.

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
        self._routes = Routes(self._way_changed)
        self._clashes: dict[int, IdClashWatch] = {}
        self._not_signed: set[tuple[str, str]] = set()
        self._compared_at = float("-inf")
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
            LinkInfo(
                url,
                entry.link.up,
                tuple(peer.name for peer in entry.link.peers),
                entry.messages_per_s,
                entry.link.messages,
                None if entry.link.signing is None else entry.link.signing.status(),
            )
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
        kept = self._routes.best(_autopilot(vehicle))
        if kept is not None:
            self._only_peer = kept.peer
            self._routes.drop(lambda way: way.peer is not kept.peer)

    def ways(self, vehicle: Vehicle) -> tuple[WayInfo, ...]:
        """The ways on which a vehicle is heard, the one that is used first."""
        now, ways = self._clock(), self._routes.ways(_autopilot(vehicle))
        return tuple(way.info(now, used=way is ways[0]) for way in ways)

    async def open(self, url: str, signing: LinkSigning | None = None) -> str:
        """Open a link; returns its URL in the canonical spelling, with the port that was really bound.

        Args:
            url: of the link.
            signing: signs it from the first packet on.

        Raises:
            InputError: not a link URL.
            ConflictError: it is open already.
            LinkError: it cannot be opened.
        """
        address = parse_link_url(url)
        if address.url in self._links:
            raise ConflictError("this link is open already", field=address.url)
        link = make_link(address, self._own, self._heard, self._clock)
        link.signing = signing
        taken = {entry.link.link_id for entry in self._links.values()}
        link.link_id = min(set(range(LINK_IDS)) - taken, default=0)
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
        self._routes.drop(lambda way: way.link is entry.link)
        await entry.link.close()

    async def set_up_signing(
        self, vehicle: Vehicle, url: str, signing: LinkSigning, keep: Callable[[], None] = lambda: None
    ) -> SigningProof:
        """Give a disarmed vehicle a key, prove it, and have the link signed; errors as of `signing_setup`.

        Args:
            vehicle: must be heard on this link alone, and be alone on it.
            url: of the link.
            signing: what the link is to be signed with.
            keep: keeps the key, before it is sent.
        """
        way = self._only_way(vehicle, url)
        self._must_be_alone(vehicle, way.link)
        return await set_up_signing(vehicle, way.link, way.peer, signing, self._clock, keep)

    async def prove_signing(self, vehicle: Vehicle, url: str) -> SigningProof:
        """See whether a disarmed vehicle goes by the key of a signed link there; errors as of `signing_setup`."""
        way = self._only_way(vehicle, url)
        return await prove_signing(vehicle, way.link, way.peer, self._clock)

    async def remove_signing(self, vehicle: Vehicle, url: str) -> None:
        """Have a disarmed vehicle forget its key, and the link be unsigned; errors as of `signing_setup`."""
        way = self._only_way(vehicle, url)
        self._must_be_alone(vehicle, way.link)
        await remove_signing(vehicle, way.link, way.peer, self._clock)

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

    async def wait_for_vehicle(
        self, timeout_s: float, system_id: int | None = None, *, other_than: Vehicle | None = None
    ) -> Vehicle:
        """Wait until a vehicle is heard; at once when one is connected already.

        Args:
            timeout_s: how long.
            system_id: which; any by default.
            other_than: not this one.

        Raises:
            LinkError: nobody answers; names the links.
        """
        async with self.events() as heard:
            try:
                async with asyncio.timeout(timeout_s):
                    while True:
                        for vehicle in self._vehicles.values():
                            wanted = system_id in (None, vehicle.identity.system_id) and vehicle is not other_than
                            if vehicle.connected and wanted:
                                return vehicle
                        await anext(heard)
            except TimeoutError:
                pass
        who = "no vehicle answers" if system_id is None else f"no vehicle with system id {system_id} answers"
        urls = ", ".join(self._links) or "any link, as none is open"
        raise LinkError(f"{who} within {timeout_s:g} s on {urls}; check that it runs and that the URL is right")

    # ---- inside ----

    def _only_way(self, vehicle: Vehicle, url: str) -> Way:
        """The way over a link; a vehicle's key holds for all its links, so there must not be another."""
        canonical = parse_link_url(url).url
        ways = self._routes.ways(_autopilot(vehicle))
        others = [way.link.url for way in ways if way.link.url != canonical]
        if others:
            words = f"it is heard on {', '.join(others)} too, and a key holds for all its links: close the others first"
            raise ConflictError(words, field=vehicle.identity.name)
        if not ways:
            raise LinkError(f"it is not heard on {canonical}", field=vehicle.identity.name)
        return ways[0]

    def _must_be_alone(self, vehicle: Vehicle, link: Link) -> None:
        """A link has one key, and a vehicle without it is not heard there: one that flies would lose its stream."""
        others = [
            other.identity.name
            for other in self._vehicles.values()
            if other is not vehicle
            and other.connected
            and any(way.link is link for way in self._routes.ways(_autopilot(other)))
        ]
        if others:
            words = f"{', '.join(others)} would not be heard on it any more: open a link of its own for each vehicle"
            raise ConflictError(words, field=link.url)

    def _heard(self, link: Link, peer: Peer, message: ReceivedMessage) -> None:
        system_id = message.from_system
        if system_id in (0, self._own[0]) or self._only_system not in (None, system_id):
            return
        if self._only_peer not in (None, peer):
            return
        component, now = (system_id, message.from_component), peer.heard_at  # just now
        way = self._routes.hear(link, peer, component, now)
        vehicle = self._vehicles.get(system_id)
        if way is None:
            if vehicle is not None:
                self._say_not_signed(vehicle, link)
            return
        if vehicle is not None and component[1] == vehicle.identity.component_id:
            self._watch(vehicle, way, message, now)
        if not self._routes.take(component, way, message, now):
            return
        if message.message_number == HEARTBEAT and is_vehicle(message):
            vehicle = self._discover(message, link, peer)
        if vehicle is None:
            return
        try:
            vehicle.handle(message, now)
        except Exception:  # untrusted input: a message that cannot be taken must not stop the link
            log.exception("%s: a %s could not be taken", vehicle.identity.name, message.get_type())

    def _say_not_signed(self, vehicle: Vehicle, link: Link) -> None:
        """A vehicle is heard on a link without a key, though another link to it has one: said, once."""
        said, best = (vehicle.identity.name, link.url), self._routes.best(_autopilot(vehicle))
        is_so = link.signing is None and best is not None and best.link.signing is not None
        if is_so and said not in self._not_signed:
            self._not_signed.add(said)
            words = "%s is heard on %s too, which is not used for it: another link to it is signed, this one is not"
            log.warning(words, *said)

    def _watch(self, vehicle: Vehicle, way: Way, message: ReceivedMessage, now: float) -> None:
        """Look for a second vehicle with this id, and for answers to what was asked on each way."""
        system_id, kind, number = message.from_system, message.layout.name, message.running_number
        earlier, way.number = way.number, number
        if earlier is not None and (number - earlier) % 256 != 1:
            self._clashes[system_id].jump(way.peer, earlier, number, now)
        if kind in TIME_STAMPED:
            if now - way.clock_read_s >= CLOCK_EVERY_S:
                way.clock_read_s = now
                self._clashes[system_id].clock(message.boot_s, now, vehicle.clock.rate)
        elif kind in WAY_ANSWERS:
            way.hear(message, now)
            if way.unit is not None:
                self._clashes[system_id].unit(way.peer, way.unit, now)

    def _way_changed(self, component: Component, way: Way) -> None:
        vehicle = self._vehicles.get(component[0])
        if vehicle is None or component != _autopilot(vehicle):
            return
        log.info("%s is spoken to on %s (%s) from now on", vehicle.identity.name, way.link.url, way.peer.name)
        if not self._routes.carry_the_same(component[0], self._clock()):
            vehicle.way_changed()

    def _discover(self, heartbeat: ReceivedMessage, link: Link, peer: Peer) -> Vehicle:
        """The vehicle of a heartbeat, which may be a new one."""
        system_id = heartbeat.from_system
        known = self._vehicles.get(system_id)
        autopilot = autopilot_of(heartbeat)
        if known is not None and (known.connected or known.identity.autopilot is autopilot):
            return known
        identity = VehicleIdentity(system_id, heartbeat.from_component, autopilot, int(heartbeat.type))
        target = (system_id, identity.component_id)

        def send(message: Message) -> None:
            wanted = (system_id, getattr(message, "target_component", 0))
            way = self._routes.best(wanted) or self._routes.best(target)
            if way is not None:
                vehicle.passed(way.peer.send(message))

        def peer_now() -> Peer | None:
            way = self._routes.best(target)
            return None if way is None else way.peer

        channel = VehicleChannel(target, self._own, send, self._clock, peer_now)
        vehicle = Vehicle(identity, channel, lost_after_s=self._lost_after_s)
        vehicle.on_event = lambda event: self._events.publish(StationEvent(system_id, event))
        self._vehicles[system_id] = vehicle
        self._clashes[system_id] = IdClashWatch()
        if known is not None:
            self._spawn(known.close())
        log.info("heard %s on %s from %s", identity.name, link.url, peer.name)
        peer.send(station_heartbeat())
        self._events.publish(StationEvent(system_id, VehicleFoundEvent()))
        vehicle.ask_for_messages()
        return vehicle

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
                    entry.messages_per_s = (entry.link.messages - entry.counted) / (now - entry.counted_from_s)
                    entry.counted, entry.counted_from_s = entry.link.messages, now
            if now - self._compared_at >= COMPARE_S:
                self._compared_at = now
                self._compare_ways(now)
            for system_id, vehicle in list(self._vehicles.items()):
                vehicle.tell_id_clash(self._clashes[system_id].reason(now))
                vehicle.on_time()
            await asyncio.sleep(TICK_S)

    def _compare_ways(self, now: float) -> None:
        for vehicle in self._vehicles.values():
            ways = self._routes.ways(_autopilot(vehicle))
            for way in ways if len(ways) > 1 else ():
                way.ask(_autopilot(vehicle), now)
        self._routes.compare(now)

    def _beat(self, link: Link) -> None:
        """Send a heartbeat to every peer of a link; it belongs to the logs of the vehicles that are spoken to there."""
        logged: dict[Peer, list[Vehicle]] = {}
        for vehicle in self._vehicles.values():
            way = self._routes.best(_autopilot(vehicle))
            if way is not None:
                logged.setdefault(way.peer, []).append(vehicle)
        heartbeat = station_heartbeat()
        for peer in link.peers:
            if self._only_peer not in (None, peer) or (self._only_system is not None and not self._routes.heard(peer)):
                continue
            packet = peer.send(heartbeat)
            for vehicle in logged.get(peer, ()):
                vehicle.passed(packet)


def _autopilot(vehicle: Vehicle) -> Component:
    return vehicle.identity.system_id, vehicle.identity.component_id


def _newer_telemetry(event: StationEvent, waiting: StationEvent) -> bool:
    same = event.system_id == waiting.system_id
    return same and isinstance(event.event, TelemetryEvent) and isinstance(waiting.event, TelemetryEvent)
