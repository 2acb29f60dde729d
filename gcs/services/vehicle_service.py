"""Links and vehicles of the running station: opened, watched, and told to the dashboards."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from gcs.core.clock import utc_now
from gcs.core.errors import GcsError, LinkError, NotFoundError
from gcs.mavlink.events import StatusTextEvent
from gcs.mavlink.link_url import parse_link_url
from gcs.services.link_signing import LinkSigningService
from gcs.services.live_feed import LinkChanged, LiveFeed, TelemetryChanged, VehicleSaid
from gcs.storage.records import LinkRecord

if TYPE_CHECKING:
    from gcs.core.vehicle import Telemetry, VehicleIdentity
    from gcs.mavlink.link_quality import LinkQuality
    from gcs.mavlink.routing import WayInfo
    from gcs.mavlink.signing import SigningStatus
    from gcs.mavlink.signing_setup import SigningProof
    from gcs.mavlink.station import MavlinkStation
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.sighted_flight import SightedFlight
    from gcs.storage.database import Database
    from gcs.storage.signing_keys import SigningKeyStore

PUBLISH_S = 0.2
"""Telemetry goes to the dashboards at most this often."""
REFRESH_S = 1.0
"""Ages and link quality are told again at least this often."""
MAX_MESSAGES = 300
"""Messages kept of each vehicle; those of a flight are also in its log."""


@dataclass(frozen=True)
class LinkView:
    """A link and whether it is open."""

    link: LinkRecord
    state: Literal["open", "down", "failed", "closed"]
    """`down`: opened, but the other side is away, and it is tried again; `failed`: it could not be opened."""
    problem: str | None = None
    messages_per_s: float | None = None
    peers: tuple[str, ...] = ()
    signing: SigningStatus | None = None
    """How its signing goes; None when it is not signed."""


@dataclass(frozen=True)
class VehicleView:
    """A vehicle at one moment."""

    identity: VehicleIdentity
    telemetry: Telemetry
    connected: bool
    last_heard_s: float | None
    link_quality: LinkQuality
    flight_id: str | None
    now_s: float
    """The station's monotonic time, from which ages are counted."""
    id_clash: str | None = None
    """How two vehicles with its system id were told apart; None while there is but one."""
    mavlink_version: int | None = None
    ways: tuple[WayInfo, ...] = ()
    """The links on which it is heard, the one that is used first."""
    position_source: str | None = None
    """Where it has its position from while it has no fix of its own and is looked at by another vehicle."""


@dataclass(frozen=True)
class VehicleText:
    """A message of a vehicle for people; severity 0 emergency to 7 debug."""

    number: int
    vehicle: str
    at: str
    severity: int
    text: str


class VehicleService:
    """Owns the MAVLink station.

    Args:
        database: where links are kept.
        feed: the dashboards.
        station: the MAVLink side.
        links: URLs to open besides those of the database; not kept.
        keys: of signed links; None where no link is signed.
    """

    def __init__(
        self,
        database: Database,
        feed: LiveFeed,
        station: MavlinkStation,
        links: tuple[str, ...] = (),
        keys: SigningKeyStore | None = None,
    ) -> None:
        self.station = station
        self._signing = None if keys is None else LinkSigningService(station, keys)
        self._database = database
        self._feed = feed
        self._given = tuple(LinkRecord(f"given-{i}", url, utc_now()) for i, url in enumerate(links))
        self._links: dict[str, LinkView] = {}
        self._opened: dict[str, str] = {}
        self._messages: dict[int, deque[VehicleText]] = {}
        self._message_count = 0
        self._flights: dict[int, str] = {}
        self._sighted: dict[int, SightedFlight] = {}
        self._tasks: list[asyncio.Task[None]] = []

    async def open(self, *, stored_links: bool = True) -> None:
        """Listen, and open the given links and those of earlier runs; nothing but heartbeats is sent by itself.

        Args:
            stored_links: whether the links of earlier runs are opened too.
        """
        self._tasks = [
            asyncio.create_task(self._publish_telemetry(), name="publish telemetry"),
            asyncio.create_task(self._collect_messages(), name="collect vehicle messages"),
        ]
        for link in (*self._given, *(self._database.links.all() if stored_links else ())):
            await self._open(link)

    async def close(self) -> None:
        """Stop listening and close all links."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.station.close_all()

    def links(self) -> tuple[LinkView, ...]:
        """All links, with those that failed."""
        opened = {info.url: info for info in self.station.links}
        views = []
        for view in self._links.values():
            info = opened.get(self._opened.get(view.link.id, ""))
            if info is None:
                views.append(view)
            else:
                state: Literal["open", "down"] = "open" if info.up else "down"
                views.append(
                    replace(
                        view,
                        state=state,
                        messages_per_s=info.messages_per_s,
                        peers=info.peers,
                        signing=info.signing,
                    )
                )
        return tuple(views)

    async def open_link(self, url: str) -> LinkView:
        """Open a link and keep it for the next start; one that is open already stays as it is.

        Raises:
            InputError: the URL is malformed.
            LinkError: it cannot be opened.
        """
        canonical = parse_link_url(url).url
        for view in self.links():
            if self._opened.get(view.link.id) == canonical or view.link.url == canonical:
                if view.state == "failed":
                    break
                return view
        opened = await self._open_url(canonical)
        link = self._database.links.add(canonical)
        self._opened[link.id] = opened
        return self._show(LinkView(link, "open"))

    async def close_link(self, link_id: str) -> None:
        """Close a link and forget it.

        Raises:
            NotFoundError: there is none of this name.
        """
        view = self._links.get(link_id)
        if view is None:
            raise NotFoundError(f"there is no link {link_id}", field="link_id")
        opened = self._opened.pop(link_id, None)
        if opened is not None:
            await self.station.close(opened)
        self._database.links.delete(link_id)
        self._show(replace(view, state="closed"))
        del self._links[link_id]

    async def set_up_signing(self, link_id: str, vehicle: str, *, rejects_unsigned: bool) -> SigningProof:
        """Give a vehicle a new key over a link; errors as of `LinkSigningService.set_up`."""
        signing, url = self._signing_of(link_id)
        return await signing.set_up(vehicle, url, rejects_unsigned=rejects_unsigned)

    async def remove_signing(self, link_id: str, vehicle: str) -> None:
        """Have a vehicle forget its key; errors as of `LinkSigningService.remove`."""
        signing, url = self._signing_of(link_id)
        await signing.remove(vehicle, url)

    def link(self, link_id: str) -> LinkView:
        """A link.

        Raises:
            NotFoundError: there is none of this name.
        """
        for view in self.links():
            if view.link.id == link_id:
                return view
        raise NotFoundError(f"there is no link {link_id}", field="link_id")

    def _signing_of(self, link_id: str) -> tuple[LinkSigningService, str]:
        self.link(link_id)
        opened = self._opened.get(link_id)
        if opened is None or self._signing is None:
            raise LinkError("this link is not open", field=link_id)
        return self._signing, opened

    def vehicle(self, name: str) -> Vehicle:
        """A vehicle by its name or bare system id.

        Raises:
            NotFoundError: none of this name was heard.
        """
        return self.station.vehicle(name)

    def vehicle_view(self, name: str) -> VehicleView:
        """A vehicle as it is now.

        Raises:
            NotFoundError: none of this name was heard.
        """
        return self._view(self.vehicle(name))

    def vehicles(self) -> tuple[VehicleView, ...]:
        """All vehicles heard since the start, by system id."""
        return tuple(self._view(vehicle) for _, vehicle in sorted(self.station.vehicles.items()))

    def messages(self, name: str) -> tuple[VehicleText, ...]:
        """The latest messages of a vehicle, oldest first.

        Raises:
            NotFoundError: none of this name was heard.
        """
        return tuple(self._messages.get(self.vehicle(name).identity.system_id, ()))

    def set_flight(self, system_id: int, flight_id: str | None) -> None:
        """Say which flight a vehicle is on; shown with its telemetry."""
        self._sighted.pop(system_id, None)
        if flight_id is None:
            self._flights.pop(system_id, None)
        else:
            self._flights[system_id] = flight_id

    def set_position_source(self, system_id: int, sighted: SightedFlight) -> None:
        """Say what positions a vehicle on its flight, where it has no fix; shown with its telemetry."""
        self._sighted[system_id] = sighted

    async def _open(self, link: LinkRecord) -> None:
        try:
            self._opened[link.id] = await self._open_url(link.url)
        except GcsError as error:
            self._show(LinkView(link, "failed", error.message))
        else:
            self._show(LinkView(link, "open"))

    async def _open_url(self, url: str) -> str:
        return await (self.station.open(url) if self._signing is None else self._signing.open(url))

    def _show(self, view: LinkView) -> LinkView:
        self._links[view.link.id] = view
        self._feed.publish(LinkChanged(view))
        return view

    def _view(self, vehicle: Vehicle) -> VehicleView:
        sighted = self._sighted.get(vehicle.identity.system_id)
        return VehicleView(
            identity=vehicle.identity,
            telemetry=vehicle.telemetry,
            connected=vehicle.connected,
            last_heard_s=vehicle.last_heard_s,
            link_quality=vehicle.link_quality,
            flight_id=self._flights.get(vehicle.identity.system_id),
            now_s=time.monotonic(),
            id_clash=vehicle.id_clash,
            mavlink_version=vehicle.mavlink_version,
            ways=self.station.ways(vehicle),
            position_source=None if sighted is None else sighted.source,
        )

    async def _publish_telemetry(self) -> None:
        told: dict[int, VehicleView] = {}
        while True:
            for view in self.vehicles():
                last = told.get(view.identity.system_id)
                if last is None or _differs(view, last) or view.now_s - last.now_s >= REFRESH_S:
                    told[view.identity.system_id] = view
                    self._feed.publish(TelemetryChanged(view))
            await asyncio.sleep(PUBLISH_S)

    async def _collect_messages(self) -> None:
        async with self.station.events() as events:
            async for heard in events:
                if isinstance(heard.event, StatusTextEvent):
                    self._collect(heard.system_id, heard.event)

    def _collect(self, system_id: int, event: StatusTextEvent) -> None:
        vehicle = self.station.vehicles.get(system_id)
        name = vehicle.identity.name if vehicle is not None else str(system_id)
        self._message_count += 1
        text = VehicleText(self._message_count, name, utc_now(), event.status.severity, event.status.text)
        self._messages.setdefault(system_id, deque(maxlen=MAX_MESSAGES)).append(text)
        self._feed.publish(VehicleSaid(text))


def _differs(a: VehicleView, b: VehicleView) -> bool:
    return (a.telemetry is not b.telemetry) or (a.connected, a.flight_id) != (b.connected, b.flight_id)
