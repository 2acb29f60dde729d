"""What a fault of the mission protocol is, and where faults stand: between a mission server and its links."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random
from typing import NamedTuple, Protocol

from sitl_mocks.dialect import AUTOPILOT_COMPONENT, Message, mavlink
from sitl_mocks.mission_server import MESSAGES, MissionServer

STATION = (255, 190)
"""System and component id of the station whose transfers are disturbed."""
UPLOAD, DOWNLOAD = "upload", "download"
REQUESTS = frozenset({"MISSION_REQUEST", "MISSION_REQUEST_INT"})
ITEMS = frozenset({"MISSION_ITEM", "MISSION_ITEM_INT"})


class Said(NamedTuple):
    """A message and who says it; by default the vehicle's autopilot."""

    message: Message
    component: int = AUTOPILOT_COMPONENT
    system_id: int | None = None


class Send(Protocol):
    """Puts a message on the link, as the autopilot or as somebody else."""

    def __call__(self, message: Message, component: int = ..., system_id: int | None = ..., /) -> None:
        """Send it."""
        ...


class MissionFault:
    """One thing that goes wrong with missions; this one changes nothing.

    Args:
        server: the vehicle's mission server.
        rng: of everything that is left to chance.
    """

    severs: frozenset[str] = frozenset()
    """Which transfers can never come to an end, whatever a station tries: its link is gone, as far as they go."""

    def __init__(self, server: MissionServer, rng: Random) -> None:
        self.server = server
        self.rng = rng
        self.meddled_s = -math.inf
        """When somebody else last changed what the vehicle holds."""
        self.restarts = 0
        """How often it had the autopilot start anew."""

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """What reaches the server of a mission message that came in."""
        del wall_s
        return [message]

    def hears_file(self, wall_s: float) -> bool:
        """Whether a request about the file of the list reaches the vehicle."""
        del wall_s
        return True

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """What goes out of a message of the server."""
        del wall_s
        return [Said(message)]

    def step(self, wall_s: float) -> None:
        """Let time pass."""

    @property
    def next_s(self) -> float:
        """Wall time at which `step` has something to do."""
        return math.inf

    def ack(self, result: int) -> Message:
        """A MISSION_ACK to the station."""
        return mavlink.MAVLink_mission_ack_message(*STATION, result, self.server.mission_type)


class MissionDoor:
    """Everything about missions passes through here, and through the faults that stand in it.

    Args:
        server: the mission server.
        faults: in the order in which they hear; they say in the opposite order.
    """

    def __init__(self, server: MissionServer, faults: Sequence[MissionFault] = ()) -> None:
        self._server = server
        self._faults = tuple(faults)

    @property
    def meddled_s(self) -> float:
        """When somebody else last changed what the vehicle holds."""
        return max((fault.meddled_s for fault in self._faults), default=-math.inf)

    @property
    def restarts(self) -> int:
        """How often the autopilot has started anew."""
        return sum(fault.restarts for fault in self._faults)

    @property
    def severs(self) -> frozenset[str]:
        """Which transfers can never come to an end."""
        return frozenset().union(*(fault.severs for fault in self._faults))

    @property
    def next_s(self) -> float:
        """Wall time at which `step` has something to do."""
        return min([fault.next_s for fault in self._faults], default=math.inf)

    def handle(self, message: Message, send: Send, wall_s: float) -> bool:
        """Answer a message of the mission protocol; False if it is none."""
        if message.get_type() not in MESSAGES:
            return False
        heard = [message]
        for fault in self._faults:
            heard = [passed for each in heard for passed in fault.hear(each, wall_s)]
        for each in heard:
            self._server.handle(each, self._speaker(send, wall_s), wall_s)
        return True

    def hears_file(self, wall_s: float) -> bool:
        """Whether a request about the file of the list gets through."""
        return all(fault.hears_file(wall_s) for fault in self._faults)

    def step(self, wall_s: float) -> None:
        """Let time pass for the faults."""
        for fault in self._faults:
            fault.step(wall_s)

    def _speaker(self, send: Send, wall_s: float) -> Callable[[Message], None]:
        if not self._faults:
            return send

        def speak(message: Message) -> None:
            said = [Said(message)]
            for fault in reversed(self._faults):
                said = [altered for each in said for altered in self._altered(fault, each, wall_s)]
            for each in said:
                send(*each)

        return speak

    @staticmethod
    def _altered(fault: MissionFault, said: Said, wall_s: float) -> list[Said]:
        by_autopilot = said.system_id is None and said.component == AUTOPILOT_COMPONENT
        return fault.say(said.message, wall_s) if by_autopilot else [said]
