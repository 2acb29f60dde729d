"""All parameters in one file: ArduPilot's `@PARAM/param.pck`.

Little-endian: u16 magic (0x671b, or 0x671c with defaults), u16 parameters in the file, u16 parameters in all; then a
block each:

    u8   low half: type (1 int8, 2 int16, 3 int32, 4 float); high half: bit 0, a default follows the value
    u8   low half: letters shared with the name before; high half: further letters, less one
    the further letters, the value, the default where there is one

Zero bytes may stand before a block: they keep values from crossing the boundary between two packets.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from gcs.core.errors import IncompleteError
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.parameter_protocol import NAME_LENGTH, ParameterReading

PATH = "@PARAM/param.pck"
_MAGIC, _MAGIC_WITH_DEFAULTS = 0x671B, 0x671C
_HEADER = struct.Struct("<3H")
_TYPES = {
    1: (struct.Struct("<b"), mavlink.MAV_PARAM_TYPE_INT8),
    2: (struct.Struct("<h"), mavlink.MAV_PARAM_TYPE_INT16),
    3: (struct.Struct("<i"), mavlink.MAV_PARAM_TYPE_INT32),
    4: (struct.Struct("<f"), mavlink.MAV_PARAM_TYPE_REAL32),
}


@dataclass(frozen=True)
class PackedParameter:
    """A parameter with its default.

    Attributes:
        reading: what it is.
        default: what it would be by default; None when the file does not say, or it is the value.
    """

    reading: ParameterReading
    default: float | None = None


def decode_parameter_pack(data: bytes) -> dict[str, PackedParameter]:
    """The parameters in a file that a vehicle gave.

    Raises:
        IncompleteError: it is no such file, or not whole, or a name comes twice.
    """
    if len(data) < _HEADER.size:
        raise IncompleteError(f"the vehicle's parameter file has {len(data)} bytes, too few for its head")
    magic, count, _ = _HEADER.unpack_from(data)
    if magic not in {_MAGIC, _MAGIC_WITH_DEFAULTS}:
        raise IncompleteError(f"the vehicle's parameter file begins with {magic:#06x}, which is no known format")
    parameters: dict[str, PackedParameter] = {}
    place, name = _skip_zeros(data, _HEADER.size), b""
    while place < len(data):
        try:
            place, name, parameter = _block(data, place, name, has_defaults=magic == _MAGIC_WITH_DEFAULTS)
            text = name.decode("ascii")
        except (struct.error, IndexError, KeyError, UnicodeDecodeError, ValueError) as error:
            raise IncompleteError(f"the vehicle's parameter file is damaged at byte {place}") from error
        if text in parameters:
            raise IncompleteError(f"the vehicle's parameter file has {text} twice")
        parameters[text] = parameter
        place = _skip_zeros(data, place)
    if len(parameters) != count:
        raise IncompleteError(f"the vehicle's parameter file has {len(parameters)} of {count} parameters")
    return parameters


def _block(data: bytes, place: int, before: bytes, *, has_defaults: bool) -> tuple[int, bytes, PackedParameter]:
    """The parameter at a place, its name, and the place behind it."""
    head, lengths = data[place], data[place + 1]
    code, parameter_type = _TYPES[head & 15]
    shared, own = lengths & 15, (lengths >> 4) + 1
    end = place + 2 + own
    name = before[:shared] + data[place + 2 : end]
    if shared > len(before) or len(name) != shared + own or len(name) > NAME_LENGTH or b"\0" in name:
        raise ValueError("impossible name")
    value = code.unpack_from(data, end)[0]
    end += code.size
    default = None
    if has_defaults and head & 16:
        default = _finite(code.unpack_from(data, end)[0])
        end += code.size
    return end, name, PackedParameter(ParameterReading(_finite(value), parameter_type), default)


def _skip_zeros(data: bytes, place: int) -> int:
    while place < len(data) and not data[place]:
        place += 1
    return place


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
