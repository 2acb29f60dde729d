"""Faults while a station reads a mission: those of QGroundControl's MockLink."""

from __future__ import annotations

from random import Random

from sitl_mocks.dialect import Message
from sitl_mocks.mission_fault import DOWNLOAD, ITEMS, REQUESTS, MissionFault, Said
from sitl_mocks.mission_server import ERROR, MissionServer


class DeafToList(MissionFault):
    """The request for the list is not answered, always or the first time only."""

    def __init__(self, server: MissionServer, rng: Random, *, once: bool) -> None:
        super().__init__(server, rng)
        self._left = 1 if once else -1
        self.severs = frozenset() if once else frozenset({DOWNLOAD})

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """See base class."""
        del wall_s
        if message.get_type() != "MISSION_REQUEST_LIST" or not self._left:
            return [message]
        self._left -= 1
        return []


class DeafToRequest(MissionFault):
    """The request for an item is not answered, always or the first time only."""

    def __init__(self, server: MissionServer, rng: Random, *, sequence: int, once: bool) -> None:
        super().__init__(server, rng)
        self._sequence = sequence
        self._left = 1 if once else -1
        self.severs = frozenset() if once else frozenset({DOWNLOAD})

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """See base class."""
        del wall_s
        if message.get_type() not in REQUESTS or message.seq != self._sequence or not self._left:
            return [message]
        self._left -= 1
        return []


class MisnumberedItem(MissionFault):
    """An item is given out under the next one's number."""

    severs = frozenset({DOWNLOAD})

    def __init__(self, server: MissionServer, rng: Random, *, sequence: int) -> None:
        super().__init__(server, rng)
        self._sequence = sequence

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if message.get_type() in ITEMS and message.seq == self._sequence:
            message.seq += 1
        return [Said(message)]


class ErrorInsteadOfItem(MissionFault):
    """An error is answered to the request for an item."""

    severs = frozenset({DOWNLOAD})

    def __init__(self, server: MissionServer, rng: Random, *, sequence: int) -> None:
        super().__init__(server, rng)
        self._sequence = sequence

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if message.get_type() in ITEMS and message.seq == self._sequence:
            return [Said(self.ack(ERROR))]
        return [Said(message)]
