"""Faults of what a vehicle holds, and of how it tells it."""

from __future__ import annotations

from random import Random

from sitl_mocks.dialect import Message
from sitl_mocks.mission_fault import ITEMS, MissionFault, Said
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.mission_server import ACCEPTED, MissionServer
from sitl_mocks.plan_id import MissionAckWithId, plan_id
from sitl_mocks.stray_faults import foreign_plan

_LAST_BIT = 2.0**-23


class StoreFault(MissionFault):
    """Acts on the store when an upload has come to its end, before that is acknowledged."""

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        if message.get_type() == "MISSION_ACK" and message.type == ACCEPTED and self.server.items:
            self.spoil(wall_s)
            if isinstance(message, MissionAckWithId):
                message.ids = (plan_id(self.server.items),)
        return [Said(message)]

    def spoil(self, wall_s: float) -> None:
        """Change the store."""
        raise NotImplementedError


class Truncated(StoreFault):
    """The last item is silently not kept."""

    def __init__(self, server: MissionServer, rng: Random) -> None:
        super().__init__(server, rng)
        self._kept = rng.randrange(2, 5)

    def spoil(self, wall_s: float) -> None:
        """See base class."""
        del wall_s
        self.server.items = self.server.items[: self._kept]


class Mixed(StoreFault):
    """An item of the mission before is silently kept in the new one."""

    def __init__(self, server: MissionServer, rng: Random) -> None:
        super().__init__(server, rng)
        self._old = list(server.items)
        self._place = rng.randrange(1, 5)

    def spoil(self, wall_s: float) -> None:
        """See base class."""
        del wall_s
        if self._place < min(len(self._old), len(self.server.items)):
            self.server.items[self._place] = self._old[self._place]


class HomeInItem0(StoreFault):
    """Home is put before the first item, and everything moves up by one."""

    def spoil(self, wall_s: float) -> None:
        """See base class."""
        del wall_s
        home = StoredItem(0, 16, (0.0, 0.0, 0.0, 0.0), 313620196, 1216152898, 4.0, wire=b"home")
        self.server.items = [home, *self.server.items]


class ReplacedByOther(MissionFault):
    """Somebody else changes or clears the mission, once: right after it was acknowledged, or when it is read."""

    def __init__(self, server: MissionServer, rng: Random, *, clears: bool) -> None:
        super().__init__(server, rng)
        self._clears = clears
        self._when = rng.choice(("acknowledged", "read"))
        self._file_requests = rng.randrange(12)
        self._uploaded = self._done = False

    def hear(self, message: Message, wall_s: float) -> list[Message]:
        """See base class."""
        if message.get_type() == "MISSION_REQUEST_LIST" and (self._when == "read" or self._uploaded):
            self._replace(wall_s)
        return [message]

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        if message.get_type() == "MISSION_ACK" and message.type == ACCEPTED:
            self._uploaded = True
            if self._when == "acknowledged":
                self._replace(wall_s)
        return [Said(message)]

    def hears_file(self, wall_s: float) -> bool:
        """See base class."""
        self._file_requests -= 1
        if self._file_requests < 0:
            self._replace(wall_s)
        return True

    def _replace(self, wall_s: float) -> None:
        if not self._done:
            self._done = True
            self.meddled_s = wall_s
            self.server.items = [] if self._clears else foreign_plan(self.rng, self.server.mission_type)


class Rounded(MissionFault):
    """Numbers come back rounded: places by a unit of the last digit, the rest by what single precision leaves.

    Whole numbers do not: what an autopilot keeps as an integer comes back as it is.
    """

    def __init__(self, server: MissionServer, rng: Random) -> None:
        super().__init__(server, rng)
        self._seed = rng.randrange(2**32)

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if message.get_type() in ITEMS:
            chance = Random(self._seed + message.seq)  # the same item is rounded in the same way each time
            if message.x and message.y:
                message.x += chance.choice((-1, 0, 1))
                message.y += chance.choice((-1, 0, 1))
            for name in ("z", "param4"):
                value = getattr(message, name)
                if value % 1.0:
                    setattr(message, name, value * (1.0 + chance.choice((-1, 0, 1)) * _LAST_BIT))
        return [Said(message)]


class DriftingHome(MissionFault):
    """Where item 0 is home, it is a little different every time it is told."""

    def say(self, message: Message, wall_s: float) -> list[Said]:
        """See base class."""
        del wall_s
        if self.server.home_is_item_0 and message.get_type() in ITEMS and message.seq == 0:
            message.x += self.rng.randrange(-50, 50)
            message.y += self.rng.randrange(-50, 50)
            message.z += self.rng.uniform(-0.5, 0.5)
        return [Said(message)]
