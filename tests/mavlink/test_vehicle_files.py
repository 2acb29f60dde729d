"""A whole `Vehicle` beside simulated ones in the same process: what goes by files, and what by the protocols."""

from __future__ import annotations

import asyncio
import contextlib
import time
from concurrent.futures import Future

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import GcsError, IncompleteError, InputError, NotFoundError, OperationCancelled, RefusedError
from gcs.core.frames import GeoPoint
from gcs.core.mission import Mission, MissionItem
from gcs.core.vehicle import Autopilot, VehicleIdentity
from gcs.mavlink.events import ListChangedEvent
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.mission_protocol import MissionType, check_places
from gcs.mavlink.stepped_channel import SteppedChannel, SteppedTask
from gcs.mavlink.vehicle import Vehicle
from gcs.mavlink.vehicle_channel import VehicleChannel
from sitl_mocks.ardupilot import ArduPilotVehicle
from sitl_mocks.camera import CameraFolder
from sitl_mocks.channel import Channel
from sitl_mocks.file_server import FileServer
from sitl_mocks.px4 import Px4Vehicle
from sitl_mocks.vehicle_options import VehicleOptions

HOME = GeoPoint(31.36201962, 121.61528979, 4.0)
TICK_S = 0.002


class Pair:
    """A vehicle of the station and the simulated one that it talks to, without a socket in between."""

    def __init__(self, cls, autopilot, **options):
        self.simulated = cls(VehicleOptions(1, HOME, HOME, _draw, **options))
        self.asked = []
        self.loses = lambda message: False
        packer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        parser = FrameParser()
        self._under_way = []
        self._link = Channel(1, lambda packet: self._under_way.extend(parser.feed(packet)))
        channel = VehicleChannel((1, 1), (255, 190), self._send, time.monotonic)
        self.vehicle = Vehicle(VehicleIdentity(1, 1, autopilot, 2), channel, lost_after_s=1e9)
        self._packer = packer
        self.simulated.add_channel(self._link)
        self.wall_s = 0.0
        for _ in range(250):
            self.step(0.02)

    def _send(self, message):
        self.asked.append(message.get_type())
        if self.loses(message):
            return
        for m in self._link.receive(bytes(message.pack(self._packer))):
            self.simulated.handle(m, self._link)

    def step(self, seconds):
        self.wall_s += seconds
        self.simulated.step(seconds, self.wall_s)
        arrived, self._under_way = self._under_way, []
        for message in arrived:
            self.vehicle.handle(message, time.monotonic())

    async def live(self):
        while True:
            self.step(TICK_S)
            await asyncio.sleep(TICK_S)


def _draw(exposure):
    done = Future()
    done.set_result(b"\xff\xd8\xff" + bytes([exposure.index]) * 5000)
    return done


@pytest.fixture
async def make_pair():
    tasks = []

    def make(cls=ArduPilotVehicle, autopilot=Autopilot.ARDUPILOT, **options):
        pair = Pair(cls, autopilot, **options)
        tasks.append(asyncio.ensure_future(pair.live()))
        return pair

    yield make
    for task in tasks:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


def mission(count, command=16):
    rows = [MissionItem(0, 0, 16, (0.0,) * 4, 313620196, 1216152897, 4.0, 1)]
    rows += [MissionItem(k, 5, command, (0.0,) * 4, 313620196 + 50 * k, 1216152897, 20.0) for k in range(1, count)]
    return Mission(tuple(rows))


async def test_ardupilot_missions_go_as_files_both_ways(make_pair):
    pair = make_pair()
    proof = await pair.vehicle.upload_mission(mission(60))
    assert "file" in proof.how
    assert "MISSION_COUNT" not in pair.asked
    assert len(pair.simulated.missions.items) == 60
    pair.simulated.broadcast(pair.simulated.telemetry.build(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT))
    await pair.vehicle.until(lambda: pair.vehicle.telemetry.mission is not None, 5.0, "its mission")
    assert [i.x for i in await pair.vehicle.download_mission()][1:] == [i.x for i in mission(60).items][1:]
    assert "MISSION_REQUEST_LIST" not in pair.asked


async def test_what_the_file_does_not_bring_the_protocol_does(make_pair):
    pair = make_pair()
    pair.simulated.autopilot_files = FileServer(CameraFolder())
    proof = await pair.vehicle.upload_mission(mission(20))
    assert "file" not in proof.how
    assert len(pair.simulated.missions.items) == 20


async def test_the_protocol_says_what_is_wrong_with_an_item(make_pair):
    pair = make_pair()
    with pytest.raises(RefusedError, match="command"):
        await pair.vehicle.upload_mission(mission(20, command=31000))
    assert "MISSION_COUNT" in pair.asked


async def test_px4_is_asked_for_no_such_file(make_pair):
    pair = make_pair(Px4Vehicle, Autopilot.PX4)
    with contextlib.suppress(RefusedError):
        await pair.vehicle.upload_mission(mission(20))
    assert "FILE_TRANSFER_PROTOCOL" not in pair.asked
    with pytest.raises(NotFoundError):
        await pair.vehicle.read_all_parameters()


async def test_many_parameters_come_in_one_file_and_unknown_names_cost_nothing(make_pair):
    pair = make_pair()
    names = [f"NO_SUCH_{k}" for k in range(40)] + ["RTL_ALT", "WPNAV_SPEED"]
    begin = time.monotonic()
    values = await pair.vehicle.read_parameters(names)
    assert time.monotonic() - begin < 3.0, "it waited for names that do not exist"
    assert (values["RTL_ALT"], values["WPNAV_SPEED"], values["NO_SUCH_1"]) == (1500.0, 1000.0, None)
    assert "PARAM_REQUEST_READ" not in pair.asked


async def test_the_defaults_come_with_all_parameters(make_pair):
    pair = make_pair()
    pair.simulated.parameters.override("RTL_ALT", 2000)
    told = await pair.vehicle.read_all_parameters()
    assert (told["RTL_ALT"].reading.value, told["RTL_ALT"].default) == (2000.0, 1500.0)
    assert told["WPNAV_SPEED"].default is None


@pytest.mark.parametrize("damage", [lambda data: data[:-3], lambda data: b"\0\0" + data[2:], lambda data: b""])
async def test_a_damaged_parameter_file_is_left_for_the_protocol(make_pair, damage):
    pair = make_pair()
    files = pair.simulated.autopilot_files._virtual
    content = files.content
    files.content = lambda path: damage(content(path))
    names = list(pair.simulated.parameters.table())[:20]
    values = await pair.vehicle.read_parameters(names)
    assert None not in values.values()
    assert "PARAM_REQUEST_READ" in pair.asked


async def test_a_few_parameters_are_asked_for_by_name(make_pair):
    pair = make_pair()
    assert await pair.vehicle.read_parameters(["RTL_ALT"]) == {"RTL_ALT": 1500.0}
    assert "FILE_TRANSFER_PROTOCOL" not in pair.asked


async def test_fence_and_rally_go_as_files_too(make_pair):
    pair = make_pair()
    corners = [
        MissionItem(k, 0, 5001, (6.0, 0.0, 0.0, 0.0), 313620196 + x, 1216152897 + y, 0.0)
        for k, (x, y) in enumerate(
            [(-9000, -9000), (9000, -9000), (12000, 0), (9000, 9000), (-9000, 9000), (-12000, 0)]
        )
    ]
    proof = await pair.vehicle.upload_list(corners, MissionType.FENCE)
    assert "file" in proof.how
    assert len(await pair.vehicle.download_list(MissionType.FENCE)) == 6


@pytest.mark.parametrize(("cls", "autopilot"), [(Px4Vehicle, Autopilot.PX4), (ArduPilotVehicle, Autopilot.ARDUPILOT)])
async def test_a_camera_that_serves_no_files_sends_its_newest_picture(make_pair, cls, autopilot):
    pair = make_pair(cls, autopilot, serves_pictures=False)
    await pair.vehicle.until(lambda: pair.vehicle.camera_component is not None, 5.0, "its camera")
    with pytest.raises(NotFoundError):
        await pair.vehicle.request_picture()
    pair.simulated.camera.take()
    pair.simulated.camera.take()
    await asyncio.sleep(0.1)
    picture = await pair.vehicle.request_picture()
    assert picture.data == pair.simulated.folder.files["/DCIM/IMG_0002.JPG"]
    pair.simulated.options = VehicleOptions(1, HOME, HOME, _draw)
    assert (await pair.vehicle.fetch_file("/DCIM/IMG_0001.JPG")).data[:3] == b"\xff\xd8\xff"


class SilentCamera:
    """A vehicle just heard, on fake time, whose autopilot has no files and whose camera speaks at `camera_at_s`."""

    def __init__(self, camera_at_s):
        self.now, self.asked = 100.0, []
        self.channel = SteppedChannel((1, 1), (255, 190), self._send, lambda: self.now)
        self.vehicle = Vehicle(VehicleIdentity(1, 1, Autopilot.PX4, 2), self.channel, lost_after_s=1e9)
        self._camera_at_s = self.now + camera_at_s
        self._packers = {c: mavlink.MAVLink(None, srcSystem=1, srcComponent=c) for c in (1, 100)}
        self._parser = FrameParser()
        self._task = None

    def _send(self, message):
        if message.get_type() == "FILE_TRANSFER_PROTOCOL":
            self.asked.append((self.now, message.target_component))

    def run(self, work, until_s):
        self._task = SteppedTask(work)
        for tick in range(int(until_s / 0.1)):
            self.now += 0.1
            if tick % 10 == 0:
                self._hear(1, mavlink.MAV_TYPE_QUADROTOR)
                if self.now >= self._camera_at_s:
                    self._hear(100, mavlink.MAV_TYPE_CAMERA)
            self._task.on_time()

    def _hear(self, component, kind):
        heartbeat = mavlink.MAVLink_heartbeat_message(kind, 12, 0, 0, 4, 3)
        for message in self._parser.feed(bytes(heartbeat.pack(self._packers[component]))):
            self.vehicle.handle(message, self.now)
            self._task.handle(message)


@pytest.mark.parametrize(("camera_at_s", "server", "from_s"), [(0.5, 100, 1.0), (2.5, 100, 3.0), (1e9, 1, 5.0)])
@pytest.mark.parametrize("ask", ["list_files", "fetch_file"])
async def test_a_camera_that_is_heard_later_than_its_vehicle_is_waited_for(camera_at_s, server, from_s, ask):
    """The station was started again: asked at once, the autopilot would answer that there is no such file."""
    world = SilentCamera(camera_at_s)

    async def work():
        with contextlib.suppress(GcsError):
            await getattr(world.vehicle, ask)("/DCIM/IMG_0001.JPG")

    world.run(work(), until_s=8.0)
    assert {component for _, component in world.asked} == {server}
    assert world.asked[0][0] - 100.0 == pytest.approx(from_s, abs=0.25)


async def test_a_mission_that_is_changed_behind_our_back_is_told_once(make_pair):
    pair = make_pair(Px4Vehicle, Autopilot.PX4)
    vehicle, simulated, told = pair.vehicle, pair.simulated, []

    def show(times=3):
        for _ in range(times):
            simulated.broadcast(simulated.telemetry.build(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT))
            pair.step(TICK_S)

    def changes():
        return [event.mission_type for event in told if isinstance(event, ListChangedEvent)]

    vehicle.on_event = told.append
    rows = [(22 if k == 0 else 16, 313620196 + 50 * k) for k in range(6)]
    sent = [MissionItem(k, 5, command, (0.0,) * 4, x, 1216152897, 20.0) for k, (command, x) in enumerate(rows)]
    await vehicle.upload_mission(Mission(tuple(sent)))
    show()
    assert changes() == []
    simulated.missions.clear()
    show()
    assert changes() == [MissionType.MISSION]
    assert await vehicle.download_mission() == ()
    show()
    assert changes() == [MissionType.MISSION], "what it holds is known again"


BOTH = [(Px4Vehicle, Autopilot.PX4), (ArduPilotVehicle, Autopilot.ARDUPILOT)]


def small_mission():
    rows = [(16, 0), (22, 50), *((16, 100 + 50 * k) for k in range(4))]
    items = [MissionItem(k, 0, c, (0.0,) * 4, 313620196 + x, 1216152897, 20.0) for k, (c, x) in enumerate(rows)]
    return Mission(tuple(items))


@pytest.mark.parametrize(("cls", "autopilot"), BOTH)
async def test_a_list_that_was_read_and_is_changed_then_is_told_once(make_pair, cls, autopilot):
    pair = make_pair(cls, autopilot)
    told = []
    pair.vehicle.on_event = told.append

    def changes():
        for _ in range(3):
            pair.simulated.broadcast(pair.simulated.telemetry.build(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT))
            pair.step(TICK_S)
        return [event.mission_type for event in told if isinstance(event, ListChangedEvent)]

    await pair.vehicle.upload_mission(small_mission())
    assert len(await pair.vehicle.download_mission()) == 6
    assert changes() == []
    pair.simulated.missions.clear()
    assert changes() == changes() == [MissionType.MISSION]


def old_acknowledgement(pair, lost):
    """Lose what clears a mission so often; an ACK of an earlier upload comes instead."""
    left = [lost]

    def loses(message):
        if message.get_type() != "MISSION_CLEAR_ALL" or left[0] == 0:
            return False
        left[0] -= 1
        pair.simulated.broadcast(mavlink.MAVLink_mission_ack_message(255, 190, 0, 0))
        return True

    return loses


@pytest.mark.parametrize(("cls", "autopilot"), BOTH)
async def test_an_old_acknowledgement_clears_nothing(make_pair, cls, autopilot):
    pair = make_pair(cls, autopilot)
    await pair.vehicle.upload_mission(small_mission())
    pair.loses = old_acknowledgement(pair, 1)
    await pair.vehicle.clear_list(MissionType.MISSION)
    assert pair.asked.count("MISSION_CLEAR_ALL") == 2
    assert len(pair.simulated.missions.items) == 0


async def test_a_list_that_stays_is_not_called_cleared(make_pair):
    pair = make_pair(Px4Vehicle, Autopilot.PX4)
    await pair.vehicle.upload_mission(small_mission())
    pair.loses = old_acknowledgement(pair, 100)
    with pytest.raises(IncompleteError, match="still holds 6 items of its mission"):
        await pair.vehicle.clear_list(MissionType.MISSION)
    assert pair.vehicle._lists.idle, "nobody knows what it will hold"


@pytest.mark.parametrize(("cls", "autopilot"), BOTH)
@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((950_000_000, 0), r"item 2: its latitude of 95 deg is out of range \(-90 to 90\)"),
        ((0, -1_800_000_001), r"item 2: its longitude of -180 deg is out of range \(-180 to 180\)"),
    ],
)
async def test_places_that_are_nowhere_are_not_sent(make_pair, cls, autopilot, place, words):
    pair = make_pair(cls, autopilot)
    await pair.vehicle.upload_mission(small_mission())
    asked = len(pair.asked)
    for mission_type, command in ((MissionType.MISSION, 16), (MissionType.FENCE, 5001), (MissionType.RALLY, 5100)):
        items = list(small_mission().items[:2])
        items.append(MissionItem(2, 0, command, (4.0, 0.0, 0.0, 0.0), *place, 20.0))
        with pytest.raises(InputError, match=f"{mission_type.noun}, {words}"):
            if mission_type is MissionType.MISSION:
                await pair.vehicle.upload_mission(Mission(tuple(items)))
            else:
                await pair.vehicle.upload_list(items, mission_type)
    assert not [kind for kind in pair.asked[asked:] if kind.startswith(("MISSION", "FILE"))]
    assert len(pair.simulated.missions.items) == 6
    assert not pair.vehicle._lists.idle, "what it holds is still known"


def test_numbers_that_are_no_place_are_sent():
    items = [*small_mission().items, MissionItem(6, 2, 1000, (0.0,) * 4, 2_000_000_000, 2_000_000_000, 0.0)]
    check_places(items, MissionType.MISSION)


async def test_a_file_transfer_that_is_cancelled_is_not_done_by_the_protocol_instead(make_pair):
    pair = make_pair()

    class Impatient:
        def report(self, stage, fraction):
            raise OperationCancelled("enough")

    with pytest.raises(OperationCancelled):
        await pair.vehicle.upload_mission(mission(60), Impatient())
    assert "FILE_TRANSFER_PROTOCOL" in pair.asked
    assert "MISSION_COUNT" not in pair.asked


@pytest.mark.parametrize(("cls", "autopilot"), BOTH)
async def test_the_current_item_is_set_and_shown(make_pair, cls, autopilot):
    pair = make_pair(cls, autopilot)
    await pair.vehicle.upload_mission(small_mission())
    await pair.vehicle.set_current(3)
    assert pair.vehicle.telemetry.mission.value.current == 3
