import asyncio
import threading
import time

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.mavlink.events import OffboardEnd
from gcs.mavlink.offboard import OffboardSession, Setpoint, SetpointStream, setpoint_message

HERE = Setpoint.hover(np.array([1.0, 2.0, 3.0]), 0.5)


class Bench:
    def __init__(self, source=lambda t: HERE, deadman_s=0.5):
        self.now = 10.0
        self.sent = []
        self.stream = SetpointStream(
            target=(1, 1), send=self.sent.append, clock=lambda: self.now, deadman_s=deadman_s, source=source
        )


def test_axes_and_fields_of_the_message():
    setpoint = Setpoint(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), np.array([7.0, 8.0, 9.0]), 0.0)
    m = setpoint_message(setpoint, 12.5, (3, 1))
    assert (m.x, m.y, m.z) == (2.0, 1.0, -3.0)
    assert (m.vx, m.vy, m.vz) == (5.0, 4.0, -6.0)
    assert (m.afx, m.afy, m.afz) == (8.0, 7.0, -9.0)
    assert m.yaw == pytest.approx(np.pi / 2), "facing east is a heading of 90 degrees"
    assert m.type_mask == 0b1000_0000_0000, "all is used but the yaw rate; the force flag is not set"
    assert (m.coordinate_frame, m.time_boot_ms, m.target_system) == (1, 12500, 3)


def test_it_sends_what_the_source_says_for_the_vehicles_time():
    asked = []
    bench = Bench(lambda t: asked.append(t) or HERE)
    assert bench.stream.step(33.0)
    assert asked == [33.0]
    assert len(bench.sent) == 1


@pytest.mark.parametrize("end", [OffboardEnd.MODE_CHANGED, OffboardEnd.LINK_LOST, OffboardEnd.DISARMED])
def test_no_setpoint_follows_its_end(end):
    bench = Bench()
    bench.stream.step(1.0)
    bench.stream.stop(end)
    for _ in range(10):
        assert not bench.stream.step(2.0)
    bench.stream.feed()
    assert not bench.stream.step(2.0)
    assert len(bench.sent) == 1
    assert bench.stream.end == (end, end.value)


def test_a_process_that_stood_still_does_not_go_on_even_when_it_is_fed_first():
    bench = Bench()
    bench.stream.step(1.0)
    bench.now += 3.0
    bench.stream.feed()
    assert not bench.stream.step(4.0)
    assert len(bench.sent) == 1
    assert bench.stream.end == (OffboardEnd.DEADMAN, "it was interrupted for 3.0 s")


def test_a_setpoint_that_was_on_its_way_when_the_process_stood_still_is_not_sent():
    def source(vehicle_s):
        bench.now += 3.0
        bench.stream.feed()
        return HERE

    bench = Bench(source)
    assert not bench.stream.step(1.0)
    assert bench.sent == []
    assert bench.stream.end == (OffboardEnd.DEADMAN, "it was interrupted for 3.0 s")


def test_an_end_while_the_source_is_being_asked_stops_that_setpoint_too():
    bench = Bench(lambda t: bench.stream.stop(OffboardEnd.MODE_CHANGED) and HERE)
    assert not bench.stream.step(1.0)
    assert bench.sent == []
    assert bench.stream.end[0] is OffboardEnd.MODE_CHANGED


def test_the_dead_mans_switch():
    bench = Bench(deadman_s=0.5)
    bench.now += 0.4
    assert bench.stream.step(1.0)
    bench.stream.feed()
    bench.now += 0.5
    assert bench.stream.step(1.0)
    bench.now += 0.01
    assert not bench.stream.step(1.0)
    assert bench.stream.end[0] is OffboardEnd.DEADMAN
    bench.stream.feed()
    assert not bench.stream.step(1.0), "feeding a dead stream does not revive it"


def test_the_first_end_is_the_one_that_is_told():
    bench = Bench()
    assert bench.stream.stop(OffboardEnd.MODE_CHANGED, "went into POSCTL")
    assert not bench.stream.stop(OffboardEnd.STOPPED)
    assert bench.stream.end == (OffboardEnd.MODE_CHANGED, "went into POSCTL")


def test_a_source_that_ends_or_fails_ends_the_stream():
    finished = Bench(lambda t: None)
    assert not finished.stream.step(1.0)
    assert finished.stream.end[0] is OffboardEnd.FINISHED

    def broken(t):
        raise InputError("no such time")

    failed = Bench(broken)
    assert not failed.stream.step(1.0)
    assert failed.stream.end[0] is OffboardEnd.SOURCE_FAILED
    assert "no such time" in failed.stream.end[1]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_never_sent(bad):
    bench = Bench(lambda t: Setpoint.hover(np.array([0.0, bad, 1.0]), 0.0))
    assert not bench.stream.step(1.0)
    assert bench.sent == []


def test_the_source_can_be_changed():
    bench = Bench()
    bench.stream.step(1.0)
    bench.stream.follow(lambda t: Setpoint.hover(np.array([9.0, 0.0, 0.0]), 0.0))
    bench.stream.step(1.0)
    assert [m.y for m in bench.sent] == [1.0, 9.0]


def make_session(sent, *, rate_hz=50.0, clock_rate=1.0, deadman_s=0.5):
    ended = threading.Event()
    stream = SetpointStream(
        target=(1, 1), send=sent.append, clock=time.monotonic, deadman_s=deadman_s, source=lambda t: HERE
    )

    async def leave(session):
        session.halt(OffboardEnd.STOPPED)

    session = OffboardSession(
        "test",
        stream,
        clock=time.monotonic,
        vehicle_now=time.monotonic,
        clock_rate=lambda: clock_rate,
        rate_hz=rate_hz,
        on_end=lambda _: ended.set(),
        leave=leave,
    )
    return session, ended


def test_the_thread_stops_without_food_and_says_so():
    sent = []
    session, ended = make_session(sent, deadman_s=0.1)
    session.start()
    assert ended.wait(5.0)
    session.join(5.0)
    assert session.end[0] is OffboardEnd.DEADMAN
    assert not session.active
    assert session.setpoints_sent == len(sent) > 0


async def test_halt_from_another_thread_is_final():
    sent = []
    session, ended = make_session(sent, rate_hz=400.0, deadman_s=5.0)
    session.start()
    await asyncio.sleep(0.05)
    session.halt(OffboardEnd.MODE_CHANGED)
    count = len(sent)
    assert ended.wait(5.0)
    session.join(5.0)
    assert len(sent) == count
    await session.stop()
    assert session.end[0] is OffboardEnd.MODE_CHANGED
