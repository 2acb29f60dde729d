"""How parameter values travel in the one float of PARAM_VALUE and PARAM_SET."""

from __future__ import annotations

import math
import struct

from gcs.core.errors import InputError
from gcs.mavlink.dialect import mavlink

_FLOAT_MAX = 3.4e38
_WHOLE = {
    mavlink.MAV_PARAM_TYPE_UINT8: ("<B", 0, 255),
    mavlink.MAV_PARAM_TYPE_INT8: ("<b", -128, 127),
    mavlink.MAV_PARAM_TYPE_UINT16: ("<H", 0, 65535),
    mavlink.MAV_PARAM_TYPE_INT16: ("<h", -32768, 32767),
    mavlink.MAV_PARAM_TYPE_UINT32: ("<I", 0, 2**32 - 1),
    mavlink.MAV_PARAM_TYPE_INT32: ("<i", -(2**31), 2**31 - 1),
}


def decode_parameter(wire: float, parameter_type: int, *, bytewise: bool) -> float | None:
    """The value of a PARAM_VALUE.

    Args:
        wire: the float field as decoded.
        parameter_type: MAV_PARAM_TYPE.
        bytewise: whole numbers are the float's bytes (PX4), not its value (ArduPilot).

    Returns:
        The value; None when it is not a finite number.
    """
    whole = _WHOLE.get(parameter_type)
    if whole is not None and bytewise:
        code = whole[0]
        return float(struct.unpack(code, struct.pack("<f", wire)[: struct.calcsize(code)])[0])
    return float(wire) if math.isfinite(wire) else None


def encode_parameter(name: str, value: float, parameter_type: int, *, bytewise: bool) -> float:
    """The float field of a PARAM_SET.

    Raises:
        InputError: the value does not fit the parameter's type.
    """
    if not math.isfinite(value) or abs(value) > _FLOAT_MAX:
        raise InputError("its value must be a finite number that fits into 32 bits", field=name)
    whole = _WHOLE.get(parameter_type)
    if whole is None:
        return float(value)
    code, low, high = whole
    if value != round(value) or not low <= value <= high:
        raise InputError(f"it takes whole numbers from {low} to {high}, not {value:g}", field=name)
    if not bytewise:
        return float(value)
    raw = struct.pack(code, round(value)).ljust(4, b"\0")
    return float(struct.unpack("<f", raw)[0])
