"""Faults of identity and time: messages of others, about other lists, from before; a second station; a reboot."""

from __future__ import annotations

import math
from dataclasses import replace
from random import Random

from sitl_mocks.dialect import AUTOPILOT_COMPONENT, CAMERA_COMPONENT, Message, mavlink
from sitl_mocks.fence_rally import EXCLUDED_CIRCLE, FENCE, RALLY, RALLY_POINT
from sitl_mocks.mission_fault import DOWNLOAD, ITEMS, REQUESTS, STATION, UPLOAD, MissionFault, Said
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.mission_server import ACCEPTED, CANCELLED, ERROR, NO_SPACE, UNSUPPORTED, MissionServer
from sitl_mocks.plan_id import wire_form

_OTHER_STATION = (254, 190)


class Deaf(MissionFault):
    """Nothing reaches the vehicle: it takes signed packets only."""

    severs = frozenset({UPLOAD, DOWNLOAD})

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """See base class."""
        del message, wall_s
        return []

    def hears_file(self, wall_s: float) -> bool:
        """See base class."""
        del wall_s
        return False


class StaleOfOtherList(MissionFault):
    """Acknowledgements and requests about another list come in between; about the fence, beside a mission."""

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        other = (self.server.mission_type + 1) % 3
        stale = [
            mavlink.MAVLink_mission_ack_message(*STATION, self.rng.choice((ACCEPTED, ERROR, NO_SPACE)), other),
            mavlink.MAVLink_mission_request_int_message(*STATION, self.rng.randrange(5), other),
            mavlink.MAVLink_mission_count_message(*STATION, 3, other),
        ]
        return [*map(Said, stale), Said(message)]


class Impostor(MissionFault):
    """Another component, or another vehicle on the link, acknowledges and asks."""

    def __init__(self, server: MissionServer, rng: Random, *, system_id: int | None = None) -> None:
        super().__init__(server, rng)
        self._source = (CAMERA_COMPONENT, None) if system_id is None else (AUTOPILOT_COMPONENT, system_id)

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        result = self.rng.choice((ACCEPTED, ERROR, UNSUPPORTED, NO_SPACE, CANCELLED))
        foreign = [
            self.ack(result),
            mavlink.MAVLink_mission_request_int_message(*STATION, self.rng.randrange(5), self.server.mission_type),
            mavlink.MAVLink_mission_count_message(*STATION, 3, self.server.mission_type),
        ]
        return [*(Said(each, *self._source) for each in foreign), Said(message)]


class StaleAcknowledgement(MissionFault):
    """The acknowledgement of an earlier upload arrives at the begin of this one."""

    _sent = False

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if self._sent or message.get_type() not in REQUESTS:
            return [Said(message)]
        self._sent = True
        return [Said(self.ack(ACCEPTED)), Said(message)]


class Reboot(MissionFault):
    """The autopilot starts anew in mid-transfer and is silent for some seconds."""

    _TRIGGERS = ITEMS | REQUESTS | {"MISSION_COUNT", "MISSION_REQUEST_LIST"}

    def __init__(self, server: MissionServer, rng: Random) -> None:
        super().__init__(server, rng)
        self._after = rng.randrange(8)
        self._silent_until_s = -math.inf

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """See base class."""
        if message.get_type() in self._TRIGGERS:
            self._count_down(wall_s)
        return [] if wall_s < self._silent_until_s else [message]

    def hears_file(self, wall_s: float) -> bool:
        """See base class."""
        self._count_down(wall_s)
        return wall_s >= self._silent_until_s

    def _count_down(self, wall_s: float) -> None:
        self._after -= 1
        if self._after == -1:
            self.server.restart()
            self.restarts += 1
            self._silent_until_s = wall_s + self.rng.uniform(1.0, 4.0)


def foreign_plan(rng: Random, mission_type: int) -> list[StoredItem]:
    """A list of somebody else; every item differs from those of any plan that is tested with."""
    command, size_m = {0: (16, 0.0), FENCE: (EXCLUDED_CIRCLE, 55.0), RALLY: (RALLY_POINT, 0.0)}[mission_type]
    plan = []
    for sequence in range(rng.randrange(3, 8)):
        x, y = rng.randrange(-(10**8), 10**8), rng.randrange(-(10**8), 10**8)
        message = mavlink.MAVLink_mission_item_int_message(
            1, 1, sequence, 6, command, 0, 1, size_m, 0.0, 0.0, 0.0, x, y, 55.0, mission_type
        )
        item = StoredItem(6, command, (size_m, 0.0, 0.0, 0.0), x, y, 55.0)
        plan.append(replace(item, wire=wire_form(message)))
    return plan


class SecondStation(MissionFault):
    """Another station uploads a mission of its own meanwhile; it may give up in the middle."""

    _ANSWERS_AFTER_S = 0.03
    _RETRIES_AFTER_S = 1.0

    def __init__(self, server: MissionServer, rng: Random) -> None:
        super().__init__(server, rng)
        self._plan = foreign_plan(rng, server.mission_type)
        self._stops_at = rng.choice((len(self._plan), rng.randrange(len(self._plan))))
        self._tries = 4
        self._outbox: list[Message] = []
        self._next_s = math.inf
        self._starts_after = rng.randrange(10)

    @property
    def next_s(self) -> float:
        """See base class."""
        return self._next_s

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """See base class."""
        self._count_down(wall_s)
        return [message]

    def hears_file(self, wall_s: float) -> bool:
        """See base class."""
        self._count_down(wall_s)
        return True

    def step(self, wall_s: float) -> None:
        """See base class."""
        if wall_s < self._next_s:
            return
        outbox, self._outbox = self._outbox, []
        self._next_s = math.inf
        for message in outbox:
            self._pass_on(message, wall_s)

    def _count_down(self, wall_s: float) -> None:
        self._starts_after -= 1
        if self._starts_after == -1:
            self._announce(wall_s)

    def _announce(self, wall_s: float) -> None:
        self._tries -= 1
        self._outbox = [mavlink.MAVLink_mission_count_message(1, 1, len(self._plan), self.server.mission_type)]
        self._next_s = wall_s + self._ANSWERS_AFTER_S

    def _pass_on(self, message: Message, wall_s: float) -> None:
        message.get_header().srcSystem, message.get_header().srcComponent = _OTHER_STATION
        before = list(self.server.items)
        self.server.handle(message, lambda reply: self._answer(reply, wall_s), wall_s)
        if self.server.items != before:
            self.meddled_s = wall_s

    def _answer(self, reply: Message, wall_s: float) -> None:
        kind = reply.get_type()
        if kind in REQUESTS and reply.seq < self._stops_at:
            item = self._plan[reply.seq]
            self._outbox.append(
                mavlink.MAVLink_mission_item_int_message(
                    *(1, 1, reply.seq, item.frame, item.command, 0, 1, *item.params, item.x, item.y, item.z),
                    self.server.mission_type,
                )
            )
            self._next_s = wall_s + self._ANSWERS_AFTER_S
        elif kind == "MISSION_ACK" and reply.type not in {ACCEPTED, CANCELLED} and self._tries:
            self._announce(wall_s)
            self._next_s = wall_s + self._RETRIES_AFTER_S
