from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.status_text import StatusTextAssembler


def chunk(text, number=0, sequence=0, severity=4):
    raw = mavlink.MAVLink_statustext_message(severity, text.encode(), number, sequence).pack(mavlink.MAVLink(None))
    return mavlink.MAVLink(None).parse_buffer(raw)[0]


def texts(*chunks):
    assembler = StatusTextAssembler()
    return [status.text for c in chunks for status in assembler.take(c)]


def test_short_texts_come_at_once():
    assert texts(chunk("PreArm: no fix\t"), chunk("Armed")) == ["PreArm: no fix", "Armed"]


def test_chunks_are_joined_in_their_order():
    long = "a" * 50 + "b" * 50 + "c" * 7
    assert texts(chunk(long[:50], 9, 0), chunk(long[50:100], 9, 1), chunk(long[100:], 9, 2)) == [long]


def test_a_lost_chunk_shows():
    assert texts(chunk("a" * 50, 9, 0), chunk("end", 9, 2)) == ["a" * 50 + " ... end"]


def test_texts_that_never_end_do_not_pile_up():
    told = texts(*(chunk("x" * 50, number, 0) for number in range(1, 200)))
    assert len(told) > 150
