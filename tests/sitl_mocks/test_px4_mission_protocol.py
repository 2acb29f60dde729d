"""The mission protocol of the PX4-like vehicle, row by row as measured on the real one."""

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

NAN = math.nan
M = mavlink


def simple_mission(g, n=4):
    return [g.item(0, 6, 22, current=1), *[g.item(i, 6, 16, north=5.0 * i) for i in range(1, n)]]


def test_asks_with_int_requests_and_accepts(px4):
    result, requests = px4.upload(simple_mission(px4))
    assert result == M.MAV_MISSION_ACCEPTED
    assert requests == [("MISSION_REQUEST_INT", i) for i in range(4)]


def test_an_old_request_gets_a_float_item(px4):
    px4.upload(simple_mission(px4))
    px4.send(M.MAVLink_mission_request_list_message(1, 1, 0))
    px4.send(M.MAVLink_mission_request_int_message(1, 1, 0, 0))
    (item,) = px4.of("MISSION_ITEM", px4.send(M.MAVLink_mission_request_message(1, 1, 1, 0)))
    assert item.x == pytest.approx(31.3622 + 5.0 / 110_863.0, abs=1e-5)


def test_what_changes_in_an_item(px4):
    sent = [
        px4.item(0, 6, 22, current=1),
        px4.item(1, 0, 16, (3.0, 2.0, 4.0, -90.0)),
        px4.item(2, 3, 16, (0.0, 0.0, 0.0, 450.0)),
        px4.item(3, 5, 16, (0.0, 0.0, 0.0, NAN)),
        px4.item(4, 6, 80, (3.0, 0.0, 0.0, 0.0)),
        px4.item(5, 2, 206, (5.0, 7.0, 1.0, 0.0), x=0, y=0, z=0.0),
        px4.item(6, 2, 203, (0.0, 0.0, 0.0, 0.0), x=1, y=0, z=0.0),
    ]
    assert px4.upload(sent)[0] == 0
    back = px4.download()
    assert [(i.frame, i.command) for i in back] == [(6, 22), (5, 16), (6, 16), (5, 16), (6, 201), (2, 206), (2, 203)]
    assert (back[1].param1, back[1].param2, back[1].param3, back[1].param4) == (3.0, 2.0, 0.0, 270.0)
    assert back[2].param4 == 90.0
    assert math.isnan(back[3].param4)
    assert back[4].param1 == 0.0
    assert (back[5].param1, back[5].param2, back[5].param3) == (5.0, 7.0, 1.0)
    assert back[6].x == 1
    assert [i.current for i in back] == [1, 0, 0, 0, 0, 0, 0]
    assert [(a.x, a.y, a.z) for a in sent] == [(b.x, b.y, b.z) for b in back]


def test_sent_again_and_read_back_is_identical(px4):
    px4.upload([px4.item(0, 0, 22, current=1), px4.item(1, 3, 16, (1.0, 0.5, 9.0, 370.0), z=12.34567)])
    once = px4.download()
    assert px4.upload(once)[0] == 0
    twice = px4.download()
    assert [str(i) for i in once] == [str(i) for i in twice]


@pytest.mark.parametrize(
    ("frame", "command", "expected"),
    [
        (2, 115, M.MAV_MISSION_UNSUPPORTED),
        (6, 82, M.MAV_MISSION_UNSUPPORTED),
        (6, 18, M.MAV_MISSION_UNSUPPORTED),
        (2, 183, M.MAV_MISSION_UNSUPPORTED),
        (2, 181, M.MAV_MISSION_UNSUPPORTED),
        (2, 207, M.MAV_MISSION_UNSUPPORTED),
        (6, 178, M.MAV_MISSION_UNSUPPORTED),
        (6, 2000, M.MAV_MISSION_UNSUPPORTED),
        (6, 93, M.MAV_MISSION_UNSUPPORTED),
        (2, 195, M.MAV_MISSION_UNSUPPORTED),
        (2, 16, M.MAV_MISSION_UNSUPPORTED),
        (1, 16, M.MAV_MISSION_UNSUPPORTED_FRAME),
        (7, 16, M.MAV_MISSION_UNSUPPORTED_FRAME),
        (10, 16, M.MAV_MISSION_UNSUPPORTED_FRAME),
        (11, 16, M.MAV_MISSION_UNSUPPORTED_FRAME),
        *[(f, 16, M.MAV_MISSION_UNSUPPORTED_FRAME) for f in (4, 8, 9, 12, 20, 21)],
        *[(2, c, 0) for c in (178, 206, 214, 2000, 2001, 203, 1000, 1001, 205, 93, 177, 20, 530, 2003, 2500)],
        (6, 195, 0),
    ],
)
def test_which_commands_are_taken_in_which_frame(px4, frame, command, expected):
    before = simple_mission(px4)
    px4.upload(before)
    mission = [px4.item(0, 6, 22, current=1), px4.item(1, frame, command, (1.0, 1.0, 1.0, 0.0)), px4.item(2, 6, 16)]
    assert px4.upload(mission)[0] == expected
    # What is refused leaves the old mission as it was: the replacement is atomic.
    assert len(px4.download()) == (3 if expected == 0 else 4)


def test_a_refused_item_is_told_in_words_to_stations_only(make_ground):
    g = make_ground("px4", ready=False)
    quiet = g.second()
    g.run(2.0)
    g.upload([g.item(0, 6, 22, current=1), g.item(1, 2, 115)])
    assert "IGN MISSION_ITEM: Invalid item" in g.texts()
    assert quiet.texts() == []


def test_too_many_items_keep_the_old_mission(px4):
    px4.upload(simple_mission(px4))
    (ack,) = px4.of("MISSION_ACK", px4.send(M.MAVLink_mission_count_message(1, 1, 10_001, 0)))
    assert ack.type == M.MAV_MISSION_NO_SPACE
    assert len(px4.download()) == 4


def test_an_item_out_of_order_is_ignored_and_the_awaited_one_asked_for_again(px4):
    px4.send(M.MAVLink_mission_count_message(1, 1, 3, 0))
    assert px4.send(px4.item(2, 6, 16)) == []
    again = px4.of("MISSION_REQUEST_INT", px4.run(0.3))
    assert [m.seq for m in again] == [0]
    px4.send(px4.item(0, 6, 22))
    assert px4.of("MISSION_ACK", px4.send(px4.item(0, 6, 22))) == []
    px4.send(px4.item(1, 6, 16))
    (ack,) = px4.of("MISSION_ACK", px4.send(px4.item(2, 6, 16)))
    assert ack.type == 0


def test_the_last_item_sent_again_is_acknowledged_again(px4):
    mission = simple_mission(px4)
    px4.upload(mission)
    (ack,) = px4.of("MISSION_ACK", px4.send(mission[-1]))
    assert ack.type == 0
    (ack,) = px4.of("MISSION_ACK", px4.send(mission[1]))
    assert ack.type == M.MAV_MISSION_ERROR


def test_a_stalled_upload_is_asked_for_each_quarter_second_and_dropped_without_an_answer(px4):
    px4.send(M.MAVLink_mission_count_message(1, 1, 3, 0))
    heard = px4.run(5.0)
    assert 17 <= len(px4.of("MISSION_REQUEST_INT", heard)) <= 20
    px4.run(0.1)
    heard = px4.run(2.0)
    assert px4.of("MISSION_ACK", heard) == []
    assert px4.of("MISSION_REQUEST_INT", heard) == []
    assert any("timeout" in text for text in px4.texts())
    assert px4.upload(simple_mission(px4))[0] == 0


def test_a_lost_first_request_is_repeated_for_the_same_count(px4):
    px4.send(M.MAVLink_mission_count_message(1, 1, 3, 0))
    (again,) = px4.send(M.MAVLink_mission_count_message(1, 1, 3, 0))
    assert (again.get_type(), again.seq) == ("MISSION_REQUEST_INT", 0)


def test_a_second_count_and_a_second_station_get_error_and_the_upload_goes_on(px4):
    other = px4.second()
    px4.send(M.MAVLink_mission_count_message(1, 1, 2, 0))
    px4.send(px4.item(0, 6, 22, current=1))
    (ack,) = px4.of("MISSION_ACK", px4.send(M.MAVLink_mission_count_message(1, 1, 5, 0)))
    assert ack.type == M.MAV_MISSION_ERROR
    (ack,) = other.of("MISSION_ACK", other.send(M.MAVLink_mission_count_message(1, 1, 5, 0)))
    assert ack.type == M.MAV_MISSION_ERROR
    (ack,) = other.of("MISSION_ACK", other.send(M.MAVLink_mission_request_list_message(1, 1, 0)))
    assert ack.type == M.MAV_MISSION_ERROR
    (ack,) = px4.of("MISSION_ACK", px4.send(px4.item(1, 6, 16)))
    assert ack.type == 0


def test_an_item_without_a_count_is_an_error(px4):
    (ack,) = px4.of("MISSION_ACK", px4.send(px4.item(0, 6, 16)))
    assert ack.type == M.MAV_MISSION_ERROR


def test_cancelling_works_and_keeps_the_old_mission(px4):
    px4.upload(simple_mission(px4))
    px4.send(M.MAVLink_mission_count_message(1, 1, 2, 0))
    px4.send(M.MAVLink_mission_ack_message(1, 1, M.MAV_MISSION_OPERATION_CANCELLED, 0))
    assert px4.of("MISSION_REQUEST_INT", px4.run(1.0)) == []
    assert len(px4.download()) == 4


def test_a_list_is_given_out_strictly_in_order_and_to_one_at_a_time(px4):
    other = px4.second()
    px4.upload(simple_mission(px4))
    assert px4.send(M.MAVLink_mission_request_int_message(1, 1, 0, 0)) == [], "nobody asked for the list"
    px4.send(M.MAVLink_mission_request_list_message(1, 1, 0))
    assert other.of("MISSION_COUNT", other.send(M.MAVLink_mission_request_list_message(1, 1, 0))) == []
    (busy,) = other.of("MISSION_ACK", other.send(M.MAVLink_mission_count_message(1, 1, 2, 0)))
    assert busy.type == M.MAV_MISSION_ERROR
    for n in (0, 0, 1):
        assert px4.of("MISSION_ITEM_INT", px4.send(M.MAVLink_mission_request_int_message(1, 1, n, 0)))
    (ack,) = px4.of("MISSION_ACK", px4.send(M.MAVLink_mission_request_int_message(1, 1, 3, 0)))
    assert ack.type == M.MAV_MISSION_ERROR
    assert px4.send(M.MAVLink_mission_request_int_message(1, 1, 2, 0)) == [], "that was the end of it"
    assert len(px4.download()) == 4


def id_of(message, at):
    """The opaque id that lies at a place of a payload."""
    packet = bytes(message.get_msgbuf())
    return int.from_bytes(packet[10 : 10 + packet[1]].ljust(at + 4, b"\0")[at : at + 4], "little")


def test_it_names_its_lists_by_ids(px4):
    ids = []
    for mission in (simple_mission(px4), simple_mission(px4), simple_mission(px4)[:3]):
        px4.upload(mission)
        (count,) = px4.of("MISSION_COUNT", px4.send(M.MAVLink_mission_request_list_message(1, 1, 0)))
        px4.send(M.MAVLink_mission_ack_message(1, 1, 0, 0))
        ids.append(id_of(count, 5))
        assert id_of(px4.of("MISSION_ACK")[-1], 4) == ids[-1]
        assert id_of(px4.of("MISSION_CURRENT", px4.run(1.5))[-1], 6) == ids[-1]
    assert ids[0] == ids[1] != ids[2]
    assert 0 not in ids
    px4.send(M.MAVLink_mission_clear_all_message(1, 1, 0))
    (count,) = px4.of("MISSION_COUNT", px4.send(M.MAVLink_mission_request_list_message(1, 1, 0)))
    assert (count.count, id_of(count, 5)) == (0, 0)


def test_count_zero_and_clear_all_clear(px4):
    for message in (M.MAVLink_mission_count_message(1, 1, 0, 0), M.MAVLink_mission_clear_all_message(1, 1, 0)):
        px4.upload(simple_mission(px4))
        (ack,) = px4.of("MISSION_ACK", px4.send(message))
        assert ack.type == 0
        assert px4.download() == []


def test_accepted_does_not_mean_flyable(px4):
    mission = [px4.item(0, 6, 22, current=1), px4.item(1, 6, 16, z=NAN)]
    assert px4.upload(mission)[0] == 0
    current = px4.of("MISSION_CURRENT", px4.run(3.0))[-1]
    assert (current.total, current.mission_state) == (2, 1)
    assert px4.set_mode(4, 4) == [0, M.MAV_RESULT_TEMPORARILY_REJECTED]
    mission[1] = px4.item(1, 6, 16, x=950_000_000)
    assert px4.upload(mission)[0] == 0
    assert px4.of("MISSION_CURRENT", px4.run(3.0))[-1].mission_state == 1
    assert px4.upload([px4.item(0, 6, 16, north=12_000.0, current=1)])[0] == 0
    assert px4.of("MISSION_CURRENT", px4.run(3.0))[-1].mission_state == 1


@pytest.mark.parametrize(
    ("command", "event", "arguments"),
    [(112, 0x0185E823, (3, 112)), (114, 0x0185E823, (3, 114)), (22, 0x01FE4222, ())],
)
def test_what_is_taken_and_cannot_be_flown_is_told_by_an_event_to_everybody(px4, command, event, arguments):
    companion = px4.second()
    frame, x, y = (6, 313_622_000, 1_216_155_000) if command == 22 else (2, 0, 0)
    item = px4.item(2, frame, command, (3.0, 0.0, 0.0, 0.0), x=x, y=y)
    assert px4.upload([*simple_mission(px4)[:2], item])[0] == 0
    for side in (px4, companion):
        ((number, levels, rest),) = events(side)
        assert number == event
        assert struct.unpack("<2H", rest[:4]) == (arguments or (0, 0))
        assert levels == (0x43 if arguments else 0x63)
    assert px4.of("MISSION_CURRENT", px4.run(3.0))[-1].mission_state == 1


def test_a_refused_item_is_told_by_an_event_to_everybody_and_by_a_text_to_stations(px4):
    companion = px4.second()
    assert (
        px4.upload([*simple_mission(px4)[:2], px4.item(2, 2, 115, (90.0, 20.0, 1.0, 0.0))])[0]
        == M.MAV_MISSION_UNSUPPORTED
    )
    assert [(number, levels) for number, levels, _ in events(companion)] == [(0x01FEB270, 0x33)]
    assert "IGN MISSION_ITEM: Invalid item" in px4.texts()
    assert companion.texts() == []


def events(side):
    """(number, log levels, arguments) of every EVENT that was heard; pymavlink has no such message."""
    packets = [bytes(m.get_msgbuf()) for m in side.heard if m.get_type() == "UNKNOWN_410"]
    fields = [struct.unpack("<IIHBBB40s", packet[10:-2].ljust(53, b"\0")) for packet in packets]
    return [(number, levels, rest) for number, _, _, _, _, levels, rest in fields]


def test_the_mission_mode_is_refused_right_after_an_upload(px4):
    assert px4.upload(simple_mission(px4))[0] == 0
    assert px4.set_mode(4, 4) == [0, M.MAV_RESULT_TEMPORARILY_REJECTED]
    px4.run(1.2)
    assert px4.set_mode(4, 4) == [0, 0]


def test_a_new_upload_keeps_the_old_index_unless_an_item_is_marked(px4):
    px4.upload(simple_mission(px4))
    px4.send(M.MAVLink_mission_set_current_message(1, 1, 3))
    px4.upload([px4.item(i, 6, 22 if i == 0 else 16) for i in range(6)])
    assert px4.of("MISSION_CURRENT", px4.run(1.5))[-1].seq == 3
    px4.upload([px4.item(i, 6, 22 if i == 0 else 16) for i in range(2)])
    assert px4.of("MISSION_CURRENT", px4.run(1.5))[-1].seq == 1
    px4.send(M.MAVLink_mission_set_current_message(1, 1, 0))
    assert px4.of("MISSION_CURRENT")[-1].seq == 0
    px4.send(M.MAVLink_mission_set_current_message(1, 1, 1))
    px4.upload([px4.item(i, 6, 22 if i == 0 else 16, current=int(i == 0)) for i in range(6)])
    assert px4.of("MISSION_CURRENT", px4.run(1.5))[-1].seq == 0


def test_what_lies_where_no_vehicle_can_go_is_told_by_an_event(px4):
    companion = px4.second()
    for bad in (px4.item(1, 6, 16, z=NAN), px4.item(1, 6, 16, x=950_000_000)):
        before = len(events(companion))
        assert px4.upload([px4.item(0, 6, 22, current=1), bad])[0] == 0
        assert len(events(companion)) == before + 1


@pytest.mark.parametrize("room", [500, 1000])
def test_boards_with_less_room_say_so(make_ground, room):
    g = make_ground("px4", mission_items=room)
    for count, answer in ((room + 1, "MISSION_ACK"), (room, "MISSION_REQUEST_INT")):
        (reply,) = g.send(M.MAVLink_mission_count_message(1, 1, count, 0))
        assert reply.get_type() == answer
