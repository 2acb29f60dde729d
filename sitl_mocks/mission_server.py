"""What the two mission servers have in common: the stored mission and how to reach the peer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.mission_items import StoredItem

Peer = tuple[int, int]
"""System and component id of who talks to the vehicle."""

ACCEPTED = int(mavlink.MAV_MISSION_ACCEPTED)
ERROR = int(mavlink.MAV_MISSION_ERROR)
UNSUPPORTED = int(mavlink.MAV_MISSION_UNSUPPORTED)
NO_SPACE = int(mavlink.MAV_MISSION_NO_SPACE)
INVALID_SEQUENCE = int(mavlink.MAV_MISSION_INVALID_SEQUENCE)
DENIED = int(mavlink.MAV_MISSION_DENIED)
CANCELLED = int(mavlink.MAV_MISSION_OPERATION_CANCELLED)

MISSION_TYPE = int(mavlink.MAV_MISSION_TYPE_MISSION)
MESSAGES = {
    "MISSION_COUNT",
    "MISSION_ITEM",
    "MISSION_ITEM_INT",
    "MISSION_REQUEST_LIST",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_ACK",
    "MISSION_CLEAR_ALL",
}


@dataclass
class Upload:
    """An upload that is under way."""

    peer: Peer
    send: Callable[[Message], None]
    count: int
    next: int
    heard_s: float
    asked_s: float


class MissionServer(ABC):
    """Keeps the mission and answers the mission protocol.

    Timers run on wall time. Fences and rally points are no part of these vehicles: their uploads are answered with
    UNSUPPORTED, their lists are empty.

    Args:
        say: sends a STATUSTEXT of a severity.
        changed: called when the stored mission has changed.
    """

    def __init__(self, say: Callable[[int, str], None], changed: Callable[[], None]) -> None:
        self._say = say
        self._changed = changed
        self.items: list[StoredItem] = []
        self.upload: Upload | None = None

    def handle(self, message: Message, send: Callable[[Message], None], wall_s: float) -> bool:
        """Answer a message of the mission protocol; False if it is none."""
        kind = message.get_type()
        if kind not in MESSAGES:
            return False
        peer = (message.get_srcSystem(), message.get_srcComponent())
        if message.mission_type != MISSION_TYPE:
            self._other_type(kind, message, peer, send)
            return True
        getattr(self, f"_{kind.lower()}")(message, peer, send, wall_s)
        return True

    @abstractmethod
    def step(self, wall_s: float) -> None:
        """Ask again, or give up, when the peer is silent."""

    def _other_type(self, kind: str, message: Message, peer: Peer, send: Callable[[Message], None]) -> None:
        if kind == "MISSION_REQUEST_LIST":
            send(mavlink.MAVLink_mission_count_message(*peer, 0, message.mission_type))
        elif kind == "MISSION_COUNT":
            send(mavlink.MAVLink_mission_ack_message(*peer, UNSUPPORTED, message.mission_type))
        elif kind == "MISSION_CLEAR_ALL":
            if message.mission_type == mavlink.MAV_MISSION_TYPE_ALL:
                self.clear()
            send(mavlink.MAVLink_mission_ack_message(*peer, ACCEPTED, message.mission_type))

    def clear(self) -> None:
        """Forget the mission."""
        self.items = []
        self._changed()

    @staticmethod
    def _acknowledge(result: int, peer: Peer, send: Callable[[Message], None]) -> None:
        send(mavlink.MAVLink_mission_ack_message(*peer, result, MISSION_TYPE))
