"""Links over UDP."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import threading
from dataclasses import replace

from gcs.core.errors import LinkError
from gcs.mavlink.link_base import Link, OnMessage, Outlet, Peer, SocketAddress, error_words, resolve
from gcs.mavlink.link_url import LinkAddress, LinkKind
from gcs.mavlink.transaction import Clock

log = logging.getLogger(__name__)

MAX_PEERS = 256
PEER_FORGOTTEN_S = 120.0
DATAGRAM_SIZE = 65536
DATAGRAMS_AT_ONCE = 64
RECEIVE_BUFFER = 4 << 20
"""Asked of the system, which may give less: half a second of a hundred vehicles."""
THICK_PER_S = 2000.0
"""Where datagrams come this thick, they are let gather: to be woken for each few costs more than to take them in."""
GATHERED = 170
LONGEST_PAUSE_S = 0.02
RATE_WINDOW_S = 0.2


class UdpLink(Link):
    """UDP: `udpin` waits for peers on a port, `udpout` speaks first to one. A peer is an address that was heard."""

    def __init__(self, address: LinkAddress, own: tuple[int, int], on_message: OnMessage, clock: Clock) -> None:
        super().__init__(address, own, on_message, clock)
        self._socket: socket.socket | None = None
        self._closing = threading.Lock()
        self._peers: dict[SocketAddress, Peer] = {}
        self._remote: SocketAddress | None = None
        self._buffer = memoryview(bytearray(DATAGRAM_SIZE))
        self._datagrams = 0
        self._counted_from_s = clock()
        self._pause_s = 0.0

    @property
    def up(self) -> bool:
        """See Link."""
        return self._socket is not None

    @property
    def peers(self) -> list[Peer]:
        """See Link."""
        return list(self._peers.values())

    async def open(self) -> None:
        """See Link."""
        loop = asyncio.get_running_loop()
        family, where = await resolve(self.address, socket.SOCK_DGRAM)
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.setblocking(False)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            if self.address.kind is LinkKind.UDP_IN:
                sock.bind(where)
            else:
                sock.connect(where)
        except OSError as error:
            sock.close()
            why, what = f"cannot send there ({error_words(error)})", "check the address"
            if self.address.kind is LinkKind.UDP_IN:
                why = f"cannot listen there ({error_words(error)})"
                what = "end the program that uses the port, or name another port"
            raise LinkError(f"{why}; {what}", field=self.url) from None
        self._socket = sock
        if self.address.number == 0:
            self.address = replace(self.address, number=int(sock.getsockname()[1]))
        if self.address.kind is LinkKind.UDP_OUT:
            self._remote = sock.getpeername()
            self._peers[self._remote] = self._peer_at(self._remote)
        self._watch(loop)

    async def close(self) -> None:
        """See Link."""
        with self._closing:
            sock, self._socket = self._socket, None
        self._peers.clear()
        if sock is not None:
            asyncio.get_running_loop().remove_reader(sock.fileno())
            sock.close()

    def _duplicate(self) -> int:
        with self._closing:
            if self._socket is None:
                raise OSError("the link is closed")
            return os.dup(self._socket.fileno())

    def _peer_at(self, where: SocketAddress) -> Peer:
        def write(data: bytes) -> None:
            sock = self._socket
            if sock is None:
                return
            try:
                if self._remote is None:
                    sock.sendto(data, where)
                else:
                    sock.send(data)
            except OSError as error:
                log.debug("%s: datagram to %s lost: %s", self.url, where, error)

        outlet = Outlet(self._duplicate, where if self._remote is None else None)
        return self._new_peer(f"{where[0]}:{where[1]}", write, lambda: outlet if self.up else None)

    def _watch(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._socket is not None:
            loop.add_reader(self._socket.fileno(), self._readable)

    def _readable(self) -> None:
        for _ in range(DATAGRAMS_AT_ONCE):
            if self._socket is None:
                return
            try:
                size, where = self._socket.recvfrom_into(self._buffer)
            except OSError:
                self._let_gather(self._socket)
                return
            self._datagrams += 1
            self._datagram(bytes(self._buffer[:size]), where)

    def _let_gather(self, sock: socket.socket) -> None:
        """There is nothing more to read just now: look away for a while, when there soon will be much."""
        now = self._clock()
        counted_s = now - self._counted_from_s
        if counted_s >= RATE_WINDOW_S:
            per_s = self._datagrams / counted_s
            self._pause_s = min(GATHERED / per_s, LONGEST_PAUSE_S) if per_s >= THICK_PER_S else 0.0
            self._datagrams, self._counted_from_s = 0, now
        if self._pause_s > 0.0:
            loop = asyncio.get_running_loop()
            loop.remove_reader(sock.fileno())
            loop.call_later(self._pause_s, self._watch, loop)

    def _datagram(self, data: bytes, where: SocketAddress) -> None:
        peer = self._peers.get(where)
        if peer is not None:
            self._take(peer, peer.parser.feed_datagram(data))
            return
        peer = self._peer_at(where)
        messages = peer.parser.feed_datagram(data)
        if messages and self._has_room():
            self._peers[where] = peer
            self._take(peer, messages)

    def _has_room(self) -> bool:
        now = self._clock()
        if len(self._peers) >= MAX_PEERS or any(self._silent(peer, now) for peer in self._peers.values()):
            self._peers = {
                where: peer
                for where, peer in self._peers.items()
                if where == self._remote or not self._silent(peer, now)
            }
        return len(self._peers) < MAX_PEERS

    @staticmethod
    def _silent(peer: Peer, now: float) -> bool:
        return now - peer.heard_at > PEER_FORGOTTEN_S
