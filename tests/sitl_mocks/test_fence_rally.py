"""Fence and rally points of the two simulated vehicles, row by row as measured on the real ones."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

M = mavlink
FENCE, RALLY = 1, 2
SQUARE = [(50.0, 50.0), (-50.0, 50.0), (-50.0, -50.0), (50.0, -50.0)]


def item(g, seq, command, north, east, param1=0.0, frame=0, z=0.0, mission_type=FENCE):
    made = g.item(seq, frame, command, (param1, 0.0, 0.0, 0.0), north, east, z)
    made.mission_type = mission_type
    return made


def polygon(g, corners=SQUARE, command=5001, frame=0, first=0, says=None):
    count = len(corners) if says is None else says
    return [item(g, first + k, command, n, e, float(count), frame) for k, (n, e) in enumerate(corners)]


def rally(g, count, frame=0, z=30.0):
    return [item(g, k, 5100, 10.0 * k, 5.0, frame=frame, z=z, mission_type=RALLY) for k in range(count)]


def upload(g, items, mission_type):
    """The result that the vehicle acknowledges with, for this list."""
    start = len(g.heard)
    g.send(M.MAVLink_mission_count_message(1, 1, len(items), mission_type))
    for _ in range(500):
        fresh, start = g.heard[start:], len(g.heard)
        for message in fresh:
            if message.get_type() in {"MISSION_REQUEST", "MISSION_REQUEST_INT"}:
                assert message.mission_type == mission_type
                g.send(items[message.seq])
            elif message.get_type() == "MISSION_ACK":
                assert message.mission_type == mission_type
                return message.type
        if len(g.heard) == start:
            g.run(0.02)
    raise AssertionError("no MISSION_ACK")


def download(g, mission_type):
    (count,) = g.of("MISSION_COUNT", g.send(M.MAVLink_mission_request_list_message(1, 1, mission_type)))
    assert count.mission_type == mission_type
    items = []
    for seq in range(count.count):
        items += g.of("MISSION_ITEM_INT", g.send(M.MAVLink_mission_request_int_message(1, 1, seq, mission_type)))
        assert items[-1].mission_type == mission_type
    g.send(M.MAVLink_mission_ack_message(1, 1, 0, mission_type))
    return items


@pytest.fixture(params=["px4", "ardupilot"])
def either(request, make_ground):
    return make_ground(request.param)


def test_each_list_is_its_own(either):
    mission = [either.item(0, 6, 22, current=1), either.item(1, 6, 16)]
    assert either.upload(mission)[0] == 0
    assert upload(either, polygon(either), FENCE) == 0
    assert upload(either, rally(either, 3), RALLY) == 0
    assert len(either.download()) == 2
    assert [(i.command, i.param1) for i in download(either, FENCE)] == [(5001, 4.0)] * 4
    assert [i.command for i in download(either, RALLY)] == [5100] * 3
    (ack,) = either.of("MISSION_ACK", either.send(M.MAVLink_mission_clear_all_message(1, 1, FENCE)))
    assert (ack.type, ack.mission_type) == (0, FENCE)
    assert download(either, FENCE) == []
    assert len(download(either, RALLY)) == 3
    assert len(either.download()) == 2


@pytest.mark.parametrize("frame", [0, 3, 5, 6])
def test_frames_of_a_fence(either, frame):
    assert upload(either, polygon(either, frame=frame), FENCE) == 0
    held = 0 if either.vehicle.kind == "ardupilot" else 5
    assert {(i.frame, i.autocontinue) for i in download(either, FENCE)} == {(held, 0)}


@pytest.mark.parametrize(("frame", "held"), [(0, 0), (3, 3), (5, 0), (6, 3), (10, 10), (11, 10)])
def test_frames_of_rally_points_on_ardupilot(ardupilot, frame, held):
    assert upload(ardupilot, rally(ardupilot, 1, frame, 30.9), RALLY) == 0
    (point,) = download(ardupilot, RALLY)
    assert (point.frame, point.z, point.autocontinue) == (held, 30.0, 0)


def test_rally_points_on_px4_come_back_in_frame_5(px4):
    assert upload(px4, rally(px4, 1, 0, 30.25), RALLY) == 0
    (point,) = download(px4, RALLY)
    assert (point.frame, point.z) == (5, 30.25)


@pytest.mark.parametrize(("kind", "fence", "points"), [("px4", 64, 32), ("ardupilot", 70, 46)])
def test_capacities(make_ground, kind, fence, points):
    g = make_ground(kind)
    assert upload(g, rally(g, points), RALLY) == 0
    assert upload(g, rally(g, points + 1), RALLY) == M.MAV_MISSION_NO_SPACE
    assert len(download(g, RALLY)) == points
    circles = [item(g, k, 5004, 1000.0 + k, 0.0, 1.0) for k in range(fence + 1)]
    assert upload(g, circles[:-1], FENCE) == 0
    assert upload(g, circles, FENCE) == M.MAV_MISSION_NO_SPACE


@pytest.mark.parametrize("bad", ["two corners", "says five", "repeats its first"])
def test_a_bad_polygon_gives_an_error_and_the_old_fence_is_kept(ardupilot, bad):
    assert upload(ardupilot, polygon(ardupilot), FENCE) == 0
    wrong = {
        "two corners": polygon(ardupilot, SQUARE[:2]),
        "says five": polygon(ardupilot, says=5),
        "repeats its first": polygon(ardupilot, [*SQUARE, SQUARE[0]]),
    }[bad]
    assert upload(ardupilot, wrong, FENCE) == M.MAV_MISSION_ERROR
    assert "Fence validation failed" in ardupilot.texts()
    assert len(download(ardupilot, FENCE)) == 4


def test_wrong_commands_and_lists(either):
    stray = item(either, 0, 16, 0.0, 0.0)
    assert upload(either, [stray], FENCE) == M.MAV_MISSION_UNSUPPORTED
    (ack,) = either.of("MISSION_ACK", either.send(M.MAVLink_mission_count_message(1, 1, 1, 3)))
    assert (ack.type, ack.mission_type) == (M.MAV_MISSION_UNSUPPORTED, 3)


def test_clearing_all_lists_at_once(either):
    upload(either, polygon(either), FENCE)
    (ack,) = either.of("MISSION_ACK", either.send(M.MAVLink_mission_clear_all_message(1, 1, 255)))
    works = either.vehicle.kind == "px4"
    assert ack.type == (0 if works else M.MAV_MISSION_UNSUPPORTED)
    assert len(download(either, FENCE)) == (0 if works else 4)


def test_px4_has_one_transfer_at_a_time(px4):
    px4.send(M.MAVLink_mission_count_message(1, 1, 3, 0))
    (ack,) = px4.of("MISSION_ACK", px4.send(M.MAVLink_mission_count_message(1, 1, 4, FENCE)))
    assert (ack.type, ack.mission_type) == (M.MAV_MISSION_ERROR, FENCE)


def test_a_vehicle_without_the_list_says_unsupported(px4):
    px4.vehicle.missions.others.clear()
    for message in (
        M.MAVLink_mission_request_list_message(1, 1, FENCE),
        M.MAVLink_mission_count_message(1, 1, 3, RALLY),
    ):
        (ack,) = px4.of("MISSION_ACK", px4.send(message))
        assert ack.type == M.MAV_MISSION_UNSUPPORTED


@pytest.mark.parametrize(
    ("corners", "command", "breaks"),
    [
        ([(500, 500), (-500, 500), (-500, -500), (500, -500)], 5001, False),
        ([(500, 500), (400, 500), (400, 400), (500, 400)], 5001, True),
        ([(500, 500), (-500, 500), (-500, -500), (500, -500)], 5002, True),
        ([(500, 500), (400, 500), (400, 400), (500, 400)], 5002, False),
    ],
)
def test_polygons_are_watched(either, corners, command, breaks):
    either.in_air()
    before = either.vehicle.mode
    assert upload(either, polygon(either, corners, command), FENCE) == 0
    either.run(1.0)
    assert (either.vehicle.mode is not before) == breaks


def test_px4_takes_a_fence_with_home_outside_and_says_so(px4):
    texts = len(px4.texts())
    assert upload(px4, polygon(px4), FENCE) == 0
    assert px4.texts()[texts:] == []
    assert upload(px4, polygon(px4, [(500, 500), (400, 500), (400, 400), (500, 400)]), FENCE) == 0
    (text,) = px4.texts()[texts:]
    assert "home" in text
    assert len(download(px4, FENCE)) == 4


@pytest.mark.parametrize(
    ("kind", "frame", "lands_at_it"),
    [("px4", 0, True), ("px4", 3, True), ("px4", 5, False), ("px4", 6, False), ("ardupilot", 0, True)],
)
def test_a_return_ends_at_the_nearest_rally_point(make_ground, kind, frame, lands_at_it):
    """PX4 takes rally points in the frames 5 and 6, too, and then does not return to them."""
    g = make_ground(kind)
    far = item(g, 0, 5100, 200.0, 200.0, frame=frame, z=4.0, mission_type=RALLY)
    near = item(g, 1, 5100, -10.0, -12.0, frame=frame, z=4.0, mission_type=RALLY)
    assert upload(g, [far, near], RALLY) == 0
    g.in_air(10.0)
    vehicle = g.vehicle
    vehicle.flight.fly_to(np.add(vehicle.home_m, (8.0, 8.0, 10.0)))
    g.run(12.0)
    g.command(M.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    g.run_until(lambda: not vehicle.armed, 200.0)
    place = vehicle.frame.scene_e7(near.x, near.y, 4.0) if lands_at_it else vehicle.home_m
    assert vehicle.airframe.position_m[:2] == pytest.approx(place[:2], abs=0.3)
