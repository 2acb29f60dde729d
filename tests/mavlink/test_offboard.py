import socket
import threading
import time

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.mavlink.events import OffboardEnd
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.link_base import Outlet
from gcs.mavlink.offboard import AHEAD_S, COMPONENT, OffboardSession, Setpoint, SetpointStream, setpoint_message

HERE = Setpoint.hover(np.array([1.0, 2.0, 3.0]), 0.5)
RATE_HZ, PERIOD_S = 50.0, 0.02


def at(east_m):
    return Setpoint.hover(np.array([east_m, 0.0, 0.0]), 0.0)


class Bench:
    """A stream on fake time, and the queue that it fills."""

    def __init__(self, source=lambda t: HERE, deadman_s=0.5, vehicle_ahead_s=100.0):
        self.now = 10.0
        self.queue = []
        self.vehicle_ahead_s = vehicle_ahead_s
        self.stream = SetpointStream(target=(1, 1), clock=lambda: self.now, deadman_s=deadman_s, source=source)

    def top_up(self):
        """Whether it goes on."""
        batch = self.stream.next_batch(lambda s: s + self.vehicle_ahead_s, RATE_HZ)
        if batch.replaces:
            self.queue = [entry for entry in self.queue if entry[0] <= self.now]
        self.queue += batch.messages
        return self.stream.end is None

    def run(self, seconds, step_s=0.03, *, feed=True):
        end = self.now + seconds
        while self.now < end:
            self.now += step_s
            if feed:
                self.stream.feed()
            self.top_up()

    @property
    def dues(self):
        return [due for due, _ in self.queue]


def test_axes_and_fields_of_the_message():
    setpoint = Setpoint(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), np.array([7.0, 8.0, 9.0]), 0.0)
    m = setpoint_message(setpoint, 12.5, (3, 1))
    assert (m.x, m.y, m.z) == (2.0, 1.0, -3.0)
    assert (m.vx, m.vy, m.vz) == (5.0, 4.0, -6.0)
    assert (m.afx, m.afy, m.afz) == (8.0, 7.0, -9.0)
    assert m.yaw == pytest.approx(np.pi / 2), "facing east is a heading of 90 degrees"
    assert m.type_mask == 0b1000_0000_0000, "all is used but the yaw rate; the force flag is not set"
    assert (m.coordinate_frame, m.time_boot_ms, m.target_system) == (1, 12500, 3)


def test_setpoints_are_queued_evenly_a_little_ahead_each_for_the_vehicles_time_when_it_is_due():
    asked = []
    bench = Bench(lambda t: asked.append(t) or HERE)
    bench.top_up()
    assert bench.dues[0] == 10.0
    assert AHEAD_S - PERIOD_S < bench.dues[-1] - bench.now <= AHEAD_S
    bench.run(2.0)
    assert np.diff(bench.dues) == pytest.approx(PERIOD_S)
    assert asked == [due + 100.0 for due in bench.dues]
    assert [m.time_boot_ms for _, m in bench.queue] == [int(1e3 * t) for t in asked]
    assert bench.dues[-1] - bench.now <= AHEAD_S


def test_after_a_stall_that_emptied_the_queue_it_goes_on_in_step_and_not_in_the_past():
    bench = Bench()
    bench.top_up()
    before = bench.dues[-1]
    bench.now += 0.405
    bench.stream.feed()
    assert bench.top_up()
    first = bench.dues[bench.dues.index(before) + 1]
    assert bench.now < first <= bench.now + PERIOD_S
    assert (first - before) / PERIOD_S == pytest.approx(round((first - before) / PERIOD_S))


def test_a_new_source_takes_the_place_of_what_is_queued_at_once_and_in_step():
    bench = Bench()
    bench.run(1.0)
    bench.stream.follow(lambda t: at(9.0))
    bench.top_up()
    assert np.diff(bench.dues) == pytest.approx(PERIOD_S)
    assert {m.y for due, m in bench.queue if due <= bench.now} == {1.0}
    assert {m.y for due, m in bench.queue if due > bench.now} == {9.0}


def test_no_setpoint_is_due_later_than_the_dead_mans_switch_allows():
    bench = Bench(deadman_s=0.1)
    bench.top_up()
    assert bench.dues[-1] == pytest.approx(10.1)
    bench.now += 0.06
    bench.stream.feed()
    bench.top_up()
    assert bench.dues[-1] == pytest.approx(10.16)
    bench.run(1.0, feed=False)
    assert bench.dues[-1] == pytest.approx(10.16)
    assert bench.stream.end == (OffboardEnd.DEADMAN, "its owner did not feed it for 0.1 s")
    bench.stream.feed()
    assert not bench.top_up(), "feeding a dead stream does not revive it"


@pytest.mark.parametrize("end", [OffboardEnd.MODE_CHANGED, OffboardEnd.LINK_LOST, OffboardEnd.DISARMED])
def test_nothing_is_queued_after_its_end(end):
    bench = Bench()
    bench.top_up()
    count = len(bench.queue)
    bench.stream.stop(end)
    bench.run(1.0)
    bench.stream.follow(lambda t: at(9.0))
    assert not bench.top_up()
    assert len(bench.queue) == count
    assert bench.stream.end == (end, end.value)


def test_a_process_that_stood_still_does_not_go_on_even_when_it_is_fed_first():
    bench = Bench()
    bench.top_up()
    count = len(bench.queue)
    bench.now += 3.0
    bench.stream.feed()
    assert not bench.top_up()
    assert len(bench.queue) == count
    assert bench.stream.end == (OffboardEnd.DEADMAN, "it was interrupted for 3.0 s")


def test_setpoints_that_were_on_their_way_when_the_process_stood_still_are_not_queued():
    def source(vehicle_s):
        bench.now += 3.0
        bench.stream.feed()
        return HERE

    bench = Bench(source)
    assert not bench.top_up()
    assert bench.queue == []
    assert bench.stream.end[0] is OffboardEnd.DEADMAN


def test_an_end_while_the_source_is_being_asked_stops_those_setpoints_too():
    bench = Bench(lambda t: bench.stream.stop(OffboardEnd.MODE_CHANGED) and HERE)
    assert not bench.top_up()
    assert bench.queue == []
    assert bench.stream.end[0] is OffboardEnd.MODE_CHANGED


def test_the_first_end_is_the_one_that_is_told():
    bench = Bench()
    assert bench.stream.stop(OffboardEnd.MODE_CHANGED, "went into POSCTL")
    assert not bench.stream.stop(OffboardEnd.STOPPED)
    assert bench.stream.end == (OffboardEnd.MODE_CHANGED, "went into POSCTL")


def test_a_source_that_ends_ends_the_stream_when_its_last_setpoint_has_gone_out():
    bench = Bench(lambda t: None if t >= 110.1 else HERE)
    assert bench.top_up()
    assert bench.dues[-1] == pytest.approx(10.08)
    bench.now = 10.09
    assert bench.top_up()
    bench.now = 10.1001
    assert not bench.top_up()
    assert bench.stream.end[0] is OffboardEnd.FINISHED
    assert len(bench.queue) == 5


def test_a_new_source_takes_over_from_one_that_is_about_to_end():
    bench = Bench(lambda t: None if t >= 110.1 else HERE)
    bench.top_up()
    bench.now = 10.15
    bench.stream.follow(lambda t: at(9.0))
    assert bench.top_up()
    assert bench.queue[-1][1].y == 9.0


@pytest.mark.parametrize("failing", ["source", "clock"])
def test_a_source_that_fails_ends_the_stream(failing):
    def broken(t):
        raise InputError("no such time")

    bench = Bench(broken if failing == "source" else lambda t: HERE)
    bench.stream.next_batch(broken if failing == "clock" else lambda s: s, RATE_HZ)
    assert bench.stream.end[0] is OffboardEnd.SOURCE_FAILED
    assert "no such time" in bench.stream.end[1]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_never_sent(bad):
    bench = Bench(lambda t: at(bad))
    assert not bench.top_up()
    assert bench.queue == []


class Vehicle:
    """A socket that setpoints go to, and the session that streams them."""

    def __init__(self, *, rate_hz=50.0, clock_rate=1.0, deadman_s=5.0):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(10.0)
        self.link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.outlet_now = Outlet(self.link.dup().detach, self.socket.getsockname())
        self.signed = []
        self.passed = []
        self.ended = threading.Event()
        self.session = OffboardSession(
            "test",
            SetpointStream(target=(7, 1), clock=time.monotonic, deadman_s=deadman_s, source=lambda t: HERE),
            own_system=255,
            peer=lambda: self,
            passed=self.passed.append,
            vehicle_at=lambda station_s: station_s,
            clock_rate=lambda: clock_rate,
            rate_hz=rate_hz,
            on_end=lambda _: self.ended.set(),
            leave=self.leave,
        )

    async def leave(self, session):
        session.halt(OffboardEnd.STOPPED)

    def outlet(self):
        return self.outlet_now

    def sign(self, packet, stream):
        self.signed.append(stream)
        return packet

    def heard(self):
        """All that is waiting."""
        self.socket.setblocking(False)
        packets = []
        while True:
            try:
                packets.append(self.socket.recv(512))
            except BlockingIOError:
                return packets

    def close(self):
        self.session.halt(OffboardEnd.STOPPED)
        self.session.join(10.0)
        self.socket.close()
        self.link.close()


@pytest.fixture
def vehicle():
    made = []

    def make(**options):
        made.append(Vehicle(**options))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_the_stream_stops_without_food_and_says_so(vehicle):
    bench = vehicle(deadman_s=0.5)
    bench.session.start()
    packets = [bench.socket.recv(512)]
    assert bench.ended.wait(10.0)
    bench.session.join(10.0)
    assert bench.session.end[0] is OffboardEnd.DEADMAN
    assert not bench.session.active
    packets += bench.heard()
    assert bench.session.setpoints_sent == len(packets)
    assert bench.passed == packets, "what is recorded is what went out"


async def test_halt_is_final(vehicle):
    bench = vehicle(rate_hz=400.0)
    bench.session.start()
    bench.socket.recv(512)
    bench.session.halt(OffboardEnd.MODE_CHANGED)
    packets = [b"", *bench.heard()]
    assert bench.session.setpoints_sent == len(packets)
    assert bench.ended.wait(10.0)
    bench.session.join(10.0)
    assert bench.heard() == []
    assert len(bench.passed) == len(packets)
    await bench.session.stop()
    assert bench.session.end[0] is OffboardEnd.MODE_CHANGED


def test_setpoints_are_numbered_and_signed_as_a_stream_of_their_own(vehicle):
    bench = vehicle()
    bench.session.start()
    messages = [message for _ in range(10) for message in FrameParser().feed(bench.socket.recv(512))]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(255, COMPONENT)}
    assert [m.get_seq() for m in messages] == sorted(m.get_seq() for m in messages)
    assert set(bench.signed) == {7}, "by the vehicle: one that does not hear another's packets misses none"


def test_the_stream_goes_on_when_the_link_comes_back_and_never_where_it_went_before(vehicle):
    bench = vehicle()
    bench.session.start()
    bench.socket.recv(512)
    bench.outlet_now = None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.settimeout(10.0)
        bench.outlet_now = Outlet(bench.link.dup().detach, other.getsockname())
        other.recv(512)
        bench.heard()
        for _ in range(5):
            other.recv(512)
        assert bench.heard() == []
        bench.session.halt(OffboardEnd.STOPPED)


def test_a_sender_that_dies_ends_the_stream(vehicle):
    bench = vehicle()
    bench.session.start()
    bench.socket.recv(512)
    bench.session._sender._process.kill()
    assert bench.ended.wait(10.0)
    assert bench.session.end[0] is OffboardEnd.SOURCE_FAILED


def test_halting_what_has_ended_changes_nothing(vehicle):
    bench = vehicle(deadman_s=0.1)
    bench.session.start()
    assert bench.ended.wait(10.0)
    bench.session.halt(OffboardEnd.STOPPED)
    assert bench.session.end[0] is OffboardEnd.DEADMAN
