"""The process that writes packets when they are due, for real: no threshold here depends on how fast the machine is."""

import os
import select
import signal
import socket
import subprocess
import sys
import time

import psutil
import pytest

from gcs.mavlink.link_base import Outlet
from gcs.mavlink.sender_process import SenderProcess

LONG_S = 30.0


class Far:
    """The other end of a datagram link."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(LONG_S)
        self.near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def outlet(self):
        return Outlet(lambda: os.dup(self.near.fileno()), self.socket.getsockname())

    def close(self):
        self.socket.close()
        self.near.close()

    def next(self):
        return self.socket.recv(100)

    def waiting(self):
        packets = []
        while select.select([self.socket], [], [], 0.0)[0]:
            packets.append(self.next())
        return packets


@pytest.fixture
def far():
    far = Far()
    yield far
    far.close()


@pytest.fixture
def sender(far):
    made = []

    def make(patience_s=LONG_S):
        sender = SenderProcess(patience_s)
        made.append(sender)
        while not sender.ready:
            sender.written(LONG_S)
        sender.use(far.outlet())
        return sender

    yield make
    for one in made:
        one.close()


def numbered(count, begin_s, step_s=0.01):
    return [(begin_s + step_s * k, b"%d" % k) for k in range(count)]


def test_packets_go_out_in_order_each_not_before_it_is_due_and_are_told_back(sender, far):
    process = sender()
    packets = numbered(20, time.monotonic() + 0.05)
    process.queue(packets[:10], replaces=False)
    process.queue(packets[10:], replaces=False)
    dues, heard = {packet: due for due, packet in packets}, []
    while not heard or heard[-1] != packets[-1][1]:
        heard.append(far.next())
        assert time.monotonic() >= dues[heard[-1]]
    assert heard == sorted(heard, key=int)
    assert [process.written(LONG_S) for _ in heard] == heard


def test_of_several_that_are_due_only_the_newest_goes_out(sender, far):
    process = sender()
    process.queue(numbered(5, time.monotonic() - 1.0), replaces=False)
    assert far.next() == b"4"
    process.halt()
    assert far.waiting() == []


def test_what_is_queued_gives_way_to_what_replaces_it(sender, far):
    process = sender()
    process.queue([(time.monotonic() + 0.5, b"old"), (time.monotonic() + LONG_S, b"older")], replaces=False)
    process.queue([(time.monotonic() + 0.6, b"new")], replaces=True)
    assert far.next() == b"new"


def test_what_went_out_before_it_was_replaced_does_not_go_out_twice(sender, far):
    process = sender()
    due = time.monotonic()
    process.queue([(due, b"first")], replaces=False)
    assert far.next() == b"first"
    process.queue([(due, b"first again"), (due + 0.01, b"second")], replaces=True)
    assert far.next() == b"second"


def test_nothing_goes_out_after_a_halt_also_of_what_was_queued(sender, far):
    process = sender()
    process.queue(numbered(2000, time.monotonic(), 0.001), replaces=False)
    far.next()
    process.halt()
    heard = 1 + len(far.waiting())
    told = []
    while packet := process.written():
        told.append(packet)
    assert len(told) == heard < 2000
    assert process.ended
    assert not process.stood_still
    process.queue([(time.monotonic(), b"late")], replaces=True)
    assert far.waiting() == []


def test_a_halt_of_a_process_that_does_not_obey(sender, far):
    process = sender()
    process.queue(numbered(2000, time.monotonic(), 0.001), replaces=False)
    far.next()
    os.kill(process._process.pid, signal.SIGSTOP)
    process.halt()
    assert process._process.poll() is not None
    far.waiting()
    assert far.waiting() == []


def test_a_process_that_stood_still_sends_nothing_of_what_is_over(sender, far):
    process = sender(patience_s=0.2)
    process.queue(numbered(30, time.monotonic() + 0.1), replaces=False)
    os.kill(process._process.pid, signal.SIGSTOP)
    time.sleep(0.1 + 0.3 + 0.3)
    before = far.waiting()
    os.kill(process._process.pid, signal.SIGCONT)
    while not process.ended:
        process.written(LONG_S)
    assert process.stood_still
    assert far.waiting() == []
    assert len(before) < 30


def test_it_ends_with_a_station_that_is_killed_whatever_is_queued(far):
    script = f"""
import os, socket, time
from gcs.mavlink.link_base import Outlet
from gcs.mavlink.sender_process import SenderProcess
near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
process = SenderProcess({LONG_S})
while not process.ready:
    process.written(1.0)
process.use(Outlet(lambda: os.dup(near.fileno()), {far.socket.getsockname()}))
begin = time.monotonic()
process.queue([(begin + 0.01 * k, b"x") for k in range(2000)], replaces=False)
print(process._process.pid, flush=True)
time.sleep({LONG_S})
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as station:
        child = psutil.Process(int(station.stdout.readline()))
        far.next()
        station.kill()
    psutil.wait_procs([child], timeout=LONG_S)
    assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE
    far.waiting()
    assert far.waiting() == []


@pytest.mark.parametrize("kind", ["stream", "terminal"])
def test_links_with_one_other_end_are_written_to_by_their_descriptor(sender, kind):
    if kind == "stream":
        near, other = socket.socketpair()
        ends = near.detach(), other.detach()
    else:
        ends = os.openpty()[::-1]
    process = sender()
    process.use(Outlet(lambda: os.dup(ends[0]), None))
    process.queue([(time.monotonic(), b"to a device\n")], replaces=False)
    assert select.select([ends[1]], [], [], LONG_S)[0]
    assert os.read(ends[1], 100).strip() == b"to a device"
    for descriptor in ends:
        os.close(descriptor)


def test_a_link_that_is_gone_is_let_go_of(sender):
    process = sender()
    near, other = socket.socketpair()
    process.use(Outlet(lambda: os.dup(near.fileno()), None))
    near.close()
    process.use(None)
    other.settimeout(LONG_S)
    assert other.recv(10) == b"", "the last one to hold it has closed it"
    other.close()
    process.queue([(time.monotonic(), b"nowhere")], replaces=False)
    process.halt()
    assert process.written() is None
    assert not process.stood_still
