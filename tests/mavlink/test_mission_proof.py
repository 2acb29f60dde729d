"""Upload with proof, on fake time, against scripted vehicles of both dialects and every fault that we know of."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import GcsError, LinkError, OperationCancelled, RefusedError
from gcs.core.mission import Mission, MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_proof import MissionPeer, compare_with_vehicle, download, upload_and_prove
from gcs.mavlink.mission_protocol import UnknownStateError
from gcs.mavlink.mission_upload import MissionUpload, NoRoomError

DIALECTS = ["px4", "ardupilot"]


def mission(kind: str, count: int = 20) -> Mission:
    frame, action = (5, 2) if kind == "px4" else (0, 0)
    items = []
    for n in range(count):
        if n == 0:
            command = 22 if kind == "px4" else 16
            items.append(MissionItem(0, frame, command, (0, 0, 0, 0), 313622000, 1216155000, 14.0, current=1))
        elif n % 4 == 3:
            items.append(MissionItem(n, action, 93, (1.5 + n, -1.0, -1.0, -1.0), 0, 0, 0.0))
        else:
            params = (2.0, 0.7, 0.0, 33.3 * n % 360) if kind == "px4" else (2.0, 0.0, 0.0, 0.0)
            items.append(MissionItem(n, frame, 16, params, 313622000 + 17 * n, 1216155000 - n, 14.0 + 0.37 * n))
    return Mission(tuple(items))


def peer(rig, kind: str) -> MissionPeer:
    return MissionPeer(1, 1, Autopilot(kind), rig.send, rig.clock, rig.run, own_system=255)


def truly_held(rig, kind: str, wanted: Mission) -> bool:
    """Whether the vehicle's store is what a perfect transfer would have left in it."""
    vehicle = rig.vehicle
    if len(vehicle.store) != len(wanted.items):
        return False
    for k, (item, kept) in enumerate(zip(wanted.items, vehicle.store, strict=True)):
        if kind == "ardupilot" and k == 0:
            continue
        sent = type(kept)(
            item.frame, item.command, tuple(float(p) for p in item.params), item.x, item.y, item.z, item.autocontinue
        )
        expected = vehicle.stored(sent)
        if (expected.frame, expected.command, expected.x, expected.y) != (kept.frame, kept.command, kept.x, kept.y):
            return False
        if abs(expected.z - kept.z) > 0.0101:
            return False
        if any(abs(a - b) > 1e-3 for a, b in zip(expected.p, kept.p, strict=True)):
            return False
    return True


async def prove(rig, kind: str, wanted: Mission | None = None):
    return await upload_and_prove(wanted or mission(kind), peer(rig, kind))


@pytest.mark.parametrize("kind", DIALECTS)
async def test_clean_link(make_rig, kind):
    rig = make_rig(kind)
    proof = await prove(rig, kind)
    assert (proof.items_sent, proof.items_read) == (20, 20)
    assert truly_held(rig, kind, mission(kind))
    assert rig.clock.now - 100 < 3


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("loss", [0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("seed", range(8))
async def test_loss_doubling_and_reordering_both_ways(make_rig, kind, loss, seed):
    rig = make_rig(kind, seed=seed, loss=loss, double=0.1, jitter_s=0.08, delay_s=0.02)
    wanted = mission(kind, 40)
    proof = await prove(rig, kind, wanted)
    assert proof.items_read == 40
    assert truly_held(rig, kind, wanted)


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("seed", range(40))
async def test_random_faults_never_give_a_false_answer(make_rig, kind, seed):
    """Loss up to 60 %, jitter up to 1.5 s, reboots, lost acknowledgements: an answer may fail, but not lie."""
    import random

    rng = random.Random(1000 + seed)
    rig = make_rig(
        kind,
        seed=seed,
        loss=rng.choice([0, 0.2, 0.4, 0.6]),
        double=rng.choice([0, 0.5]),
        jitter_s=rng.choice([0, 0.3, 1.5]),
        corrupt=rng.choice([0, 0.1]),
    )
    if rng.random() < 0.4:
        rig.at.append((100 + rng.random() * 3, lambda: rig.vehicle.reboot(rng.random() * 4, keeps_store=False)))
    if rng.random() < 0.3:
        rig.vehicle.alter_out = lambda m: [] if m.get_type() == "MISSION_ACK" else [m]
    wanted = mission(kind)
    try:
        await prove(rig, kind, wanted)
    except GcsError as error:
        assert isinstance(error, LinkError | RefusedError)
    else:
        assert truly_held(rig, kind, wanted)


@pytest.mark.parametrize("kind", DIALECTS)
async def test_lost_final_acknowledgement_is_a_success(make_rig, kind):
    rig = make_rig(kind)
    rig.down.faults.drop = lambda m: m.get_type() == "MISSION_ACK"
    proof = await prove(rig, kind)
    assert "acknowledgement did not come" in proof.how
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
async def test_messages_about_another_list_or_from_another_component_are_ignored(make_rig, wire, kind):
    rig = make_rig(kind)

    def noisy(message):
        for source, mission_type in (((1, 1), 1), ((1, 100), 0), ((2, 1), 0)):
            for result in (0, 1, 3, 4, 15):
                rig.down.put(wire.MAVLink_mission_ack_message(255, 190, result, mission_type), source)
            rig.down.put(wire.MAVLink_mission_request_int_message(255, 190, 0, mission_type), source)
            rig.down.put(wire.MAVLink_mission_count_message(255, 190, 3, mission_type), source)
        rig.down.put(wire.MAVLink_mission_ack_message(254, 190, 4, 0))
        return [message]

    rig.vehicle.alter_out = noisy
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


async def test_invalid_sequence_is_not_the_end(make_rig):
    rig = make_rig("ardupilot", up={"double": 1.0, "jitter_s": 0.1})
    told = []
    rig.on_heard = lambda t, m: told.append(getattr(m, "type", None) if m.get_type() == "MISSION_ACK" else None)
    await prove(rig, "ardupilot")
    assert 13 in told
    assert truly_held(rig, "ardupilot", mission("ardupilot"))


@pytest.mark.parametrize("kind", DIALECTS)
async def test_every_packet_doubled(make_rig, kind):
    rig = make_rig(kind, double=1.0)
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("seed", range(4))
async def test_jitter_above_the_timeouts(make_rig, kind, seed):
    rig = make_rig(kind, seed=seed, jitter_s=1.0)
    await prove(rig, kind, mission(kind, 10))
    assert truly_held(rig, kind, mission(kind, 10))


async def test_request_storm_that_ends_is_survived(make_rig):
    rig = make_rig("px4")
    rig.vehicle.alter_out = lambda m: [m] * (200 if getattr(m, "seq", None) == 3 else 1)
    await prove(rig, "px4")
    assert truly_held(rig, "px4", mission("px4"))
    assert rig.up.sent < 400, "a storm is answered with a storm"


async def test_endless_requests_for_one_item_are_given_up(make_rig, wire):
    rig = make_rig("px4")
    rig.vehicle.ignore_in = lambda m: m.get_type() == "MISSION_ITEM_INT" and m.seq == 3
    rig.vehicle.before_in = lambda m: setattr(rig.vehicle, "heard_at", rig.clock())
    with pytest.raises(LinkError, match="unknown"):
        await prove(rig, "px4")
    assert rig.clock.now < 100 + 200


@pytest.mark.parametrize("kind", DIALECTS)
async def test_request_out_of_range_is_ignored(make_rig, wire, kind):
    rig = make_rig(kind)

    def with_nonsense(message):
        request = wire.MAVLink_mission_request_int_message(255, 190, 5000, 0)
        return [request, message] if "REQUEST" in message.get_type() else [message]

    rig.vehicle.alter_out = with_nonsense
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("lost", ["MISSION_REQUEST", "MISSION_ITEM_INT"])
async def test_a_lost_packet_costs_a_round_trip_or_two_and_not_the_vehicles_timeout(make_rig, kind, lost):
    clean = make_rig(kind, delay_s=0.025)
    await prove(clean, kind)
    rig = make_rig(kind, delay_s=0.025)
    gone = []

    def drop(message):
        hit = message.get_type().startswith(lost) and message.seq == 9 and not gone
        gone.extend([message] * hit)
        return hit

    (rig.up if lost == "MISSION_ITEM_INT" else rig.down).faults.drop = drop
    await prove(rig, kind)
    assert gone
    assert rig.clock.now - clean.clock.now < 0.15
    assert truly_held(rig, kind, mission(kind))


async def test_a_refusal_that_was_not_meant_for_the_last_item_is_settled_by_reading_back(make_rig, wire):
    rig = make_rig("px4")

    def stale(message):
        last = message.get_type() == "MISSION_REQUEST_INT" and message.seq == 19
        return [message, wire.MAVLink_mission_ack_message(255, 190, 4, 0)] if last else [message]

    rig.vehicle.alter_out = stale
    rig.up.faults.delay_s = 0.05
    proof = await prove(rig, "px4")
    assert "refused" in proof.how
    assert truly_held(rig, "px4", mission("px4"))


async def test_a_mission_that_cannot_be_read_back_is_of_unknown_state(make_rig, wire):
    rig = make_rig("ardupilot")
    rig.vehicle.alter_out = lambda m: (
        [wire.MAVLink_mission_ack_message(255, 190, 1, 0)] if m.get_type() == "MISSION_ITEM_INT" else [m]
    )
    with pytest.raises(UnknownStateError, match="unknown"):
        await prove(rig, "ardupilot")


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("after", [1, 7, 19])
async def test_vehicle_reboots_in_mid_transfer(make_rig, kind, after):
    rig = make_rig(kind)
    done = []

    def reboot_once(message):
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == after and not done:
            done.append(True)
            rig.vehicle.reboot(3.0, keeps_store=False)

    rig.vehicle.before_in = reboot_once
    await prove(rig, kind)
    assert done
    assert truly_held(rig, kind, mission(kind))


async def test_another_station_is_waited_for(make_rig, wire):
    rig = make_rig("ardupilot")
    other = wire.MAVLink_mission_count_message(1, 1, 5, 0)
    rig.up.put(other, source=(254, 190))
    rig.up.faults.delay_s = 0.05
    await prove(rig, "ardupilot")  # the other one sends nothing more and is cancelled after 8 s
    assert rig.clock.now > 107
    assert truly_held(rig, "ardupilot", mission("ardupilot"))


async def test_a_vehicle_that_stays_busy_refuses(make_rig):
    rig = make_rig("ardupilot")
    rig.vehicle.on_mission_count = lambda m: rig.vehicle.ack(14)
    with pytest.raises(RefusedError, match="another station"):
        await prove(rig, "ardupilot")
    assert rig.clock.now < 120


@pytest.mark.parametrize("kind", DIALECTS)
async def test_another_mission_written_after_the_acknowledgement_is_found_out(make_rig, kind):
    rig = make_rig(kind)
    spoiled = []

    def spoil(message):
        if message.get_type() == "MISSION_REQUEST_LIST" and len(spoiled) < 1:
            spoiled.append(True)
            rig.vehicle.store = rig.vehicle.store[:5]

    rig.vehicle.before_in = spoil
    proof = await prove(rig, kind)
    assert "2 attempts" in proof.how
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("takes_parts", [True, False])
async def test_items_that_came_out_wrong_are_replaced_one_by_one_where_the_autopilot_has_it(make_rig, takes_parts):
    rig = make_rig("ardupilot", loss=0.1)
    heard, spoiled = [], []

    def spoil(message):
        heard.append(message)
        if message.get_type() == "MISSION_REQUEST_LIST" and not spoiled:
            spoiled.append(True)
            rig.vehicle.store[7:9] = rig.vehicle.store[5], rig.vehicle.store[6]

    rig.vehicle.before_in = spoil
    if not takes_parts:
        rig.vehicle.on_mission_write_partial_list = lambda m: rig.vehicle.ack(1)
    proof = await prove(rig, "ardupilot")
    assert ("2 attempts" if takes_parts else "3 attempts") in proof.how
    assert truly_held(rig, "ardupilot", mission("ardupilot"))
    second = heard[next(i for i, m in enumerate(heard) if m.get_type() == "MISSION_WRITE_PARTIAL_LIST") :]
    sent = {m.seq for m in second if m.get_type() == "MISSION_ITEM_INT"}
    assert sent == ({7, 8} if takes_parts else set(range(20)))


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("fault", ["truncated", "mixed", "longer", "one altitude"])
async def test_a_vehicle_that_keeps_something_else_is_never_called_proved(make_rig, kind, fault):
    rig = make_rig(kind)

    def spoil(message):
        store = rig.vehicle.store
        if message.get_type() != "MISSION_REQUEST_LIST" or len(store) < 20:
            return
        if fault == "truncated":
            del store[-1]
        elif fault == "mixed":
            store[7] = store[6]
        elif fault == "longer":
            store.append(store[-1])
        else:
            store[9] = type(store[9])(**{**store[9].__dict__, "z": store[9].z + 0.05})

    rig.vehicle.before_in = spoil
    with pytest.raises(RefusedError, match="holds something else"):
        await prove(rig, kind)


@pytest.mark.parametrize("kind", DIALECTS)
async def test_too_many_items_are_refused_in_plain_words(make_rig, kind):
    rig = make_rig(kind, max_items=10)
    rig.vehicle.store = ["old"]
    with pytest.raises(RefusedError, match="no room") as caught:
        await prove(rig, kind)
    assert "20 items" in str(caught.value)
    assert rig.vehicle.store == ["old"]


async def test_what_the_vehicle_says_of_its_room_is_heard(make_rig):
    rig = make_rig("ardupilot", max_items=10)
    refuse = rig.vehicle.ack

    def ack(result):
        refuse(result)
        text = b"Only 10 items are supported" if result == 4 else b"Only eleven items are supported"
        rig.vehicle.say(mavlink.MAVLink_statustext_message(4, text))

    rig.vehicle.ack = ack
    with pytest.raises(NoRoomError, match="20 items; it stores 10") as caught:
        await prove(rig, "ardupilot")
    assert caught.value.capacity == 10


async def test_px4_does_not_say_how_much_room_it_has(make_rig):
    with pytest.raises(NoRoomError, match="20 items; usual boards store 500 to 700: split the plan") as caught:
        await prove(make_rig("px4", max_items=10), "px4")
    assert caught.value.capacity is None


async def test_no_space_in_mid_transfer_says_that_a_part_may_be_held(make_rig):
    rig = make_rig("ardupilot")

    def full(message):
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == 9:
            rig.vehicle.idle()
            rig.vehicle.ack(4)
            return True
        return False

    rig.vehicle.ignore_in = full
    with pytest.raises(RefusedError, match=r"asked for 10 of them.*read it back"):
        await prove(rig, "ardupilot")


async def test_no_space_of_a_vehicle_that_is_still_starting_is_waited_out(make_rig):
    rig = make_rig("ardupilot")
    rig.vehicle.max_items = 0
    rig.at.append((102.0, lambda: setattr(rig.vehicle, "max_items", 650)))
    await prove(rig, "ardupilot")
    assert truly_held(rig, "ardupilot", mission("ardupilot"))


@pytest.mark.parametrize("kind", DIALECTS)
async def test_unsupported_command_names_the_item(make_rig, kind):
    rig = make_rig(kind)
    rig.vehicle.unsupported = {93}
    with pytest.raises(RefusedError, match=r"item 3, command 93"):
        await prove(rig, kind)


def breaks_off(vehicle, result, times, at_item=3):
    """The vehicle answers an item by dropping the transfer with this result, so often."""
    left = [times]

    def breaks(message):
        if message.get_type() != "MISSION_ITEM_INT" or message.seq != at_item or left[0] == 0:
            return False
        left[0] -= 1
        vehicle.idle()
        vehicle.ack(result)
        return True

    return breaks


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize(
    ("result", "words"),
    [
        (2, r"it does not know the altitude frame \(item 3, command 93\)"),
        (10, r"the latitude \(or param5\) is invalid \(item 3, command 93\)"),
        (11, r"the longitude \(or param6\) is invalid \(item 3"),
    ],
)
async def test_what_is_wrong_with_an_item_is_said_in_words(make_rig, kind, result, words):
    rig = make_rig(kind)
    rig.vehicle.ignore_in = breaks_off(rig.vehicle, result, times=1)
    with pytest.raises(RefusedError, match=words):
        await prove(rig, kind)


@pytest.mark.parametrize("kind", DIALECTS)
async def test_a_vehicle_that_cancels_an_upload_is_sent_it_anew(make_rig, kind):
    rig = make_rig(kind)
    rig.vehicle.ignore_in = breaks_off(rig.vehicle, 15, times=2)
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
async def test_a_vehicle_that_always_cancels_is_given_up(make_rig, kind):
    rig = make_rig(kind)
    rig.vehicle.ignore_in = breaks_off(rig.vehicle, 15, times=1000)
    with pytest.raises(GcsError, match="again and again: it cancelled the transfer"):
        await prove(rig, kind)


@pytest.mark.parametrize("kind", DIALECTS)
async def test_link_gone_in_mid_upload_says_unknown(make_rig, kind):
    rig = make_rig(kind)
    rig.at.append((100.1, lambda: setattr(rig.up.faults, "loss", 1.0)))
    with pytest.raises(LinkError, match="what the vehicle holds now is unknown"):
        await prove(rig, kind)
    assert rig.clock.now < 100 + 150


@pytest.mark.parametrize("kind", DIALECTS)
async def test_link_gone_before_the_read_back_says_unknown(make_rig, kind):
    rig = make_rig(kind)
    rig.vehicle.ignore_in = lambda m: m.get_type() == "MISSION_REQUEST_LIST"
    with pytest.raises(LinkError, match=r"could not be read back.*unknown"):
        await prove(rig, kind)


async def test_a_silent_vehicle_is_a_link_error(make_rig):
    rig = make_rig("px4")
    rig.vehicle.ignore_in = lambda m: True
    with pytest.raises(LinkError, match="does not answer"):
        await prove(rig, "px4")
    assert rig.clock.now - 100 == pytest.approx(20.0, abs=2.0)


@pytest.mark.parametrize("kind", DIALECTS)
async def test_outage_of_some_seconds_in_mid_transfer(make_rig, kind):
    """As when the link changes from one radio to another."""
    rig = make_rig(kind, delay_s=0.03)

    def set_loss(value):
        rig.up.faults.loss = rig.down.faults.loss = value

    rig.at += [(100.3, lambda: set_loss(1.0)), (106.5, lambda: set_loss(0.0))]
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
async def test_corrupt_packets(make_rig, kind):
    rig = make_rig(kind, corrupt=0.2)
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
async def test_a_mavlink_1_vehicle(make_rig, kind):
    rig = make_rig(kind, down={"mavlink1": True})
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
async def test_saturated_57600_baud_link(make_rig, kind):
    """Telemetry leaves a tenth of the line: 0.6 kB/s each way, 0.15 s one way."""
    rig = make_rig(kind, bytes_per_s=5760, background_bytes_per_s=5184, delay_s=0.15)
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("killed_at", [0, 1, 10, 19])
async def test_station_killed_in_mid_upload_and_started_again(make_rig, kind, killed_at):
    rig = make_rig(kind)

    class Killed(BaseException):
        pass

    def kill(transaction, message):
        if "REQUEST" in message.get_type() and message.seq == killed_at:
            raise Killed

    rig.on_heard = kill
    with pytest.raises(Killed):
        await prove(rig, kind)
    rig.on_heard = lambda t, m: None
    rig.pass_time(1.5)
    await prove(rig, kind)
    assert truly_held(rig, kind, mission(kind))


@pytest.mark.parametrize("kind", DIALECTS)
def test_cancel_at_every_step(make_rig, kind):
    steps = 22
    for step in range(steps):
        rig = make_rig(kind)
        heard = []

        def count(transaction, message, heard=heard, step=step):
            heard.append(message)
            if len(heard) == step:
                transaction.cancel()

        rig.on_heard = count
        upload = MissionUpload(mission(kind).items, 1, 1, rig.send, rig.clock)
        if step == 0:
            upload.start()
            upload.cancel()
        else:
            rig.drive(upload)
        if step == steps - 1:  # the final acknowledgement had come
            assert upload.result().acknowledged
            continue
        with pytest.raises(OperationCancelled, match="unknown"):
            upload.result()
        sent = rig.up.sent
        upload.on_time()
        upload.cancel()
        assert rig.up.sent == sent, "a cancelled upload goes on sending"
        rig.pass_time(0.2)
        if kind == "px4":
            assert rig.vehicle.state == "idle"
            assert len(rig.vehicle.store) == (20 if step == 20 else 0)  # the last item went out before the cancel


async def test_progress_can_cancel(make_rig):
    class Impatient:
        def report(self, stage, fraction):
            if stage == "upload" and fraction > 0.5:
                raise OperationCancelled("enough")

    rig = make_rig("px4")
    with pytest.raises(OperationCancelled, match="unknown"):
        await upload_and_prove(mission("px4"), peer(rig, "px4"), Impatient())


async def test_progress_grows_and_ends_at_one(make_rig):
    told: dict[str, list[float]] = {}

    class Listener:
        def report(self, stage, fraction):
            told.setdefault(stage, []).append(fraction)

    rig = make_rig("ardupilot", loss=0.1)
    await upload_and_prove(mission("ardupilot"), peer(rig, "ardupilot"), Listener())
    assert set(told) == {"upload", "read back"}
    assert told["read back"] == sorted(told["read back"])
    assert told["upload"][-1] == told["read back"][-1] == 1.0


async def test_mission_without_a_home_placeholder_is_refused_for_ardupilot(make_rig):
    rig = make_rig("ardupilot")
    with pytest.raises(RefusedError, match="item 0"):
        await upload_and_prove(mission("px4"), peer(rig, "ardupilot"))
    assert rig.up.sent == 0


@pytest.mark.parametrize("kind", DIALECTS)
async def test_mission_cleared_later_is_seen(make_rig, kind):
    rig = make_rig(kind)
    await prove(rig, kind)
    same = await compare_with_vehicle(mission(kind), peer(rig, kind))
    assert same.equal
    rig.vehicle.store = []
    gone = await compare_with_vehicle(mission(kind), peer(rig, kind))
    assert not gone.equal
    assert "0 items instead of 20" in gone.summary


@pytest.mark.parametrize("kind", DIALECTS)
async def test_what_is_read_can_be_sent_again_and_proved(make_rig, kind):
    rig = make_rig(kind)
    await prove(rig, kind)
    read = await download(peer(rig, kind))
    again = await prove(rig, kind, Mission(read))
    assert again.items_read == 20
    assert truly_held(rig, kind, Mission(read))


MOCKLINK_WRITE = {
    "no response to the count": lambda m, n: m.get_type() == "MISSION_REQUEST_INT" and m.seq == 0,
    "no response to the count, first time": lambda m, n: n == 0,
    "no request 1": lambda m, n: m.get_type() == "MISSION_REQUEST_INT" and m.seq == 1,
    "no final acknowledgement": lambda m, n: m.get_type() == "MISSION_ACK",
}


@pytest.mark.parametrize("mode", MOCKLINK_WRITE)
async def test_silences_on_writing(make_rig, mode):
    rig = make_rig("px4")
    said = []

    def silence(message):
        lost = MOCKLINK_WRITE[mode](message, len(said))
        said.append(message)
        return [] if lost else [message]

    rig.vehicle.alter_out = silence
    if mode == "no response to the count":
        with pytest.raises(LinkError, match="unknown"):
            await prove(rig, "px4")
    else:
        await prove(rig, "px4")
        assert truly_held(rig, "px4", mission("px4"))


@pytest.mark.parametrize("asked", [0, 1])
async def test_wrong_request_number_on_writing(make_rig, wire, asked):
    """The vehicle asks for item 5 where it means 0 or 1; what arrives is not what it expects."""
    rig = make_rig("px4")
    wrong = []

    def misnumber(message):
        if message.get_type() == "MISSION_REQUEST_INT" and message.seq == asked and not wrong:
            wrong.append(True)
            return [wire.MAVLink_mission_request_int_message(255, 190, 5, 0)]
        return [message]

    rig.vehicle.alter_out = misnumber
    await prove(rig, "px4")
    assert truly_held(rig, "px4", mission("px4"))


@pytest.mark.parametrize("asked", [0, 1])
async def test_error_acknowledgement_instead_of_a_request(make_rig, wire, asked):
    rig = make_rig("px4")

    def deny(message):
        if message.get_type() == "MISSION_REQUEST_INT" and message.seq == asked:
            return [wire.MAVLink_mission_ack_message(255, 190, 1, 0)]
        return [message]

    rig.vehicle.alter_out = deny
    with pytest.raises((RefusedError, LinkError)):
        await prove(rig, "px4")


async def test_final_acknowledgement_that_is_an_error_is_settled_by_reading_back(make_rig, wire):
    rig = make_rig("px4")

    def spoil(message):
        if message.get_type() == "MISSION_ACK" and message.type == 0:
            return [wire.MAVLink_mission_ack_message(255, 190, 1, 0)]
        return [message]

    rig.vehicle.alter_out = spoil
    await prove(rig, "px4")
    assert truly_held(rig, "px4", mission("px4"))


async def test_acknowledgement_that_comes_too_early_is_no_success(make_rig, wire):
    rig = make_rig("px4")

    def early(message):
        if message.get_type() == "MISSION_REQUEST_INT" and message.seq == 4:
            rig.vehicle.idle()
            return [wire.MAVLink_mission_ack_message(255, 190, 0, 0)]
        return [message]

    rig.vehicle.alter_out = early
    with pytest.raises((RefusedError, LinkError), match=r"something else|unknown"):
        await prove(rig, "px4")


async def test_early_acknowledgement_of_a_vehicle_that_goes_on_is_harmless(make_rig, wire):
    rig = make_rig("px4")
    rig.vehicle.alter_out = lambda m: [wire.MAVLink_mission_ack_message(255, 190, 0, 0), m]
    await prove(rig, "px4")
    assert truly_held(rig, "px4", mission("px4"))


def test_items_must_be_numbered_in_order(make_rig):
    rig = make_rig("px4")
    item = mission("px4").items[1]
    with pytest.raises(ValueError, match="numbered"):
        MissionUpload([item], 1, 1, rig.send, rig.clock)


async def test_nan_yaw_survives(make_rig):
    rig = make_rig("px4")
    items = list(mission("px4", 4).items)
    items[0] = MissionItem(0, 5, 22, (0, 0, 0, math.nan), 313622000, 1216155000, 14.0, current=1)
    proof = await prove(rig, "px4", Mission(tuple(items)))
    assert proof.items_read == 4
