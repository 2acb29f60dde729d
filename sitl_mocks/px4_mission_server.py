"""The mission protocol as PX4 answers it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.fence_rally import PX4_LISTS, PX4_MISSION, ListKind
from sitl_mocks.mission_items import ItemRefused, StoredItem, item_of_message, message_of_item
from sitl_mocks.mission_server import ACCEPTED, ALL_LISTS, CANCELLED, ERROR, NO_SPACE, MissionServer, Peer, Upload

Send = Callable[[Message], None]


class Px4MissionServer(MissionServer):
    """Asks with MISSION_REQUEST_INT, replaces a list only when all of a new one has come; one transfer at a time.

    Args:
        current: sequence of the current item, which is marked when items are given out.
        kind: which list; the mission's server has those of the other lists in `others`.
    """

    ASK_AGAIN_S = 0.26
    GIVE_UP_S = 5.05

    def __init__(
        self,
        say: Callable[[int, str], None],
        changed: Callable[[], None],
        current: Callable[[], int],
        kind: ListKind = PX4_MISSION,
    ) -> None:
        super().__init__(say, changed, kind)
        if kind is PX4_MISSION:
            lists = (Px4MissionServer(say, lambda: None, lambda: -1, other) for other in PX4_LISTS)
            self.others = {server._kind.mission_type: server for server in lists}
        self._current = current
        self._arriving: list[StoredItem] = []
        self._last_upload: tuple[Peer, int] | None = None
        self._readers: dict[Peer, float] = {}

    def step(self, wall_s: float) -> None:
        """Ask again, or give up, when the peer is silent."""
        for server in self.others.values():
            server.step(wall_s)
        self._readers = {peer: heard for peer, heard in self._readers.items() if wall_s - heard < self.GIVE_UP_S}
        upload = self.upload
        if upload is None:
            return
        if wall_s - upload.heard_s > self.GIVE_UP_S:
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "Operation timeout, aborting transfer")
            self.upload = None
        elif wall_s - upload.asked_s >= self.ASK_AGAIN_S:
            self._ask(upload, wall_s)

    def _refuses_beside(self, server: MissionServer, kind: str, peer: Peer, send: Send) -> bool:
        busy = any(s.upload is not None for s in (self, *self.others.values()) if s is not server)
        if busy and kind != "MISSION_ACK":
            server._acknowledge(ERROR, peer, send)
            return True
        return False

    def _clear_all_lists(self, peer: Peer, send: Send) -> None:
        for server in (self, *self.others.values()):
            server.clear()
        send(mavlink.MAVLink_mission_ack_message(*peer, ACCEPTED, ALL_LISTS))

    def _ask(self, upload: Upload, wall_s: float) -> None:
        upload.asked_s = wall_s
        upload.send(mavlink.MAVLink_mission_request_int_message(*upload.peer, upload.next, self._kind.mission_type))

    def _mission_count(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        upload = self.upload
        if upload is not None:
            if upload.peer == peer and upload.next == 0 and upload.count == message.count:
                upload.send, upload.heard_s = send, wall_s
                self._ask(upload, wall_s)  # our first request was lost
            else:
                self._acknowledge(ERROR, peer, send)
            return
        if message.count > self._kind.capacity:
            self._acknowledge(NO_SPACE, peer, send)
            return
        if message.count == 0:
            self.clear()
            self._acknowledge(ACCEPTED, peer, send)
            return
        self._arriving = []
        self._last_upload = None
        self.upload = Upload(peer, send, message.count, 0, wall_s, wall_s)
        self._ask(self.upload, wall_s)

    def _mission_item(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        upload = self.upload
        if upload is None or upload.peer != peer:
            if upload is None and self._last_upload == (peer, message.seq):
                self._acknowledge(ACCEPTED, peer, send)  # our acknowledgement was lost
            else:
                self._acknowledge(ERROR, peer, send)
            return
        upload.heard_s = wall_s
        if message.seq != upload.next:
            return  # the item that is waited for will be asked for again
        try:
            self._arriving.append(self._kind.keep(item_of_message(message)))
        except ItemRefused as refusal:
            self._acknowledge(refusal.result, peer, send)
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "IGN MISSION_ITEM: Invalid item")
            self.upload = None
            return
        upload.next += 1
        if upload.next < upload.count:
            self._ask(upload, wall_s)
            return
        self.items, self._arriving = self._arriving, []
        self.upload = None
        self._last_upload = (peer, message.seq)
        self._changed()
        self._acknowledge(ACCEPTED, peer, send)

    _mission_item_int = _mission_item

    def _mission_request_list(self, _message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        if self.upload is not None:
            self._acknowledge(ERROR, peer, send)
            return
        self._readers[peer] = wall_s
        send(mavlink.MAVLink_mission_count_message(*peer, len(self.items), self._kind.mission_type))

    def _mission_request_int(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        self._give(message, peer, send, wall_s, as_float=False)

    def _mission_request(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        self._give(message, peer, send, wall_s, as_float=True)

    def _give(self, message: Message, peer: Peer, send: Send, wall_s: float, *, as_float: bool) -> None:
        if peer not in self._readers or self.upload is not None or message.seq >= len(self.items):
            self._acknowledge(ERROR, peer, send)
            return
        self._readers[peer] = wall_s
        item = replace(self.items[message.seq], current=int(message.seq == self._current()))
        send(message_of_item(item, message.seq, peer, self._kind.mission_type, as_float=as_float))

    def _mission_ack(self, message: Message, peer: Peer, _send: Send, _wall_s: float) -> None:
        self._readers.pop(peer, None)
        if self.upload is not None and self.upload.peer == peer and message.type == CANCELLED:
            self.upload = None

    def _mission_clear_all(self, _message: Message, peer: Peer, send: Send, _wall_s: float) -> None:
        if self.upload is not None:
            self._acknowledge(ERROR, peer, send)
            return
        self.clear()
        self._acknowledge(ACCEPTED, peer, send)
