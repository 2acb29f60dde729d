"""One vehicle over two links, and two vehicles under one id, with real packets."""

import asyncio
import socket
import sys
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import LinkError, RefusedError
from gcs.core.mission import Mission, MissionItem
from gcs.mavlink.events import IdClashEvent, StatusTextEvent
from gcs.mavlink.signing import LinkSigning, Verdict, new_key
from gcs.mavlink.station import MavlinkStation

HOST = "127.0.0.1"


def port_of(url):
    return int(url.rsplit(":", 1)[1])


class Leg(asyncio.DatagramProtocol):
    def __init__(self, router, port):
        self.router, self.port, self.cut, self.from_station = router, port, False, 0

    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, address):
        if not self.cut:
            self.from_station += 1
            self.router.to_vehicle(data)


class Router(asyncio.DatagramProtocol):
    """Stands between a vehicle and a station: all that the vehicle sends goes over every leg that is not cut."""

    async def start(self, *ports):
        loop = asyncio.get_running_loop()
        self.vehicle_at = None
        self.legs = []
        for port in ports:
            _, leg = await loop.create_datagram_endpoint(lambda port=port: Leg(self, port), local_addr=(HOST, 0))
            self.legs.append(leg)
        self.transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=(HOST, 0))
        self.port = self.transport.get_extra_info("sockname")[1]
        return self

    def datagram_received(self, data, address):
        self.vehicle_at = address
        for leg in self.legs:
            if not leg.cut:
                leg.transport.sendto(data, (HOST, leg.port))

    def to_vehicle(self, data):
        if self.vehicle_at is not None:
            self.transport.sendto(data, self.vehicle_at)

    def close(self):
        for each in (self, *self.legs):
            each.transport.close()


@pytest.fixture
async def router(station):
    ports = [port_of(await station.open(f"udpin:{HOST}:0")) for _ in range(2)]
    router = await Router().start(*ports)
    yield router
    router.close()


async def test_over_two_links_all_is_heard_once_and_a_cut_is_survived(station, router, make_vehicle):
    scripted = await make_vehicle(router.port)
    vehicle = await station.wait_for_vehicle(60.0)
    await vehicle.until(lambda: len(station.ways(vehicle)) == 2, 60.0, "both ways")
    await asyncio.sleep(0.5)
    async with vehicle.events() as events:
        for i in range(10):
            scripted.send(mavlink.MAVLink_statustext_message(6, f"text {i}".encode(), 0, 0))
        await asyncio.sleep(0.3)
        used = next(way for way in station.ways(vehicle) if way.used)
        leg = router.legs[[info.url for info in station.links].index(used.url)]
        leg.cut = True
        for i in range(10, 20):
            scripted.send(mavlink.MAVLink_statustext_message(6, f"text {i}".encode(), 0, 0))
        texts = []
        async with asyncio.timeout(60.0):
            while len(texts) < 20:
                event = await anext(events)
                texts += [event.status.text] if isinstance(event, StatusTextEvent) else []
    assert texts == [f"text {i}" for i in range(20)]
    await vehicle.arm()  # goes the other way, once the first has been silent
    assert scripted.armed
    assert next(way for way in station.ways(vehicle) if way.used).url != used.url
    assert vehicle.link_quality.loss < 0.05


async def test_two_vehicles_with_one_id_are_said_and_not_commanded(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    first = await make_vehicle(port_of(url))
    vehicle = await station.wait_for_vehicle(60.0)
    second = await make_vehicle(port_of(url))
    second.born -= 500.0
    async with vehicle.events() as events, asyncio.timeout(60.0):
        while not isinstance(event := await anext(events), IdClashEvent):
            pass
    assert "clocks" in event.reason
    assert vehicle.id_clash == event.reason

    def heard():
        """Whatever is more than a question."""
        kinds = ("HEARTBEAT", "TIMESYNC", "COMMAND_LONG")
        orders = [m for one in (first, second) for m in one.of("COMMAND_LONG") if m.command not in (511, 512)]
        return orders + [m for one in (first, second) for _, m in one.heard if m.get_type() not in kinds]

    mission = Mission((MissionItem(0, 5, 16, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 20.0, 1),))
    for attempt in (vehicle.arm(), vehicle.take_off(30.0), vehicle.upload_mission(mission), vehicle.pause()):
        with pytest.raises(RefusedError, match=r"px4-1: .*two vehicles use system id 1 \(clocks"):
            await attempt
    await asyncio.sleep(0.2)
    assert not heard()


async def test_a_vehicle_that_speaks_mavlink_1_is_heard_and_said(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    scripted = await make_vehicle(port_of(url))
    scripted.command = lambda message: None  # it does not understand what is sent to it

    def send_old(message):
        raw = message.pack(scripted.codec, force_mavlink1=True)
        scripted.codec.seq = (scripted.codec.seq + 1) % 256
        scripted.put(raw)

    scripted.send = send_old
    vehicle = await station.wait_for_vehicle(60.0)
    await vehicle.until(lambda: vehicle.telemetry.position is not None and vehicle.mavlink_version == 1, 60.0, "it")
    with pytest.raises(LinkError, match=r"does not answer.*set it to MAVLink 2"):
        await vehicle.arm()


@pytest.mark.system
@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_a_mission_transfer_survives_a_change_of_link(kind, tmp_path):
    station = MavlinkStation()
    ports = [port_of(await station.open(f"udpin:{HOST}:0")) for _ in range(2)]
    router = await Router().start(*ports)
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "sitl_mocks", "--autopilot", kind, "--port", str(router.port)),
        *("--tcp-base", "none", "--exit-with-parent"),
        stdout=asyncio.subprocess.DEVNULL,
    )
    try:
        vehicle = await station.wait_for_vehicle(60.0)
        await vehicle.until(lambda: vehicle.telemetry.home is not None, 60.0, "its home")
        items = [(16, 10.0)] if kind == "ardupilot" else []
        items += [(22, 20.0), *[(16, 20.0 + i) for i in range(60)]]
        mission = Mission(
            tuple(
                MissionItem(i, 5, command, (0.0,) * 4, 313622000 + 50 * i, 1216155000, up, int(i == 0))
                for i, (command, up) in enumerate(items)
            )
        )
        used = next(way for way in station.ways(vehicle) if way.used)
        leg = router.legs[[info.url for info in station.links].index(used.url)]
        before = leg.from_station
        upload = asyncio.ensure_future(vehicle.upload_mission(mission))
        async with asyncio.timeout(60.0):
            while leg.from_station < before + 5:  # noqa: ASYNC110 - in the midst of the items
                await asyncio.sleep(0)
        leg.cut = True
        assert not upload.done()
        await asyncio.wait_for(upload, 60.0)

        def other_way():
            return next(way for way in station.ways(vehicle) if way.used).url != used.url

        await vehicle.until(other_way, 60.0, "the other way")
    finally:
        router.close()
        await station.close_all()
        process.terminate()
        await asyncio.wait_for(process.wait(), 60.0)


@pytest.fixture
async def signed_vehicle():
    """A simulated vehicle that a router sends over two links; the first is open and signed, the second is not open."""
    station, key = MavlinkStation(), new_key()
    url = await station.open(f"udpin:{HOST}:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((HOST, 0))
        other = free.getsockname()[1]
    router = await Router().start(port_of(url), other)
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "sitl_mocks", "--autopilot", "px4", "--port", str(router.port)),
        *("--tcp-base", "none", "--exit-with-parent"),
        stdout=asyncio.subprocess.DEVNULL,
    )
    try:
        vehicle = await station.wait_for_vehicle(60.0)
        await vehicle.until(lambda: vehicle.telemetry.armed is not None, 60.0, "its state")
        assert (await station.set_up_signing(vehicle, url, LinkSigning(key))).proved
        yield SimpleNamespace(station=station, vehicle=vehicle, router=router, key=key, other=f"udpin:{HOST}:{other}")
    finally:
        router.close()
        await station.close_all()
        process.terminate()
        await asyncio.wait_for(process.wait(), 60.0)


@pytest.mark.system
async def test_a_signed_vehicle_on_two_links_with_its_key_is_heard_once_and_survives_a_cut(signed_vehicle):
    station, vehicle, router = signed_vehicle.station, signed_vehicle.vehicle, signed_vehicle.router
    await station.open(signed_vehicle.other, LinkSigning(signed_vehicle.key))

    def both_are_signed():
        statuses = [info.signing for info in station.links]
        return len(station.ways(vehicle)) == 2 and all(status.counts[Verdict.GOOD] > 50 for status in statuses)

    await vehicle.until(both_are_signed, 60.0, "signed packets on both links")
    assert [status.counts[Verdict.WRONG_KEY] for status in (info.signing for info in station.links)] == [0, 0]
    heard = []
    async with vehicle.messages() as messages:
        async with asyncio.timeout(60.0):
            while len(heard) < 100:
                heard.append((await anext(messages)).packet)
    assert len(set(heard)) > 90  # not 50; a machine that stalls for seconds lets a late copy through
    used = next(way for way in station.ways(vehicle) if way.used)
    router.legs[[info.url for info in station.links].index(used.url)].cut = True
    assert await vehicle.read_failsafes()
    assert next(way for way in station.ways(vehicle) if way.used).url != used.url


@pytest.mark.system
async def test_a_second_link_without_the_key_is_not_used_and_said(signed_vehicle, caplog):
    station, vehicle = signed_vehicle.station, signed_vehicle.vehicle
    await station.open(signed_vehicle.other)
    await vehicle.until(lambda: any("is not" in line for line in caplog.messages), 60.0, "the warning")
    assert len(station.ways(vehicle)) == 1
    assert [line for line in caplog.messages if "signed" in line] == [
        f"px4-1 is heard on {signed_vehicle.other} too, which is not used for it: another link to it is signed, "
        "this one is not"
    ]


async def test_what_goes_over_a_slow_signed_link_is_still_taken_after_what_went_over_a_fast_one():
    """The other end is pymavlink's: it keeps the newest time stamp of each link id, and refuses what is older."""
    key, station = new_key(), MavlinkStation()
    other = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    other.signing.secret_key, other.signing.sign_outgoing = key, True
    sent = {}
    for name in ("slow", "fast"):
        ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        ear.bind((HOST, 0))
        ear.settimeout(60.0)
        await station.open(f"udpout:{HOST}:{ear.getsockname()[1]}", LinkSigning(key))  # its first heartbeat goes out
        sent[name] = await asyncio.to_thread(ear.recv, 2048)
        ear.close()
    await station.close_all()
    assert [other.parse_char(sent[name]).get_type() for name in ("fast", "slow")] == ["HEARTBEAT"] * 2
    with pytest.raises(mavlink.MAVError, match="signature"):
        other.parse_char(sent["slow"])
