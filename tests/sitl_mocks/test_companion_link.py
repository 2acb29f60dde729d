"""A companion of the vehicle's own system id: heard, obeyed, and put through to the station and back."""

import socket

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl_mocks.simulator import Simulator, SimulatorOptions

M = mavlink
COMPANION = 191


@pytest.fixture
def beside(either):
    """The ground side and its vehicle's companion."""
    companion = either.second(1, COMPANION)
    companion.channel.leads_to_companion = True
    return either, companion


def senders(ground, kind):
    return {(m.get_srcSystem(), m.get_srcComponent()) for m in ground.of(kind)}


def tunnel(system, component, text):
    return M.MAVLink_tunnel_message(system, component, 0x8247, len(text), list(text.ljust(128, b"\0")))


def texts(ground):
    return [bytes(m.payload[: m.payload_length]) for m in ground.of("TUNNEL")]


def test_heartbeats_pass_both_ways_and_never_back(beside):
    ground, companion = beside
    companion.heartbeat(M.MAV_TYPE_ONBOARD_CONTROLLER)
    ground.heartbeat()
    assert (1, COMPANION) in senders(ground, "HEARTBEAT")
    assert (255, 190) in senders(companion, "HEARTBEAT")
    assert (1, COMPANION) not in senders(companion, "HEARTBEAT")
    assert (255, 190) not in senders(ground, "HEARTBEAT")


def test_messages_find_their_target_and_nobody_else(beside):
    ground, companion = beside
    other = ground.second(254)
    for end in (ground, companion, other):
        end.heartbeat()
    companion.send(tunnel(255, 190, b"to the station"))
    companion.send(tunnel(0, 0, b"to all"))
    companion.send(tunnel(99, 0, b"to nobody here"))
    ground.send(tunnel(1, COMPANION, b"order"))
    ground.send(tunnel(1, 1, b"to the autopilot"))
    ground.send(tunnel(1, 0, b"to all of the vehicle"))
    assert texts(ground) == [b"to the station", b"to all"]
    assert texts(other) == [b"to all"]
    assert texts(companion) == [b"order", b"to all of the vehicle"]


def test_unknown_messages_are_dropped(beside):
    ground, companion = beside
    ground.heartbeat()
    before = len(ground.heard)
    packet = bytearray(M.MAVLink_heartbeat_message(18, 8, 0, 0, 0, 3).pack(M.MAVLink(None, 1, COMPANION)))
    packet[7:10] = (62470).to_bytes(3, "little")
    assert not list(companion.channel.receive(bytes(packet)))
    assert len(ground.heard) == before


def test_forwarded_packets_are_as_they_came(beside):
    ground, companion = beside
    ground.heartbeat()
    companion.send(tunnel(255, 190, b"whole"))
    (told,) = ground.of("TUNNEL")
    assert told.get_srcComponent() == COMPANION
    assert bytes(told.get_msgbuf())[-2:] != b"\0\0"


def test_the_companion_flies_the_vehicle_and_takes_pictures(beside):
    ground, companion = beside
    ground.in_air(8.0)
    vehicle = ground.vehicle
    start = vehicle.airframe.position_m
    target = (5.0, 0.0, -8.0)  # five metres north of the estimator's origin
    mode = 6 if vehicle.kind == "px4" else 4
    companion.setpoint(target)
    assert 0 in companion.set_mode(mode)
    for _ in range(400):
        companion.setpoint(target)
        ground.run(0.02)
    assert vehicle.airframe.position_m - start == pytest.approx(np.array([0.0, 5.0, 0.0]), abs=0.5)
    assert companion.command(M.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1, 1, component=100) == [0]
    assert ground.pictures + companion.pictures == 1
    # A command's answer goes to who gave it.
    assert not [m for m in ground.of("COMMAND_ACK") if m.command == M.MAV_CMD_IMAGE_START_CAPTURE]


def test_a_packet_of_the_vehicle_itself_is_not_taken(beside):
    ground, _ = beside
    echo = ground.second(1, 1)
    echo.command(M.MAV_CMD_DO_SET_MODE, 1, 4, 3)
    assert M.MAV_CMD_DO_SET_MODE not in ground.vehicle.counters.commands


def test_the_process_has_a_port_for_each_companion():
    listening = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    try:
        port = _neighbours(listening)
        simulator = Simulator(SimulatorOptions(port=9, tcp_base=None, count=2, companion_port=port))
        try:
            lines = simulator.open()
            simulator.step(1.0, 1.0)
            assert [f"companion udp -> 127.0.0.1:{port + i}" in lines[i] for i in range(2)] == [True, True]
            for i, sock in enumerate(listening):
                sock.settimeout(5.0)
                packet = sock.recv(300)
                assert packet[5] == i + 1  # the vehicle's system id
            assert simulator.command(1, "lidar", ["silent"]) == {}
            assert simulator.command(1, "state", [])["lidar"] == "silent"
            with pytest.raises(ValueError, match="tracking"):
                simulator.command(1, "odometry", ["lost"])
        finally:
            simulator.close()
    finally:
        for sock in listening:
            sock.close()


def _neighbours(sockets):
    """Bind to two ports that follow each other; returns the first."""
    for _ in range(50):
        sockets[0].bind(("127.0.0.1", 0))
        port = sockets[0].getsockname()[1]
        try:
            sockets[1].bind(("127.0.0.1", port + 1))
        except OSError:
            sockets[0].close()
            sockets[0] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            continue
        return port
    pytest.skip("no two neighbouring ports")
