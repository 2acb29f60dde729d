"""A vehicle's mission server at the far end of a bad link, on fake time and without sockets, and the truth about it."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from random import Random

from sitl_mocks.ardupilot_mission_server import ArduPilotMissionServer
from sitl_mocks.channel import Channel, FaultyPipe, LinkFaults
from sitl_mocks.dialect import AUTOPILOT_COMPONENT, Message, mavlink
from sitl_mocks.fence_rally import ARDUPILOT_MISSION, PX4_MISSION
from sitl_mocks.link_faults import SEVERING, ChangingLink, link_changes
from sitl_mocks.mission_fault import DOWNLOAD, UPLOAD, MissionDoor
from sitl_mocks.mission_faults import make_faults
from sitl_mocks.mission_items import ItemRefused, StoredItem, float32
from sitl_mocks.mission_server import MissionServer
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


class MissionWorld:
    """One vehicle and its link.

    Args:
        spec: what to simulate.
    """

    def __init__(self, spec: WorldSpec) -> None:
        rng = Random(spec.seed)
        self.now_s = 0.0
        self._server = _make_server(spec.autopilot)
        self._plan = self._kept(spec.plan)
        self._server.items = self._kept(spec.held) or []
        self._severed = any(name in SEVERING for name in spec.faults)
        self._door = MissionDoor(self._server, make_faults(spec.faults, self._server, rng))
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
            self._server.step(self.now_s)
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
            `held`: the vehicle held the plan when it sent the station its last words; `holds`: it holds it in the end;
            `meddled`: somebody else changed it since; `severed_upload`, `severed_download`: no such transfer can end;
            `read_right`: what the station read is what the vehicle held when it sent its last words.
        """
        under_way_s = self._faults.latency_s + self._faults.delay_s + (_QUEUED_S if self._faults.bytes_per_s else 0.0)
        spoken_s = self.now_s - under_way_s
        lately = [
            items
            for (_, items), (until_s, _) in zip(self._history, [*self._history[1:], (math.inf, [])], strict=True)
            if until_s >= spoken_s
        ]
        meddled, severs = self._door.meddled_s >= spoken_s, self._door.severs
        self._door = MissionDoor(self._server)
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
        return min(self._up.next_s, self._down.next_s, self._server.next_s, self._door.next_s, self._link.next_s)

    def _arrive(self, packet: bytes) -> None:
        try:
            message = self._parser.decode(bytearray(packet))
        except (mavlink.MAVError, struct.error):
            return  # damaged on the way; each packet comes by itself here, so that it takes no other with it
        self._door.handle(message, self._say, self.now_s)

    def _say(self, message: Message, component: int = AUTOPILOT_COMPONENT, system_id: int | None = None) -> None:
        self._channel.send(message, component, system_id)

    def _kept(self, items: Sequence[WireItem]) -> list[StoredItem] | None:
        """What the vehicle makes of wire items; None when it does not take them all, or there are none."""
        kind = PX4_MISSION if isinstance(self._server, Px4MissionServer) else ARDUPILOT_MISSION
        try:
            return [_with_wire(item, kind.keep(item)) for item in map(_stored, items)] or None
        except ItemRefused:
            return None

    def _is_plan(self, items: Sequence[StoredItem]) -> bool:
        first = int(self._server.HOME_IS_ITEM_0)
        if self._plan is None or len(items) != len(self._plan):
            return False
        return all(_exact(a) == _exact(b) for a, b in list(zip(items, self._plan, strict=True))[first:])

    def _tells(self, items: Sequence[StoredItem], read: Sequence[WireItem]) -> bool:
        """Whether a station that read these wire items read this list."""
        first = int(self._server.HOME_IS_ITEM_0)
        if len(items) != len(read):
            return False
        return all(_about(a, _stored(b)) for a, b in list(zip(items, read, strict=True))[first:])


def _make_server(autopilot: str) -> MissionServer:
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
