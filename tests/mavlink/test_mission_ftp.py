"""Lists as files, on fake time: the transactions against the simulated ArduPilot's file server, over a bad link."""

from __future__ import annotations

import math
import struct
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import GcsError, IncompleteError, LinkError, NotFoundError, OperationCancelled, RefusedError
from gcs.core.mission import MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.ftp_fetch import FetchFile
from gcs.mavlink.ftp_store import StoreFile, StoreStep
from gcs.mavlink.mission_file import decode_mission_file, encode_mission_file
from gcs.mavlink.mission_ftp import path_of, read_as_file, reading_is_faster, upload_as_file, writing_is_faster
from gcs.mavlink.mission_protocol import MissionType
from sitl_mocks.ardupilot_files import ArduPilotFiles
from sitl_mocks.ardupilot_mission_server import ArduPilotMissionServer
from sitl_mocks.ardupilot_parameters import ARDUPILOT_PARAMETERS
from sitl_mocks.camera import CameraFolder
from sitl_mocks.file_server import FileServer
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.parameters import ParameterServer

HOME = StoredItem(0, 16, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 4.0)
BURST_STEP_S = 0.004


class FileVehicle:
    """The simulated ArduPilot's files behind the test's link."""

    def __init__(self, clock) -> None:
        self.clock = clock
        self.parameters = ParameterServer(ARDUPILOT_PARAMETERS, bytewise=False)
        self.missions = ArduPilotMissionServer(lambda *_: None, lambda: None, lambda: HOME, lambda: True)
        self.files = ArduPilotFiles(lambda: self.parameters, self.missions.by_type)
        self.server = FileServer(CameraFolder(), sessions=1, virtual=self.files)
        self.put = lambda message, source=None: None
        self.deadline = math.inf
        self.silent = False
        self.requests: list[int] = []

    def hear(self, message) -> None:
        if self.silent or message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return
        self.requests.append(bytes(message.payload)[3])
        self.server.handle(message, self.put)
        self.deadline = self.clock() + BURST_STEP_S

    def on_time(self) -> None:
        self.server.step()
        self.deadline = self.clock() + BURST_STEP_S if self.server.busy else math.inf


class Peer:
    """What a vehicle offers for files, straight on the rig."""

    def __init__(self, rig) -> None:
        self.rig = rig

    async def read_made_up(self, path):
        fetch = FetchFile(path, 1, 1, self.rig.send, self.rig.clock, own_system=255, max_bytes=1 << 20, made_up=True)
        return (await self.rig.run(fetch)).data

    async def write_to_autopilot(self, path, data, on_bytes=None):
        store = StoreFile(path, 1, 1, self.rig.send, self.rig.clock, data=data, own_system=255, on_progress=on_bytes)
        await self.rig.run(store)


@pytest.fixture
def make_peer(make_rig):
    return lambda **faults: Peer(make_rig(FileVehicle, **faults))


def items(count, **fields):
    rows = [MissionItem(0, 0, 16, (0.0, 0.0, 0.0, 0.0), HOME.x, HOME.y, 4.0, 1)]
    for k in range(1, count):
        rows.append(MissionItem(k, 5, 16, (1.0, 0.0, 0.0, 90.0), HOME.x + 100 * k, HOME.y, 20.0 + 0.01 * k))
    return tuple(rows)


async def upload(peer, sent, mission_type=MissionType.MISSION, progress=None):
    return await upload_as_file(sent, mission_type, peer, (1, 1), Autopilot.ARDUPILOT, peer.rig.clock, progress)


@pytest.mark.parametrize("count", [1, 6, 7, 50, 650])
async def test_a_mission_is_written_and_read_back(make_peer, count):
    peer = make_peer()
    sent = items(count)
    proof = await upload(peer, sent)
    assert proof.items_read == count
    assert "file" in proof.how
    held = peer.rig.vehicle.missions.items
    assert len(held) == count
    assert [i.x for i in held[1:]] == [i.x for i in sent[1:]]
    assert all(abs(a.z - b.z) < 0.0101 for a, b in zip(held[1:], sent[1:], strict=True))


@pytest.mark.parametrize("loss", [0.05, 0.2])
@pytest.mark.parametrize("seed", range(5))
async def test_over_a_bad_link(make_peer, loss, seed):
    peer = make_peer(seed=seed, loss=loss, double=0.2, jitter_s=0.05, corrupt=0.02)
    assert (await upload(peer, items(120))).items_read == 120


async def test_as_fast_as_was_measured_on_a_real_one(make_peer):
    peer = make_peer(delay_s=0.0005)
    proof = await upload(peer, items(650))
    assert proof.transfer_s < 1.1
    assert proof.proof_s < 0.6


async def test_writing_beats_one_item_a_round_trip(make_peer):
    peer = make_peer(delay_s=0.05)
    data = encode_mission_file(items(100), MissionType.MISSION, (1, 1))
    await peer.write_to_autopilot(path_of(MissionType.MISSION), data)
    assert peer.rig.clock.now - 100.0 < 100 * 0.1 / 10
    assert writing_is_faster(100)
    assert not writing_is_faster(4)
    assert reading_is_faster(100)
    assert not reading_is_faster(20)


async def test_a_refused_item_is_told_and_is_no_success(make_peer):
    peer = make_peer()
    sent = [*items(8), MissionItem(8, 5, 31000, (0.0, 0.0, 0.0, 0.0), 1, 1, 5.0)]
    with pytest.raises(RefusedError, match="does not take it"):
        await upload(peer, sent)
    assert len(peer.rig.vehicle.missions.items) == 8, "the real one keeps what came before it"


async def test_a_refusal_that_was_lost_is_found_by_reading_back(make_peer):
    peer = make_peer()
    written = peer.rig.vehicle.files.written
    peer.rig.vehicle.files.written = lambda path, data: written(path, data) or True
    with pytest.raises(RefusedError, match="something else"):
        await upload(peer, [*items(8), MissionItem(8, 5, 31000, (0.0, 0.0, 0.0, 0.0), 1, 1, 5.0)])


async def test_too_many_items_keep_the_old_mission(make_peer):
    peer = make_peer()
    await upload(peer, items(10))
    with pytest.raises(RefusedError):
        await upload(peer, items(2000))
    assert len(peer.rig.vehicle.missions.items) == 10


async def test_a_bad_fence_keeps_the_old_one(make_peer):
    peer = make_peer()
    fence = [
        MissionItem(k, 0, 5001, (3.0, 0.0, 0.0, 0.0), HOME.x + x, HOME.y + y, 0.0)
        for k, (x, y) in enumerate([(0, 0), (9000, 0), (9000, 9000)])
    ]
    await upload(peer, fence, MissionType.FENCE)
    with pytest.raises(RefusedError):
        await upload(peer, fence[:2], MissionType.FENCE)
    assert [i.x for i in await read_as_file(peer, MissionType.FENCE)] == [i.x for i in fence]
    rally = [MissionItem(0, 3, 5100, (0.0, 0.0, 0.0, 0.0), HOME.x, HOME.y, 20.0)]
    assert (await upload(peer, rally, MissionType.RALLY)).items_read == 1


async def test_a_vehicle_without_such_files(make_peer):
    peer = make_peer()
    peer.rig.vehicle.server = FileServer(CameraFolder())
    with pytest.raises(NotFoundError):
        await read_as_file(peer, MissionType.MISSION)
    with pytest.raises(RefusedError):
        await upload(peer, items(5))


async def test_a_vehicle_that_serves_no_files_at_all_costs_little_time(make_peer):
    peer = make_peer()
    peer.rig.vehicle.silent = True
    with pytest.raises(LinkError):
        await upload(peer, items(5))
    assert peer.rig.clock.now - 100.0 < 4.0


async def test_a_session_that_was_lost_begins_anew(make_peer):
    peer = make_peer()
    server = peer.rig.vehicle.server
    peer.rig.at.append((100.1, lambda: server.handle(_reset(), lambda _: None)))
    assert (await upload(peer, items(300))).items_read == 300
    assert peer.rig.vehicle.requests.count(6) == 2


def _reset():
    payload = struct.pack("<HBBBBBBI", 7, 0, 2, 0, 0, 0, 0, 0).ljust(251, b"\0")
    message = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)
    message._header = SimpleNamespace(srcSystem=254, srcComponent=1)
    return message


async def test_the_link_is_gone_in_the_middle(make_peer):
    peer = make_peer()
    peer.rig.at.append((100.1, lambda: setattr(peer.rig.vehicle, "silent", True)))
    with pytest.raises(LinkError, match="stopped"):
        await upload(peer, items(300))


async def test_progress_is_told_and_can_cancel(make_peer):
    class Stop:
        def __init__(self):
            self.told = []

        def report(self, stage, fraction):
            self.told.append((stage, fraction))
            if len(self.told) == 8:
                raise OperationCancelled("enough")

    peer, stop = make_peer(), Stop()
    with pytest.raises(OperationCancelled):
        await upload(peer, items(300), progress=stop)
    fractions = [fraction for _, fraction in stop.told]
    assert fractions == sorted(fractions)
    peer.rig.pass_time(1.0)
    assert 1 in peer.rig.vehicle.requests, "the file was left open"
    assert not peer.rig.vehicle.missions.items


def test_cancel_before_anything_was_heard(make_peer):
    rig = make_peer().rig
    store = StoreFile("@MISSION/mission.dat", 1, 1, rig.send, rig.clock, data=b"x")
    store.start()
    store.cancel()
    assert store.step is StoreStep.DONE
    with pytest.raises(OperationCancelled):
        store.result()


def test_the_items_of_the_file_are_the_payload_of_the_message():
    sent = items(3)
    data = encode_mission_file(sent, MissionType.MISSION, (1, 1))
    assert len(data) == 10 + 38 * 3
    assert struct.unpack_from("<5H", data) == (0x763D, 0, 0, 0, 3)
    for i in sent:
        message = mavlink.MAVLink_mission_item_int_message(
            1, 1, i.sequence, i.frame, i.command, i.current, i.autocontinue, *i.params, i.x, i.y, i.z, 0
        )
        raw = bytes(message.pack(mavlink.MAVLink(None)))[10:-2].ljust(38, b"\0")
        assert data[10 + 38 * i.sequence :][:38] == raw


WHOLE = encode_mission_file(items(5), MissionType.MISSION, (1, 1))


@pytest.mark.parametrize(
    "data",
    [b"", WHOLE[:9], WHOLE[:-1], WHOLE + b"\0", b"\0\0" + WHOLE[2:], WHOLE[:2] + b"\1" + WHOLE[3:], WHOLE[:10]],
)
def test_what_is_no_whole_file_is_refused(data):
    with pytest.raises(IncompleteError):
        decode_mission_file(data, MissionType.MISSION)


@given(st.binary(max_size=300))
def test_any_bytes_are_a_mission_or_an_error(data):
    for raw in (data, WHOLE[:10] + data, WHOLE[:8] + struct.pack("<H", len(data) // 38) + data):
        try:
            found = decode_mission_file(raw, MissionType.MISSION)
        except GcsError:
            continue
        assert len(found) * 38 + 10 == len(raw)
