"""Parameters of a vehicle and the parameter protocol, in the two encodings of the two autopilots."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from gcs.core.errors import InputError
from sitl_mocks.dialect import Message, mavlink

INT8, INT16, INT32, REAL32 = (
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_INT16,
    mavlink.MAV_PARAM_TYPE_INT32,
    mavlink.MAV_PARAM_TYPE_REAL32,
)
_MEANINGLESS = "X_"
_INT_RANGE = {INT8: 2**7, INT16: 2**15, INT32: 2**31}


@dataclass
class Parameter:
    """A value and its MAV_PARAM_TYPE."""

    value: float
    type: int


@dataclass
class _Listing:
    """A list that is being sent: how far it has come, and since when."""

    send: Callable[[Message], None]
    sent: int = 0
    began_s: float | None = None


class ParameterServer:
    """Holds parameters and answers the parameter protocol.

    Args:
        table: name -> (value, MAV_PARAM_TYPE).
        bytewise: integers travel as the bytes of the float field (PX4) instead of being cast to float (ArduPilot).
        answers_unknown: what to do about a name that does not exist; None for silence.
        at_most: name -> name of the parameter that it is clamped to when one of the two is written.
        clamped: what to do about one that was.
        listed_per_s: how many of a list it sends in a second of wall time.
        least: how many there are at least; others without a meaning are added.
    """

    def __init__(
        self,
        table: Mapping[str, tuple[float, int]],
        *,
        bytewise: bool,
        answers_unknown: Callable[[str], None] | None = None,
        at_most: Mapping[str, str] = MappingProxyType({}),
        clamped: Callable[[str], None] = lambda _name: None,
        listed_per_s: float = 1000.0,
        least: int = 0,
    ) -> None:
        meaningless = {f"{_MEANINGLESS}{n:04d}": (n, REAL32) for n in range(least - len(table))}
        every = sorted({**table, **meaningless}.items())
        self._parameters = {name: Parameter(float(value), kind) for name, (value, kind) in every}
        self._defaults = {name: parameter.value for name, parameter in self._parameters.items()}
        self._names = list(self._parameters)
        self._numbers = {name: number for number, name in enumerate(self._names)}
        self._listed_per_s = listed_per_s
        self._bytewise = bytewise
        self._answers_unknown = answers_unknown
        self._at_most = at_most
        self._clamped = clamped
        self._listing: dict[object, _Listing] = {}

    def __getitem__(self, name: str) -> float:
        """Value of a parameter."""
        return self._parameters[name].value

    def table(self) -> dict[str, tuple[float, int, float]]:
        """Value, MAV_PARAM_TYPE and value at the start of all parameters, by name."""
        return {name: (p.value, p.type, self._defaults[name]) for name, p in self._parameters.items()}

    def override(self, name: str, value: float) -> None:
        """Set a parameter before the flight.

        Raises:
            InputError: there is no such parameter.
        """
        if name not in self._parameters:
            raise InputError(f"there is no parameter {name} on this simulated vehicle", field="--param")
        self._set(self._parameters[name], value)

    def handle(self, message: Message, send: Callable[[Message], None], channel: object) -> bool:
        """Answer a message of the parameter protocol; False if it is none."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._listing[channel] = _Listing(send)
        elif kind == "PARAM_REQUEST_READ":
            self._read(message, send)
        elif kind == "PARAM_SET":
            self._write(message, send)
        else:
            return False
        return True

    def step(self, wall_s: float) -> None:
        """Go on with the lists that were asked for."""
        for channel, listing in list(self._listing.items()):
            if listing.began_s is None:
                listing.began_s = wall_s
            until = 1 + int((wall_s - listing.began_s) * self._listed_per_s)
            for name in self._names[listing.sent : until]:
                listing.send(self._value_message(name, self._numbers[name]))
            listing.sent = until
            if until >= len(self._names):
                del self._listing[channel]

    def _read(self, message: Message, send: Callable[[Message], None]) -> None:
        if message.param_index >= 0:
            if message.param_index < len(self._names):
                send(self._value_message(self._names[message.param_index], message.param_index))
            return
        name = _text(message.param_id)
        if name in self._parameters:
            send(self._value_message(name, self._numbers[name]))
        elif self._answers_unknown is not None:
            self._answers_unknown(name)

    def _write(self, message: Message, send: Callable[[Message], None]) -> None:
        name = _text(message.param_id)
        parameter = self._parameters.get(name)
        if parameter is None:
            if self._answers_unknown is not None:
                self._answers_unknown(name)
            return
        if self._bytewise:
            if message.param_type != parameter.type:
                return
            value = float(message.param_value)
            if parameter.type == INT32:
                value = float(struct.unpack("<i", struct.pack("<f", message.param_value))[0])
        else:
            value = float(message.param_value)
        if math.isfinite(value):
            self._set(parameter, value)
            self._clamp(name)
        send(self._value_message(name, self._numbers[name] if self._bytewise else 65535))

    def _clamp(self, written: str) -> None:
        for name, limit in self._at_most.items():
            if written in {name, limit} and self[name] > self[limit]:
                self._parameters[name].value = self[limit]
                self._clamped(name)

    @staticmethod
    def _set(parameter: Parameter, value: float) -> None:
        if parameter.type == REAL32:
            parameter.value = struct.unpack("<f", struct.pack("<f", value))[0]
        else:
            limit = _INT_RANGE[parameter.type]
            parameter.value = float(min(max(round(value), -limit), limit - 1))

    def _value_message(self, name: str, index: int) -> Message:
        parameter = self._parameters[name]
        value = parameter.value
        if self._bytewise and parameter.type == INT32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return mavlink.MAVLink_param_value_message(name.encode(), value, parameter.type, len(self._names), index)


def _text(param_id: str | bytes) -> str:
    if isinstance(param_id, bytes):
        param_id = param_id.decode("ascii", "replace")
    return param_id.split("\0", 1)[0]
