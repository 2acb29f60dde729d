"""The mission protocol as PX4 answers it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.fence_rally import FENCE, MISSION, PX4_LISTS, PX4_MISSION, ListKind
from sitl_mocks.mission_items import ItemRefused, StoredItem, item_of_message, message_of_item
from sitl_mocks.mission_server import ACCEPTED, ALL_LISTS, CANCELLED, ERROR, NO_SPACE, MissionServer, Peer, Upload
from sitl_mocks.plan_id import MissionAckWithId, MissionCountWithId, plan_id, wire_form

Send = Callable[[Message], None]


@dataclass
class Reader:
    """Who is reading the list, and which item is expected to be asked for next."""

    peer: Peer
    next: int
    heard_s: float


class Px4MissionServer(MissionServer):
    """Asks with MISSION_REQUEST_INT, replaces a list only when all of a new one has come; one transfer at a time.

    A list is given out strictly in order: any other request ends the transfer with an error.

    Args:
        current: sequence of the current item, which is marked when items are given out.
        fence_changed: called when the stored fence has changed.
        item_refused: called when an item was not taken.
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
        fence_changed: Callable[[], None] = lambda: None,
        item_refused: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(say, changed, kind)
        self._item_refused = item_refused
        if kind.mission_type == MISSION:
            for other in PX4_LISTS:
                told = fence_changed if other.mission_type == FENCE else lambda: None
                self.others[other.mission_type] = Px4MissionServer(
                    say, told, lambda: -1, other, item_refused=item_refused
                )
        self._current = current
        self._arriving: list[StoredItem] = []
        self._sender: Peer | None = None
        self._reader: Reader | None = None

    def step(self, wall_s: float) -> None:
        """Ask again, or give up, when the peer is silent."""
        for server in self.others.values():
            server.step(wall_s)
        if self._reader is not None and wall_s - self._reader.heard_s > self.GIVE_UP_S:
            self._reader = None
        upload = self.upload
        if upload is None:
            return
        if wall_s - upload.heard_s > self.GIVE_UP_S:
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "Operation timeout, aborting transfer")
            self.upload = None
        elif wall_s - upload.asked_s >= self.ASK_AGAIN_S:
            self._ask(upload, wall_s)

    def _refuses_beside(self, server: MissionServer, kind: str, peer: Peer, send: Send) -> bool:
        servers = (s for s in (self, *self.others.values()) if isinstance(s, Px4MissionServer) and s is not server)
        busy = any(s.upload is not None or s._reader is not None for s in servers)
        if busy and kind != "MISSION_ACK":
            server._acknowledge(ERROR, peer, send)
            return True
        return False

    def _clear_all_lists(self, peer: Peer, send: Send) -> None:
        for server in (self, *self.others.values()):
            server.clear()
        send(mavlink.MAVLink_mission_ack_message(*peer, ACCEPTED, ALL_LISTS))

    def list_ids(self) -> tuple[int, ...]:
        """The opaque ids of mission, fence and rally points."""
        return tuple(plan_id(server.items) for server in (self, *self.others.values()))

    def restart(self) -> None:
        """The autopilot starts anew: transfers are forgotten, the stored lists are not."""
        super().restart()
        for server in (self, *self.others.values()):
            if isinstance(server, Px4MissionServer):
                server._sender = server._reader = None

    def _acknowledge(self, result: int, peer: Peer, send: Send, plan: Sequence[StoredItem] = ()) -> None:
        message = MissionAckWithId(*peer, result, self._kind.mission_type)
        message.ids = (plan_id(plan),)
        send(message)

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
        if self._reader is not None:
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
        self._sender = peer
        self.upload = Upload(peer, send, message.count, 0, wall_s, wall_s)
        self._ask(self.upload, wall_s)

    def _mission_item(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        upload = self.upload
        if upload is None or upload.peer != peer:
            if upload is None and self._reader is None and self._taken_last(peer, message.seq):
                self._acknowledge(ACCEPTED, peer, send, self._arriving)
            else:
                self._acknowledge(ERROR, peer, send)
            return
        upload.heard_s = wall_s
        if message.seq != upload.next:
            return  # the item that is waited for will be asked for again
        try:
            kept = self._kind.keep(item_of_message(message))
        except ItemRefused as refusal:
            self._acknowledge(refusal.result, peer, send)
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "IGN MISSION_ITEM: Invalid item")
            self._item_refused()
            self.upload = None
            return
        self._arriving.append(replace(kept, wire=wire_form(message)))
        upload.next += 1
        if upload.next < upload.count:
            self._ask(upload, wall_s)
            return
        self.items = list(self._arriving)
        self.upload = None
        self._changed()
        self._acknowledge(ACCEPTED, peer, send, self.items)

    _mission_item_int = _mission_item

    def _taken_last(self, peer: Peer, sequence: int) -> bool:
        """Whether an item was the last one taken, so that it comes again because our acknowledgement was lost.

        PX4 believes so of an upload that broke off, too.
        """
        return self._sender == peer and len(self._arriving) == sequence + 1

    def _mission_request_list(self, _message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        if self.upload is not None:
            self._acknowledge(ERROR, peer, send)
            return
        reader = self._reader
        if reader is not None and reader.peer != peer and reader.next < len(self.items):
            self._say(mavlink.MAV_SEVERITY_INFO, "Mission download request ignored, already active")
            return
        self._reader = Reader(peer, 0, wall_s)
        message = MissionCountWithId(*peer, len(self.items), self._kind.mission_type)
        message.ids = (plan_id(self.items),)
        send(message)

    def _mission_request_int(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        self._give(message, peer, send, wall_s, as_float=False)

    def _mission_request(self, message: Message, peer: Peer, send: Send, wall_s: float) -> None:
        self._give(message, peer, send, wall_s, as_float=True)

    def _give(self, message: Message, peer: Peer, send: Send, wall_s: float, *, as_float: bool) -> None:
        reader = self._reader
        if reader is None or reader.peer != peer or self.upload is not None:
            return
        if message.seq >= len(self.items) or message.seq not in {reader.next, reader.next - 1}:
            self._reader = None
            self._acknowledge(ERROR, peer, send)
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "WPM: REJ. CMD: Req. WP was unexpected")
            return
        reader.next, reader.heard_s = message.seq + 1, wall_s
        item = replace(self.items[message.seq], current=int(message.seq == self._current()))
        send(message_of_item(item, message.seq, peer, self._kind.mission_type, as_float=as_float))

    def _mission_ack(self, message: Message, peer: Peer, _send: Send, _wall_s: float) -> None:
        if self._reader is not None and self._reader.peer == peer:
            self._reader = None
        if self.upload is not None and self.upload.peer == peer and message.type == CANCELLED:
            self.upload = None

    def _mission_write_partial_list(self, _message: Message, _peer: Peer, _send: Send, _wall_s: float) -> None:
        """Not known: no answer."""

    def _mission_clear_all(self, _message: Message, peer: Peer, send: Send, _wall_s: float) -> None:
        if self.upload is not None:
            self._acknowledge(ERROR, peer, send)
            return
        if self._reader is not None:
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "WPM: IGN CLEAR CMD: Busy")
            return
        self.clear()
        self._acknowledge(ACCEPTED, peer, send)
