"""Mission download: the receiver's side as one state machine.

Every item is asked for by its number, some of them at once where the vehicle allows (ArduPilot answers any request;
PX4 wants them strictly in order). A list that changes under the transfer is read anew from its start, so that what is
returned is never a mixture: a vehicle that names its lists by ids is asked for the id again at the end, and from one
that does not, a list that did not come in one go is read twice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from gcs.mavlink.plan_id import px4_plan_id, told_plan_id
from gcs.mavlink.round_trip import RoundTrip
from gcs.mavlink.transaction import Clock, Send

_SILENT = "the vehicle fell silent"
_CHANGED = "somebody else changed it meanwhile"
_SILENCE_S = 5.5
"""A vehicle that says nothing for so long has dropped the download (PX4 after 5 s)."""
_DRAIN_S, _LONGEST_DRAIN_S = 0.1, 4.0
"""So long, doubled each time, requests that are under way may arrive before a disturbed download begins anew."""
_RESTARTS, _RESTARTS_IN_ORDER, _SILENCES = 8, 40, 5
"""How often a download begins anew; oftener where the vehicle ends it at every request that is not in order."""
_IN_ALL_S = 240.0
"""After so long it does not begin anew any more."""
_BUSY_S = 40.0
"""So long a vehicle that says that it is busy is asked again: others' transfers end, or are dropped after 8 s. So long
an unruly link is borne with, too."""
_MOST_DISORDERS = 2
_LONGEST_OPENING_S = 3.0
_ASK_AGAIN_AT_LEAST_S = 2.0
"""So that a request or two may be lost before the vehicle takes the silence for the end."""
_IN_FLIGHT = {Autopilot.ARDUPILOT: 10}


class DownloadStep(Enum):
    """Where a download is."""

    COUNT = "waiting for the number of items"
    ITEMS = "asking for items"
    CONFIRM = "asking whether the list is still the same"
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
        known: a list that the vehicle should hold; when it names just that one, its items are not read.
        own_system: system id of the station, to ignore answers meant for another station.
        on_progress: told (items read, items in all).
        timing: timers.
        round_trip: what was measured in earlier transfers with the vehicle.

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
        known: Sequence[MissionItem] | None = None,
        own_system: int | None = None,
        on_progress: OnItems | None = None,
        timing: TransferTiming | None = None,
        round_trip: RoundTrip | None = None,
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
            round_trip=round_trip,
        )
        self._autopilot = autopilot
        self._known = tuple(known) if known is not None else None
        self._window = _IN_FLIGHT.get(autopilot, 1)
        self._step = DownloadStep.COUNT
        self._count = 0
        self._next = 0
        self._items: dict[int, MissionItem] = {}
        self._in_flight: dict[int, tuple[float, int]] = {}
        self._plan_id: int | None = None
        self._begun_at = self._opened_at = self._heard_at = self._advanced_at = clock()
        self._tries = 0
        self._restarts = 0
        self._disorders = self._silences = 0
        self._busy = False
        self._repeated = False
        self._first_pass: dict[int, MissionItem] | None = None
        self._reason = ""
        self._recognised = False

    @property
    def step(self) -> DownloadStep:
        """Where the download is."""
        return self._step

    @property
    def recognised(self) -> bool:
        """Whether the vehicle named the known list, so that its items were not read."""
        return self._recognised

    def start(self) -> None:
        """Ask for the number of items."""
        self._open(DownloadStep.COUNT)

    def handle(self, message: Message) -> None:
        """Take a count, an item or an error."""
        kind = message.get_type()
        if self.finished or kind not in {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_ACK"}:
            return
        if not self._concerns(message):
            return
        if kind == "MISSION_COUNT":
            self._on_count(message.count, told_plan_id(message))
        elif kind == "MISSION_ACK":
            self._on_ack(message.type)
        elif self._step is DownloadStep.ITEMS:
            self._on_item(item_from_message(message))

    def on_time(self) -> None:
        """Ask again for what did not come."""
        if self.finished:
            return
        now = self._clock()
        if self._step is not DownloadStep.ITEMS:
            patient = self._busy or self._disorders
            if now - self._opened_at > (_BUSY_S if patient else self._timing.opening_in_all_s):
                self._give_up()
            else:
                self._send_list_request()
        elif now - self._advanced_at > self._timing.stall_s:
            self._give_up()
        elif now - self._heard_at > _SILENCE_S:
            self._silences += 1
            if self._silences > _SILENCES + self._disorders:
                self._give_up()
            else:
                self._restart(_SILENT)
        else:
            for sequence, (sent_at, tries) in list(self._in_flight.items()):
                if now >= sent_at + self._timeout_s(tries):
                    self._request(sequence, tries + 1)
            self._set_deadline()

    def cancel(self) -> None:
        """Tell the vehicle and end."""
        if self.finished:
            return
        self._send_ack(MissionResult.OPERATION_CANCELLED)
        self._finish_with(OperationCancelled("reading the vehicle's mission was cancelled"))

    def _on_count(self, count: int, plan_id: int | None) -> None:
        if self._tries == 1:
            self._round_trip.measured(self._clock() - self._opened_at)
        self._tries = 0
        if self._step is DownloadStep.ITEMS:
            if count != self._count:
                self._restart("the number of items changed")
        elif self._step is DownloadStep.CONFIRM:
            self._confirm(count, plan_id)
        elif self._names_known(count, plan_id):
            self._recognised = True
            self._items = dict(enumerate(self._known or ()))
            self._end()
            self._tell_progress(count, count)
        else:
            self._count, self._plan_id, self._first_pass = count, plan_id, None
            self._repeated = False
            self._read({})

    def _read(self, but_for: dict[int, MissionItem]) -> None:
        """Ask for all items but for the first ones, that are given."""
        self._step = DownloadStep.ITEMS
        self._heard_at = self._advanced_at = self._clock()
        self._next = len(but_for)
        self._items = but_for
        self._in_flight.clear()
        self._ask_for_more()

    def _confirm(self, count: int, plan_id: int | None) -> None:
        if (count, plan_id) != (self._count, self._plan_id):
            self._restart(_CHANGED)
        elif plan_id is not None:
            self._end()
        else:
            self._first_pass = self._items
            self._read({0: self._items[0]} if self._is_home(self._items[0]) else {})

    def _names_known(self, count: int, plan_id: int | None) -> bool:
        return self._known is not None and count == len(self._known) and plan_id == px4_plan_id(self._known)

    def _on_item(self, item: MissionItem) -> None:
        self._heard_at = self._clock()
        known = self._items.get(item.sequence)
        if known is not None:
            if not self._is_home(item) and not _same(known, item):
                self._restart("an item changed")
            return
        if item.sequence not in self._in_flight:
            return
        sent_at, tries = self._in_flight.pop(item.sequence)
        if tries == 0:
            self._round_trip.measured(self._clock() - sent_at)
        self._items[item.sequence] = item
        self._advanced_at = self._heard_at
        if self._first_pass is None:
            self._tell_progress(len(self._items), self._count)
        if not self.finished:
            self._ask_for_more()

    def _is_home(self, item: MissionItem) -> bool:
        """Whether an item is ArduPilot's home, which is estimated anew all the time."""
        return (
            self._autopilot is Autopilot.ARDUPILOT and self._mission_type is MissionType.MISSION and item.sequence == 0
        )

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
            self._busy, self._reason = True, result_words(code)  # asked again when the timer ends

    def _ask_for_more(self) -> None:
        if len(self._items) == self._count:
            self._all_read()
            return
        while self._next < self._count and len(self._in_flight) < self._window:
            self._request(self._next, 0)
            self._next += 1
        self._set_deadline()

    def _all_read(self) -> None:
        if self._first_pass is not None:
            if all(_same(self._first_pass[i], item) for i, item in self._items.items()):
                self._end()
            else:
                self._restart(_CHANGED)
        elif self._count and (self._plan_id is not None or self._repeated):
            # Somebody else's upload may have fallen into a gap between two answers, and into no other time: while it
            # lasts, no items are given out.
            self._open(DownloadStep.CONFIRM)
        else:
            self._end()

    def _restart(self, reason: str) -> None:
        self._reason = reason
        most = _RESTARTS if self._window > 1 else _RESTARTS_IN_ORDER
        if self._restarts >= most or self._clock() - self._begun_at > _IN_ALL_S:
            self._give_up()
            return
        self._restarts += 1
        self._step = DownloadStep.COUNT
        self._tries = 0
        self._deadline = self._clock() + min(_DRAIN_S * 2.0**self._restarts, _LONGEST_DRAIN_S)
        self._opened_at = self._deadline
        self._busy = False

    def _open(self, step: DownloadStep) -> None:
        self._step = step
        self._tries = 0
        self._opened_at = self._clock()
        self._busy = False
        self._send_list_request()

    def _end(self) -> None:
        self._send_ack(MissionResult.ACCEPTED)
        self._step = DownloadStep.DONE
        self._succeed(tuple(self._items[i] for i in range(len(self._items))))

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
        wait_s = min(self._opening_timeout_s(self._tries) * self._patience, _LONGEST_OPENING_S)
        self._deadline = self._clock() + wait_s
        self._tries += 1

    def _request(self, sequence: int, tries: int) -> None:
        self._in_flight[sequence] = (self._clock(), tries)
        self._repeated |= tries > 0
        self._send(mavlink.MAVLink_mission_request_int_message(*self._target, sequence, self._mission_type))

    def _set_deadline(self) -> None:
        self._deadline = min(sent_at + self._timeout_s(tries) for sent_at, tries in self._in_flight.values())

    @property
    def _patience(self) -> float:
        # PX4 ends a download at a request out of order, so repeated requests that overtake each other break it off:
        # after each such end more patience is had.
        return 2.0 ** min(self._disorders, _MOST_DISORDERS)

    def _timeout_s(self, tries: int) -> float:
        return min(self._round_trip.timeout_s(tries, patience=self._patience), _ASK_AGAIN_AT_LEAST_S)

    def _finish_with(self, error: GcsError) -> None:
        self._step = DownloadStep.DONE
        self._fail(error)


def _same(a: MissionItem, b: MissionItem) -> bool:
    """Equality of two answers for one number, NaN equal to NaN; `current` moves while a mission is flown."""

    def key(i: MissionItem) -> tuple[object, ...]:
        floats = tuple(None if math.isnan(v) else v for v in (*i.params, i.z))
        return (i.frame, i.command, i.x, i.y, i.autocontinue, floats)

    return key(a) == key(b)
