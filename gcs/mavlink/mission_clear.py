"""Clearing one of a vehicle's lists: MISSION_CLEAR_ALL until it is acknowledged."""

from __future__ import annotations

from gcs.core.errors import LinkError, OperationCancelled, RefusedError
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.mission_protocol import MissionResult, MissionTransaction, result_words


class MissionClear(MissionTransaction[None]):
    """Clear a list; constructor arguments are those of `MissionTransaction`.

    Raises (from `result`):
        RefusedError: the vehicle does not clear it.
        LinkError: no answer; whether it was cleared is unknown.
        OperationCancelled: cancelled before the answer came.
    """

    _tries = 0
    _begun_at = 0.0
    _refusal: int | None = None

    def start(self) -> None:
        """Send the request."""
        self._begun_at = self._clock()
        self._ask()

    def handle(self, message: Message) -> None:
        """Take the acknowledgement."""
        if self.finished or message.get_type() != "MISSION_ACK" or not self._concerns(message):
            return
        if message.type == MissionResult.ACCEPTED:
            self._succeed(None)
        else:
            self._refusal = message.type  # busy, perhaps: asked again when the timer ends

    def on_time(self) -> None:
        """Send it again, or give up."""
        if self.finished:
            return
        noun = self._mission_type.noun
        if self._clock() - self._begun_at <= self._timing.opening_in_all_s:
            self._ask()
        elif self._refusal is not None:
            self._fail(RefusedError(f"the vehicle does not clear its {noun}: {result_words(self._refusal)}"))
        else:
            self._fail(LinkError(f"no answer to clearing the {noun}; whether it was cleared is unknown"))

    def _ask(self) -> None:
        self._send(mavlink.MAVLink_mission_clear_all_message(*self._target, self._mission_type))
        self._deadline = self._clock() + self._opening_timeout_s(self._tries)
        self._tries += 1

    def cancel(self) -> None:
        """Stop asking."""
        self._fail(OperationCancelled("clearing was cancelled; whether it happened is unknown"))
