"""Mission download: the receiver's side as one state machine.

Every item is asked for by its number, some of them at once where the vehicle allows (ArduPilot answers any request;
PX4 wants them strictly in order). A list that changes under the transfer is read anew from its start, so that what is
returned is never a mixture.
"""

from __future__ import annotations

import math
from enum import Enum

from gcs.core.errors import GcsError, LinkError, OperationCancelled, RefusedError
from gcs.core.mission import MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.mission_protocol import (
    ListUnsupportedError,
    MissionResult,
    MissionTransaction,
    MissionType,
    OnItems,
    TransferTiming,
    item_from_message,
    result_words,
)
from gcs.mavlink.transaction import Clock, Send

_SILENT = "the vehicle fell silent"
_SILENCE_S = 5.5
"""A vehicle that says nothing for so long has dropped the download (PX4 after 5 s)."""
_IN_FLIGHT = {Autopilot.ARDUPILOT: 10}


class DownloadStep(Enum):
    """Where a download is."""

    COUNT = "waiting for the number of items"
    ITEMS = "asking for items"
    DONE = "finished"


class MissionDownload(MissionTransaction[tuple[MissionItem, ...]]):
    """Read a list of items from a vehicle.

    Args:
        target_system: system id of the vehicle.
        target_component: component that holds the mission.
        send: puts a message on the link.
        clock: monotonic seconds.
        mission_type: which of the vehicle's lists.
        autopilot: decides how many requests may be under way at once.
        own_system: system id of the station, to ignore answers meant for another station.
        on_progress: told (items read, items in all).
        timing: timers.

    Raises (from `result`):
        RefusedError: the vehicle does not give its list, or changes it all the time.
        LinkError: the vehicle stopped answering.
        OperationCancelled: cancelled.
    """

    def __init__(
        self,
        target_system: int,
        target_component: int,
        send: Send,
        clock: Clock,
        mission_type: int = MissionType.MISSION,
        *,
        autopilot: Autopilot = Autopilot.GENERIC,
        own_system: int | None = None,
        on_progress: OnItems | None = None,
        timing: TransferTiming | None = None,
    ) -> None:
        super().__init__(
            target_system,
            target_component,
            send,
            clock,
            mission_type,
            own_system=own_system,
            on_progress=on_progress,
            timing=timing,
        )
        self._window = _IN_FLIGHT.get(autopilot, 1)
        self._step = DownloadStep.COUNT
        self._count = 0
        self._next = 0
        self._items: dict[int, MissionItem] = {}
        self._in_flight: dict[int, tuple[float, int]] = {}
        self._heard_at = clock()
        self._tries = 0
        self._restarts = 0
        self._disorders = 0
        self._reason = ""

    @property
    def step(self) -> DownloadStep:
        """Where the download is."""
        return self._step

    def start(self) -> None:
        """Ask for the number of items."""
        self._send_list_request()

    def handle(self, message: Message) -> None:
        """Take a count, an item or an error."""
        kind = message.get_type()
        if self.finished or kind not in {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_ACK"}:
            return
        if not self._concerns(message):
            return
        if kind == "MISSION_COUNT":
            self._on_count(message.count)
        elif kind == "MISSION_ACK":
            self._on_ack(message.type)
        elif self._step is DownloadStep.ITEMS:
            self._on_item(item_from_message(message))

    def on_time(self) -> None:
        """Ask again for what did not come."""
        if self.finished:
            return
        now = self._clock()
        if self._step is DownloadStep.COUNT:
            self._tries += 1
            if self._tries >= self._timing.tries:
                self._give_up()
            else:
                self._send_list_request()
            return
        if now - self._heard_at > _SILENCE_S:
            self._restart(_SILENT)
            return
        for sequence, (sent_at, tries) in list(self._in_flight.items()):
            if now < sent_at + self._timeout_s(tries):
                continue
            self._request(sequence, tries + 1)
        self._set_deadline()

    def cancel(self) -> None:
        """Tell the vehicle and end."""
        if self.finished:
            return
        self._send_ack(MissionResult.OPERATION_CANCELLED)
        self._finish_with(OperationCancelled("reading the vehicle's mission was cancelled"))

    def _on_count(self, count: int) -> None:
        if self._step is DownloadStep.ITEMS:
            if count != self._count:
                self._restart("the number of items changed")
            return
        self._step = DownloadStep.ITEMS
        self._heard_at = self._clock()
        self._count, self._next, self._tries = count, 0, 0
        self._items.clear()
        self._in_flight.clear()
        self._ask_for_more()

    def _on_item(self, item: MissionItem) -> None:
        self._heard_at = self._clock()
        known = self._items.get(item.sequence)
        if known is not None:
            if not _same(known, item):
                self._restart("an item changed")
            return
        if item.sequence not in self._in_flight:
            return
        sent_at, tries = self._in_flight.pop(item.sequence)
        if tries == 0:
            self._round_trip.measured(self._clock() - sent_at)
        self._items[item.sequence] = item
        self._tell_progress(len(self._items), self._count)
        if not self.finished:
            self._ask_for_more()

    def _on_ack(self, code: int) -> None:
        if code in {MissionResult.ACCEPTED, MissionResult.INVALID_SEQUENCE}:
            return
        if code == MissionResult.UNSUPPORTED and self._mission_type is not MissionType.MISSION:
            self._finish_with(ListUnsupportedError(f"the vehicle keeps no {self._mission_type.noun}"))
        elif code == MissionResult.UNSUPPORTED:
            self._finish_with(RefusedError(f"the vehicle does not give its mission: {result_words(code)}"))
        elif self._step is DownloadStep.ITEMS:
            self._disorders += 1
            self._restart(result_words(code))
        else:
            self._reason = result_words(code)  # busy: asked again when the timer ends

    def _ask_for_more(self) -> None:
        if len(self._items) == self._count:
            self._send_ack(MissionResult.ACCEPTED)
            self._step = DownloadStep.DONE
            self._succeed(tuple(self._items[i] for i in range(self._count)))
            return
        while self._next < self._count and len(self._in_flight) < self._window:
            self._request(self._next, 0)
            self._next += 1
        self._set_deadline()

    def _restart(self, reason: str) -> None:
        self._reason = reason
        if self._restarts >= self._timing.restarts:
            self._give_up()
            return
        self._restarts += 1
        self._step = DownloadStep.COUNT
        self._tries = 0
        self._send_list_request()

    def _give_up(self) -> None:
        if self._reason and self._reason != _SILENT:
            error: GcsError = RefusedError(
                f"the vehicle's {self._mission_type.noun} could not be read: {self._reason}; try again"
            )
        else:
            error = LinkError(f"the vehicle stopped answering while its {self._mission_type.noun} was read")
        self._finish_with(error)

    def _send_list_request(self) -> None:
        self._send(mavlink.MAVLink_mission_request_list_message(*self._target, self._mission_type))
        self._deadline = self._clock() + self._timing.general_s

    def _request(self, sequence: int, tries: int) -> None:
        self._in_flight[sequence] = (self._clock(), tries)
        self._send(mavlink.MAVLink_mission_request_int_message(*self._target, sequence, self._mission_type))

    def _set_deadline(self) -> None:
        self._deadline = min(sent_at + self._timeout_s(tries) for sent_at, tries in self._in_flight.values())

    def _timeout_s(self, tries: int) -> float:
        # PX4 ends a download at a request out of order, so repeated requests that overtake each other break it off:
        # after each such end more patience is had.
        return self._round_trip.timeout_s(tries, patience=2.0 ** min(self._disorders, 2))

    def _finish_with(self, error: GcsError) -> None:
        self._step = DownloadStep.DONE
        self._fail(error)


def _same(a: MissionItem, b: MissionItem) -> bool:
    """Equality of two answers for one number, NaN equal to NaN; `current` moves while a mission is flown."""

    def key(i: MissionItem) -> tuple[object, ...]:
        floats = tuple(None if math.isnan(v) else v for v in (*i.params, i.z))
        return (i.frame, i.command, i.x, i.y, i.autocontinue, floats)

    return key(a) == key(b)
