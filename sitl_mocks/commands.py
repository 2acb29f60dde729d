"""Commands as they arrive, whichever of the two messages carried them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sitl_mocks.dialect import Message, mavlink

ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
REJECTED = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)
FAILED = int(mavlink.MAV_RESULT_FAILED)

FORCE_ARM_MAGIC = 21196.0


@dataclass(frozen=True)
class Command:
    """A MAV_CMD from COMMAND_LONG or COMMAND_INT, or from a mission item.

    Attributes:
        number: MAV_CMD.
        params: param1 to param7; of COMMAND_INT the fifth and sixth in degrees (global frames).
        sender: system and component id.
        confirmation: how often it was sent before.
        frame: of a COMMAND_INT; None for COMMAND_LONG.
    """

    number: int
    params: tuple[float, float, float, float, float, float, float]
    sender: tuple[int, int] = (0, 0)
    confirmation: int = 0
    frame: int | None = None

    @property
    def place_is_given(self) -> bool:
        """Whether params 5 and 6 are a latitude and a longitude."""
        latitude, longitude = self.params[4], self.params[5]
        known = math.isfinite(latitude) and math.isfinite(longitude)
        return known and (latitude != 0.0 or longitude != 0.0) and abs(latitude) <= 90.0 and abs(longitude) <= 180.0


def command_of_message(message: Message) -> Command:
    """The command in a COMMAND_LONG or COMMAND_INT."""
    sender = (message.get_srcSystem(), message.get_srcComponent())
    head = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_INT":
        no_place = message.x == 2**31 - 1 or message.y == 2**31 - 1
        x, y = (math.nan, math.nan) if no_place else (message.x * 1e-7, message.y * 1e-7)
        return Command(message.command, (*head, x, y, message.z), sender, 0, message.frame)
    params = (*head, message.param5, message.param6, message.param7)
    return Command(message.command, params, sender, message.confirmation)
