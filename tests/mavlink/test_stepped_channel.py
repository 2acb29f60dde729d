"""Command sequences without an event loop: they wait, are resent, fail and are cancelled on fake time."""

from __future__ import annotations

import pytest

from gcs.core.errors import LinkError, RefusedError
from gcs.mavlink.autopilots.base import CommandCall
from gcs.mavlink.command_protocol import CommandExchange
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.stepped_channel import SteppedChannel, SteppedTask


class Time:
    def __init__(self):
        self.now, self.sent = 0.0, []
        self.channel = SteppedChannel((1, 1), (1, 191), self.sent.append, lambda: self.now)

    def exchange(self, command):
        return CommandExchange(
            CommandCall(command), target=(1, 1), sender=(1, 191), send=self.sent.append, clock=lambda: self.now
        )

    def pass_time(self, task, seconds):
        end = self.now + seconds
        while not task.finished and task.deadline <= end:
            self.now = max(self.now, task.deadline)
            task.on_time()
        self.now = end


def answer(command, result=0):
    packet = FramePacker(1, 1).pack(mavlink.MAVLink_command_ack_message(command, result, 0, 0, 1, 191))
    return FrameParser().feed(packet)[0]


@pytest.fixture
def time():
    return Time()


def test_one_exchange_after_the_other(time):
    done = []

    async def work():
        await time.channel.run(time.exchange(400))
        done.append(time.now)
        await time.channel.sleep(2.0)
        await time.channel.run(time.exchange(22))
        done.append(time.now)

    task = SteppedTask(work())
    assert [m.command for m in time.sent] == [400]
    task.handle(answer(400))
    time.pass_time(task, 2.1)
    assert [m.command for m in time.sent] == [400, 22]
    task.handle(answer(22))
    assert task.finished and task.error is None
    assert done == [0.0, pytest.approx(2.1)]


def test_what_fails_is_its_error(time):
    async def work():
        await time.channel.run(time.exchange(400))

    task = SteppedTask(work())
    task.handle(answer(400, result=2))
    assert isinstance(task.error, RefusedError)
    task = SteppedTask(work())
    time.pass_time(task, 10.0)
    assert isinstance(task.error, LinkError)
    assert sum(m.command == 400 for m in time.sent) == 1 + 6, "resent"


def test_a_wait_looks_often_and_ends_in_time(time):
    async def work():
        await time.channel.until(lambda: time.now >= 1.0, 5.0, "a second")

    task = SteppedTask(work())
    time.pass_time(task, 0.9)
    assert not task.finished
    time.pass_time(task, 0.2)
    assert task.finished and task.error is None

    async def in_vain():
        await time.channel.until(lambda: False, 3.0, "what never comes")

    task = SteppedTask(in_vain())
    time.pass_time(task, 4.0)
    assert "what never comes" in str(task.error)


def test_cancelled_from_outside_or_by_itself_nothing_more_is_sent(time):
    async def work():
        await time.channel.run(time.exchange(400))

    task = SteppedTask(work())
    task.cancel()
    time.pass_time(task, 5.0)
    assert task.finished and len(time.sent) == 1

    tasks = []

    async def cancels_itself():
        await time.channel.run(time.exchange(22))
        tasks[0].cancel()
        await time.channel.run(time.exchange(21))

    tasks.append(SteppedTask(cancels_itself()))
    tasks[0].handle(answer(22))
    assert tasks[0].finished
    tasks[0].handle(answer(21))
    time.pass_time(tasks[0], 5.0)
    assert sum(m.command == 21 for m in time.sent) <= 1
