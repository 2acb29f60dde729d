"""Sockets of the simulated vehicles: UDP to the station, and a TCP server for the ArduPilot kind."""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
import time
from collections.abc import Callable

from gcs.core.errors import GcsError
from sitl_mocks.channel import Channel, FaultyPipe, LinkFaults
from sitl_mocks.dialect import Message

Receive = Callable[[Message, Channel], None]

Arrival = tuple[float, bytes]
"""Wall time and bytes of a packet."""

_MOST_WAITING_BYTES = 4_000_000
_OLDEST_ARRIVAL_S = 0.25
_SO_TIMESTAMPNS = 35
_TIMESPEC = struct.Struct("@qq")


class UdpLink:
    """One UDP socket that sends to one place, whoever listens there.

    Args:
        system_id: of the vehicle.
        address: where it sends.
        faults: of the link, each way.
        seed: of the faults.
        receive: takes each message.
        wall: the wall's clock.
    """

    def __init__(
        self,
        system_id: int,
        address: tuple[str, int],
        faults: LinkFaults,
        seed: int,
        receive: Receive,
        wall: Callable[[], float],
    ) -> None:
        self._address = address
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1_000_000)
        with contextlib.suppress(OSError):  # where the system has no arrival times, the time of reading has to do
            self.socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self.socket.setblocking(False)
        self.socket.bind((address[0] if address[0].startswith("127.") else "", 0))
        outward = FaultyPipe(self._transmit, faults, seed)
        self.channel = Channel(system_id, lambda packet: outward.put(packet, wall()), faults)
        inward = FaultyPipe(self._take, faults, seed + 1)
        self._pipes = (outward, inward)
        self._inward = inward
        self._receive = receive
        self._wall = wall

    def read(self) -> list[Arrival]:
        """What has come in, with the wall time at which the system got it.

        A simulator that was kept from running for a while can so let its vehicles hear each packet at its time.
        """
        arrivals: list[Arrival] = []
        now, unix = self._wall(), time.time()
        for _ in range(500):
            try:
                data, ancillary, _, _ = self.socket.recvmsg(65535, 64)
            except (BlockingIOError, InterruptedError):
                break
            except ConnectionError:
                continue  # nobody listens there yet
            age_s = 0.0
            for level, kind, value in ancillary:
                if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(value) == _TIMESPEC.size:
                    seconds, nanoseconds = _TIMESPEC.unpack(value)
                    age_s = min(max(unix - seconds - nanoseconds * 1e-9, 0.0), _OLDEST_ARRIVAL_S)
            arrivals.append((now - age_s, data))
        return arrivals

    def deliver(self, data: bytes, wall_s: float) -> None:
        """Let the vehicle hear a packet."""
        self._inward.put(data, wall_s)

    @property
    def next_s(self) -> float:
        """Wall time at which the next delayed packet is due."""
        return min(pipe.next_s for pipe in self._pipes)

    def release(self, wall_s: float) -> None:
        """Pass on delayed packets."""
        for pipe in self._pipes:
            pipe.release(wall_s)

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()

    def _transmit(self, packet: bytes) -> None:
        # Nobody listening, or a full buffer, is a lost packet.
        with contextlib.suppress(OSError):
            self.socket.sendto(packet, self._address)

    def _take(self, data: bytes) -> None:
        for message in self.channel.receive(data):
            self._receive(message, self.channel)


class TcpClient:
    """One connection to the TCP server; the other arguments are as of `UdpLink`."""

    def __init__(
        self,
        system_id: int,
        connection: socket.socket,
        faults: LinkFaults,
        seed: int,
        receive: Receive,
        wall: Callable[[], float],
    ) -> None:
        self.socket = connection
        self.socket.setblocking(False)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._waiting = bytearray()
        outward = FaultyPipe(self._transmit, faults, seed)
        self.channel = Channel(system_id, lambda packet: outward.put(packet, wall()), faults)
        self._faults = faults
        self._outward = outward
        self._receive = receive
        self.closed = False

    def read(self) -> None:
        """Take what has come in."""
        try:
            data = self.socket.recv(65535)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if not data:
            self.closed = True
            return
        if self._faults.cut:
            return
        for message in self.channel.receive(data):
            self._receive(message, self.channel)

    @property
    def next_s(self) -> float:
        """Wall time at which the next delayed packet is due."""
        return self._outward.next_s

    def release(self, wall_s: float) -> None:
        """Pass on delayed packets and what did not fit into the socket before."""
        self._outward.release(wall_s)
        if self._waiting:
            self._flush()

    def close(self) -> None:
        """Close the connection."""
        self.closed = True
        self.socket.close()

    def _transmit(self, packet: bytes) -> None:
        if len(self._waiting) < _MOST_WAITING_BYTES:
            self._waiting += packet
            self._flush()

    def _flush(self) -> None:
        try:
            sent = self.socket.send(self._waiting)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self.closed = True
            self._waiting.clear()
            return
        del self._waiting[:sent]


def listen(host: str, port: int) -> socket.socket:
    """A listening TCP socket.

    Raises:
        GcsError: the port is taken.
    """
    server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        server.bind((host, port))
    except OSError as error:
        server.close()
        raise GcsError(f"TCP port {port} cannot be had ({error.strerror}); choose others with --tcp-base") from error
    server.listen(4)
    server.setblocking(False)
    return server


def watch(selector: selectors.BaseSelector, sock: socket.socket, on_ready: Callable[[], None]) -> None:
    """Call a function when a socket can be read."""
    selector.register(sock, selectors.EVENT_READ, on_ready)
