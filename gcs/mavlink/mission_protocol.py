"""What mission upload, download and clearing share: items on the wire, result codes in words, timers and filters.

MAVLink mission protocol, https://mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

from gcs.core.errors import InputError, LinkError, OperationCancelled, RefusedError
from gcs.core.mission import PLACE_COMMANDS, MissionItem
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.round_trip import GROWTH, RoundTrip
from gcs.mavlink.transaction import Clock, Send, Transaction

R = TypeVar("R")
OnItems = Callable[[int, int], None]
"""Progress of a transfer: items done, items in all. May raise `OperationCancelled` to stop it."""


class MissionType(IntEnum):
    """MAV_MISSION_TYPE: the three lists a vehicle holds."""

    MISSION = 0
    FENCE = 1
    RALLY = 2

    @property
    def noun(self) -> str:
        """The list in words."""
        return ("mission", "fence", "list of rally points")[self]

    @property
    def usual_capacity(self) -> str:
        """What usual vehicles store of it, and what helps when that is too little."""
        return (
            "usual boards store 500 to 700: split the plan",
            "usual vehicles store 64 to 70 corners: give the scenario simpler polygons",
            "usual vehicles store 32 to 46: give the scenario fewer",
        )[self]


class ListUnsupportedError(RefusedError):
    """The vehicle keeps no fence, or no rally points, at all."""


class UnknownStateError(LinkError):
    """What the vehicle holds is unknown, and why."""


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


RESULT_WORDS = {
    MissionResult.ERROR: "an error it does not explain",
    MissionResult.UNSUPPORTED_FRAME: "it does not know the altitude frame",
    MissionResult.UNSUPPORTED: "it does not know the command",
    MissionResult.NO_SPACE: "it has no room for that many items",
    MissionResult.INVALID: "a value is invalid",
    MissionResult.INVALID_PARAM1: "param1 is invalid",
    MissionResult.INVALID_PARAM2: "param2 is invalid",
    MissionResult.INVALID_PARAM3: "param3 is invalid",
    MissionResult.INVALID_PARAM4: "param4 is invalid",
    MissionResult.INVALID_PARAM5_X: "the latitude (or param5) is invalid",
    MissionResult.INVALID_PARAM6_Y: "the longitude (or param6) is invalid",
    MissionResult.INVALID_PARAM7: "the altitude (or param7) is invalid",
    MissionResult.INVALID_SEQUENCE: "an item came out of order",
    MissionResult.DENIED: "it takes nothing now, or another station is sending something",
    MissionResult.OPERATION_CANCELLED: "it cancelled the transfer",
}


def result_words(result: int) -> str:
    """A MAV_MISSION_RESULT in plain words; unknown numbers too."""
    try:
        return RESULT_WORDS.get(MissionResult(result), MissionResult(result).name)
    except ValueError:
        return f"result {result}, which is not in the protocol"


@dataclass(frozen=True)
class TransferTiming:
    """Timers of a transfer (s of link time) and how often things are tried.

    The item timeout is the one the protocol recommends, until a round trip was measured; the general one, as the
    longest. More tries than recommended, because at 30 % loss each way half of all round trips fail.
    """

    general_s: float = 1.5
    opening_s: float = 0.5
    """How long the first message of a transfer is waited for, before a round trip was measured."""
    opening_in_all_s: float = 20.0
    """So long a transfer is opened in vain before it is given up."""
    item_s: float = 0.25
    item_min_s: float = 0.06
    item_max_s: float = 1.5
    final_tries: int = 8
    """How often the last item is sent again to draw out the final acknowledgement."""
    silence_s: float = 9.0
    """A transfer without any sign of life for so long begins anew: vehicles drop one after 5 s or 8 s."""
    restarts: int = 5
    busy_s: float = 12.0
    """How long an answer "busy" is waited out: longer than a vehicle keeps a dead transfer open (8 s at most)."""
    stall_s: float = 30.0
    """A transfer that gets no item further for so long is given up although packets come."""

    def round_trip(self) -> RoundTrip:
        """An estimate within these limits, of nothing yet."""
        return RoundTrip(self.item_s, self.item_max_s, self.item_min_s)


def item_message(item: MissionItem, target_system: int, target_component: int, mission_type: int) -> Message:
    """MISSION_ITEM_INT of an item."""
    return mavlink.MAVLink_mission_item_int_message(
        target_system,
        target_component,
        item.sequence,
        item.frame,
        item.command,
        item.current,
        item.autocontinue,
        *item.params,
        item.x,
        item.y,
        item.z,
        mission_type,
    )


_GLOBAL_FRAMES = frozenset({0, 3, 5, 6, 10, 11})


def item_from_message(message: Message) -> MissionItem:
    """The item in a MISSION_ITEM_INT, or in an old MISSION_ITEM with degrees as floats."""
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        scale = 1e7 if message.command in PLACE_COMMANDS and message.frame in _GLOBAL_FRAMES else 1.0
        x, y = (round(v * scale) if abs(v) < 1e9 else 0 for v in (x, y))
    return MissionItem(
        sequence=message.seq,
        frame=message.frame,
        command=message.command,
        params=(message.param1, message.param2, message.param3, message.param4),
        x=int(x),
        y=int(y),
        z=message.z,
        current=message.current,
        autocontinue=message.autocontinue,
    )


def check_places(items: Sequence[MissionItem], mission_type: MissionType) -> None:
    """See that every place is one on Earth: some vehicles take others without a word, and then do not fly.

    Raises:
        InputError: one is not; names the item and its value.
    """
    for item in items:
        if item.command not in PLACE_COMMANDS or item.frame not in _GLOBAL_FRAMES:
            continue
        for name, value, most in (("latitude", item.x / 1e7, 90.0), ("longitude", item.y / 1e7, 180.0)):
            if abs(value) > most:
                words = f"its {name} of {value:g} deg is out of range (-{most:g} to {most:g}); nothing was sent"
                raise InputError(words, field=f"{mission_type.noun}, item {item.sequence}")


class MissionTransaction(Transaction[R]):
    """Base of the exchanges about one of a vehicle's lists.

    Args:
        target_system: system id of the vehicle.
        target_component: component that holds the mission (the autopilot).
        send: puts a message on the link.
        clock: monotonic seconds.
        mission_type: which list; messages about another one are ignored.
        own_system: system id of the station; when given, answers meant for another station are ignored.
        on_progress: told after every item.
        timing: timers.
        round_trip: what was measured in earlier transfers with the vehicle, to go on from.
    """

    def __init__(
        self,
        target_system: int,
        target_component: int,
        send: Send,
        clock: Clock,
        mission_type: int = MissionType.MISSION,
        *,
        own_system: int | None = None,
        on_progress: OnItems | None = None,
        timing: TransferTiming | None = None,
        round_trip: RoundTrip | None = None,
    ) -> None:
        super().__init__(send, clock)
        self._target = (target_system, target_component)
        self._mission_type = MissionType(mission_type)
        self._own_system = own_system
        self._on_progress = on_progress
        self._timing = timing if timing is not None else TransferTiming()
        self._round_trip = round_trip if round_trip is not None else self._timing.round_trip()
        self._deadline = clock()

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        return self._deadline

    def _concerns(self, message: Message) -> bool:
        """Whether a mission message is from our vehicle, about our list, and meant for us."""
        if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
            return False
        if getattr(message, "mission_type", 0) != self._mission_type:
            return False
        return self._own_system is None or message.target_system in {0, self._own_system}

    def _opening_timeout_s(self, tries: int) -> float:
        """How long to wait (s) for the answer to the first message of a transfer after so many vain tries."""
        if self._round_trip.known:
            return self._round_trip.timeout_s(tries)
        return float(min(self._timing.opening_s * GROWTH**tries, self._timing.general_s))

    def _send_ack(self, result: MissionResult) -> None:
        self._send(mavlink.MAVLink_mission_ack_message(*self._target, result, self._mission_type))

    def _tell_progress(self, done: int, total: int) -> None:
        if self._on_progress is None:
            return
        try:
            self._on_progress(done, total)
        except OperationCancelled:
            self.cancel()
