"""Reading a vehicle's mission: the list must come whole and unmixed, or not at all."""

from __future__ import annotations

import pytest

from gcs.core.errors import LinkError, OperationCancelled, RefusedError
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_clear import MissionClear
from gcs.mavlink.mission_download import MissionDownload

DIALECTS = ["px4", "ardupilot"]
HELD = {"frame": 5, "command": 16, "p": (1.0, 0.5, 0.0, 90.0), "autocontinue": 1}


@pytest.fixture
def loaded(make_rig, wire):
    """A rig whose vehicle holds items."""

    def make(kind="px4", count=25, **faults):
        rig = make_rig(kind, **faults)

        class Item:
            def __init__(self, n):
                self.__dict__.update(HELD, x=313622000 + n, y=1216155000 - n, z=10.0 + n)

        rig.vehicle.store = [Item(n) for n in range(count)]
        return rig

    return make


def read(rig, kind="px4", **options):
    download = MissionDownload(1, 1, rig.send, rig.clock, autopilot=Autopilot(kind), own_system=255, **options)
    rig.drive(download)
    return download.result()


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("count", [0, 1, 25])
def test_whole_list(loaded, kind, count):
    rig = loaded(kind, count)
    items = read(rig, kind)
    assert [i.sequence for i in items] == list(range(count))
    assert [i.x for i in items] == [313622000 + n for n in range(count)]
    if kind == "px4" and count:
        rig.pass_time(0.1)
        assert rig.vehicle.state == "idle", "the vehicle was not told that the list has come"


@pytest.mark.parametrize("kind", DIALECTS)
@pytest.mark.parametrize("loss", [0.1, 0.3])
@pytest.mark.parametrize("seed", range(10))
def test_bad_link(loaded, kind, loss, seed):
    rig = loaded(kind, seed=seed, loss=loss, double=0.2, jitter_s=0.1)
    assert [i.z for i in read(rig, kind)] == [10.0 + n for n in range(25)]


def test_several_requests_under_way_make_a_long_way_short(loaded):
    rig = loaded("ardupilot", 100, delay_s=0.25)
    read(rig, "ardupilot")
    assert rig.clock.now - 100 < 100 * 0.5 / 5


def test_float_items_are_taken(loaded, wire):
    rig = loaded("px4", 5)

    def as_float(m):
        if m.get_type() != "MISSION_ITEM_INT":
            return [m]
        return [
            wire.MAVLink_mission_item_message(
                255, 190, m.seq, 0, m.command, 0, 1, m.param1, m.param2, m.param3, m.param4, m.x / 1e7, m.y / 1e7, m.z
            )
        ]

    rig.vehicle.alter_out = as_float
    items = read(rig)
    assert len(items) == 5
    assert items[3].x == pytest.approx(313622003, abs=20)  # float32 degrees


def test_list_that_changes_under_the_transfer_is_read_anew(loaded):
    rig = loaded("ardupilot", 60, delay_s=0.1)
    asked = []

    def change(message):
        if message.get_type() == "MISSION_REQUEST_INT":
            asked.append(message.seq)
            if len(asked) == 30:
                for item in rig.vehicle.store:
                    item.z += 100
                del rig.vehicle.store[50:]
                rig.vehicle.send_count()

    rig.vehicle.before_in = change
    items = read(rig, "ardupilot")
    assert [i.z for i in items] == [110.0 + n for n in range(50)]


def test_a_list_written_anew_in_a_gap_between_two_answers_is_not_mixed(loaded):
    """Its number of items is the same, and the vehicle has no ids: only reading twice shows it."""
    rig = loaded("ardupilot", 8)
    lost = []

    def lose_and_change(message):
        if message.get_type() == "MISSION_REQUEST_INT" and message.seq == 5 and not lost:
            lost.append(True)
            rig.at.append((rig.clock() + 0.02, change))
            return True
        return False

    def change():
        for item in rig.vehicle.store:
            item.z += 100

    rig.vehicle.ignore_in = lose_and_change
    assert [i.z for i in read(rig, "ardupilot")] == [110.0 + n for n in range(8)]


def test_home_may_move_while_it_is_read(loaded):
    rig = loaded("ardupilot", 8, double=1.0)

    def drift(message):
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == 0:
            message.z += rig.clock() % 1
        return [message]

    rig.vehicle.alter_out = drift
    rig.up.faults.jitter_s = rig.down.faults.jitter_s = 0.05
    assert len(read(rig, "ardupilot")) == 8


def test_contradicting_answers_for_one_item_are_not_mixed(loaded):
    rig = loaded("px4", 10)
    changed = []

    def twice(message):
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == 4 and not changed:
            changed.append(True)
            rig.vehicle.store[4].z = 77.0
            rig.vehicle.put(message)
            rig.vehicle.expected = 4
            rig.vehicle.send_item(4)
            return []
        return [message]

    rig.vehicle.alter_out = twice
    assert read(rig)[4].z == 77.0


@pytest.mark.parametrize("lost", ["list always", "list once", "0 always", "1 always", "1 once"])
def test_silences_on_reading(loaded, lost):
    rig = loaded("px4", 8)
    hits = []
    what, how_often = lost.split()

    def ignore(message):
        hit = (
            message.get_type() == "MISSION_REQUEST_LIST"
            if what == "list"
            else message.get_type() == "MISSION_REQUEST_INT" and message.seq == int(what)
        )
        if hit:
            hits.append(message)
        return hit and (how_often == "always" or len(hits) == 1)

    rig.vehicle.ignore_in = ignore
    if how_often == "once":
        assert len(read(rig)) == 8
    else:
        with pytest.raises(LinkError, match="stopped answering"):
            read(rig)
        assert rig.clock.now < 100 + 90


@pytest.mark.parametrize("sequence", [0, 1])
def test_wrong_number_once(loaded, wire, sequence):
    rig = loaded("px4", 8)
    wrong = []

    def misnumber(message):
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == sequence and not wrong:
            wrong.append(True)
            message.seq = 6
        return [message]

    rig.vehicle.alter_out = misnumber
    assert [i.x for i in read(rig)] == [313622000 + n for n in range(8)]


@pytest.mark.parametrize("sequence", [0, 1])
def test_error_instead_of_an_item(loaded, wire, sequence):
    rig = loaded("px4", 8)

    def error(message):
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == sequence:
            rig.vehicle.idle()
            return [wire.MAVLink_mission_ack_message(255, 190, 1, 0)]
        return [message]

    rig.vehicle.alter_out = error
    with pytest.raises(RefusedError, match="could not be read"):
        read(rig)


def test_a_vehicle_without_missions_is_refused_at_once(loaded, wire):
    rig = loaded("px4")
    rig.vehicle.alter_out = lambda m: [wire.MAVLink_mission_ack_message(255, 190, 3, 0)]
    with pytest.raises(RefusedError):
        read(rig)
    assert rig.clock.now < 101


def test_a_list_that_grows_under_every_attempt_ends(loaded):
    rig = loaded("px4", 8)

    def grow(message):
        if message.get_type() == "MISSION_REQUEST_INT" and message.seq == 5:
            rig.vehicle.store.append(rig.vehicle.store[0])
            rig.vehicle.send_count()

    rig.vehicle.before_in = grow
    with pytest.raises(RefusedError, match="number of items changed"):
        read(rig)


@pytest.mark.parametrize("step", range(1, 9))
def test_cancel_at_every_step(loaded, step):
    rig = loaded("px4", 8)
    heard = []

    def count(transaction, message):
        heard.append(message)
        if len(heard) == step:
            transaction.cancel()

    rig.on_heard = count
    with pytest.raises(OperationCancelled):
        read(rig)
    rig.pass_time(0.1)
    assert rig.vehicle.state == "idle"


@pytest.mark.parametrize("kind", DIALECTS)
def test_clear(loaded, kind):
    rig = loaded(kind, seed=4, loss=0.3)
    clear = MissionClear(1, 1, rig.send, rig.clock)
    rig.drive(clear)
    assert clear.result() is None
    assert rig.vehicle.store == []


def test_clear_without_an_answer_says_unknown(loaded):
    rig = loaded("px4", down={"loss": 1.0})
    clear = MissionClear(1, 1, rig.send, rig.clock)
    rig.drive(clear)
    with pytest.raises(LinkError, match="unknown"):
        clear.result()


def test_a_clearing_that_is_cancelled_is_of_unknown_outcome_and_sends_no_more(loaded):
    rig = loaded("px4")
    clear = MissionClear(1, 1, rig.send, rig.clock)
    clear.start()
    sent = rig.up.sent
    clear.cancel()
    clear.on_time()
    assert rig.up.sent == sent
    with pytest.raises(OperationCancelled, match="whether it happened is unknown"):
        clear.result()
