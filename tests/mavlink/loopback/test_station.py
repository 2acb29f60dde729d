import asyncio
import random
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import ConflictError, InputError, LinkError, NotFoundError
from gcs.core.vehicle import Autopilot
from gcs.mavlink.events import LinkBackEvent, LinkLostEvent, VehicleFoundEvent
from gcs.mavlink.framing import FrameParser

HOST = "127.0.0.1"


def port_of(url):
    return int(url.rsplit(":", 1)[1])


async def wait_until(holds, timeout_s=60.0):
    async with asyncio.timeout(timeout_s):
        while not holds():  # noqa: ASYNC110 - the scripted peers have no events to wait for
            await asyncio.sleep(0.01)


async def test_a_vehicle_is_found_and_answered_with_heartbeats_and_asked_for_messages(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    scripted = await make_vehicle(port_of(url), system_id=7)
    vehicle = await station.wait_for_vehicle(5.0, system_id=7)
    assert vehicle.identity.name == "px4-7"
    assert vehicle.identity.autopilot is Autopilot.PX4
    assert station.vehicle("px4-7") is vehicle is station.vehicle("7") is station.vehicles[7]
    await wait_until(lambda: vehicle.uid is not None)
    assert vehicle.uid == "0102030405060708090a0b0c"
    heartbeat = scripted.of("HEARTBEAT")[0]
    assert (heartbeat.type, heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (mavlink.MAV_TYPE_GCS, 255, 190)
    asked = {int(m.param1) for m in scripted.of("COMMAND_LONG") if m.command == 511}
    assert {0, 30, 32, 33, 24, 245, 42, 242} <= asked
    await wait_until(lambda: len(scripted.of("HEARTBEAT")) >= 3)
    beats = [at for at, m in scripted.heard if m.get_type() == "HEARTBEAT"]
    assert beats[-1] - beats[-2] < 3.0


async def test_stations_cameras_and_gimbals_are_no_vehicles(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for system, component, kind, autopilot in ((9, 1, 6, 8), (9, 100, 30, 8), (9, 154, 26, 8), (254, 190, 6, 0)):
            codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
            sock.sendto(
                mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3).pack(codec), (HOST, port_of(url))
            )
        await make_vehicle(port_of(url), system_id=3)
        await station.wait_for_vehicle(60.0)
    assert list(station.vehicles) == [3]


async def test_nobody_answers(station):
    url = await station.open(f"udpin:{HOST}:0")
    with pytest.raises(LinkError, match=url):
        await station.wait_for_vehicle(0.1)
    with pytest.raises(LinkError, match="none is open"):
        await station.close(url)
        await station.wait_for_vehicle(0.05)


async def test_a_port_that_is_taken_names_the_url(station):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOST, 0))
        url = f"udpin:{HOST}:{sock.getsockname()[1]}"
        with pytest.raises(LinkError) as caught:
            await station.open(url)
    assert caught.value.field == url
    assert "another port" in caught.value.message
    assert station.links == ()


async def test_refused_unknown_and_missing_places_are_link_errors(station, tmp_path):
    with socket.socket() as sock:
        sock.bind((HOST, 0))
        port = sock.getsockname()[1]
    for url in (f"tcp:{HOST}:{port}", "udpout:no-such-host.invalid:14550", f"serial:{tmp_path}/none:57600"):
        with pytest.raises(LinkError) as caught:
            await station.open(url)
        assert caught.value.field == url
    with pytest.raises(InputError):
        await station.open("wifi:home")


async def test_a_link_is_opened_once_and_closed(station):
    url = await station.open(f"udpin:{HOST}:0")
    with pytest.raises(ConflictError):
        await station.open(url)
    assert [info.url for info in station.links] == [url]
    await station.close(url)
    with pytest.raises(NotFoundError):
        await station.close(url)
    await station.open(url)


async def test_udpout_speaks_first(station):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOST, 0))
        sock.setblocking(False)
        await station.open(f"udpout:{HOST}:{sock.getsockname()[1]}")
        data, where = await asyncio.wait_for(asyncio.get_running_loop().sock_recvfrom(sock, 500), 60.0)
        assert [m.get_type() for m in FrameParser().feed(data)] == ["HEARTBEAT"]
        codec = mavlink.MAVLink(None, srcSystem=4, srcComponent=1)
        sock.sendto(mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 3, 3).pack(codec), where)
        vehicle = await station.wait_for_vehicle(60.0)
    assert vehicle.identity.name == "ardupilot-4"


async def test_tcp_and_its_reconnection(station):
    writers = []
    heard = FrameParser()
    kinds = []
    codec = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 3, 3).pack(codec)

    async def serve(reader, writer):
        writers.append(writer)
        writer.write(beat)
        while data := await reader.read(4096):
            kinds.extend(m.get_type() for m in heard.feed(data))
        writer.close()

    server = await asyncio.start_server(serve, HOST, 0)
    url = await station.open(f"tcp:{HOST}:{server.sockets[0].getsockname()[1]}")
    vehicle = await station.wait_for_vehicle(60.0)
    await wait_until(lambda: "HEARTBEAT" in kinds and "COMMAND_LONG" in kinds)
    writers[0].close()
    await wait_until(lambda: not station.links[0].up)
    await wait_until(lambda: not vehicle.connected)
    await wait_until(lambda: len(writers) == 2 and vehicle.connected)
    assert station.links[0].up
    await station.close(url)
    server.close()
    await server.wait_closed()


async def test_answers_go_to_the_address_a_vehicle_was_heard_on_each_with_its_own_numbers(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    one = await make_vehicle(port_of(url), system_id=1)
    two = await make_vehicle(port_of(url), system_id=2, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    for i in (1, 2):
        await station.wait_for_vehicle(5.0, system_id=i)
    await station.vehicles[2].arm()
    assert two.armed
    assert not one.armed
    assert not [m for m in one.of("COMMAND_LONG") if m.target_system == 2]
    for scripted in (one, two):
        numbers = [m.get_seq() for _, m in scripted.heard]
        assert numbers == [(numbers[0] + i) % 256 for i in range(len(numbers))]
    assert len(station.links[0].peers) == 2


async def test_a_second_peer_with_the_same_id_is_not_listened_to_while_the_first_lives(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    real = await make_vehicle(port_of(url))
    vehicle = await station.wait_for_vehicle(60.0)
    false = await make_vehicle(port_of(url))
    false.armed = True
    await asyncio.sleep(0.3)
    assert vehicle.telemetry.armed.value is False
    await vehicle.arm()
    assert real.armed
    assert not [m for m in false.of("COMMAND_LONG") if m.command == 400]


async def test_the_link_is_lost_and_comes_back_and_old_values_keep_their_times(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    scripted = await make_vehicle(port_of(url))
    vehicle = await station.wait_for_vehicle(60.0)
    await vehicle.until(lambda: vehicle.telemetry.position is not None, 60.0, "its position")
    async with vehicle.events() as events:
        scripted.silent = True

        async def next_of(kind):
            while True:
                event = await anext(events)
                if isinstance(event, kind):
                    return event

        lost = await asyncio.wait_for(next_of(LinkLostEvent), 60.0)
        assert lost.silent_s >= 0.6
        assert not vehicle.connected
        heard_at = vehicle.telemetry.position.at_s
        await asyncio.sleep(0.1)
        assert vehicle.telemetry.position.at_s == heard_at
        with pytest.raises(LinkError):
            await station.wait_for_vehicle(0.1)
        scripted.silent = False
        await asyncio.wait_for(next_of(LinkBackEvent), 60.0)
    assert vehicle.connected


async def test_another_flight_stack_under_the_same_id_is_a_new_vehicle(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    old = await make_vehicle(port_of(url))
    first = await station.wait_for_vehicle(60.0)
    await old.stop()
    await wait_until(lambda: not first.connected)
    async with station.events() as events:
        await make_vehicle(port_of(url), autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
        async with asyncio.timeout(60.0):
            async for event in events:
                if isinstance(event.event, VehicleFoundEvent):
                    break
    assert station.vehicles[1].identity.name == "ardupilot-1"


async def test_garbage_and_random_fields_from_the_same_peer_stop_nothing(station, make_vehicle, caplog):
    url = await station.open(f"udpin:{HOST}:0")
    scripted = await make_vehicle(port_of(url))
    vehicle = await station.wait_for_vehicle(60.0)
    rng = random.Random(5)
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for kind in mavlink.mavlink_map.values():
        if kind.msgname in ("HEARTBEAT", "COMMAND_ACK"):
            continue
        message = mavlink.MAVLink_message(kind.id, kind.msgname)
        for _ in range(3):
            scripted.put(message._pack(codec, kind.crc_extra, rng.randbytes(kind.unpacker.size)))
        scripted.put(rng.randbytes(rng.randrange(1, 400)))
        await asyncio.sleep(0)
    await asyncio.sleep(0.2)
    await vehicle.arm()
    assert scripted.armed
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


async def test_messages_per_second_and_link_quality(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    await make_vehicle(port_of(url))
    vehicle = await station.wait_for_vehicle(60.0)
    await wait_until(lambda: vehicle.link_quality.messages_per_s > 20)
    assert vehicle.link_quality.loss == pytest.approx(0.0, abs=0.05)
    await wait_until(lambda: vehicle.link_quality.round_trip_s is not None)
    assert vehicle.link_quality.round_trip_s > 0


async def test_every_packet_of_a_vehicle_is_told_both_ways_and_none_of_another(station, make_vehicle):
    url = await station.open(f"udpin:{HOST}:0")
    first = await make_vehicle(port_of(url), system_id=1)
    await make_vehicle(port_of(url), system_id=2)
    vehicle = await station.wait_for_vehicle(5.0, system_id=1)
    await station.wait_for_vehicle(5.0, system_id=2)
    packets = []
    heard_before = len(first.heard)
    vehicle.on_packet = lambda packet: packets.append(bytes(packet))
    await vehicle.arm()
    await wait_until(lambda: {"HEARTBEAT", "TIMESYNC"} <= {m.get_type() for _, m in first.heard[heard_before:]})
    vehicle.on_packet = None
    parser = FrameParser()
    passed = [message for packet in packets for message in parser.feed(packet)]
    sent = [m for m in passed if m.get_srcSystem() == 255]
    assert {m.get_srcSystem() for m in passed} == {1, 255}
    assert {"HEARTBEAT", "ATTITUDE", "COMMAND_ACK"} <= {m.get_type() for m in passed if m.get_srcSystem() == 1}
    heard = [bytes(m.get_msgbuf()) for _, m in first.heard[heard_before:]]
    assert set(heard) <= {bytes(m.get_msgbuf()) for m in sent}
