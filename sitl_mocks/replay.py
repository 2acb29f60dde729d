"""Sends a recorded telemetry log to a station as if its vehicle flew now: `python -m sitl_mocks replay FILE`.

A log is a row of entries: eight bytes with the time in microseconds since 1970 (big-endian), then the packet as it was
on the link. Packets are passed on byte by byte as they are, so also what no library knows; what the station says is
not heard.
"""

from __future__ import annotations

import argparse
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from gcs.core.errors import GcsError, InputError, NotFoundError

_TIME = struct.Struct(">Q")
_MAVLINK_1, _MAVLINK_2 = 0xFE, 0xFD
_SIGNED = 1
_LONGEST_PAUSE_S = 5.0
"""Gaps in a log are not waited for longer."""


def read_log(data: bytes) -> Iterator[tuple[float, bytes]]:
    """Time (s since 1970) and packet of each entry; a log that was cut off ends with its last whole entry.

    Raises:
        InputError: something else than a packet stands where one should begin.
    """
    place = 0
    while place + _TIME.size + 3 <= len(data):
        (time_us,) = _TIME.unpack_from(data, place)
        begin = place + _TIME.size
        magic, length, flags = data[begin : begin + 3]
        if magic == _MAVLINK_2:
            size = 12 + length + (13 if flags & _SIGNED else 0)
        elif magic == _MAVLINK_1:
            size = 8 + length
        else:
            raise InputError(f"at byte {begin} of the log no packet begins: it is no telemetry log, or damaged")
        if begin + size > len(data):
            return
        yield time_us * 1e-6, data[begin : begin + size]
        place = begin + size


def replay(
    entries: Iterator[tuple[float, bytes]],
    send: Callable[[bytes], None],
    speedup: float,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> int:
    """Send packets at the times of the log, that many times faster; returns how many were sent.

    Args:
        entries: time (s) and packet.
        send: takes each packet.
        speedup: of the log's clock.
        clock: monotonic seconds.
        sleep: waits so many seconds.
    """
    count, due_s, last_s = 0, clock(), None
    for time_s, packet in entries:
        if last_s is not None:
            due_s += min(max(time_s - last_s, 0.0), _LONGEST_PAUSE_S) / speedup
        last_s = time_s
        wait_s = due_s - clock()
        if wait_s > 0.0:
            sleep(wait_s)
        send(packet)
        count += 1
    return count


def main(arguments: Sequence[str]) -> int:
    """Replay a log from the command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m sitl_mocks replay", description="Send a recorded log as if live.")
    parser.add_argument("file", type=Path, metavar="FILE", help="telemetry log (.tlog)")
    parser.add_argument("--speedup", type=float, default=1.0, help="how much faster than it was recorded (1)")
    parser.add_argument("--host", default="127.0.0.1", help="where to send to (127.0.0.1)")
    parser.add_argument("--port", type=int, default=14550, help="UDP port to send to (14550)")
    given = parser.parse_args(arguments)
    try:
        if not 0.0 < given.speedup <= 1000.0:
            raise InputError("must be above 0 and at most 1000", field="--speedup")
        if not given.file.is_file():
            raise NotFoundError(f"there is no file {given.file}", field="FILE")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            count = replay(
                read_log(given.file.read_bytes()),
                lambda packet: _send(link, packet, (given.host, given.port)),
                given.speedup,
            )
    except KeyboardInterrupt:
        return 130
    except GcsError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return error.exit_status
    print(f"{count} packets were sent", flush=True)
    return 0


def _send(link: socket.socket, packet: bytes, address: tuple[str, int]) -> None:
    """Nobody listening is no reason to end: a real vehicle goes on too."""
    try:
        link.sendto(packet, address)
    except ConnectionError:
        return
