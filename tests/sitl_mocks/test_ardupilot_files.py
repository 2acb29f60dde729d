"""ArduPilot's made-up files, spoken to with payloads packed by hand; what is expected was measured on a real one."""

import struct
import zlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ACK, NAK = 128, 129
PARAMETERS, MISSION = b"@PARAM/param.pck", b"@MISSION/mission.dat"


class Client:
    def __init__(self, ground):
        self.ground = ground
        self.sequence = 100

    def request(self, opcode, session=0, offset=0, data=b"", size=None):
        """Session, kind and data of the answer."""
        self.sequence += 2
        head = struct.pack(
            "<HBBBBBBI", self.sequence, session, opcode, len(data) if size is None else size, 0, 0, 0, offset
        )
        start = len(self.ground.heard)
        payload = list((head + data).ljust(251, b"\0"))
        self.ground.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        (answer,) = self.ground.of("FILE_TRANSFER_PROTOCOL", self.ground.heard[start:])
        assert answer.get_srcComponent() == 1
        raw = bytes(answer.payload)
        return raw[2], raw[3], raw[12 : 12 + raw[4]]

    def read(self, path, chunk=239):
        session, kind, size = self.request(4, data=path)
        assert kind == ACK
        content = b""
        while (answer := self.request(5, session, len(content), size=chunk))[1] == ACK:
            content += answer[2]
        assert answer[2] == b"\6"
        assert self.request(1, session)[1] == ACK
        return struct.unpack("<I", size)[0], content

    def write(self, path, content):
        """The answer to closing it."""
        session, kind, _ = self.request(6, data=path)
        assert kind == ACK
        for offset in range(0, len(content), 239):
            assert self.request(7, session, offset, content[offset : offset + 239])[1] == ACK
        return self.request(1, session)[1]


@pytest.fixture
def client(ardupilot):
    return Client(ardupilot)


def item(seq, command=16, x=313622000, y=1216155000, z=20.0, params=(0.0, 0.0, 0.0, 0.0)):
    return struct.pack("<4f2if2H6B", *params, x, y, z, seq, command, 1, 1, 0, 0, 1, 0)


def mission(items, count=None, magic=0x763D, options=0):
    return struct.pack("<5H", magic, 0, options, 0, len(items) if count is None else count) + b"".join(items)


def test_the_announced_sizes_are_wrong_as_on_the_real_one(client):
    announced, content = client.read(PARAMETERS)
    assert announced == 12 * struct.unpack_from("<3H", content)[1]
    assert announced != len(content)
    announced, content = client.read(MISSION)
    assert announced == 1 << 20
    assert content == mission([])


def test_parameters_are_read_in_pieces_of_one_size_only(client):
    session, _, _ = client.request(4, data=PARAMETERS)
    assert client.request(5, session, 0, size=239)[1] == ACK
    assert client.request(5, session, 239, size=100)[1] == NAK
    assert client.request(5, session, 239, size=239)[1] == ACK


def test_the_checksum_of_the_parameters_is_that_of_another_layout(make_ground):
    client = Client(make_ground("ardupilot", parameter_count=1349))
    _, content = client.read(PARAMETERS)
    _, kind, told = client.request(14, data=PARAMETERS)
    assert kind == ACK
    state = zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF
    assert struct.unpack("<I", told)[0] != state


def test_a_mission_is_used_when_its_file_is_closed(client):
    sent = mission([item(k, z=20.0 + k) for k in range(12)])
    assert client.write(MISSION, sent) == ACK
    held = client.ground.download()
    assert [m.z for m in held[1:]] == [20.0 + k for k in range(1, 12)]
    assert client.read(MISSION)[1][10 + 38 :] == client.read(MISSION)[1][10 + 38 :]
    assert len(client.read(MISSION)[1]) == len(sent)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        mission([item(0)])[:-1],
        mission([item(0)], magic=0x1234),
        mission([item(0), item(1)], count=3),
        mission([item(0), bytes(38)]),
        mission([item(k) for k in range(800)]),
    ],
)
def test_what_is_no_mission_is_refused_at_closing_and_the_old_one_kept(client, content):
    client.write(MISSION, mission([item(0), item(1)]))
    assert client.write(MISSION, content) == NAK
    assert len(client.ground.vehicle.missions.items) == 2


def test_an_item_that_is_not_taken_leaves_those_before_it(client):
    assert client.write(MISSION, mission([item(0), item(1), item(2, command=31000), item(3)])) == NAK
    assert len(client.ground.vehicle.missions.items) == 2


def test_one_session_and_no_listing(client):
    client.request(4, data=PARAMETERS)
    assert client.request(4, data=MISSION)[1:] == (NAK, b"\5")
    assert client.request(2)[1] == ACK
    assert client.request(4, data=MISSION)[1] == ACK
    assert client.request(3, data=b"@MISSION")[1] == NAK
    assert client.request(4, data=b"@MISSION/other.dat")[1] == NAK


def test_what_cannot_be_written(client):
    for path in (PARAMETERS, b"@SYS/threads.txt", b"/DCIM/IMG_0001.JPG", b"@MISSION/../x"):
        assert client.request(6, data=path)[1] == NAK


def test_px4_has_no_such_files(px4):
    client = Client(px4)
    assert client.request(4, data=PARAMETERS)[1:] == (NAK, b"\n")
    assert client.request(6, data=MISSION)[1] == NAK
