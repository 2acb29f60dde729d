"""The command protocol: COMMAND_LONG, its acknowledgement, and mode changes that only a heartbeat proves."""

from __future__ import annotations

from collections.abc import Callable

from gcs.core.errors import LinkError, OperationCancelled, RefusedError
from gcs.mavlink.autopilots.base import CommandCall
from gcs.mavlink.command_cancel import CommandCancel
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.transaction import Clock, Send, Transaction

RESEND_S = 0.7
ATTEMPTS = 6
IN_PROGRESS_S = 10.0
RESULT_WORDS = {
    1: "not now",
    2: "denied",
    3: "not supported",
    4: "failed",
    6: "cancelled",
    7: "wants it as COMMAND_LONG",
    8: "wants it as COMMAND_INT",
    9: "frame not supported",
    10: "another station is in control",
}
"""MAV_RESULT in words; the bundled dialect lacks the names of some."""
Target = tuple[int, int]
"""System and component id."""
OnProgress = Callable[[float | None], None]
"""Told that a command is in progress, with the share that is done; None where the vehicle does not tell it."""


def command_name(command: int) -> str:
    """`MAV_CMD_...` without its prefix, or the number."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    return entry.name.removeprefix("MAV_CMD_") if entry else f"command {command}"


def command_long(call: CommandCall, target: Target, confirmation: int) -> Message:
    """The COMMAND_LONG of a call; parameters that were not given are 0."""
    params = [*call.params, *[0.0] * (7 - len(call.params))]
    return mavlink.MAVLink_command_long_message(*target, call.command, confirmation, *params)


class CommandRefusedError(RefusedError):
    """The vehicle answered a command with something else than ACCEPTED.

    Args:
        result: the MAV_RESULT number.
    """

    def __init__(self, message: str, result: int) -> None:
        super().__init__(message)
        self.result = result


class NoAnswerError(LinkError):
    """The vehicle did not acknowledge a command."""


class _Acknowledged(Transaction[None]):
    """What a command and a mode change share: sending, resending, and knowing one's own acknowledgement.

    Args:
        call: the command.
        target: system and component that it is for.
        sender: system and component of this station; acknowledgements for another station are not ours.
        send: puts a message on the link.
        clock: monotonic seconds.
        permit: raises when the command must not be sent (any more); asked before each sending.
    """

    def __init__(
        self,
        call: CommandCall,
        *,
        target: Target,
        sender: Target,
        send: Send,
        clock: Clock,
        permit: Callable[[], None] | None = None,
    ) -> None:
        super().__init__(send, clock)
        self._call = call
        self._target = target
        self._sender = sender
        self._permit = permit
        self._sent = 0
        self._deadline = 0.0

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return self._deadline

    def start(self) -> None:
        """See Transaction."""
        self._send_once()

    def _send_once(self) -> None:
        if self._permit is not None:
            try:
                self._permit()
            except RefusedError as refusal:
                self._fail(refusal)
                return
        self._send(command_long(self._call, self._target, min(self._sent, 255)))
        self._sent += 1
        self._deadline = self._clock() + RESEND_S

    def _is_answer(self, message: Message) -> bool:
        if message.get_type() != "COMMAND_ACK" or message.command != self._call.command:
            return False
        if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
            return False
        return message.target_system in (0, self._sender[0]) and message.target_component in (0, self._sender[1])

    def _refuse(self, result: int) -> None:
        words = RESULT_WORDS.get(result, f"result {result}")
        self._fail(CommandRefusedError(f"the vehicle refuses {command_name(self._call.command)}: {words}", result))


class CommandExchange(_Acknowledged):
    """A command that is finished when the vehicle acknowledges it.

    IN_PROGRESS prolongs the wait. A resent command carries the count of its sendings, by which the vehicle knows it.
    Cancelling one that is in progress sends COMMAND_CANCEL; the vehicle need not know that message.

    Args:
        on_progress: told each time the vehicle says that it is in progress.
    """

    def __init__(
        self,
        call: CommandCall,
        *,
        target: Target,
        sender: Target,
        send: Send,
        clock: Clock,
        permit: Callable[[], None] | None = None,
        on_progress: OnProgress | None = None,
    ) -> None:
        super().__init__(call, target=target, sender=sender, send=send, clock=clock, permit=permit)
        self._on_progress = on_progress
        self._in_progress = False
        self._share: float | None = None

    def handle(self, message: Message) -> None:
        """See Transaction."""
        if not self._is_answer(message):
            return
        if message.result == mavlink.MAV_RESULT_ACCEPTED:
            self._succeed(None)
        elif message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            self._in_progress = True
            self._deadline = self._clock() + IN_PROGRESS_S
            self._take_progress(message.progress)
        else:
            self._refuse(message.result)

    def on_time(self) -> None:
        """See Transaction."""
        name = command_name(self._call.command)
        if self._in_progress:
            share = "" if self._share is None else f" ({self._share:.0%} were done)"
            self._fail(NoAnswerError(f"the vehicle began {name}, but did not say that it ended{share}"))
        elif self._sent >= ATTEMPTS:
            self._fail(NoAnswerError(f"the vehicle does not answer {name}; check the link"))
        else:
            self._send_once()

    def cancel(self) -> None:
        """See Transaction."""
        if self.finished:
            return
        if self._in_progress:
            self._send(CommandCancel(*self._target, self._call.command))
        self._fail(OperationCancelled(f"{command_name(self._call.command)} was cancelled"))

    def _take_progress(self, percent: int) -> None:
        """255 is "not known"; 0 is also what vehicles send that do not know the field."""
        if 0 < percent <= 100:
            self._share = percent / 100
        if self._on_progress is not None:
            try:
                self._on_progress(self._share)
            except OperationCancelled:
                self.cancel()


class ModeSwitch(_Acknowledged):
    """DO_SET_MODE, finished only when a heartbeat of the target shows the mode.

    PX4 acknowledges twice, first ACCEPTED whatever comes of it; so ACCEPTED proves nothing, and a refusal ends it. But
    it ends the resending: from then on another mode may be what a pilot has chosen, of whom no heartbeat tells yet.

    Args:
        custom_mode: the mode number to be shown.
        timeout_s: how long to wait for it.
    """

    def __init__(
        self,
        custom_mode: int,
        call: CommandCall,
        *,
        target: Target,
        sender: Target,
        send: Send,
        clock: Clock,
        permit: Callable[[], None] | None = None,
        timeout_s: float = 5.0,
    ) -> None:
        super().__init__(call, target=target, sender=sender, send=send, clock=clock, permit=permit)
        self._custom_mode = custom_mode
        self._give_up_at = clock() + timeout_s
        self._acknowledged = False

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return min(self._deadline, self._give_up_at)

    def handle(self, message: Message) -> None:
        """See Transaction."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_type() == "HEARTBEAT" and source == self._target:
            if message.custom_mode == self._custom_mode:
                self._succeed(None)
        elif self._is_answer(message):
            if message.result in (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS):
                self._acknowledged = True
                self._deadline = self._give_up_at
            else:
                self._refuse(message.result)

    def on_time(self) -> None:
        """See Transaction."""
        if self._clock() < self._give_up_at:
            self._send_once()
        elif self._acknowledged:
            self._fail(RefusedError("the vehicle took the mode command, but does not show the mode"))
        else:
            self._fail(NoAnswerError("the vehicle does not answer the mode command; check the link"))
