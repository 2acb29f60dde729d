"""The mission protocol as ArduPilot answers it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.fence_rally import ARDUPILOT_LISTS, ARDUPILOT_MISSION, MISSION, ListKind
from sitl_mocks.mission_items import ItemRefused, StoredItem, item_of_message, message_of_item
from sitl_mocks.mission_server import (
    ACCEPTED,
    ALL_LISTS,
    CANCELLED,
    DENIED,
    ERROR,
    INVALID_SEQUENCE,
    NO_SPACE,
    UNSUPPORTED,
    MissionServer,
    Peer,
    Upload,
)

Send = Callable[[Message], None]
RECEIVED = {0: "Flight plan received", 1: "Fence Indexed OK"}


class ArduPilotMissionServer(MissionServer):
    """Asks with MISSION_REQUEST, keeps home as item 0 of a mission, and writes items into the store as they come.

    A fence is the exception: it replaces the old one when all of it has come and its polygons are whole.

    Args:
        home: item 0, as the estimator knows it now.
        ready: whether the storage has been opened; until then nothing fits into it.
        kind: which list; the mission's server has those of the other lists in `others`.
    """

    ASK_AGAIN_S = 1.0
    GIVE_UP_S = 8.0
    HOME_IS_ITEM_0 = True

    def __init__(
        self,
        say: Callable[[int, str], None],
        changed: Callable[[], None],
        home: Callable[[], StoredItem],
        ready: Callable[[], bool],
        kind: ListKind = ARDUPILOT_MISSION,
    ) -> None:
        super().__init__(say, changed, kind)
        self.by_type: dict[int, ArduPilotMissionServer] = {kind.mission_type: self}
        if kind.mission_type == MISSION:
            for other in ARDUPILOT_LISTS:
                self.by_type[other.mission_type] = ArduPilotMissionServer(say, lambda: None, home, ready, other)
            self.others = {number: server for number, server in self.by_type.items() if server is not self}
        self._arriving: list[StoredItem] = []
        self._home = home
        self._ready = ready

    def step(self, wall_s: float) -> None:
        """Ask again, or give up, when the peer is silent."""
        for server in self.others.values():
            server.step(wall_s)
        upload = self.upload
        if upload is None:
            return
        if wall_s - upload.heard_s >= self.GIVE_UP_S:
            self._acknowledge(CANCELLED, upload.peer, upload.send)
            self.upload = None
        elif wall_s - upload.asked_s >= self.ASK_AGAIN_S:
            self._ask(upload, wall_s)

    def stored(self) -> list[StoredItem]:
        """The list as it is given out: a mission has home as item 0."""
        if self._kind.mission_type != MISSION:
            return self.items
        return [self._home(), *self.items[1:]] if self.items else []

    def replace_by(self, items: Sequence[StoredItem]) -> bool:
        """Take the items of a file; False when not all are taken, which leaves those before the refused one."""
        if self.upload is not None or len(items) > (self._kind.capacity if self._ready() else 0):
            return False
        kept: list[StoredItem] = []
        with suppress(ItemRefused):
            for item in items:
                kept.append(self._kind.keep(item))
        whole = len(kept) == len(items)
        if self._kind.fit is not None and not (whole and self._kind.fit(kept)):
            return False
        self.items = kept
        self._changed()
        return whole

    def _clear_all_lists(self, peer: Peer, send: Send) -> None:
        send(mavlink.MAVLink_mission_ack_message(*peer, UNSUPPORTED, ALL_LISTS))

    def _ask(self, upload: Upload, wall_s: float) -> None:
        upload.asked_s = wall_s
        upload.send(mavlink.MAVLink_mission_request_message(*upload.peer, upload.next, self._kind.mission_type))

    def _mission_count(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        if self.upload is not None and self.upload.peer != peer:
            self._acknowledge(DENIED, peer, send)
            return
        capacity = self._kind.capacity if self._ready() else 0
        if message.count > capacity:
            self._acknowledge(NO_SPACE, peer, send)
            self._say(mavlink.MAV_SEVERITY_WARNING, f"Only {capacity} items are supported")
            return
        self._arriving = []
        if self._kind.fit is None or message.count == 0:
            # From here on the old list is no longer whole: the store is shortened now and overwritten item by item.
            self.items = self.items[: message.count]
            self._changed()
        if message.count == 0:
            self._acknowledge(ACCEPTED, peer, send)
            return
        self.upload = Upload(peer, send, message.count, 0, wall_s, wall_s)
        self._ask(self.upload, wall_s)

    def _mission_write_partial_list(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        first, last = message.start_index, message.end_index
        if self._kind.mission_type != MISSION:
            self._acknowledge(UNSUPPORTED, peer, send)
        elif not 0 <= first <= last <= len(self.items):
            self._acknowledge(ERROR, peer, send)
            self._say(mavlink.MAV_SEVERITY_WARNING, "Flight plan update rejected")
        else:
            self.upload = Upload(peer, send, last + 1, first, wall_s, wall_s)
            self._ask(self.upload, wall_s)

    def _mission_item(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        upload = self.upload
        if upload is None or upload.peer != peer:
            self._acknowledge(ERROR, peer, send)
            return
        if message.seq != upload.next:
            self._acknowledge(INVALID_SEQUENCE, peer, send)
            return
        upload.heard_s = wall_s
        try:
            item = self._kind.keep(item_of_message(message))
        except ItemRefused as refusal:
            self._acknowledge(refusal.result, peer, send)
            self.upload = None
            return
        store = self.items if self._kind.fit is None else self._arriving
        if message.seq < len(store):
            store[message.seq] = item
        else:
            store.append(item)
        self._changed()
        upload.next += 1
        if upload.next < upload.count:
            self._ask(upload, wall_s)
            return
        self.upload = None
        if self._kind.fit is not None:
            if not self._kind.fit(self._arriving):
                self._acknowledge(ERROR, peer, send)
                self._say(mavlink.MAV_SEVERITY_WARNING, "Fence validation failed")
                return
            self.items, self._arriving = self._arriving, []
        self._acknowledge(ACCEPTED, peer, send)
        if self._kind.mission_type in RECEIVED:
            self._say(mavlink.MAV_SEVERITY_INFO, RECEIVED[self._kind.mission_type])

    _mission_item_int = _mission_item

    def _mission_request_list(self, _message: Message, peer: Peer, send: Send, _wall_s: float) -> None:
        if self.upload is not None:
            self._acknowledge(DENIED, peer, send)
            return
        send(mavlink.MAVLink_mission_count_message(*peer, len(self.items), self._kind.mission_type))

    def _mission_request_int(self, message: Message, peer: Peer, send: Send, _wall_s: float) -> None:
        self._give(message, peer, send, as_float=False)

    def _mission_request(self, message: Message, peer: Peer, send: Send, _wall_s: float) -> None:
        self._give(message, peer, send, as_float=True)

    def _give(self, message: Message, peer: Peer, send: Send, *, as_float: bool) -> None:
        if self.upload is not None:
            self._acknowledge(DENIED, peer, send)
            return
        items = self.stored()
        if message.seq >= len(items):
            self._acknowledge(INVALID_SEQUENCE, peer, send)
            return
        autocontinue = int(self._kind.mission_type == MISSION)
        item = replace(items[message.seq], current=0, autocontinue=autocontinue)
        send(message_of_item(item, message.seq, peer, self._kind.mission_type, as_float=as_float))

    def _mission_ack(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        """Cancelling is not supported: the upload goes on."""

    def _mission_clear_all(self, _message: Message, peer: Peer, send: Send, _wall_s: float) -> None:
        if self.upload is not None:
            self._acknowledge(DENIED, peer, send)
            return
        self.clear()
        self._acknowledge(ACCEPTED, peer, send)
