"""The MAVLink FTP server, spoken to with payloads packed here by hand."""

import binascii
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl_mocks.file_server import file_crc32

ACK, NAK = 128, 129
CONTENT = bytes(range(256)) * 200  # 51,200 bytes


class Client:
    def __init__(self, ground):
        self.ground = ground
        self.sequence = 100

    def request(self, opcode, session=0, offset=0, data=b"", size=None, sequence=None, component=100):
        """Answers as (sequence, session, kind, requested, complete, offset, data)."""
        self.sequence = self.sequence + 2 if sequence is None else sequence
        payload = struct.pack(
            "<HBBBBBBI", self.sequence, session, opcode, len(data) if size is None else size, 0, 0, 0, offset
        )
        payload = (payload + data).ljust(251, b"\0")
        start = len(self.ground.heard)
        self.ground.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, component, list(payload)))
        return self.answers(start, component)

    def answers(self, start, component=100):
        found = []
        for m in self.ground.of("FILE_TRANSFER_PROTOCOL", self.ground.heard[start:]):
            assert m.get_srcComponent() == component
            raw = bytes(m.payload)
            sequence, session, kind, size, requested, complete, _, offset = struct.unpack("<HBBBBBBI", raw[:12])
            found.append((sequence, session, kind, requested, complete, offset, raw[12 : 12 + size]))
        return found

    def open(self, path="/DCIM/IMG_0001.JPG"):
        ((_, session, kind, _, _, _, data),) = self.request(4, data=path.encode())
        assert kind == ACK
        return session, struct.unpack("<I", data)[0]


@pytest.fixture
def client(either):
    either.vehicle.folder.files = {"/DCIM/IMG_0001.JPG": CONTENT, "/DCIM/IMG_0002.JPG": b"", "/DCIM/IMG_0003.JPG": b"x"}
    return Client(either)


def test_listing(client):
    ((sequence, _, kind, requested, _, _, data),) = client.request(3, data=b"/")
    assert (sequence, kind, requested, data) == (client.sequence + 1, ACK, 3, b"DDCIM\0")
    ((_, _, kind, _, _, _, data),) = client.request(3, data=b"/DCIM")
    assert data == b"FIMG_0001.JPG\t51200\0FIMG_0002.JPG\t0\0FIMG_0003.JPG\t1\0"
    ((_, _, kind, _, _, _, data),) = client.request(3, data=b"/DCIM/", offset=3)
    assert (kind, data) == (NAK, bytes([6]))
    ((_, _, kind, _, _, _, data),) = client.request(3, data=b"/nothing")
    assert (kind, data) == (NAK, bytes([10]))


def test_a_long_listing_comes_in_pieces(client):
    client.ground.vehicle.folder.files = {f"/DCIM/IMG_{i:04d}.JPG": b"x" for i in range(50)}
    names = []
    while True:
        ((_, _, kind, _, _, _, data),) = client.request(3, data=b"/DCIM", offset=len(names))
        if kind == NAK:
            break
        names += [entry.split(b"\t")[0] for entry in data.split(b"\0") if entry]
    assert names == [b"FIMG_%04d.JPG" % i for i in range(50)]


def test_reading(client):
    session, size = client.open()
    assert size == len(CONTENT)
    got = b""
    while True:
        ((_, _, kind, _, _, offset, data),) = client.request(5, session=session, offset=len(got), size=239)
        if kind == NAK:
            assert data == bytes([6])
            break
        assert offset == len(got)
        got += data
    assert got == CONTENT
    assert client.request(1, session=session)[0][2] == ACK


def test_bursts(client):
    session, size = client.open()
    got, bursts = b"", 0
    while len(got) < size:
        start = len(client.ground.heard)
        assert client.request(15, session=session, offset=len(got), size=239) == []
        client.ground.run(1.0)
        packets = client.answers(start)
        bursts += 1
        assert [p[4] for p in packets] == [0] * (len(packets) - 1) + [1]
        assert [p[0] for p in packets] == [client.sequence + 1 + i for i in range(len(packets))]
        for _, _, kind, requested, _, offset, data in packets:
            assert (kind, requested, offset) == (ACK, 15, len(got))
            got += data
    assert got == CONTENT
    assert bursts == 3  # a burst ends after about 24 kB, so that small buffers keep up
    ((_, _, kind, _, _, _, data),) = client.request(15, session=session, offset=size, size=239)
    assert (kind, data) == (NAK, bytes([6]))


def test_checksum(client):
    ((_, _, kind, _, _, _, data),) = client.request(14, data=b"/DCIM/IMG_0001.JPG")
    assert kind == ACK
    assert struct.unpack("<I", data)[0] == file_crc32(CONTENT)
    assert client.request(14, data=b"/DCIM/none")[0][2:] == (NAK, 14, 0, 0, bytes([10]))


def test_the_checksum_is_the_uninverted_one():
    # By the definition, bit by bit: polynomial 0xEDB88320 reflected, start 0, no final inversion.
    crc = 0
    for byte in b"123456789":
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0xEDB88320 if crc & 1 else 0)
    assert file_crc32(b"123456789") == crc == 0x2DFD2D88
    assert file_crc32(b"123456789") != binascii.crc32(b"123456789")


def test_refusals(client):
    cases = [
        ({"opcode": 4, "data": b"/DCIM/none"}, 10),
        ({"opcode": 5, "session": 1, "size": 10}, 4),
        ({"opcode": 15, "session": 1, "size": 10}, 4),
        ({"opcode": 1, "session": 1}, 4),
        ({"opcode": 8, "data": b"/DCIM/IMG_0001.JPG"}, 9),
        ({"opcode": 99}, 7),
        ({"opcode": 5, "size": 250}, 3),
    ]
    for request, code in cases:
        (answer,) = client.request(**request)
        assert (answer[2], answer[6]) == (NAK, bytes([code])), request


def test_sessions_run_out_and_are_reset(client):
    assert [client.open()[0], client.open()[0]] == [0, 1]
    (answer,) = client.request(4, data=b"/DCIM/IMG_0001.JPG")
    assert (answer[2], answer[6]) == (NAK, bytes([5]))
    assert client.request(2)[0][2] == ACK
    assert client.open()[0] == 0


def test_a_repeated_request_gets_the_same_answer_again(client):
    session, _ = client.open()
    (again,) = client.request(4, data=b"/DCIM/IMG_0001.JPG", sequence=client.sequence)
    assert again[1] == session
    assert client.open()[0] == session + 1  # the repetition opened nothing


def test_requests_to_the_autopilot_are_not_for_the_camera(client):
    ((*_, kind, _, _, _, data),) = client.request(3, data=b"/DCIM", component=1)
    assert (kind, data) == (NAK, b"\n")
