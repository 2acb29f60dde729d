"""ArduPilot's packed parameters against a decoder of the format's description and the simulated vehicle's packer."""

from __future__ import annotations

import math
import random
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavutil

from gcs.core.errors import GcsError, IncompleteError
from gcs.mavlink.ftp_protocol import decode
from gcs.mavlink.parameter_pack import decode_parameter_pack
from sitl_mocks.ardupilot_files import ArduPilotFiles
from sitl_mocks.ardupilot_parameters import ARDUPILOT_PARAMETERS
from sitl_mocks.parameters import ParameterServer

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"
FORMS = {1: "b", 2: "h", 3: "i", 4: "f"}


def described(data):
    """The format's description read word by word: a recursive reader that consumes a list of bytes."""
    magic, count, total = struct.unpack("<HHH", data[:6])
    left, name, found = list(data[6:]), "", {}
    while left:
        if left[0] == 0:
            left.pop(0)
            continue
        first, second = left.pop(0), left.pop(0)
        kind, flags, common, own = first % 16, first // 16, second % 16, second // 16 + 1
        name = name[:common] + "".join(chr(left.pop(0)) for _ in range(own))
        size = {1: 1, 2: 2, 3: 4, 4: 4}[kind]
        value = struct.unpack("<" + FORMS[kind], bytes(left.pop(0) for _ in range(size)))[0]
        default = None
        if magic == 0x671C and flags & 1:
            default = struct.unpack("<" + FORMS[kind], bytes(left.pop(0) for _ in range(size)))[0]
        found[name] = (value, kind, default)
    return count, total, found


def packed(rows, with_defaults=False, pad=0):
    """A file with a row (name, kind, value, default) each and some zeros before every block."""
    out = struct.pack("<HHH", 0x671C if with_defaults else 0x671B, len(rows), len(rows) + 7)
    before = ""
    for name, kind, value, default in rows:
        common = 0
        while common < min(len(name) - 1, len(before), 15) and name[common] == before[common]:
            common += 1
        flag = 16 if with_defaults and default is not None else 0
        out += bytes(pad) + bytes([kind | flag, common | (len(name) - common - 1) << 4]) + name[common:].encode()
        out += struct.pack("<" + FORMS[kind], value)
        out += struct.pack("<" + FORMS[kind], default) if flag else b""
        before = name
    return out


ROWS = [
    ("ACRO_BAL_PITCH", 4, 1.5, 1.0),
    ("ACRO_BAL_ROLL", 4, -1.0, None),
    ("ACRO_OPTIONS", 1, -3, 0),
    ("ARMING_CHECK", 3, 2**31 - 1, 1),
    ("ARMING_CHECK2", 2, -32768, None),
    ("A", 4, 0.0, 2.5),
    ("SIXTEEN_LETTERS_", 1, 0, 7),
]


@pytest.mark.parametrize("with_defaults", [False, True])
@pytest.mark.parametrize("pad", [0, 1, 3])
def test_values_types_and_defaults(with_defaults, pad):
    data = packed(ROWS, with_defaults, pad)
    found = decode_parameter_pack(data)
    types = {1: 2, 2: 4, 3: 6, 4: 9}  # MAV_PARAM_TYPE
    assert [(n, p.reading.value, p.reading.parameter_type) for n, p in found.items()] == [
        (n, v, types[k]) for n, k, v, _ in ROWS
    ]
    assert [p.default for p in found.values()] == [d if with_defaults else None for *_, d in ROWS]
    assert {n: (v, d) for n, (v, _, d) in described(data)[2].items()} == {
        n: (p.reading.value, p.default) for n, p in found.items()
    }


def test_numbers_that_are_none_are_not_told():
    found = decode_parameter_pack(packed([("NAN", 4, math.nan, None), ("INF", 4, math.inf, 1.0)], True))
    assert found["NAN"].reading.value is None
    assert found["INF"].reading.value is None
    assert found["INF"].default == 1.0


@pytest.mark.parametrize("query", ["", "?withdefaults=1"])
def test_what_the_simulated_vehicle_packs(query):
    server = ParameterServer(ARDUPILOT_PARAMETERS, bytewise=False)
    server.override("WPNAV_SPEED", 750.0)
    server.override("RTL_ALT", 4200)
    data = ArduPilotFiles(lambda: server, {}).content(f"@PARAM/param.pck{query}")
    found = decode_parameter_pack(data)
    assert {n: p.reading.value for n, p in found.items()} == {
        n: struct.unpack("f", struct.pack("f", v))[0] for n, (v, _, _) in server.table().items()
    }
    assert {n: p.default for n, p in found.items() if p.default is not None} == (
        {"WPNAV_SPEED": 1000.0, "RTL_ALT": 1500.0} if query else {}
    )
    assert {n: v for n, (v, *_) in described(data)[2].items()} == {n: p.reading.value for n, p in found.items()}


def test_no_value_crosses_a_packet_in_what_the_simulated_vehicle_packs():
    server = ParameterServer(ARDUPILOT_PARAMETERS, bytewise=False)
    data = ArduPilotFiles(lambda: server, {}).content("@PARAM/param.pck")
    place, crossed = 6, 0
    while place < len(data):
        if data[place] == 0:
            place += 1
            continue
        size = {1: 1, 2: 2, 3: 4, 4: 4}[data[place] % 16]
        place += 2 + data[place + 1] // 16 + 1
        crossed += place // 239 != (place + size - 1) // 239
        place += size
    assert len(data) > 3 * 239
    assert crossed == 0


@pytest.mark.parametrize("cut", range(1, 30))
def test_a_file_that_was_cut_is_no_file(cut):
    with pytest.raises(IncompleteError):
        decode_parameter_pack(packed(ROWS, True)[:-cut])


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x1b\x67\x00",
        struct.pack("<HHH", 0x671D, 0, 0),
        struct.pack("<HHH", 0x671B, 1, 1) + b"\x05\x00A\x01",  # an unknown type
        struct.pack("<HHH", 0x671B, 1, 1) + b"\x01\x03A\x01",  # shares letters with nothing
        struct.pack("<HHH", 0x671B, 1, 1) + b"\x01\x00\xff\x01",  # a name that is no text
        struct.pack("<HHH", 0x671B, 1, 1) + b"\x01\x10A\x00\x01",  # a name with a zero in it
        struct.pack("<HHH", 0x671B, 2, 2) + b"\x01\x00A\x01" * 2,  # a name that comes twice
        packed([("A", 1, 1, None)]) + packed([("LONGER_THAN_SIX", 1, 1, None)])[6:] + b"\x01\xffTEEN_LETTERS_AND\x01",
    ],
)
def test_hostile_files(data):
    with pytest.raises(IncompleteError):
        decode_parameter_pack(data)


@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_are_parameters_or_an_error(tail, defaults):
    head = struct.pack("<HHH", 0x671C if defaults else 0x671B, 1, 1)
    for data in (tail, head + tail):
        try:
            found = decode_parameter_pack(data)
        except GcsError:
            continue
        assert all(0 < len(name) <= 16 for name in found)


def test_one_flipped_bit_is_never_a_crash():
    rng = random.Random(1)
    whole = packed(ROWS, True)
    for _ in range(2000):
        place = rng.randrange(len(whole))
        data = whole[:place] + bytes([whole[place] ^ 1 << rng.randrange(8)]) + whole[place + 1 :]
        try:
            decode_parameter_pack(data)
        except IncompleteError:
            continue


def test_the_file_of_a_real_vehicle():
    record = RECORDS / "ardupilot/timing_ftp_fence.tlog"
    if not record.exists():
        pytest.skip("no records here")
    log = mavutil.mavlink_connection(str(record))
    parts, told = {}, {}
    while (message := log.recv_match(type=["FILE_TRANSFER_PROTOCOL", "PARAM_VALUE"])) is not None:
        if message.get_type() == "PARAM_VALUE":
            told[message.param_id] = message.param_value
        elif (payload := decode(message)) is not None and payload.request == 15 and payload.error is None:
            parts[payload.offset] = payload.data
    log.close()
    data = b"".join(part for _, part in sorted(parts.items()))
    found = decode_parameter_pack(data)
    assert len(data) == 14882
    assert len(found) == 1349
    assert {n: p.reading.value for n, p in found.items()} == {n: v for n, (v, *_) in described(data)[2].items()}
    both = told.keys() & found.keys()
    assert {n: found[n].reading.value for n in both} == {n: told[n] for n in both}
