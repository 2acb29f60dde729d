"""Faults of links, and the control port's commands, without waiting for anything."""

import json
import socket
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl_mocks.channel import FaultyPipe, LinkFaults
from sitl_mocks.command_line import main
from sitl_mocks.simulator import Simulator, SimulatorOptions


def passed(faults, seed=1, n=2000):
    out = []
    pipe = FaultyPipe(out.append, faults, seed)
    for i in range(n):
        pipe.put(b"%d" % i, 0.0)
    return out, pipe


def test_loss_is_as_asked_and_reproducible():
    out, _ = passed(LinkFaults(loss=0.1))
    assert 1740 < len(out) < 1860
    assert out == passed(LinkFaults(loss=0.1))[0]
    assert out != passed(LinkFaults(loss=0.1), seed=2)[0]
    assert passed(LinkFaults())[0] == [b"%d" % i for i in range(2000)]
    assert passed(LinkFaults(cut=True))[0] == []


def test_duplicates():
    out, _ = passed(LinkFaults(duplicate=0.5))
    assert 2900 < len(out) < 3100


def test_delays_let_packets_overtake_each_other():
    out, pipe = passed(LinkFaults(delay_s=1.0))
    assert out == []
    pipe.release(0.5)
    half = len(out)
    assert 850 < half < 1150
    pipe.release(1.0)
    assert len(out) == 2000
    assert out != sorted(out, key=int)


@pytest.fixture
def simulator():
    clock = [0.0]
    sim = Simulator(SimulatorOptions(port=9, control_port=0, tcp_base=0), lambda: clock[0])
    sim.open()

    def advance(seconds):
        for _ in range(round(seconds / 0.02)):
            clock[0] += 0.02
            sim.step(0.02, clock[0])

    sim.advance = advance
    yield sim
    sim.close()


def test_control_commands(simulator):
    simulator.advance(3.0)
    state = simulator.command(None, "state", [])
    assert (state["armed"], state["mode"], state["gone"]) == (False, "AUTO.LOITER", False)
    assert state["position_m"] == pytest.approx([-20.0, -20.0, 0.0], abs=0.01)
    simulator.command(1, "mode", ["posctl"])
    assert simulator.command(1, "state", [])["mode"] == "POSCTL"
    simulator.command(1, "battery", ["0.5"])
    assert simulator.command(1, "state", [])["battery"] == pytest.approx(0.5, abs=0.01)
    simulator.command(1, "param", ["NAV_DLL_ACT", "0"])
    boot = simulator.command(1, "state", [])["replan"]["boot_id"]
    simulator.command(1, "reboot", [])
    simulator.advance(0.1)
    state = simulator.command(1, "state", [])
    assert state["time_s"] < 0.5
    assert state["replan"]["boot_id"] != boot
    simulator.command(1, "vanish", [])
    simulator.advance(1.0)
    assert simulator.command(1, "state", [])["time_s"] == state["time_s"]
    for bad in (("nonsense", []), ("mode", ["NOPE"]), ("loss", ["x"])):
        with pytest.raises(ValueError, match=r"\w"):
            simulator.command(1, *bad)
    with pytest.raises(ValueError, match="no vehicle 7"):
        simulator.command(7, "state", [])


def test_the_control_port_answers_in_json(simulator):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        client.settimeout(5.0)
        for line, ok in ((b"1 state", True), (b"loss 0.2", True), (b"mode", False), (b"", False), (b"9 state", False)):
            client.sendto(line, ("127.0.0.1", simulator._control.port))
            simulator._control.read()
            answer = json.loads(client.recv(65535))
            assert answer["ok"] is ok
            assert ok or answer["error"]


def test_a_taken_tcp_port_is_told_in_one_line(capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["--autopilot", "ardupilot", "--port", "9", "--tcp-base", str(port)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(port) in error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--param", "NOPE=1"], "NOPE"),
        (["--param", "NAV_DLL_ACT"], "NAME=VALUE"),
        (["--home", "1,2"], "--home"),
        (["--speedup", "0"], "--speedup"),
        (["--count", "0"], "--count"),
        (["--loss", "2"], "--loss"),
        (["--structure", "no-such-file.ply"], "no-such-file.ply"),
        (["--uid", "xyz"], "--uid"),
        (["--tcp-base", "many"], "--tcp-base"),
        (["--wind", "1"], "--wind"),
    ],
)
def test_bad_arguments_get_one_clear_line(capsys, arguments, words):
    assert main(["--port", "9", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert words in error


def test_tcp_serves_several_stations(make_ground):
    clock = [0.0]
    sim = Simulator(SimulatorOptions(autopilot="ardupilot", port=9, tcp_base=0), lambda: clock[0])
    line = sim.open()[0]
    port = int(line.rsplit(":", 1)[1])
    try:
        clients = [socket.create_connection(("127.0.0.1", port)) for _ in range(2)]
        parsers = [mavlink.MAVLink(None) for _ in clients]
        heard = [[], []]
        for _ in range(200):
            clock[0] += 0.02
            for key, _ in sim._selector.select(0.0):
                key.data()
            sim.step(0.02, clock[0])
        for client, parser, messages in zip(clients, parsers, heard, strict=True):
            client.settimeout(5.0)
            messages.extend(parser.parse_buffer(client.recv(65535)) or [])
            client.close()
        assert all(any(m.get_type() == "HEARTBEAT" for m in messages) for messages in heard)
        for _ in range(5):
            for key, _ in sim._selector.select(0.1):
                key.data()
            sim.step(0.02, clock[0])
        assert len(sim._members[1].links) == 1  # closed connections are dropped
    finally:
        sim.close()


def test_after_a_stall_each_packet_is_heard_at_the_time_it_came():
    clock = [0.0]
    sim = Simulator(SimulatorOptions(port=9, speedup=10.0), lambda: clock[0])
    sim.open()
    try:
        member = sim._members[1]
        heard = []
        member.vehicle.handle = lambda message, channel: heard.append(member.vehicle.time_s)
        sim._advance(1.0)
        start = member.vehicle.time_s
        packet = bytes(mavlink.MAVLink_ping_message(0, 0, 0, 0).pack(mavlink.MAVLink(None, 255, 190)))
        sim._arrivals = [(1.15, member.links[0], packet), (1.05, member.links[0], packet)]
        sim._deliver()
        sim._advance(1.19)
        assert heard == pytest.approx([start + 0.5, start + 1.5], abs=0.021)
        assert member.vehicle.time_s == pytest.approx(start + 1.9, abs=0.021)
        sim._advance(9.0)  # the vehicles' clocks slip after a very long stall
        assert member.vehicle.time_s == pytest.approx(start + 1.9 + 2.5, abs=0.021)
    finally:
        sim.close()


def test_a_packets_arrival_time_is_the_systems_not_the_readers(make_ground):
    from sitl_mocks.links import UdpLink

    now = [100.0]
    link = UdpLink(1, ("127.0.0.1", 9), LinkFaults(), 0, lambda m, c: None, lambda: now[0])
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"x", link.socket.getsockname())
        link.socket.settimeout(None)
        socket_ready = [b""]
        while not socket_ready[0]:
            socket_ready[0] = link.socket.recv(10, socket.MSG_PEEK)
        link.socket.setblocking(False)
        time.sleep(0.15)
        ((arrived, data),) = link.read()
        assert data == b"x"
        assert arrived <= 100.0 - 0.1
    finally:
        link.close()


def test_a_packet_takes_its_time_and_queues_for_a_slow_line():
    out, pipe = passed(LinkFaults(latency_s=0.5), n=10)
    assert (out, pipe.next_s) == ([], 0.5)
    pipe.release(0.5)
    assert len(out) == 10
    slow = LinkFaults(bytes_per_s=1000.0)
    heard = []
    pipe = FaultyPipe(lambda packet: heard.append(len(packet)), slow, 1)
    for _ in range(10):
        pipe.put(bytes(100), 0.0)
    pipe.release(0.55)
    assert len(heard) == 5
    pipe.put(bytes(100), 5.0)
    assert pipe.next_s == pytest.approx(0.6)
    pipe.release(5.05)
    assert len(heard) == 10, "the last one is on the line for 0.1 s"


def test_damage_flips_a_bit_or_cuts_the_end_off():
    packet = bytes(range(50))
    for faults, wrong in ((LinkFaults(corrupt=0.3), 600), (LinkFaults(shortened=0.3), 600)):
        out = []
        pipe = FaultyPipe(out.append, faults, 1)
        for _ in range(2000):
            pipe.put(packet, 0.0)
        damaged = [p for p in out if p != packet]
        assert wrong * 0.85 < len(damaged) < wrong * 1.15
        for p in damaged:
            if faults.corrupt:
                assert sum((a ^ b).bit_count() for a, b in zip(p, packet, strict=True)) == 1
            else:
                assert packet.startswith(p)
