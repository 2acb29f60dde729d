"""What the two mission servers have in common: the stored lists and how to reach the peer."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.fence_rally import ListKind
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

_LATER_S = 1e-6
"""Past the end of a timer, whatever rounding does."""

ALL_LISTS = int(mavlink.MAV_MISSION_TYPE_ALL)
MESSAGES = {
    "MISSION_COUNT",
    "MISSION_ITEM",
    "MISSION_ITEM_INT",
    "MISSION_REQUEST_LIST",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_ACK",
    "MISSION_CLEAR_ALL",
    "MISSION_WRITE_PARTIAL_LIST",
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
    """Keeps the mission and answers the mission protocol, for the other lists (fence, rally points) too.

    Timers run on wall time. A list that the vehicle does not have is answered with UNSUPPORTED.

    Args:
        say: sends a STATUSTEXT of a severity.
        changed: called when the stored list has changed.
        kind: which list.
    """

    ASK_AGAIN_S: float
    GIVE_UP_S: float
    HOME_IS_ITEM_0 = False

    def __init__(self, say: Callable[[int, str], None], changed: Callable[[], None], kind: ListKind) -> None:
        self._say = say
        self._changed = changed
        self._kind = kind
        self.items: list[StoredItem] = []
        self.upload: Upload | None = None
        self.others: dict[int, MissionServer] = {}

    @property
    def mission_type(self) -> int:
        """MAV_MISSION_TYPE of its own list."""
        return self._kind.mission_type

    @property
    def home_is_item_0(self) -> bool:
        """Whether its list begins with home, whatever was uploaded."""
        return self.HOME_IS_ITEM_0 and self.mission_type == 0

    def keep(self, item: StoredItem) -> StoredItem:
        """What is kept of an item; raises ItemRefused."""
        return self._kind.keep(item)

    def handle(self, message: Message, send: Callable[[Message], None], wall_s: float) -> bool:
        """Answer a message of the mission protocol; False if it is none."""
        kind = message.get_type()
        if kind not in MESSAGES:
            return False
        peer = (message.get_srcSystem(), message.get_srcComponent())
        wanted = int(message.mission_type)
        if kind == "MISSION_CLEAR_ALL" and wanted == ALL_LISTS:
            self._clear_all_lists(peer, send)
        elif (server := self._server(wanted)) is not None:
            if not self._refuses_beside(server, kind, peer, send):
                getattr(server, f"_{kind.lower()}")(message, peer, send, wall_s)
        elif kind in {"MISSION_REQUEST_LIST", "MISSION_COUNT", "MISSION_CLEAR_ALL"}:
            send(mavlink.MAVLink_mission_ack_message(*peer, UNSUPPORTED, wanted))
        return True

    def _server(self, mission_type: int) -> MissionServer | None:
        return self if mission_type == self._kind.mission_type else self.others.get(mission_type)

    def _refuses_beside(self, server: MissionServer, kind: str, peer: Peer, send: Callable[[Message], None]) -> bool:
        """Whether a message about one list is refused because of what is under way with another."""
        del server, kind, peer, send
        return False

    @abstractmethod
    def _clear_all_lists(self, peer: Peer, send: Callable[[Message], None]) -> None: ...

    @abstractmethod
    def step(self, wall_s: float) -> None:
        """Ask again, or give up, when the peer is silent."""

    @property
    def next_s(self) -> float:
        """Wall time at which `step` has something to do; infinite while no upload is under way."""
        soonest_s = math.inf
        for server in (self, *self.others.values()):
            upload = server.upload
            if upload is not None:
                soonest_s = min(soonest_s, upload.asked_s + self.ASK_AGAIN_S, upload.heard_s + self.GIVE_UP_S)
        return soonest_s + _LATER_S

    def list_ids(self) -> tuple[int, ...]:
        """The opaque ids of mission, fence and rally points, where the vehicle has such."""
        return ()

    def restart(self) -> None:
        """The autopilot starts anew: transfers are forgotten, the stored lists are not."""
        for server in (self, *self.others.values()):
            server.upload = None

    def clear(self) -> None:
        """Forget the list."""
        self.items = []
        self._changed()

    def keep_from(self, old: MissionServer) -> None:
        """Hold what another one held: the lists survive a reboot."""
        self.items = old.items
        for mission_type, server in self.others.items():
            server.items = old.others[mission_type].items

    def _acknowledge(self, result: int, peer: Peer, send: Callable[[Message], None]) -> None:
        send(mavlink.MAVLink_mission_ack_message(*peer, result, self._kind.mission_type))
