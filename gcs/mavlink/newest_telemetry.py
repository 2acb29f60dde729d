"""The telemetry of a vehicle, decoded when it is looked at.

Attitudes and positions come ten to fifty times a second from each vehicle, and nearly all are overtaken before anybody
looks. So of these kinds only the newest message of each component waits, as it came; all others are taken in at once.
"""

from __future__ import annotations

import logging
import threading
from dataclasses import replace
from operator import itemgetter

from gcs.core.vehicle import Telemetry
from gcs.mavlink.dialect import Message
from gcs.mavlink.telemetry_decoder import Changes, Reader, TelemetryDecoder

log = logging.getLogger(__name__)

FREQUENT = frozenset(
    {
        "ATTITUDE",
        "LOCAL_POSITION_NED",
        "GLOBAL_POSITION_INT",
        "SYSTEM_TIME",
        "GIMBAL_DEVICE_ATTITUDE_STATUS",
        "MOUNT_ORIENTATION",
        "MOUNT_STATUS",
    }
)
"""Kinds of which an older one adds nothing to a newer one, and which share no value with any other kind."""


class NewestTelemetry:
    """What is known of one vehicle; may be read from any thread.

    Args:
        decoder: of its messages.
    """

    __slots__ = ("_changes", "_decoder", "_telemetry", "_waiting")
    _lock = threading.Lock()
    """One for all vehicles, as it is never held for long."""

    def __init__(self, decoder: TelemetryDecoder) -> None:
        self._decoder = decoder
        self._telemetry = Telemetry()
        self._changes: Changes = {}
        self._waiting: dict[tuple[str, int], tuple[Reader, Message, float]] = {}

    def take(self, message: Message, now_s: float, *, from_autopilot: bool) -> bool:
        """Take a message; returns whether it can say anything of use."""
        kind = message.get_type()
        reader = self._decoder.reader(kind, from_autopilot=from_autopilot)
        if reader is None:
            return False
        if kind in FREQUENT:
            with self._lock:
                self._waiting[kind, message.get_srcComponent()] = (reader, message, now_s)
            return True
        changes = reader(message, now_s)
        with self._lock:
            self._changes |= changes
        return bool(changes)

    def read(self) -> Telemetry:
        """The newest of everything; the same object as long as nothing new came."""
        if not self._waiting and not self._changes:
            return self._telemetry
        with self._lock:
            waiting, self._waiting = self._waiting, {}
            changes, self._changes = self._changes, {}
            for reader, message, heard_s in sorted(waiting.values(), key=itemgetter(2)):
                try:
                    changes |= reader(message, heard_s)
                except Exception:  # untrusted input: whoever looks is not to pay for it
                    log.exception("a %s could not be taken", message.get_type())
            if changes:
                self._telemetry = replace(self._telemetry, **changes)
            return self._telemetry
