"""The image transmission protocol on fake time, over a bad link, against the simulated camera and against forgeries."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import GcsError, IncompleteError, LinkError, NotFoundError, OperationCancelled, RefusedError
from gcs.mavlink.image_transmission import RequestImage, TransmissionStep
from sitl_mocks.image_sender import ImageSender

STEP_S = 0.01


def picture(size, seed=1):
    return b"\xff\xd8\xff\xe0" + random.Random(seed).randbytes(size - 4)


class Camera:
    def __init__(self, clock) -> None:
        self.clock = clock
        self.newest = picture(60_000)
        self.sender = ImageSender(lambda: self.newest)
        self.put = lambda message, source=None: None
        self.deadline = math.inf
        self.requests = 0
        self.alter = lambda message: [message]

    def say(self, message) -> None:
        for altered in self.alter(message):
            self.put(altered, (1, 100))

    def hear(self, message) -> None:
        if message.get_type() == "DATA_TRANSMISSION_HANDSHAKE":
            self.requests += 1
            self.sender.handle(message, self.say, "station")
            self.deadline = self.clock() + STEP_S

    def on_time(self) -> None:
        self.sender.step()
        self.deadline = self.clock() + STEP_S if self.sender.busy else math.inf


@pytest.fixture
def make_camera(make_rig):
    return lambda **faults: make_rig(Camera, **faults)


def receive(rig, **options):
    request = RequestImage((1, 100), rig.send, rig.clock, **options)
    rig.drive(request)
    return request.result()


@pytest.mark.parametrize("size", [5, 252, 253, 254, 506, 60_000])
def test_every_size_on_a_clean_link(make_camera, size):
    rig = make_camera()
    rig.vehicle.newest = picture(size)
    got = receive(rig)
    assert (got.data, got.suffix, got.passes) == (picture(size), "jpg", 1)


def test_zeros_at_the_end_are_part_of_it(make_camera):
    rig = make_camera()
    rig.vehicle.newest = picture(1000) + bytes(300)
    assert receive(rig).data == rig.vehicle.newest


@pytest.mark.parametrize("loss", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("seed", range(5))
def test_gaps_are_found_and_asked_for_again(make_camera, loss, seed):
    rig = make_camera(seed=seed, loss=loss, double=0.1, jitter_s=0.03, corrupt=0.01)
    got = receive(rig)
    assert got.data == rig.vehicle.newest
    assert got.passes == 1 or rig.vehicle.requests >= got.passes


def test_a_doubled_packet_does_not_fill_a_hole(make_camera):
    rig = make_camera()
    state = {"lost": False}

    def lose_one_and_double_another(message):
        if message.get_type() == "ENCAPSULATED_DATA" and message.seqnr == 5 and not state["lost"]:
            state["lost"] = True
            return []
        return [message, message]

    rig.vehicle.alter = lose_one_and_double_another
    got = receive(rig)
    assert (got.data, got.passes) == (rig.vehicle.newest, 2)


PAYLOAD, PACKETS = 200, 40
HEAD = b"\xff\xd8\xff" + bytes(2 * PAYLOAD - 3)
OLD, NEW = (HEAD + bytes([each]) * (PAYLOAD * (PACKETS - 2)) for each in b"AB")


def after_passes(*passes):
    """The request after passes that brought these packets of pictures of one size."""
    now = [0.0]
    request = RequestImage((1, 100), lambda _: None, lambda: now[0])

    def say(message):
        message._header.srcSystem, message._header.srcComponent = 1, 100
        request.handle(message)

    request.start()
    for sent, numbers in passes:
        assert request.step is TransmissionStep.ASK
        say(mavlink.MAVLink_data_transmission_handshake_message(0, len(sent), 1, 1, PACKETS, PAYLOAD, 1))
        for n in numbers:
            say(mavlink.MAVLink_encapsulated_data_message(n, list(sent[n * PAYLOAD : (n + 1) * PAYLOAD].ljust(253))))
        while request.step is TransmissionStep.PASS:
            now[0] = request.deadline
            request.on_time()
    return request


EVEN, ODD, ALL = range(0, PACKETS, 2), range(1, PACKETS, 2), range(PACKETS)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (range(20), [0, 1, *range(20, 40)]),  # the same head, and each the half that the other lacks
        ([0, 1, *range(20, 40)], range(20)),
        ([0, 1, 2, 3, *range(4, 40, 2)], [*range(4), *range(5, 40, 2)]),
        (range(39), ALL[1:]),
        ([0, 1, *range(4, 40)], [0, 1, 2, 3]),  # half of what came is the same head
    ],
)
def test_a_newer_picture_of_the_same_size_is_never_mixed_with_the_older(first, second):
    request = after_passes((OLD, first), (NEW, second))
    assert not request.finished
    request = after_passes((OLD, first), (NEW, second), (NEW, ALL))
    assert request.result().data == NEW


def test_a_few_rows_that_are_the_same_do_not_join_two_pictures():
    black = bytes(PAYLOAD)
    old, new = OLD[:-PAYLOAD] + black, NEW[:-PAYLOAD] + black
    request = after_passes((old, [*range(20), 39]), (new, [0, 1, *range(20, 40)]), (new, ALL))
    assert request.result().data == new


@pytest.mark.parametrize("lost", [[39], [0], [7, 39], [38, 39], ODD[15:]])
def test_passes_of_one_picture_are_put_together(lost):
    came = [n for n in ALL if n not in lost]
    request = after_passes((OLD, came), (OLD, [n for n in ALL if n != 20]))
    assert (request.result().data, request.result().passes) == (OLD, 2)


def test_passes_without_anything_in_common_are_not_put_together():
    assert not after_passes((OLD, EVEN), (OLD, ODD)).finished


def test_a_newer_picture_of_another_size_begins_anew(make_camera):
    rig = make_camera(loss=0.1)
    hear = rig.vehicle.hear

    def take_another(message):
        hear(message)
        rig.vehicle.newest = picture(50_000, 3)

    rig.vehicle.hear = take_another
    assert receive(rig).data == picture(50_000, 3)


def test_no_picture(make_camera):
    rig = make_camera()
    rig.vehicle.newest = None
    with pytest.raises(NotFoundError):
        receive(rig)


def test_a_camera_that_does_not_know_the_protocol(make_camera):
    rig = make_camera()
    rig.vehicle.hear = lambda message: None
    with pytest.raises(LinkError, match="does not answer"):
        receive(rig)
    assert rig.clock.now - 100.0 < 10.0


def test_a_link_that_goes_in_the_middle(make_camera):
    rig = make_camera()
    rig.at.append((100.05, lambda: setattr(rig.vehicle, "alter", lambda message: [])))
    with pytest.raises(LinkError, match="in the middle"):
        receive(rig)


def test_a_packet_that_never_comes_is_no_picture(make_camera):
    rig = make_camera()
    rig.vehicle.alter = lambda m: [] if m.get_type() == "ENCAPSULATED_DATA" and m.seqnr == 7 else [m]
    with pytest.raises(IncompleteError, match="237 of 238"):
        receive(rig)


def test_what_is_no_picture_is_refused(make_camera):
    rig = make_camera()
    rig.vehicle.newest = bytes(1000)
    with pytest.raises(IncompleteError, match="jpg"):
        receive(rig)


def test_packets_of_others_are_ignored(make_camera):
    rig = make_camera()
    junk = mavlink.MAVLink_encapsulated_data_message(3, [0] * 253)

    def others(message):
        rig.down.put(junk, (1, 101))
        rig.down.put(junk, (2, 100))
        return [message]

    rig.vehicle.alter = others
    assert receive(rig).data == rig.vehicle.newest


@pytest.mark.parametrize(
    "fields",
    [
        (0, 2**32 - 1, 1, 1, 65535, 253, 80),
        (0, 1000, 1, 1, 65535, 253, 80),
        (0, 1000, 1, 1, 4, 0, 80),
        (0, 1000, 1, 1, 4, 255, 80),
        (3, 1000, 1, 1, 4, 253, 80),
        (99, 1000, 1, 1, 4, 253, 80),
    ],
)
def test_impossible_announcements_are_refused(make_camera, fields):
    rig = make_camera()
    forged = mavlink.MAVLink_data_transmission_handshake_message(*fields)
    rig.vehicle.alter = lambda m: [forged] if m.get_type() == "DATA_TRANSMISSION_HANDSHAKE" else [m]
    with pytest.raises(RefusedError):
        receive(rig)


def test_a_picture_that_is_too_large(make_camera):
    with pytest.raises(RefusedError, match="more than the 1000"):
        receive(make_camera(), max_bytes=1000)


def test_progress_is_told_and_can_cancel(make_camera):
    told = []

    def stop(done, total):
        told.append(done)
        if done > 20_000:
            raise OperationCancelled("enough")

    with pytest.raises(OperationCancelled):
        receive(make_camera(), on_progress=stop)
    assert told == sorted(told)


def test_cancel():
    request = RequestImage((1, 100), lambda _: None, lambda: 0.0)
    request.start()
    request.cancel()
    assert request.step is TransmissionStep.DONE
    with pytest.raises(OperationCancelled):
        request.result()


numbers = st.integers(0, 65535)


@settings(max_examples=200)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.integers(0, 255), st.integers(0, 2**32 - 1), numbers, st.integers(0, 255)),
            st.tuples(st.integers(0, 3), st.integers(0, 800), st.integers(0, 5), st.sampled_from([1, 200, 253])),
            numbers,
            st.integers(0, 5),
        ),
        max_size=30,
    )
)
def test_whatever_a_camera_says_ends_in_an_error_or_a_picture_of_the_announced_size(told):
    now = [0.0]
    request = RequestImage((1, 100), lambda _: None, lambda: now[0], max_bytes=100_000)
    request.start()
    sizes = set()
    for each in told:
        if isinstance(each, tuple):
            kind, size, packets, payload = each
            sizes.add(size)
            message = mavlink.MAVLink_data_transmission_handshake_message(kind, size, 1, 1, packets, payload, 1)
        else:
            message = mavlink.MAVLink_encapsulated_data_message(each, [255, 216, 255] + [1] * 250)
        message._header.srcSystem, message._header.srcComponent = 1, 100
        request.handle(message)
        now[0] = max(now[0], request.deadline if not request.finished and each == 0 else now[0])
        request.on_time() if not request.finished and now[0] >= request.deadline else None
    if request.finished:
        try:
            assert len(request.result().data) in sizes
        except GcsError:
            return
