"""Every fault that can be switched on bites, and the simulated world judges by what the vehicle holds."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import InputError
from sitl_mocks.link_faults import LINK_FAULTS
from sitl_mocks.lockstep import answer
from sitl_mocks.mission_faults import FAULTS, MISSION_FAULTS, check_fault
from sitl_mocks.mission_world import MissionWorld


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_changes_what_a_station_hears_or_what_the_vehicle_holds(kind, fault, naive):
    if (kind, fault) == ("px4", "home-drifts"):
        pytest.skip("item 0 is an item like any other there")
    for seed in range(1, 6):  # some faults leave it to chance where they strike
        clean, spoiled = naive(kind, seed=seed).upload().download(), naive(kind, fault, seed=seed).upload().download()
        if clean.trace != spoiled.trace or clean.world.truth() != spoiled.world.truth():
            return
    raise AssertionError("it changes nothing")


def test_there_are_the_faults_of_mocklink_and_more():
    reading = [name for name in MISSION_FAULTS if name.startswith("read-")]
    writing = [name for name in MISSION_FAULTS if name.startswith(("write-", "ack-")) and name != "ack-lost-once"]
    assert (len(reading), len(writing)) == (9, 10)
    assert len(FAULTS) == len(set(FAULTS)) >= 19 + 22
    assert check_fault("mixed") == "mixed"
    with pytest.raises(InputError, match=r"no fault 'mixde'.*truncated"):
        check_fault("mixde")


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_the_truth_is_what_is_held(kind, naive):
    assert naive(kind).upload().world.truth()["holds"]
    assert not naive(kind).world.truth()["holds"]
    for fault in ("truncated", "mixed", "home-in-item-0", "no-space-later", "write-0-error"):
        told = naive(kind, fault).upload().world.truth()
        assert not told["held"], fault
        assert not told["holds"], fault
    told = naive(kind, "ack-missing").upload().world.truth()
    assert told["holds"]
    assert not told["severed_upload"]
    assert naive(kind, "link-gone").world.truth()["severed_upload"]
    assert naive(kind, "read-0-silent").world.truth()["severed_download"]


def test_what_somebody_else_does_after_the_last_words_is_not_laid_to_the_station(naive):
    lately = []
    for seed in range(10):
        station = naive("px4", "changed", seed=seed, jitter_s=0.02).upload()
        station.exchange(mavlink.MAVLink_mission_request_list_message(1, 1, 0), 0.06)
        told = station.world.truth()
        assert not told["holds"]
        lately.append(told["meddled"])
    assert True in lately, "changed while the station was answered"
    assert False in lately, "changed when the upload was acknowledged, two seconds before"


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_what_was_read_is_held_against_the_store(kind, naive):
    plan = naive.PLAN[kind]
    moved = [plan[0], (*plan[1][:6], plan[1][6] + 5, *plan[1][7:]), *plan[2:]]
    assert naive(kind).upload().world.truth(plan)["read_right"]
    assert not naive(kind).upload().world.truth(moved)["read_right"]
    assert not naive(kind).upload().world.truth(plan[:4])["read_right"]
    assert not naive(kind).world.truth(plan)["read_right"]


def test_the_same_seed_gives_the_same_world(naive):
    def trace(seed):
        return naive("px4", "corrupt", seed=seed, loss=0.2, jitter_s=0.1).upload().download().trace

    assert trace(3) == trace(3)
    assert trace(3) != trace(4)


def test_orders_of_the_lockstep_process(naive):
    worlds: dict[int, MissionWorld] = {}
    assert "mixed" in answer(worlds, ["faults"])
    spec = {"autopilot": "px4", "faults": [], "seed": 1, "loss": 0.0, "plan": naive.PLAN["px4"], "held": []}
    assert answer(worlds, ["open", 7, spec]) is None
    count = mavlink.MAVLink_mission_count_message(1, 1, 5, 0).pack(mavlink.MAVLink(None, srcSystem=255))
    now_s, packets = answer(worlds, ["pass", 7, 9.0, [bytes(count).hex()]])
    assert 0.05 <= now_s < 0.07
    (request,) = mavlink.MAVLink(None).parse_buffer(bytes.fromhex(packets[0]))
    assert (request.get_type(), request.seq) == ("MISSION_REQUEST_INT", 0)
    assert answer(worlds, ["truth", 7, None])["holds"] is False
    assert worlds == {}


@pytest.mark.parametrize("fault", ["ack-missing", "write-count-silent"])
def test_faults_are_switched_on_in_whole_vehicles(make_ground, fault):
    ground = make_ground("px4", faults=(fault,))
    items = [ground.item(n, 6, 22 if n == 0 else 16) for n in range(3)]
    with pytest.raises(AssertionError, match="no MISSION_ACK"):
        ground.upload(items, 2.0)
    assert len(ground.vehicle.missions.items) == (3 if fault == "ack-missing" else 0)


def test_link_faults_name_fields_of_links():
    from random import Random

    from sitl_mocks.channel import LinkFaults
    from sitl_mocks.link_faults import ChangingLink, link_changes

    for name in LINK_FAULTS:
        faults = LinkFaults()
        link = ChangingLink(faults, link_changes([name], Random(1)), 100.0)
        link.step(1000.0)
        assert faults != LinkFaults(), name
        assert vars(faults).keys() == vars(LinkFaults()).keys(), name
        assert link.next_s == float("inf")
