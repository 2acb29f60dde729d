"""The mission protocol of the ArduPilot-like vehicle, row by row as measured on the real one."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

NAN = math.nan
M = mavlink
ZERO = (0.0, 0.0, 0.0, 0.0)


def simple_mission(g, n=4):
    return [g.item(0, 0, 16), g.item(1, 3, 22), *[g.item(i, 3, 16, north=5.0 * i) for i in range(2, n)]]


def test_asks_with_the_old_request(ardupilot):
    result, requests = ardupilot.upload(simple_mission(ardupilot))
    assert result == 0
    assert requests == [("MISSION_REQUEST", i) for i in range(4)]


def test_an_upload_before_the_storage_is_open_gets_no_space(make_ground):
    g = make_ground("ardupilot", ready=False)
    g.run(0.1)
    (ack,) = g.of("MISSION_ACK", g.send(M.MAVLink_mission_count_message(1, 1, 3, 0)))
    assert ack.type == M.MAV_MISSION_NO_SPACE
    assert "Only 0 items are supported" in g.texts()


def test_what_changes_in_an_item(ardupilot):
    sent = [
        ardupilot.item(0, 0, 16, x=1, y=2, z=3.0),
        ardupilot.item(1, 6, 22, (1.9, 0.0, 0.0, NAN)),
        ardupilot.item(2, 6, 16, (3.7, 2.0, 4.0, NAN), z=12.3456),
        ardupilot.item(3, 5, 16, ZERO),
        ardupilot.item(4, 11, 16, ZERO),
        ardupilot.item(5, 6, 19, (5.0, 0.0, 0.0, 0.0)),
        ardupilot.item(6, 6, 178, (1.0, 4.0, -1.0, 0.0), x=5, y=6, z=7.0),
        ardupilot.item(7, 2, 205, (-30.25, 0.0, 0.0, 0.0), x=0, y=0, z=2.0),
        ardupilot.item(8, 2, 203, ZERO, x=1, y=0, z=0.0),
    ]
    for each in sent:
        each.autocontinue = 0
    assert ardupilot.upload(sent)[0] == 0
    back = ardupilot.download()
    assert [i.frame for i in back] == [0, 3, 3, 0, 10, 3, 0, 0, 0]
    assert (back[0].x, back[0].y) == (313620196, 1216152898)  # home, whatever was sent
    assert back[0].z == pytest.approx(4.0, abs=0.011)
    assert (back[2].param1, back[2].param2, back[2].param3, back[2].param4) == (3.0, 0.0, 0.0, 0.0)
    assert back[2].z == pytest.approx(12.34, abs=1e-6)
    assert (back[2].x, back[2].y) == (sent[2].x, sent[2].y)
    assert back[1].param4 == 0.0
    assert back[5].param3 == 1.0
    assert (back[6].x, back[6].y, back[6].z) == (0, 0, 0.0)
    assert (back[7].param1, back[7].z) == (-30.25, 2.0)
    assert back[8].x == 1
    assert {i.autocontinue for i in back} == {1}


def test_sent_again_and_read_back_is_identical(ardupilot):
    ardupilot.upload([ardupilot.item(0, 0, 16), ardupilot.item(1, 6, 22), ardupilot.item(2, 6, 16, z=7.777)])
    once = ardupilot.download()
    assert ardupilot.upload(once)[0] == 0
    assert [str(i) for i in ardupilot.download()] == [str(i) for i in once]


@pytest.mark.parametrize(
    ("item", "expected"),
    [
        (("params", (NAN, 0.0, 0.0, 0.0)), M.MAV_MISSION_INVALID_PARAM1),
        (("params", (0.0, math.inf, 0.0, 0.0)), M.MAV_MISSION_INVALID_PARAM2),
        (("params", (0.0, 0.0, 0.0, NAN)), 0),
        (("x", 950_000_000), M.MAV_MISSION_INVALID_PARAM5_X),
        (("z", NAN), M.MAV_MISSION_INVALID_PARAM7),
        (("z", 40_000.0), 0),
        (("x", 0), 0),
        (("y", 0), 0),
        (("y", 1_900_000_000), M.MAV_MISSION_INVALID_PARAM6_Y),
    ],
)
def test_bad_numbers(ardupilot, item, expected):
    bad = ardupilot.item(2, 3, 16, **{"params": ZERO, item[0]: item[1]})
    assert ardupilot.upload([*simple_mission(ardupilot, 2), bad])[0] == expected


@pytest.mark.parametrize(
    ("frame", "command", "expected"),
    [
        (2, 214, M.MAV_MISSION_UNSUPPORTED),
        (2, 176, M.MAV_MISSION_UNSUPPORTED),
        (1, 16, M.MAV_MISSION_UNSUPPORTED_FRAME),
        *[(f, 16, M.MAV_MISSION_UNSUPPORTED_FRAME) for f in (4, 7, 8, 9, 12, 20, 21)],
        *[(2, c, 0) for c in (181, 183, 211)],  # there is neither relay nor servo nor gripper
        (3, 0, M.MAV_MISSION_INVALID),
        *[(f, c, 0) for c in (178, 206, 2000, 203, 1000, 205, 115, 93) for f in (0, 2, 3, 6)],
        (3, 82, 0),
    ],
)
def test_which_commands_are_taken_in_which_frame(ardupilot, frame, command, expected):
    item = ardupilot.item(2, frame, command, (1.0, 1.0, 1.0, 0.0))
    assert ardupilot.upload([*simple_mission(ardupilot, 2), item])[0] == expected


def test_a_refused_item_aborts_and_the_items_so_far_stay_mixed_with_the_old(ardupilot):
    ardupilot.upload(simple_mission(ardupilot, 6))
    new = [*[ardupilot.item(i, 3, 16, z=99.0) for i in range(3)], ardupilot.item(3, 3, 214), ardupilot.item(4, 3, 16)]
    assert ardupilot.upload(new)[0] == M.MAV_MISSION_UNSUPPORTED
    back = ardupilot.download()
    assert [i.z for i in back[1:]] == [99.0, 99.0, 10.0, 10.0]  # shortened to 5, two written, two old ones left


def test_too_many_items_keep_the_old_mission(ardupilot):
    ardupilot.upload(simple_mission(ardupilot))
    (ack,) = ardupilot.of("MISSION_ACK", ardupilot.send(M.MAVLink_mission_count_message(1, 1, 651, 0)))
    assert ack.type == M.MAV_MISSION_NO_SPACE
    assert "Only 650 items are supported" in ardupilot.texts()
    assert len(ardupilot.download()) == 4


def test_a_mission_on_a_card_has_more_room(make_ground):
    g = make_ground("ardupilot", parameters=(("BRD_SD_MISSION", 64),))
    for count, answer in ((4369, "MISSION_ACK"), (4368, "MISSION_REQUEST")):
        reply = g.send(M.MAVLink_mission_count_message(1, 1, count, 0))[0]
        assert reply.get_type() == answer
    assert "Only 4368 items are supported" in g.texts()


def test_many_requests_in_flight_are_all_answered_in_any_order(ardupilot):
    ardupilot.upload(simple_mission(ardupilot, 60))
    ardupilot.send(M.MAVLink_mission_request_list_message(1, 1, 0))
    order = [*range(20, 60), *range(20)]
    answers = [m for n in order for m in ardupilot.send(M.MAVLink_mission_request_int_message(1, 1, n, 0))]
    assert [m.seq for m in ardupilot.of("MISSION_ITEM_INT", answers)] == order


def test_a_trigger_distance_loses_its_second_number(ardupilot):
    do = ardupilot.item(2, 6, 206, (5.0, 7.0, 1.0, 0.0))
    assert ardupilot.upload([*simple_mission(ardupilot, 2), do])[0] == 0
    kept = ardupilot.download()[2]
    assert (kept.frame, kept.param1, kept.param2, kept.param3) == (0, 5.0, 0.0, 1.0)


def test_an_item_out_of_order_or_twice_is_told_but_the_upload_goes_on(ardupilot):
    ardupilot.send(M.MAVLink_mission_count_message(1, 1, 3, 0))
    ardupilot.send(ardupilot.item(0, 0, 16))
    (ack,) = ardupilot.send(ardupilot.item(2, 3, 16))
    assert ack.type == M.MAV_MISSION_INVALID_SEQUENCE
    ardupilot.send(ardupilot.item(1, 3, 22))
    (ack,) = ardupilot.send(ardupilot.item(1, 3, 22))
    assert ack.type == M.MAV_MISSION_INVALID_SEQUENCE
    answers = ardupilot.send(ardupilot.item(2, 3, 16))
    assert [m.type for m in ardupilot.of("MISSION_ACK", answers)] == [0]


def test_a_stalled_upload_is_asked_for_each_second_and_cancelled_after_eight(ardupilot):
    ardupilot.upload(simple_mission(ardupilot, 6))
    ardupilot.send(M.MAVLink_mission_count_message(1, 1, 3, 0))
    heard = ardupilot.run(7.9)
    assert len(ardupilot.of("MISSION_REQUEST", heard)) == 7
    assert ardupilot.of("MISSION_ACK", heard) == []
    (ack,) = ardupilot.of("MISSION_ACK", ardupilot.run(0.5))
    assert ack.type == M.MAV_MISSION_OPERATION_CANCELLED
    assert len(ardupilot.download()) == 3  # the store was shortened all the same


def test_a_second_station_is_denied(ardupilot):
    other = ardupilot.second()
    ardupilot.send(M.MAVLink_mission_count_message(1, 1, 3, 0))
    for message in (M.MAVLink_mission_count_message(1, 1, 5, 0), M.MAVLink_mission_request_list_message(1, 1, 0)):
        (ack,) = other.of("MISSION_ACK", other.send(message))
        assert ack.type == M.MAV_MISSION_DENIED


def test_an_item_without_a_count_and_a_last_item_sent_again_are_errors(ardupilot):
    mission = simple_mission(ardupilot)
    (ack,) = ardupilot.of("MISSION_ACK", ardupilot.send(mission[0]))
    assert ack.type == M.MAV_MISSION_ERROR
    ardupilot.upload(mission)
    (ack,) = ardupilot.of("MISSION_ACK", ardupilot.send(mission[-1]))
    assert ack.type == M.MAV_MISSION_ERROR


def test_cancelling_is_not_supported(ardupilot):
    ardupilot.send(M.MAVLink_mission_count_message(1, 1, 2, 0))
    ardupilot.send(M.MAVLink_mission_ack_message(1, 1, M.MAV_MISSION_OPERATION_CANCELLED, 0))
    assert len(ardupilot.of("MISSION_REQUEST", ardupilot.run(2.1))) == 2


def test_a_request_out_of_range(ardupilot):
    ardupilot.upload(simple_mission(ardupilot))
    (ack,) = ardupilot.send(M.MAVLink_mission_request_int_message(1, 1, 99, 0))
    assert ack.type == M.MAV_MISSION_INVALID_SEQUENCE


def test_set_current_and_its_command(ardupilot):
    ardupilot.upload(simple_mission(ardupilot))
    (current,) = ardupilot.of("MISSION_CURRENT", ardupilot.send(M.MAVLink_mission_set_current_message(1, 1, 2)))
    assert (current.seq, current.total, current.mission_state) == (2, 3, 2)
    assert ardupilot.command(M.MAV_CMD_DO_SET_MISSION_CURRENT, 1) == [0]
    assert ardupilot.command(M.MAV_CMD_DO_SET_MISSION_CURRENT, 99) == [M.MAV_RESULT_DENIED]


def test_items_can_be_replaced_one_by_one(ardupilot):
    g = ardupilot
    items = [g.item(n, 0, 22 if n == 1 else 16, (0.0, 0.0, 0.0, 0.0), z=10.0 + n) for n in range(5)]
    g.upload(items)
    (request,) = g.of("MISSION_REQUEST", g.send(M.MAVLink_mission_write_partial_list_message(1, 1, 2, 3, 0)))
    assert request.seq == 2
    g.send(g.item(2, 0, 16, (0.0, 0.0, 0.0, 0.0), z=50.0))
    (ack,) = g.of("MISSION_ACK", g.send(g.item(3, 0, 16, (0.0, 0.0, 0.0, 0.0), z=51.0)))
    assert ack.type == 0
    assert [m.z for m in g.download()][1:] == [11.0, 50.0, 51.0, 14.0]
    (ack,) = g.of("MISSION_ACK", g.send(M.MAVLink_mission_write_partial_list_message(1, 1, 2, 9, 0)))
    assert ack.type == M.MAV_MISSION_ERROR
    (ack,) = g.of("MISSION_ACK", g.send(M.MAVLink_mission_write_partial_list_message(1, 1, 0, 0, 1)))
    assert ack.type == M.MAV_MISSION_UNSUPPORTED
