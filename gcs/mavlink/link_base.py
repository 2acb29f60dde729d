"""What every link is: bytes in, messages out, and back to each peer with its own sequence numbers.

Receiving happens in the event loop. Sending may be done from any thread: datagrams and bytes go straight to the
non-blocking socket under a lock. Setpoints are written by another process (`sender_process`), by an `Outlet`.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from gcs.core.errors import LinkError
from gcs.mavlink.dialect import Message
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.link_url import LinkAddress
from gcs.mavlink.received_message import ReceivedMessage
from gcs.mavlink.signing import LinkSigning
from gcs.mavlink.transaction import Clock

CONNECT_S = 5.0
SocketAddress: TypeAlias = tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Outlet:
    """Where the packets for a peer go, for a process that writes them itself; each reconnection makes a new one.

    Attributes:
        duplicate: makes a descriptor of the link's socket or device, for the caller to close; OSError when that is
            closed. From any thread.
        where: address to send to; None when there is only one.
    """

    duplicate: Callable[[], int]
    where: SocketAddress | None


class Peer:
    """One other end of a link, to which messages can be sent from any thread.

    Attributes:
        outlet: tells where the packets go now; None while the link is down.
        link_id: in the signatures of what is sent.
        name: address, for people.
        heard_at: station time of its last good message; minus infinity when it was never heard.
    """

    __slots__ = ("_lock", "_packer", "_signing", "_write", "heard_at", "link_id", "name", "outlet", "parser")

    def __init__(
        self,
        name: str,
        write: Callable[[bytes], None],
        packer: FramePacker,
        outlet: Callable[[], Outlet | None],
        signing: Callable[[], LinkSigning | None] = lambda: None,
        link_id: int = 0,
    ) -> None:
        self.name = name
        self.link_id = link_id
        self.outlet = outlet
        self.heard_at = float("-inf")
        self.parser = FrameParser()
        self._write = write
        self._packer = packer
        self._signing = signing
        self._lock = threading.Lock()

    def send(self, message: Message) -> bytes:
        """Number, pack, sign where the link is signed, and send; it may get lost. Returns the packet."""
        signing = self._signing()
        with self._lock:
            packet = self._packer.pack(message)
            if signing is not None:
                packet = signing.sign(packet, self.link_id)
            self._write(packet)
        return packet

    def sign(self, packet: bytes, stream: int) -> bytes:
        """A packet as it is to be written by somebody else: signed where the link is signed.

        Args:
            packet: as it was packed.
            stream: 1 to 255; among the packets of one stream no signature may be older than one before.
        """
        signing = self._signing()
        return packet if signing is None else signing.sign(packet, stream)

    def send_unsigned(self, message: Message) -> None:
        """Send as somebody without the key would."""
        with self._lock:
            self._write(self._packer.pack(message))


OnMessage: TypeAlias = Callable[["Link", Peer, ReceivedMessage], None]


class Link(ABC):
    """A link that is open.

    Args:
        address: where it leads.
        own: system and component id of this station.
        on_message: called in the event loop for each message heard.
        clock: monotonic seconds.
    """

    def __init__(self, address: LinkAddress, own: tuple[int, int], on_message: OnMessage, clock: Clock) -> None:
        self.address = address
        self._own = own
        self._on_message = on_message
        self._clock = clock
        self.link_id = 0
        """In the signatures of what it sends; each link of a station has its own, as a vehicle keeps one newest time
        stamp for each, and what goes over a slow link comes after what went later over a fast one."""
        self.messages = 0
        """Heard since it was opened, and let in."""
        self.signing: LinkSigning | None = None
        """Signs what goes out and judges what comes in; None while the link is not signed."""

    @property
    def url(self) -> str:
        """Its URL."""
        return self.address.url

    @property
    @abstractmethod
    def up(self) -> bool:
        """Whether bytes can be sent."""

    @property
    @abstractmethod
    def peers(self) -> list[Peer]:
        """Who is to get heartbeats."""

    @abstractmethod
    async def open(self) -> None:
        """Open it.

        Raises:
            LinkError: it cannot be opened; says why and what to do.
        """

    @abstractmethod
    async def close(self) -> None:
        """Close it; nothing is sent or heard afterwards."""

    def _new_peer(self, name: str, write: Callable[[bytes], None], outlet: Callable[[], Outlet | None]) -> Peer:
        return Peer(name, write, FramePacker(*self._own), outlet, lambda: self.signing, self.link_id)

    def _take(self, peer: Peer, messages: list[ReceivedMessage]) -> None:
        if messages:
            peer.heard_at = self._clock()
        signing = self.signing
        for message in messages:
            if signing is None or signing.admits(message):
                self.messages += 1
                self._on_message(self, peer, message)


async def resolve(address: LinkAddress, kind: socket.SocketKind) -> tuple[socket.AddressFamily, SocketAddress]:
    """Family and address of a host and port.

    Raises:
        LinkError: the host is not known.
    """
    loop = asyncio.get_running_loop()
    try:
        found = await loop.getaddrinfo(address.place, address.number, type=kind)
    except (OSError, UnicodeError) as error:
        raise LinkError(f"the host {address.place!r} is not known ({error_words(error)})", field=address.url) from None
    return found[0][0], found[0][4]


def error_words(error: BaseException) -> str:
    """What the system says is wrong."""
    if isinstance(error, TimeoutError):
        return f"no answer for {CONNECT_S:g} s"
    return str(getattr(error, "strerror", None) or error)
