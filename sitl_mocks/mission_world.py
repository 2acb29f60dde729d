"""A vehicle's mission server at the far end of a bad link, on fake time and without sockets, and the truth about it."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from random import Random

from sitl_mocks.ardupilot_files import ArduPilotFiles
from sitl_mocks.ardupilot_mission_server import ArduPilotMissionServer
from sitl_mocks.channel import Channel, FaultyPipe, LinkFaults
from sitl_mocks.dialect import AUTOPILOT_COMPONENT, Message, mavlink
from sitl_mocks.file_server import FileServer
from sitl_mocks.link_faults import SEVERING, ChangingLink, link_changes
from sitl_mocks.mission_fault import DOWNLOAD, UPLOAD, MissionDoor
from sitl_mocks.mission_faults import make_faults
from sitl_mocks.mission_items import ItemRefused, StoredItem, float32
from sitl_mocks.mission_server import MissionServer
from sitl_mocks.parameters import ParameterServer
from sitl_mocks.plan_id import wire_form
from sitl_mocks.px4_mission_server import Px4MissionServer

WireItem = Sequence[float]
"""Frame, command, param1 to param4, x, y, z, autocontinue, as they travel."""

SYSTEM_ID = 1
AFTERMATH_S = 15.0
"""How long what is still under way may have its effect after the station has come to its verdict."""
_HOME = StoredItem(0, 16, (0.0, 0.0, 0.0, 0.0), 313620196, 1216152898, 4.0)
_PLACE_TOLERANCE = 1
_NUMBER_TOLERANCE = 0.011
_QUEUED_S = 2.0


@dataclass(frozen=True)
class WorldSpec:
    """What to simulate.

    Attributes:
        autopilot: px4 or ardupilot.
        faults: names of faults of missions and of the link.
        seed: of all that is left to chance.
        loss: of packets, each way.
        latency_s: of the link, one way.
        jitter_s: each packet takes up to so much longer.
        mission_type: MAV_MISSION_TYPE of the list that is transferred.
        serves_files: whether the vehicle has the lists as files, too; ArduPilot does.
        plan: what a station will upload, as wire items; empty when it just reads.
        held: what the vehicle holds at first, likewise.
    """

    autopilot: str
    faults: tuple[str, ...]
    seed: int
    loss: float
    plan: tuple[WireItem, ...]
    held: tuple[WireItem, ...]
    latency_s: float = 0.025
    jitter_s: float = 0.005
    mission_type: int = 0
    serves_files: bool = False


class MissionWorld:
    """One vehicle and its link.

    Args:
        spec: what to simulate.
    """

    def __init__(self, spec: WorldSpec) -> None:
        rng = Random(spec.seed)
        self.now_s = 0.0
        self._servers = _make_servers(spec.autopilot)
        self._server = self._servers if spec.mission_type == 0 else self._servers.others[spec.mission_type]
        self._serves_files = spec.serves_files
        self._files = self._make_files()
        self._file_made_s = math.inf
        """When the vehicle made the file that the station reads; infinite when it reads item by item."""
        self._restarts = 0
        self._plan = self._kept(spec.plan)
        self._server.items = self._kept(spec.held) or []
        self._severed = any(name in SEVERING for name in spec.faults)
        self._door = MissionDoor(self._servers, make_faults(spec.faults, self._server, rng))
        self._faults = LinkFaults(loss=spec.loss, delay_s=spec.jitter_s, latency_s=spec.latency_s)
        self._link = ChangingLink(self._faults, link_changes(spec.faults, rng), 0.0)
        self._link.step(0.0)
        self._to_station: list[bytes] = []
        self._down = FaultyPipe(self._to_station.append, self._faults, spec.seed * 2 + 1)
        self._channel = Channel(SYSTEM_ID, lambda packet: self._down.put(packet, self.now_s), self._faults)
        self._parser = mavlink.MAVLink(None)
        self._up = FaultyPipe(self._arrive, self._faults, spec.seed * 2 + 2)
        self._history: list[tuple[float, list[StoredItem]]] = [(0.0, list(self._server.items))]

    def pass_time(self, until_s: float, packets: Sequence[bytes]) -> tuple[float, list[bytes]]:
        """Send packets to the vehicle now, and let time pass until the station hears something, or until a time.

        Returns:
            The time then, and what the station hears.
        """
        for packet in packets:
            self._up.put(packet, self.now_s)
        while True:
            self.now_s = max(self.now_s, min(until_s, self._next_s()))
            self._link.step(self.now_s)
            self._up.release(self.now_s)
            self._servers.step(self.now_s)
            self._files.step()
            self._door.step(self.now_s)
            self._down.release(self.now_s)
            if self._server.items != self._history[-1][1]:
                self._history.append((self.now_s, list(self._server.items)))
            if self._to_station or self.now_s >= until_s:
                heard = list(self._to_station)
                self._to_station.clear()
                return self.now_s, heard

    def truth(self, read: Sequence[WireItem] | None = None) -> dict[str, bool]:
        """What is so, independently of what the station believes; nothing else may be asked afterwards.

        Args:
            read: what the station says that the vehicle holds, after a download.

        Returns:
            `held`: the vehicle held the plan when it sent the station its last words, or made the file that it last
            gave out; `holds`: it holds it in the end;
            `meddled`: somebody else changed it since; `severed_upload`, `severed_download`: no such transfer can end;
            `read_right`: what the station read is what the vehicle held when it sent its last words.
        """
        under_way_s = self._faults.latency_s + self._faults.delay_s + (_QUEUED_S if self._faults.bytes_per_s else 0.0)
        spoken_s = min(self.now_s - under_way_s, self._file_made_s)
        lately = [
            items
            for (_, items), (until_s, _) in zip(self._history, [*self._history[1:], (math.inf, [])], strict=True)
            if until_s >= spoken_s
        ]
        meddled, severs = self._door.meddled_s >= spoken_s, self._door.severs
        self._door = MissionDoor(self._servers)
        end_s = self.now_s + AFTERMATH_S
        while self.now_s < end_s:
            self.pass_time(end_s, ())
        return {
            "held": any(self._is_plan(items) for items in lately),
            "holds": self._is_plan(self._server.items),
            "meddled": meddled,
            "severed_upload": self._severed or UPLOAD in severs,
            "severed_download": self._severed or DOWNLOAD in severs,
            "read_right": read is not None and any(self._tells(items, read) for items in lately),
        }

    def _next_s(self) -> float:
        if self._files.busy:
            return self.now_s
        return min(self._up.next_s, self._down.next_s, self._servers.next_s, self._door.next_s, self._link.next_s)

    def _arrive(self, packet: bytes) -> None:
        try:
            message = self._parser.decode(bytearray(packet))
        except (mavlink.MAVError, struct.error):
            return  # damaged on the way; each packet comes by itself here, so that it takes no other with it
        if message.get_type() == "FILE_TRANSFER_PROTOCOL":
            self._file_request(message)
            return
        self._file_made_s = math.inf
        self._door.handle(message, self._say, self.now_s)

    def _file_request(self, message: Message) -> None:
        heard = self._door.hears_file(self.now_s)
        if self._door.restarts != self._restarts:
            self._restarts = self._door.restarts
            self._files = self._make_files()
        if heard and self._serves_files:
            self._files.handle(message, self._say)

    def _make_files(self) -> FileServer:
        servers = self._servers.by_type if isinstance(self._servers, ArduPilotMissionServer) else {}
        return FileServer(_NoFiles(), sessions=1, virtual=_ListFiles(servers, self._note_file))

    def _note_file(self) -> None:
        self._file_made_s = self.now_s

    def _say(self, message: Message, component: int = AUTOPILOT_COMPONENT, system_id: int | None = None) -> None:
        self._channel.send(message, component, system_id)

    def _kept(self, items: Sequence[WireItem]) -> list[StoredItem] | None:
        """What the vehicle makes of wire items; None when it does not take them all, or there are none."""
        try:
            return [_with_wire(item, self._server.keep(item)) for item in map(_stored, items)] or None
        except ItemRefused:
            return None

    def _is_plan(self, items: Sequence[StoredItem]) -> bool:
        first = int(self._server.home_is_item_0)
        if self._plan is None or len(items) != len(self._plan):
            return False
        return all(_exact(a) == _exact(b) for a, b in list(zip(items, self._plan, strict=True))[first:])

    def _tells(self, items: Sequence[StoredItem], read: Sequence[WireItem]) -> bool:
        """Whether a station that read these wire items read this list."""
        first = int(self._server.home_is_item_0)
        if len(items) != len(read):
            return False
        return all(_about(a, _stored(b)) for a, b in list(zip(items, read, strict=True))[first:])


class _ListFiles(ArduPilotFiles):
    """The lists as files.

    Args:
        servers: by MAV_MISSION_TYPE.
        made: called whenever one is made to be read.
    """

    def __init__(self, servers: Mapping[int, ArduPilotMissionServer], made: Callable[[], None]) -> None:
        super().__init__(lambda: ParameterServer({}, bytewise=False), servers)
        self._made = made

    def content(self, path: str) -> bytes | None:
        """See base class."""
        self._made()
        return super().content(path)


class _NoFiles:
    """A folder without files."""

    def content(self, path: str) -> bytes | None:
        """There is none."""
        del path
        return None

    def entries(self, path: str) -> list[str] | None:
        """There are none."""
        del path
        return None


def _make_servers(autopilot: str) -> MissionServer:
    if autopilot == "px4":
        return Px4MissionServer(lambda _severity, _text: None, lambda: None, lambda: 0)
    return ArduPilotMissionServer(lambda _severity, _text: None, lambda: None, lambda: _HOME, lambda: True)


def _stored(values: WireItem) -> StoredItem:
    frame, command, p1, p2, p3, p4, x, y, z, autocontinue = values
    params = (float32(p1), float32(p2), float32(p3), float32(p4))
    return StoredItem(int(frame), int(command), params, int(x), int(y), float32(z), 0, int(autocontinue))


def _with_wire(item: StoredItem, kept: StoredItem) -> StoredItem:
    message = mavlink.MAVLink_mission_item_int_message(
        SYSTEM_ID, 1, 0, item.frame, item.command, 0, item.autocontinue, *item.params, item.x, item.y, item.z, 0
    )
    return replace(kept, wire=wire_form(message))


def _exact(item: StoredItem) -> tuple[object, ...]:
    floats = tuple("nan" if math.isnan(value) else value for value in (*item.params, item.z))
    return (item.frame, item.command, item.x, item.y, item.autocontinue, floats)


def _about(a: StoredItem, b: StoredItem) -> bool:
    """Whether two items are the same but for rounding."""
    numbers = zip((*a.params, a.z), (*b.params, b.z), strict=True)
    return (
        (a.frame, a.command) == (b.frame, b.command)
        and abs(a.x - b.x) <= _PLACE_TOLERANCE
        and abs(a.y - b.y) <= _PLACE_TOLERANCE
        and all(abs(p - q) <= _NUMBER_TOLERANCE or (math.isnan(p) and math.isnan(q)) for p, q in numbers)
    )
