import hashlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.signing import EPOCH_S, NEW_STREAM_S, TICKS_PER_S, LinkSigning, Verdict, new_key

KEY = hashlib.sha256(b"a key").digest()
NOW = 1_795_000_000.0


class Wall:
    def __init__(self, now=NOW):
        self.now = now

    def __call__(self):
        return self.now


def ticks(unix_s):
    return int((unix_s - EPOCH_S) * TICKS_PER_S)


def codec_with(key, *, now=NOW, system_id=1):
    """pymavlink's own signer and judge."""
    codec = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)
    codec.signing.secret_key = key
    codec.signing.sign_outgoing = key is not None
    codec.signing.timestamp = ticks(now)
    return codec


def said(codec, text="x"):
    raw = mavlink.MAVLink_statustext_message(6, text.encode(), 0, 0).pack(codec)
    codec.seq = (codec.seq + 1) % 256
    [message] = FrameParser().feed(raw)
    return message


def test_what_we_sign_pymavlink_accepts_and_only_with_the_key():
    packer, signing = FramePacker(255, 190), LinkSigning(KEY, wall=Wall())
    judge, stranger = codec_with(KEY), codec_with(new_key())
    for i in range(300):
        packet = signing.sign(packer.pack(mavlink.MAVLink_statustext_message(6, b"text", i % 7, 0)))
        message = judge.decode(bytearray(packet))
        assert message.get_signed()
        assert message.get_seq() == i % 256
        with pytest.raises(mavlink.MAVError, match="signature"):
            stranger.decode(bytearray(packet))


def test_what_pymavlink_signs_is_good_once():
    signing, codec = LinkSigning(KEY, wall=Wall()), codec_with(KEY)
    messages = [said(codec, str(i)) for i in range(20)]
    assert all(signing.admits(m) for m in messages)
    assert not any(signing.admits(m) for m in messages)
    assert signing.judge(messages[3]) is Verdict.REPEATED
    assert "repeated" in signing.status().problem


def test_unsigned_traffic_is_refused_or_let_in_by_the_policy_and_counted():
    plain = said(codec_with(None))
    strict, open_door = LinkSigning(KEY, wall=Wall()), LinkSigning(KEY, rejects_unsigned=False, wall=Wall())
    assert not strict.admits(plain)
    assert "unsigned" in strict.status().problem
    assert open_door.admits(plain)
    assert open_door.status().problem is None
    assert strict.status().counts[Verdict.UNSIGNED] == open_door.status().counts[Verdict.UNSIGNED] == 1


def test_the_radios_own_messages_pass_without_a_signature():
    raw = mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7).pack(codec_with(None))
    [message] = FrameParser().feed(raw)
    assert LinkSigning(KEY, wall=Wall()).admits(message)


def test_a_wrong_key_is_said_even_where_unsigned_packets_may_pass():
    signing = LinkSigning(KEY, rejects_unsigned=False, wall=Wall())
    assert not signing.admits(said(codec_with(new_key())))
    assert "another key" in signing.status().problem


def test_a_changed_bit_is_found():
    signing, packet = LinkSigning(KEY, wall=Wall()), bytearray(said(codec_with(KEY)).packet)
    for place in range(len(packet) - 13, len(packet)):
        changed = packet.copy()
        changed[place] ^= 1
        [message] = FrameParser().feed(bytes(changed))
        assert signing.judge(message) is Verdict.WRONG_KEY


def test_a_clock_in_the_past_is_said_until_the_sender_has_our_time():
    wall = Wall()
    signing, codec = LinkSigning(KEY, wall=wall), codec_with(KEY, now=NOW - NEW_STREAM_S - 5)
    assert not signing.admits(said(codec))
    assert "clock in the past" in signing.status().problem
    ours = signing.sign(FramePacker(255, 190).pack(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    codec.decode(bytearray(ours))  # from which pymavlink takes the time over
    assert signing.admits(said(codec))
    wall.now += signing.PROBLEM_KEPT_S + 1
    assert signing.status().problem is None


def test_our_own_clock_in_the_past_follows_the_vehicles():
    wall = Wall(NOW - 1e6)
    signing, codec = LinkSigning(KEY, wall=wall), codec_with(KEY)
    first = signing.timestamp()
    assert signing.admits(said(codec))
    assert first < ticks(NOW) < signing.timestamp()


def test_each_sender_has_its_own_time():
    signing = LinkSigning(KEY, wall=Wall())
    ahead, behind = codec_with(KEY, now=NOW + 5, system_id=1), codec_with(KEY, now=NOW, system_id=2)
    assert signing.admits(said(ahead))
    assert signing.admits(said(behind))


def test_a_packet_signed_with_the_pending_key_shows_that_it_is_the_key_for_good():
    present, pending = new_key(), new_key()
    signing, recorded = LinkSigning(present, wall=Wall(), pending=pending), said(codec_with(present))
    assert not signing.admits(said(codec_with(new_key())))
    assert signing.admits(said(codec_with(present)))
    assert signing.key == present
    assert signing.admits(said(codec_with(pending, now=NOW + 1)))
    assert (signing.key, signing.pending) == (pending, None)
    assert signing.judge(recorded) is Verdict.WRONG_KEY
