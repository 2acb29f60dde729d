"""A loopback door for tests: what a pilot, a fault or an observer would do to a simulated vehicle.

A UDP datagram holds one line, `[VEHICLE] COMMAND [ARGUMENT]` (the vehicle's system id, the first one when left out);
the answer is one JSON object with `ok`, and `error` when it is false. Commands:

    state               the truth about the vehicle (position, mode, images, counts of setpoints ...)
    mode NAME           a mode as the pilot's switch sets it, such as POSCTL, AUTO.LOITER, STABILIZE, LOITER
    loss SHARE          packet loss each way, 0 to 1
    duplicate SHARE     share of packets that come twice
    delay SECONDS       packets are late by up to this much (wall time)
    kill-link           nothing passes in either direction; the vehicle flies on
    restore-link        the link passes again
    vanish              the vehicle is gone: it neither sends nor flies on
    reboot              the autopilot starts anew on the ground where it is, with its mission and parameters
    clear-mission       the stored mission is gone
    battery SHARE       what is left in the battery, 0 to 1
    param NAME VALUE    a parameter
    lidar STATE         clear, covered (all ranges are zero) or silent
    odometry STATE      of the lidar: tracking, failed or silent
"""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Callable
from typing import Any

from gcs.core.errors import GcsError

Handler = Callable[[int | None, str, list[str]], dict[str, Any]]


class ControlPort:
    """The socket.

    Args:
        port: on loopback; 0 for any free one.
        handle: carries out a command for a vehicle, or raises ValueError or GcsError.
    """

    def __init__(self, port: int, handle: Handler) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.bind(("127.0.0.1", port))
        except OSError as error:
            self.socket.close()
            raise GcsError(
                f"UDP port {port} cannot be had ({error.strerror}); choose another --control-port"
            ) from error
        self.socket.setblocking(False)
        self._handle = handle

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.socket.getsockname()[1])

    def read(self) -> None:
        """Carry out what has come in."""
        try:
            data, sender = self.socket.recvfrom(4096)
        except (BlockingIOError, InterruptedError, ConnectionError):
            return
        words = data.decode("utf-8", "replace").split()
        vehicle = int(words.pop(0)) if words and words[0].isdigit() else None
        try:
            answer = {"ok": True, **self._handle(vehicle, words[0] if words else "", words[1:])}
        except (ValueError, IndexError, GcsError) as error:
            answer = {"ok": False, "error": str(error)}
        with contextlib.suppress(OSError):
            self.socket.sendto(json.dumps(answer).encode(), sender)

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()
