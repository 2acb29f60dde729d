import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.framing import FrameParser
from gcs.mavlink.received_message import LAYOUTS, ReceivedMessage


def test_every_field_of_every_message_is_what_pymavlink_makes_of_it():
    rng = random.Random(3)
    codec, judge = mavlink.MAVLink(None, srcSystem=1, srcComponent=7), mavlink.MAVLink(None)
    for kind in mavlink.mavlink_map.values():
        for trial in range(4):
            size = kind.unpacker.size if trial < 2 else rng.randrange(1, 255)  # cut, or longer than the dialect knows
            raw = mavlink.MAVLink_message(kind.id, kind.msgname)._pack(codec, kind.crc_extra, rng.randbytes(size))
            [ours], theirs = FrameParser().feed(raw), judge.decode(bytearray(raw))
            assert ours.get_type() == theirs.get_type()
            assert (ours.get_srcSystem(), ours.get_srcComponent(), ours.get_seq()) == (1, 7, 0)
            for name in theirs.get_fieldnames():
                assert repr(getattr(ours, name)) == repr(getattr(theirs, name)), f"{kind.msgname}.{name}"
            if "time_boot_ms" in theirs.get_fieldnames():
                assert ours.boot_s == theirs.time_boot_ms * 1e-3


def test_no_field_of_the_dialect_is_hidden_by_the_messages_own_attributes():
    own = set(dir(ReceivedMessage))
    assert not [f"{each.name}.{name}" for each in LAYOUTS.values() for name in each.fields if name in own]


def test_a_field_that_a_message_lacks_is_an_attribute_error():
    raw = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mavlink.MAVLink(None))
    [message] = FrameParser().feed(raw)
    with pytest.raises(AttributeError, match="HEARTBEAT has no field 'roll'"):
        _ = message.roll
    assert message.get_payload() == raw[10:-2]
    assert message.get_msgbuf() == raw
    assert "autopilot=3" in repr(message)
