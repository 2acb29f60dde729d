"""The files of the autopilots themselves: what PX4 takes and gives, and what ArduPilot makes up beside parameters."""

import json
import lzma
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl_mocks.file_server import file_crc32

ACK, NAK = 128, 129
NOT_FOUND, PROTECTED = b"\n", b"\t"
GENERAL = b"etc/extras/component_general.json.xz"


class Client:
    """A client of the autopilot's file server, with payloads packed by hand."""

    def __init__(self, ground):
        self.ground = ground
        self.sequence = 100

    def request(self, opcode, session=0, offset=0, data=b"", size=None):
        """Session, kind and data of each answer."""
        self.sequence += 2
        length = len(data) if size is None else size
        head = struct.pack("<HBBBBBBI", self.sequence, session, opcode, length, 0, 0, 0, offset)
        payload = list((head + data).ljust(251, b"\0"))
        start = len(self.ground.heard)
        self.ground.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        if opcode == 15:
            self.ground.run(1.0)
        found = []
        for m in self.ground.of("FILE_TRANSFER_PROTOCOL", self.ground.heard[start:]):
            assert m.get_srcComponent() == 1
            raw = bytes(m.payload)
            found.append((raw[2], raw[3], raw[12 : 12 + raw[4]]))
        return found

    def one(self, *args, **kwargs):
        (answer,) = self.request(*args, **kwargs)
        return answer

    def open(self, path):
        """Session and announced size."""
        session, kind, size = self.one(4, data=path)
        assert kind == ACK
        return session, struct.unpack("<I", size)[0]

    def read(self, path):
        session, size = self.open(path)
        content = b""
        while (answer := self.one(5, session, len(content), size=239))[1] == ACK:
            content += answer[2]
        self.request(1, session)
        return size, content

    def write(self, path, content):
        session, kind, _ = self.one(6, data=path)
        assert kind == ACK
        for offset in range(0, len(content), 239):
            assert self.one(7, session, offset, content[offset : offset + 239])[1] == ACK
        return self.one(1, session)[1]


def test_px4_lists_reads_bursts_and_creates(px4):
    client = Client(px4)
    assert set(client.one(3, data=b"/")[2].split(b"\0")) >= {b"Detc", b"Dfs"}
    size, general = client.read(GENERAL)
    assert size == len(general)
    assert b"Fcomponent_general.json.xz\t%d\0" % size in client.one(3, data=b"/etc/extras")[2]
    content = bytes(range(256)) * 40
    assert client.write(b"/fs/left.bin", content) == ACK
    assert client.read(b"/fs/left.bin") == (len(content), content)
    session, _ = client.open(b"/fs/left.bin")
    packets = client.request(15, session, size=239)
    assert b"".join(data for _, kind, data in packets if kind == ACK) == content
    assert client.one(6, data=GENERAL)[1:] == (NAK, PROTECTED)


def test_a_station_cannot_fill_px4_with_files(px4):
    client = Client(px4)
    answers = []
    for n in range(30):
        session, kind, _ = client.one(6, data=b"/fs/%d" % n)
        answers.append(kind)
        client.request(1, session)
    assert answers[0] == ACK
    assert answers[-1] == NAK


def test_px4_describes_itself_in_compressed_files_with_checksums(px4):
    client = Client(px4)
    general = json.loads(lzma.decompress(client.read(GENERAL)[1]))
    (about,) = general["metadataTypes"]
    assert about["uri"].startswith("mftp://etc/")
    packed = client.read(about["uri"].removeprefix("mftp://").encode())[1]
    assert about["fileCrc"] == file_crc32(packed)
    parameters = json.loads(lzma.decompress(packed))["parameters"]
    assert {"name": "COM_OF_LOSS_T", "type": "Float", "default": 1.0} in parameters
    assert len(parameters) == len(px4.vehicle.parameters.table())


@pytest.mark.parametrize(
    "path", [b"@PARAM/param.pck", b"@MISSION/mission.dat", b"@SYS/uarts.txt", b"@MISSION/fence.dat"]
)
def test_px4_makes_no_files_up(px4, path):
    assert Client(px4).one(4, data=path)[1:] == (NAK, NOT_FOUND)
    assert Client(px4).one(6, data=path)[1:] == (NAK, PROTECTED)


def test_ardupilot_lists_its_roots_and_tells_wrong_sizes_of_what_it_says_of_itself(ardupilot):
    client = Client(ardupilot)
    assert client.one(3, data=b"/")[2].split(b"\0")[:-1] == [b"D.", b"D..", b"Dterrain", b"D@ROMFS", b"D@SYS"]
    assert b"Fuarts.txt\t100000\0" in client.one(3, data=b"@SYS")[2]
    announced, content = client.read(b"@SYS/uarts.txt")
    assert announced == 100_000
    assert 0 < len(content) < 1000
    assert client.one(3, data=b"@PARAM")[1:] == (NAK, NOT_FOUND)


@pytest.mark.parametrize(
    ("path", "command", "mission_type", "p1"),
    [(b"@MISSION/fence.dat", 5004, 1, 25.0), (b"@MISSION/rally.dat", 5100, 2, 0.0)],
)
def test_fence_and_rally_points_are_files_too(ardupilot, path, command, mission_type, p1):
    client = Client(ardupilot)
    item = struct.pack("<4f2if2H6B", p1, 0, 0, 0, 313622000, 1216155000, 20.0, 0, command, 0, 0, 0, 0, 0, mission_type)
    content = struct.pack("<5H", 0x763D, mission_type, 0, 0, 1) + item
    assert client.write(path, content) == ACK
    (held,) = ardupilot.vehicle.missions.by_type[mission_type].items
    assert (held.command, held.x, held.y) == (command, 313622000, 1216155000)
    assert len(client.read(path)[1]) == 10 + 38
