"""Links with one peer over bytes in order: TCP and serial."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import threading
from abc import abstractmethod
from typing import Any

from gcs.core.errors import LinkError
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.link_base import CONNECT_S, Link, OnMessage, Outlet, Peer, error_words, resolve
from gcs.mavlink.link_url import LinkAddress
from gcs.mavlink.transaction import Clock

log = logging.getLogger(__name__)

RECONNECT_S = 1.0
MAX_UNSENT = 256 * 1024
READ_SIZE = 65536


class StreamLink(Link):
    """A link with one peer over a file descriptor that carries bytes in order; it is opened again when it breaks."""

    def __init__(self, address: LinkAddress, own: tuple[int, int], on_message: OnMessage, clock: Clock) -> None:
        super().__init__(address, own, on_message, clock)
        self._lock = threading.Lock()
        self._unsent = bytearray()
        self._descriptor: int | None = None
        self._outlet: Outlet | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._reopening: asyncio.Task[None] | None = None
        self._peer = self._new_peer(f"{address.place}:{address.number}", self._write, lambda: self._outlet)

    @property
    def up(self) -> bool:
        """See Link."""
        return self._descriptor is not None

    @property
    def peers(self) -> list[Peer]:
        """See Link."""
        return [self._peer] if self.up else []

    @abstractmethod
    async def _connect(self) -> int:
        """Open the device and return its non-blocking file descriptor; LinkError when that fails."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Close the device."""

    async def open(self) -> None:
        """See Link."""
        self._loop = asyncio.get_running_loop()
        self._attach(await self._connect())

    async def close(self) -> None:
        """See Link."""
        reopening, self._reopening = self._reopening, None
        if reopening is not None:
            reopening.cancel()
            await asyncio.gather(reopening, return_exceptions=True)
        self._detach()

    def _attach(self, descriptor: int) -> None:
        self._peer.parser = FrameParser()
        with self._lock:
            self._unsent.clear()
            self._descriptor = descriptor
            self._outlet = Outlet(self._duplicate, None)
        self._running_loop.add_reader(descriptor, self._readable)

    def _detach(self) -> None:
        with self._lock:
            descriptor, self._descriptor, self._outlet = self._descriptor, None, None
        if descriptor is not None:
            self._running_loop.remove_reader(descriptor)
            self._running_loop.remove_writer(descriptor)
            self._disconnect()

    def _duplicate(self) -> int:
        with self._lock:
            if self._descriptor is None:
                raise OSError("the link is down")
            return os.dup(self._descriptor)

    @property
    def _running_loop(self) -> asyncio.AbstractEventLoop:
        if self._loop is None:
            raise LinkError("the link was never opened", field=self.url)
        return self._loop

    def _broken(self, why: str) -> None:
        log.warning("%s: %s; trying again every %g s", self.url, why, RECONNECT_S)
        self._detach()
        if self._reopening is None:
            self._reopening = asyncio.ensure_future(self._reopen())

    async def _reopen(self) -> None:
        while not self.up:
            await asyncio.sleep(RECONNECT_S)
            try:
                self._attach(await self._connect())
            except LinkError as error:
                log.debug("%s", error)
        self._reopening = None

    def _readable(self) -> None:
        descriptor = self._descriptor
        if descriptor is None:
            return
        try:
            data = os.read(descriptor, READ_SIZE)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._broken(error_words(error))
            return
        if data:
            self._take(self._peer, self._peer.parser.feed(data))
        else:
            self._broken("the other end closed the link")

    def _write(self, data: bytes) -> None:
        with self._lock:
            if self._descriptor is None or len(self._unsent) > MAX_UNSENT:
                return
            waiting = bool(self._unsent)
            self._unsent += data
            if not waiting:
                self._flush()
                if self._unsent:
                    self._running_loop.call_soon_threadsafe(self._wait_for_room)

    def _flush(self) -> None:
        if self._descriptor is None:
            return
        try:
            del self._unsent[: os.write(self._descriptor, self._unsent)]
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            log.debug("%s: %s", self.url, error)
            self._unsent.clear()

    def _wait_for_room(self) -> None:
        if self._descriptor is not None:
            self._running_loop.add_writer(self._descriptor, self._writable)

    def _writable(self) -> None:
        with self._lock:
            self._flush()
            if not self._unsent and self._descriptor is not None:
                self._running_loop.remove_writer(self._descriptor)


class TcpLink(StreamLink):
    """TCP to a server."""

    _socket: socket.socket | None = None

    async def _connect(self) -> int:
        loop = asyncio.get_running_loop()
        family, where = await resolve(self.address, socket.SOCK_STREAM)
        sock = socket.socket(family, socket.SOCK_STREAM)
        sock.setblocking(False)
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            async with asyncio.timeout(CONNECT_S):
                await loop.sock_connect(sock, where)
        except (OSError, asyncio.CancelledError) as error:
            sock.close()
            if isinstance(error, asyncio.CancelledError):
                raise
            why = f"nobody answers there ({error_words(error)})"
            raise LinkError(f"{why}; check that the vehicle runs and the address is right", field=self.url) from None
        self._socket = sock
        return sock.fileno()

    def _disconnect(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class SerialLink(StreamLink):
    """A serial device."""

    _port: Any = None

    async def _connect(self) -> int:
        import serial

        try:
            self._port = serial.Serial(self.address.place, self.address.number, timeout=0, exclusive=True)
        except (OSError, ValueError, serial.SerialException) as error:
            why = f"cannot open the device ({error_words(error)})"
            raise LinkError(f"{why}; check that it is plugged in, free and yours to use", field=self.url) from None
        descriptor = int(self._port.fileno())
        os.set_blocking(descriptor, False)
        return descriptor

    def _disconnect(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None
