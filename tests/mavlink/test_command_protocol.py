import asyncio
import math
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from gcs.core.errors import LinkError, OperationCancelled, RefusedError
from gcs.mavlink.autopilots.base import CommandCall
from gcs.mavlink.command_cancel import CommandCancel
from gcs.mavlink.command_protocol import ATTEMPTS, CommandExchange, CommandRefusedError, ModeSwitch
from gcs.mavlink.vehicle_channel import VehicleChannel

ARM = CommandCall(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0, 0.0))
HOLD = 4 << 16 | 3 << 24


class Bench:
    """A transaction with its clock and what it sent."""

    def __init__(self, kind=CommandExchange, **options):
        self.now = 50.0
        self.sent = []
        options.setdefault("call", ARM)
        self.t = kind(target=(1, 1), sender=(255, 190), send=self.sent.append, clock=lambda: self.now, **options)
        self.t.start()

    def hear(self, message, system=1, component=1):
        message._header.srcSystem, message._header.srcComponent = system, component
        self.t.handle(message)

    def ack(self, result, *, command=400, target=(255, 190), system=1, component=1, progress=0):
        self.hear(mavlink.MAVLink_command_ack_message(command, result, progress, 0, *target), system, component)

    def heartbeat(self, custom_mode, **source):
        self.hear(mavlink.MAVLink_heartbeat_message(2, 12, 29, custom_mode, 4, 3), **source)

    def wait(self, seconds):
        end = self.now + seconds
        while not self.t.finished and self.t.deadline <= end:
            self.now = max(self.now, self.t.deadline)
            self.t.on_time()
        self.now = end


def mode_bench(**options):
    return Bench(ModeSwitch, custom_mode=HOLD, call=CommandCall(176, (1.0, 4.0, 3.0)), **options)


def test_accepted():
    bench = Bench()
    bench.ack(0)
    assert bench.t.result() is None
    message = bench.sent[0]
    assert (message.target_system, message.target_component, message.command) == (1, 1, 400)
    assert (message.param1, message.param2, message.param7) == (1.0, 0.0, 0.0)


def test_it_is_sent_again_with_its_count_until_answered():
    bench = Bench()
    bench.wait(1.6)
    assert [m.confirmation for m in bench.sent] == [0, 1, 2]
    bench.ack(0)
    assert bench.t.finished


def test_nobody_answers():
    bench = Bench()
    bench.wait(60)
    assert len(bench.sent) == ATTEMPTS
    with pytest.raises(LinkError, match="ARM_DISARM"):
        bench.t.result()


@pytest.mark.parametrize("result", [1, 2, 3, 4, 6, 7, 8, 9, 77])
def test_every_other_result_is_a_refusal(result):
    bench = Bench()
    bench.ack(result)
    with pytest.raises(CommandRefusedError) as caught:
        bench.t.result()
    assert caught.value.result == result


def test_in_progress_prolongs_without_resending():
    bench = Bench()
    bench.ack(5)
    bench.wait(8.0)
    bench.ack(5)
    bench.wait(8.0)
    assert len(bench.sent) == 1
    bench.ack(0)
    assert bench.t.result() is None


def test_in_progress_that_never_ends_is_an_error():
    bench = Bench()
    bench.ack(5)
    bench.wait(30.0)
    with pytest.raises(LinkError, match="did not say"):
        bench.t.result()


@pytest.mark.parametrize(
    "other", [{"command": 22}, {"target": (254, 190)}, {"target": (255, 191)}, {"system": 2}, {"component": 100}]
)
def test_acknowledgements_of_others_do_not_count(other):
    bench = Bench()
    bench.ack(4, **other)
    assert not bench.t.finished


def test_an_acknowledgement_for_everybody_counts():
    bench = Bench()
    bench.ack(0, target=(0, 0))
    assert bench.t.finished


def test_nothing_is_sent_any_more_when_it_is_not_permitted():
    allowed = True

    def permit():
        if not allowed:
            raise RefusedError("the pilot flies")

    bench = Bench(permit=permit)
    allowed = False
    bench.wait(5)
    assert len(bench.sent) == 1
    with pytest.raises(RefusedError, match="pilot"):
        bench.t.result()


def test_a_mode_that_was_accepted_is_not_commanded_again_over_what_a_pilot_may_have_chosen_since():
    bench = mode_bench()
    bench.wait(1.0)
    before = len(bench.sent)
    assert before > 1, "until it is answered it is sent again"
    bench.ack(0, command=176)
    bench.wait(10.0)
    assert len(bench.sent) == before
    with pytest.raises(RefusedError, match="does not show"):
        bench.t.result()


def test_the_first_acknowledgement_of_px4_proves_no_mode():
    bench = mode_bench()
    bench.ack(0, command=176)
    assert not bench.t.finished
    bench.ack(1, command=176)
    with pytest.raises(RefusedError, match="not now"):
        bench.t.result()


def test_a_mode_is_reached_when_the_autopilots_heartbeat_shows_it():
    bench = mode_bench()
    bench.ack(0, command=176)
    bench.heartbeat(4 << 16 | 4 << 24)
    bench.heartbeat(HOLD, component=100)
    bench.heartbeat(HOLD, system=2)
    assert not bench.t.finished
    bench.heartbeat(HOLD)
    assert bench.t.result() is None


def test_a_mode_that_is_acknowledged_and_never_shown_is_refused_and_silence_is_no_link():
    shown_not = mode_bench()
    shown_not.ack(0, command=176)
    shown_not.wait(10)
    with pytest.raises(RefusedError, match="does not show"):
        shown_not.t.result()
    silent = mode_bench()
    silent.wait(10)
    assert len(silent.sent) > 3
    with pytest.raises(LinkError):
        silent.t.result()


def test_nan_parameters_stay_nan():
    bench = Bench(call=CommandCall(22, (math.nan, 0.0, 0.0, math.nan, math.nan, math.nan, 30.0)))
    assert math.isnan(bench.sent[0].param1)
    assert bench.sent[0].param7 == 30.0


def test_progress_is_told_with_the_share_where_the_vehicle_knows_it():
    told = []
    bench = Bench(on_progress=told.append)
    for percent in (0, 255, 20, 101, 75, 100):
        bench.ack(5, progress=percent)
    bench.ack(0)
    assert told == [None, None, 0.2, 0.2, 0.75, 1.0]
    assert bench.t.result() is None


def test_a_command_that_got_stuck_says_how_far_it_was():
    bench = Bench()
    bench.ack(5, progress=40)
    bench.wait(60)
    with pytest.raises(LinkError, match="40%"):
        bench.t.result()


def test_cancelling_what_is_in_progress_is_told_to_the_vehicle():
    bench = Bench()
    bench.ack(5)
    bench.t.cancel()
    bench.t.cancel()
    assert [m.get_type() for m in bench.sent] == ["COMMAND_LONG", "COMMAND_CANCEL"]
    cancel = bench.sent[-1]
    assert (cancel.target_system, cancel.target_component, cancel.command) == (1, 1, 400)
    bench.ack(6)
    with pytest.raises(OperationCancelled):
        bench.t.result()


def test_what_has_not_begun_needs_no_cancel_message():
    bench = Bench()
    bench.t.cancel()
    assert len(bench.sent) == 1
    with pytest.raises(OperationCancelled):
        bench.t.result()


def test_whoever_hears_the_progress_may_stop_it():
    def stop(_share):
        raise OperationCancelled("enough")

    bench = Bench(on_progress=stop)
    bench.ack(5, progress=10)
    assert bench.sent[-1].get_type() == "COMMAND_CANCEL"
    with pytest.raises(OperationCancelled):
        bench.t.result()


def test_the_cancel_message_is_that_of_the_protocol():
    raw = bytes(CommandCancel(1, 100, 2000).pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190)))
    assert raw[:10] == bytes([0xFD, 4, 0, 0, 0, 255, 190, 80, 0, 0])
    assert raw[10:14] == (2000).to_bytes(2, "little") + bytes([1, 100])
    described = x25crc(b"COMMAND_CANCEL uint16_t command uint8_t target_system uint8_t target_component ").crc
    extra = (described & 255) ^ (described >> 8)
    assert int.from_bytes(raw[14:], "little") == x25crc(raw[1:14] + bytes([extra])).crc


async def test_a_task_that_is_cancelled_lets_the_vehicle_know():
    sent = []
    channel = VehicleChannel((1, 1), (255, 190), sent.append, time.monotonic)
    command = CommandExchange(ARM, target=(1, 1), sender=(255, 190), send=sent.append, clock=time.monotonic)
    task = asyncio.create_task(channel.run(command))
    await asyncio.sleep(0)
    began = mavlink.MAVLink_command_ack_message(400, 5, 10, 0, 255, 190)
    began._header.srcSystem, began._header.srcComponent = 1, 1
    channel.publish(began)
    await asyncio.sleep(0.01)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert [m.get_type() for m in sent] == ["COMMAND_LONG", "COMMAND_CANCEL"]
