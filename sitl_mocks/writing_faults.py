"""Faults while a station writes a mission: those of QGroundControl's MockLink, and what real vehicles add to them."""

from __future__ import annotations

from random import Random

from sitl_mocks.dialect import Message
from sitl_mocks.mission_fault import ITEMS, REQUESTS, UPLOAD, MissionFault, Said
from sitl_mocks.mission_server import ACCEPTED, INVALID_SEQUENCE, NO_SPACE, MissionServer


class DeafToCount(MissionFault):
    """The announcement of a mission is not answered, always or the first time only."""

    def __init__(self, server: MissionServer, rng: Random, *, once: bool) -> None:
        super().__init__(server, rng)
        self._left = 1 if once else -1
        self.severs = frozenset() if once else frozenset({UPLOAD})

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """See base class."""
        del wall_s
        if message.get_type() != "MISSION_COUNT" or not self._left:
            return [message]
        self._left -= 1
        return []


class NeverAsks(MissionFault):
    """An item is never asked for; it is taken all the same when it comes."""

    def __init__(self, server: MissionServer, rng: Random, *, sequence: int) -> None:
        super().__init__(server, rng)
        self._sequence = sequence

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        asked = message.get_type() in REQUESTS and message.seq == self._sequence
        return [] if asked else [Said(message)]


class AsksForAnother(MissionFault):
    """The next item is asked for instead of the one that is waited for."""

    severs = frozenset({UPLOAD})

    def __init__(self, server: MissionServer, rng: Random, *, sequence: int) -> None:
        super().__init__(server, rng)
        self._sequence = sequence

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if message.get_type() in REQUESTS and message.seq == self._sequence:
            message.seq += 1
        return [Said(message)]


class EndsInstead(MissionFault):
    """The upload is ended with a result where an item should be asked for."""

    severs = frozenset({UPLOAD})

    def __init__(self, server: MissionServer, rng: Random, *, sequence: int, result: int) -> None:
        super().__init__(server, rng)
        self._sequence, self._result = sequence, result

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if message.get_type() in REQUESTS and message.seq == self._sequence:
            self.server.upload = None
            return [Said(self.ack(self._result))]
        return [Said(message)]


class FinalAcknowledgement(MissionFault):
    """The final acknowledgement is lost, always or the first time only, or says something else."""

    def __init__(self, server: MissionServer, rng: Random, *, once: bool = False, result: int | None = None) -> None:
        super().__init__(server, rng)
        self._left = 1 if once else -1
        self._result = result

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if message.get_type() != "MISSION_ACK" or message.type != ACCEPTED or not self._left:
            return [Said(message)]
        self._left -= 1
        return [] if self._result is None else [Said(self.ack(self._result))]


class FullAfter(MissionFault):
    """The storage turns out to be full in mid-transfer."""

    severs = frozenset({UPLOAD})

    def __init__(self, server: MissionServer, rng: Random) -> None:
        super().__init__(server, rng)
        self._room = rng.randrange(1, 4)

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """See base class."""
        del wall_s
        if message.get_type() in ITEMS and message.seq == self._room and self.server.upload is not None:
            upload, self.server.upload = self.server.upload, None
            upload.send(self.ack(NO_SPACE))
            return []
        return [message]


class OddWordsBeforeRequests(MissionFault):
    """Before each request comes a word that does not end the transfer: INVALID_SEQUENCE, or a request out of range."""

    def __init__(self, server: MissionServer, rng: Random, *, out_of_range: bool) -> None:
        super().__init__(server, rng)
        self._out_of_range = out_of_range

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if message.get_type() not in REQUESTS:
            return [Said(message)]
        odd: Message = self.ack(INVALID_SEQUENCE)
        if self._out_of_range:
            sequence = self.rng.choice((5, 6, 5000, 65535))
            odd = type(message)(message.target_system, message.target_component, sequence, message.mission_type)
        return [Said(odd), Said(message)]


class RequestStorm(MissionFault):
    """One request comes many times at once."""

    _TIMES = 50

    def __init__(self, server: MissionServer, rng: Random) -> None:
        super().__init__(server, rng)
        self._sequence = rng.randrange(5)

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        stormy = message.get_type() in REQUESTS and message.seq == self._sequence
        return [Said(message)] * (self._TIMES if stormy else 1)
