"""A process that plays many vehicles on UDP for the gateway benchmark: `traffic(...)`, or this module as a program.

As a program it sends until its standard input ends, then prints how many packets it has sent.
"""

from __future__ import annotations

import json
import select
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from gcs.mavlink.packed_traffic import PackedVehicle

if TYPE_CHECKING:
    from collections.abc import Iterator

TICK_S = 0.002
MOST_LATE_S = 0.05
"""Traffic that could not be sent for longer than this is left out: a real vehicle sends no backlog either."""


@contextmanager
def traffic(port: int, vehicles: int, rate_per_s: float, key: bytes | None = None) -> Iterator[list[int]]:
    """Have a process of its own send to a UDP port of this machine for the time of a `with` block.

    Args:
        port: where the station listens.
        vehicles: how many, with system ids from 1.
        rate_per_s: packets a second of all of them together.
        key: they sign with.

    Yields:
        A list, to which the number of packets that were sent is appended when the block ends.
    """
    command = [sys.executable, "-m", __name__, str(port), str(vehicles), str(rate_per_s), (key or b"").hex() or "-"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    sent: list[int] = []
    try:
        yield sent
    finally:
        told, _ = process.communicate()
        sent.append(int(json.loads(told)["sent"]))


def send_until_told(port: int, vehicles: int, rate_per_s: float, key: bytes | None) -> int:
    """Send and answer until standard input ends; returns the number of packets sent."""
    signing_time = int((time.time() - 1_420_070_400) * 1e5)
    fleet = [PackedVehicle(system_id, key, signing_time) for system_id in range(1, vehicles + 1)]
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in fleet]
    for one in sockets:
        one.setblocking(False)
        one.connect(("127.0.0.1", port))
    by_file = dict(zip((one.fileno() for one in sockets), zip(sockets, fleet, strict=True), strict=True))
    begin = time.monotonic()
    due, sent = begin, 0
    poll = select.poll()
    for number in (*by_file, sys.stdin.fileno()):
        poll.register(number, select.POLLIN)
    while True:
        now = time.monotonic()
        boot_ms = int((now - begin) * 1e3) + 60_000
        due = max(due, now - MOST_LATE_S)
        while due <= now:
            k = sent % vehicles
            sent += _send(sockets[k], fleet[k].message(boot_ms))
            due += 1.0 / rate_per_s
        for number, _ in poll.poll(TICK_S * 1e3):
            if number not in by_file:
                return sent
            sock, vehicle = by_file[number]
            sent += _answer(sock, vehicle, boot_ms)


def _answer(sock: socket.socket, vehicle: PackedVehicle, boot_ms: int) -> int:
    try:
        question = sock.recv(2048)
    except OSError:
        return 0
    return sum(_send(sock, packet) for packet in vehicle.answers(question, boot_ms))


def _send(sock: socket.socket, packet: bytes) -> int:
    try:
        sock.send(packet)
    except OSError:  # nobody listens yet
        return 0
    return 1


if __name__ == "__main__":
    port_text, count_text, rate_text, key_text = sys.argv[1:]
    signed_with = None if key_text == "-" else bytes.fromhex(key_text)
    print(json.dumps({"sent": send_until_told(int(port_text), int(count_text), float(rate_text), signed_with)}))
