"""The parameter protocol: many values at once by name, and one value set with proof."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from dataclasses import dataclass

from gcs.core.errors import InputError, LinkError, RefusedError
from gcs.mavlink.command_protocol import Target
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.parameter_values import decode_parameter, encode_parameter
from gcs.mavlink.transaction import Clock, Send, Transaction

NAME_LENGTH = 16
WINDOW = 24
RESEND_S = 0.4
ATTEMPTS = 8


@dataclass(frozen=True)
class ParameterReading:
    """A parameter as the vehicle told it.

    Attributes:
        value: None when it is not a finite number.
        parameter_type: MAV_PARAM_TYPE.
    """

    value: float | None
    parameter_type: int


def _check_name(name: str) -> str:
    if not name.isascii() or not 0 < len(name) <= NAME_LENGTH:
        raise InputError(f"a parameter name has 1 to {NAME_LENGTH} ASCII letters", field=name)
    return name


@dataclass
class _Asked:
    attempts: int
    resend_at: float


class ParameterRead(Transaction[dict[str, ParameterReading | None]]):
    """Reads parameters by name, many in flight at once.

    A name that stays unanswered is None in the result: ArduPilot does not answer unknown names. When no name at all is
    answered, the link is at fault and that is an error.

    Args:
        names: of the parameters.
        target: system and component of the autopilot.
        bytewise: see `decode_parameter`.
        send: puts a message on the link.
        clock: monotonic seconds.
    """

    def __init__(self, names: Iterable[str], *, target: Target, bytewise: bool, send: Send, clock: Clock) -> None:
        super().__init__(send, clock)
        self._target = target
        self._bytewise = bytewise
        self._waiting = list(dict.fromkeys(_check_name(name) for name in names))
        self._asked: dict[str, _Asked] = {}
        self._readings: dict[str, ParameterReading | None] = {}
        self._answered = False

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return min((asked.resend_at for asked in self._asked.values()), default=self._clock())

    def start(self) -> None:
        """See Transaction."""
        self._go_on()

    def handle(self, message: Message) -> None:
        """See Transaction."""
        if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
            return
        kind = message.get_type()
        if kind not in ("PARAM_VALUE", "PARAM_ERROR") or message.param_id not in self._asked:
            return
        del self._asked[message.param_id]
        self._answered = True
        if kind == "PARAM_ERROR":
            self._readings[message.param_id] = None
        else:
            value = decode_parameter(message.param_value, message.param_type, bytewise=self._bytewise)
            self._readings[message.param_id] = ParameterReading(value, message.param_type)
        self._go_on()

    def on_time(self) -> None:
        """See Transaction."""
        now = self._clock()
        for name, asked in list(self._asked.items()):
            if asked.resend_at > now:
                continue
            if asked.attempts >= ATTEMPTS:
                del self._asked[name]
                self._readings[name] = None
            else:
                self._ask(name, asked.attempts + 1)
        self._go_on()

    def _go_on(self) -> None:
        while self._waiting and len(self._asked) < WINDOW:
            self._ask(self._waiting.pop(0), 1)
        if not self._asked and not self._waiting:
            if self._readings and not self._answered:
                self._fail(LinkError("the vehicle does not answer when asked for its parameters; check the link"))
            else:
                self._succeed(self._readings)

    def _ask(self, name: str, attempt: int) -> None:
        self._asked[name] = _Asked(attempt, self._clock() + RESEND_S)
        self._send(mavlink.MAVLink_param_request_read_message(*self._target, name.encode(), -1))


class ParameterSet(Transaction[float]):
    """Sets one parameter; finished when the vehicle tells the new value itself.

    Args:
        name: of the parameter.
        value: to be set.
        parameter_type: MAV_PARAM_TYPE, as read before.
        target: system and component of the autopilot.
        bytewise: see `decode_parameter`.
        send: puts a message on the link.
        clock: monotonic seconds.

    Raises:
        InputError: the value does not fit the type.
    """

    def __init__(
        self,
        name: str,
        value: float,
        parameter_type: int,
        *,
        target: Target,
        bytewise: bool,
        send: Send,
        clock: Clock,
    ) -> None:
        super().__init__(send, clock)
        self._name = _check_name(name)
        self._wanted = value
        self._type = parameter_type
        self._target = target
        self._bytewise = bytewise
        self._wire = encode_parameter(name, value, parameter_type, bytewise=bytewise)
        self._attempts = 0
        self._resend_at = 0.0
        self._told: float | None = None

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return self._resend_at

    def start(self) -> None:
        """See Transaction."""
        self._set()

    def handle(self, message: Message) -> None:
        """See Transaction; a value that is still the old one may be older than the command, so it is asked again."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source != self._target or message.get_type() != "PARAM_VALUE" or message.param_id != self._name:
            return
        told = decode_parameter(message.param_value, message.param_type, bytewise=self._bytewise)
        if told is not None and math.isclose(told, _as_float32(self._wanted), rel_tol=1e-6, abs_tol=1e-9):
            self._succeed(told)
        else:
            self._told = told

    def on_time(self) -> None:
        """See Transaction."""
        if self._attempts < ATTEMPTS:
            self._set()
        elif self._told is not None:
            self._fail(RefusedError(f"the vehicle keeps {self._told:g} instead of {self._wanted:g}", field=self._name))
        else:
            self._fail(LinkError("the vehicle does not confirm the new value; check the link", field=self._name))

    def _set(self) -> None:
        self._attempts += 1
        self._resend_at = self._clock() + RESEND_S
        message = mavlink.MAVLink_param_set_message(*self._target, self._name.encode(), self._wire, self._type)
        self._send(message)


def _as_float32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])
