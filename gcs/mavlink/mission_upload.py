"""Mission upload: the sender's side as one state machine.

The vehicle leads: it asks for every item and asks again when one is lost. The sender serves whatever is asked, in any
order and as often as it is asked, and pushes only when the vehicle falls silent. What an upload really left on the
vehicle is not decided here but by reading it back (`mission_proof`): an acknowledgement that never came is no failure,
and one that came too early is no success.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from gcs.core.errors import GcsError, LinkError, OperationCancelled, RefusedError
from gcs.core.mission import MissionItem
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.mission_protocol import (
    ListUnsupportedError,
    MissionResult,
    MissionTransaction,
    MissionType,
    OnItems,
    TransferTiming,
    item_message,
    result_words,
)
from gcs.mavlink.round_trip import RoundTrip
from gcs.mavlink.transaction import Clock, Send

UNKNOWN = "what the vehicle holds now is unknown: read it back before flying"

_MAY_GO_ON = frozenset({MissionResult.ERROR, MissionResult.DENIED})
"""Results after which the transfer may still go on: PX4 sends ERROR for a doubled COUNT, and either stack ERROR or
DENIED to a second station that may have our ids. Silence decides. (INVALID_SEQUENCE is no trouble at all: ArduPilot
sends it for every doubled item, and goes on.)"""

_CAPACITY_TOLD = re.compile(r"Only (\d+) items are supported")
"""What ArduPilot says beside NO_SPACE; PX4 says no number."""

_STARTING_S = 2.5
_SETTLED_S = 1.5
"""A vehicle that goes on in spite of an odd answer asks for an item within this time (ArduPilot every second)."""
_A_LITTLE_S = 0.01
_ECHO_S = 0.02
"""An item asked for twice within this time is a doubled packet: one answer is enough."""


class NoRoomError(RefusedError):
    """The vehicle does not store that many items; it keeps what it held before.

    Args:
        message: for people.
        capacity: how many it stores; None when it does not say.
    """

    def __init__(self, message: str, capacity: int | None = None) -> None:
        super().__init__(message)
        self.capacity = capacity


class UploadStep(Enum):
    """Where an upload is."""

    COUNT = "waiting for the first request"
    ITEMS = "serving items"
    FINAL_ACK = "waiting for the final acknowledgement"
    DONE = "finished"


@dataclass(frozen=True)
class UploadOutcome:
    """How an upload ended that was not refused.

    Attributes:
        acknowledged: whether the vehicle acknowledged after having asked for every item.
        restarts: how often the transfer began anew.
        note: what was odd, in plain words; empty when nothing was.
        refusal: what it refused when it had been given every item; it may have been about something else.
    """

    acknowledged: bool
    restarts: int = 0
    note: str = ""
    refusal: RefusedError | None = None


class MissionUpload(MissionTransaction[UploadOutcome]):
    """Send a list of items to a vehicle.

    Args:
        items: numbered 0 to n - 1.
        target_system: system id of the vehicle.
        target_component: component that holds the mission.
        send: puts a message on the link.
        clock: monotonic seconds.
        mission_type: which of the vehicle's lists.
        own_system: system id of the station, to ignore answers meant for another station.
        on_progress: told (items asked for so far, items in all).
        timing: timers.
        round_trip: what was measured in earlier transfers with the vehicle.
        part: numbers of the items to replace in the list that the vehicle holds; all by default. ArduPilot only.

    Raises (from `result`):
        RefusedError: the vehicle does not take it; says which item and why.
        LinkError: the vehicle stopped answering; what it holds is unknown.
        OperationCancelled: cancelled; what it holds is unknown.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
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
        part: range | None = None,
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
        if [item.sequence for item in items] != list(range(len(items))):
            raise ValueError("items must be numbered 0 to n - 1 in order")
        self._items = tuple(items)
        self._part = part
        self._numbers = range(len(items)) if part is None else part
        self._step = UploadStep.COUNT
        self._asked: set[int] = set()
        self._pushed: set[int] = set()
        self._last_served: int | None = None
        self._served_at: dict[int, float] = {}
        self._served_once = True
        self._tries = 0
        self._restarts = 0
        self._capacity: int | None = None
        self._trouble: MissionResult | None = None
        self._busy_since: float | None = None
        self._accepted_early = False
        self._odd_at = 0.0
        self._opened_at = self._advanced_at = self._heard_at = clock()

    @property
    def step(self) -> UploadStep:
        """Where the upload is."""
        return self._step

    def start(self) -> None:
        """Announce the number of items."""
        self._opened_at = self._advanced_at = self._clock()
        self._send_count()

    def handle(self, message: Message) -> None:
        """Serve a request or take an acknowledgement."""
        kind = message.get_type()
        if kind == "STATUSTEXT":
            self._on_text(message)
        if self.finished or kind not in {"MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"}:
            return
        if not self._concerns(message):
            return
        if kind == "MISSION_ACK":
            self._on_ack(message.type)
        else:
            self._on_request(message.seq)

    def on_time(self) -> None:
        """The vehicle has been silent: push, begin anew or give up."""
        if self.finished:
            return
        self._tries += 1
        if self._clock() - self._advanced_at > self._timing.stall_s:
            self._give_up()
        elif self._step is UploadStep.COUNT:
            self._count_unanswered()
        elif self._step is UploadStep.FINAL_ACK:
            if self._dead() or self._tries > self._timing.final_tries:
                told = "" if self._trouble is None else f", but it answered: {result_words(self._trouble)}"
                self._end(acknowledged=False, note=f"the final acknowledgement did not come{told}")
            else:
                self._push()
        elif self._accepted_early and self._clock() - self._odd_at > _SETTLED_S:
            self._end(acknowledged=False, note="it acknowledged before it had asked for every item")
        elif self._dead():
            self._restart()
        elif self._trouble is not None or self._accepted_early:
            self._deadline = self._odd_at + _SETTLED_S + _A_LITTLE_S  # if it goes on, it asks
        else:
            self._push()

    def cancel(self) -> None:
        """Tell the vehicle (PX4 stops cleanly, ArduPilot times out) and end."""
        if self.finished:
            return
        self._send_ack(MissionResult.OPERATION_CANCELLED)
        self._finish_with(OperationCancelled(f"the upload was cancelled; {UNKNOWN}"))

    @property
    def _noun(self) -> str:
        return self._mission_type.noun

    def _dead(self) -> bool:
        """Whether the vehicle has ended the transfer: it said so, perhaps, and fell silent, or is just silent."""
        if self._trouble is not None and self._clock() - self._odd_at > _SETTLED_S:
            return True
        return self._clock() - self._heard_at > self._timing.silence_s

    def _on_request(self, sequence: int) -> None:
        if sequence not in self._numbers:
            return
        now = self._clock()
        if self._last_served == sequence and now - self._served_at.get(sequence, -1.0) < _ECHO_S:
            return
        if self._step is UploadStep.COUNT and self._tries == 0:
            self._round_trip.measured(now - self._opened_at)
        self._measure_round_trip(sequence, now)
        self._heard_at = now
        self._trouble, self._busy_since = None, None
        self._accepted_early = False
        if sequence not in self._asked:
            self._asked.update(range(self._numbers.start, sequence + 1))  # it has those before, asked for or pushed
            self._advanced_at = now
            self._tries = 0
        self._step = UploadStep.FINAL_ACK if len(self._asked) == len(self._numbers) else UploadStep.ITEMS
        self._served_once = self._last_served != sequence
        self._serve(sequence)
        self._deadline = now + self._round_trip.timeout_s(self._tries)
        if now - self._advanced_at > self._timing.stall_s:
            self._give_up()
            return
        self._tell_progress(len(self._asked), len(self._numbers))

    def _on_ack(self, code: int) -> None:
        if code == MissionResult.ACCEPTED:
            if len(self._asked | self._pushed) == len(self._numbers):
                self._end(acknowledged=True)
            elif self._step is UploadStep.ITEMS:
                self._accepted_early, self._odd_at = True, self._clock()
        elif code == MissionResult.OPERATION_CANCELLED:
            if self._step is not UploadStep.COUNT:
                self._trouble = MissionResult.OPERATION_CANCELLED
                self._restart()
        elif code == MissionResult.INVALID_SEQUENCE:
            return
        elif code in _MAY_GO_ON:
            if self._trouble is None:
                self._odd_at = self._clock()
            self._trouble = MissionResult(code)
            if self._busy_since is None:
                self._busy_since = self._clock()
        elif not (code == MissionResult.NO_SPACE and self._may_still_be_starting()):
            self._refuse(code)

    def _may_still_be_starting(self) -> bool:
        """ArduPilot has no room in its first seconds, before its storage is up: asked again on the next timeout."""
        return self._step is UploadStep.COUNT and self._clock() - self._opened_at < _STARTING_S

    def _on_text(self, message: Message) -> None:
        told = _CAPACITY_TOLD.match(message.text)
        # In its first seconds ArduPilot says 0.
        if told is not None and message.get_srcSystem() == self._target[0] and int(told[1]) > 0:
            self._capacity = int(told[1])

    def _refuse(self, code: int) -> None:
        count = len(self._items)
        if code == MissionResult.UNSUPPORTED and not self._asked and self._mission_type is not MissionType.MISSION:
            self._finish_with(ListUnsupportedError(f"the vehicle takes no {self._noun}"))
            return
        words = result_words(code)
        if code == MissionResult.NO_SPACE:
            taken = f", it asked for {len(self._asked)} of them" if self._asked else ""
            room = self._mission_type.usual_capacity if self._capacity is None else f"it stores {self._capacity}"
            words = f"{words}: the {self._noun} has {count} items{taken}; {room}"
        elif self._last_served is not None:
            words = f"{words} (item {self._last_served}, command {self._items[self._last_served].command})"
        kept = f"; it may now hold a part of this {self._noun}: read it back" if self._asked else ""
        refusal = f"the vehicle refused the {self._noun}: {words}{kept}"
        if self._step is UploadStep.FINAL_ACK:
            self._end(acknowledged=False, note=refusal, refusal=RefusedError(refusal))
        elif code == MissionResult.NO_SPACE and not self._asked:
            self._finish_with(NoRoomError(refusal, self._capacity))
        else:
            self._finish_with(RefusedError(refusal))

    def _count_unanswered(self) -> None:
        busy = self._busy_since is not None
        if busy and self._clock() - (self._busy_since or 0.0) > self._timing.busy_s:
            trouble = self._trouble if self._trouble is not None else MissionResult.ERROR
            self._finish_with(
                RefusedError(
                    f"the vehicle refused the {self._noun}: {result_words(trouble)}; end other transfers first"
                )
            )
        elif not busy and self._clock() - self._opened_at > self._timing.opening_in_all_s:
            self._give_up()
        else:
            self._send_count()

    def _restart(self) -> None:
        if self._restarts >= self._timing.restarts:
            self._give_up()
            return
        self._restarts += 1
        self._asked.clear()
        self._pushed.clear()
        self._served_at.clear()
        self._last_served = None
        self._accepted_early = False
        self._busy_since = None  # what it said before is no answer to the new announcement
        self._tries = 0
        self._opened_at = self._advanced_at = self._clock()
        self._step = UploadStep.COUNT
        self._send_count()

    def _give_up(self) -> None:
        if self._step is UploadStep.COUNT and not self._restarts:
            text = f"the vehicle does not answer to the announcement of a {self._noun}"
        elif self._trouble is not None:
            text = f"the upload broke off again and again: {result_words(self._trouble)}"
        else:
            text = f"the vehicle stopped in mid-upload, after {len(self._asked)} of {len(self._numbers)} items"
        self._finish_with(LinkError(f"{text}; {UNKNOWN}"))

    def _send_count(self) -> None:
        if self._part is None:
            self._send(mavlink.MAVLink_mission_count_message(*self._target, len(self._items), self._mission_type))
        else:
            first, last = self._part.start, self._part.stop - 1
            self._send(
                mavlink.MAVLink_mission_write_partial_list_message(*self._target, first, last, self._mission_type)
            )
        self._deadline = self._clock() + self._opening_timeout_s(self._tries)

    def _serve(self, sequence: int) -> None:
        self._send(item_message(self._items[sequence], *self._target, self._mission_type))
        self._last_served = sequence
        self._served_at[sequence] = self._clock()

    def _push(self) -> None:
        """Send what may have been lost: the last item, or the request for the next one, which vehicles take unasked."""
        last = self._last_served
        if last is not None:
            if last + 1 in self._numbers and last + 1 not in self._asked:
                self._send(item_message(self._items[last + 1], *self._target, self._mission_type))
                self._pushed.add(last + 1)
            self._served_once = False
            self._serve(last)
        self._deadline = self._clock() + self._round_trip.timeout_s(self._tries)

    def _measure_round_trip(self, sequence: int, now: float) -> None:
        # Karn's rule: an item that was sent twice says nothing about the round trip.
        last = self._last_served
        if last is None or sequence != last + 1 or not self._served_once:
            return
        self._round_trip.measured(now - self._served_at[last])

    def _end(self, *, acknowledged: bool, note: str = "", refusal: RefusedError | None = None) -> None:
        self._step = UploadStep.DONE
        self._succeed(UploadOutcome(acknowledged, self._restarts, note, refusal))

    def _finish_with(self, error: GcsError) -> None:
        self._step = UploadStep.DONE
        self._fail(error)
