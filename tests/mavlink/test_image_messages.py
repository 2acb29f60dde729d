"""Announcements of pictures, and finding those that were lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.image_messages import ImageGaps, image_report

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"


def captured(**changes):
    fields = {
        "time_boot_ms": 52024,
        "time_utc": 1,
        "camera_id": 1,
        "lat": 313625590,
        "lon": 1216159013,
        "alt": 26739,
        "relative_alt": 22949,
        "q": [1, 0, 0, 0],
        "image_index": 3,
        "capture_result": 1,
        "file_url": b"mftp:/DCIM/IMG_0003.jpg",
    }
    return mavlink.MAVLink_camera_image_captured_message(**{**fields, **changes})


def test_captured():
    report = image_report(captured())
    assert (report.index, report.file, report.at_vehicle_s) == (3, "mftp:/DCIM/IMG_0003.jpg", 52.024)
    assert report.success
    assert report.position.latitude_deg == pytest.approx(31.362559)
    assert report.position.altitude_m == pytest.approx(26.739)


def test_failed_capture_unknown_place_and_no_name():
    report = image_report(captured(capture_result=0, lat=0, lon=0, file_url=b""))
    assert not report.success
    assert report.position is None
    assert report.file is None


@pytest.mark.parametrize("changes", [{"lat": 2_000_000_000}, {"lon": -2_000_000_000}])
def test_impossible_place_is_unknown(changes):
    assert image_report(captured(**changes)).position is None


def test_negative_index_is_dropped():
    assert image_report(captured(image_index=-1)) is None


def test_bytes_that_are_no_text():
    assert image_report(captured(file_url=b"\xff\xfe/x\0\0")).file.endswith("/x")


@pytest.mark.parametrize(("time_usec", "at"), [(12_500_000, 12.5), (1_795_321_911_179_483, None)])
def test_feedback(time_usec, at):
    message = mavlink.MAVLink_camera_feedback_message(
        time_usec, 0, 0, 7, 313624140, 1216155130, 19.07, 15.0, 1.0, 2.0, 3.0, 0.0, 0
    )
    report = image_report(message)
    assert (report.index, report.file, report.at_vehicle_s) == (7, None, at)
    assert report.position.altitude_m == pytest.approx(19.07)


def test_feedback_with_a_height_that_is_no_number():
    message = mavlink.MAVLink_camera_feedback_message(
        1, 0, 0, 7, 313624140, 1216155130, float("nan"), 15.0, 1.0, 2.0, 3.0, 0.0, 0
    )
    assert image_report(message).position is None


def test_other_messages():
    assert image_report(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3)) is None


@pytest.mark.skipif(not RECORDS.is_dir(), reason="the recorded traffic is not here")
@pytest.mark.parametrize(
    ("name", "count"), [("px4/auto_mission_camera.tlog", 9), ("ardupilot/auto_mission_camera.tlog", 7)]
)
def test_recorded_announcements(name, count):
    raw, place, reports = (RECORDS / name).read_bytes(), 0, []
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    while place + 8 < len(raw):
        place += 8
        size = 12 + raw[place + 1] + (13 if raw[place + 2] & 1 else 0) if raw[place] == 0xFD else 8 + raw[place + 1]
        reports += [r for m in parser.parse_buffer(raw[place : place + size]) or [] if (r := image_report(m))]
        place += size
    assert len(reports) >= count
    gaps = ImageGaps()
    assert all(gaps.heard(r.index) for r in reports)
    assert gaps.missing == ()
    assert all(r.success and r.position is not None for r in reports)


def test_gaps_are_asked_for_until_they_come():
    gaps = ImageGaps(0, retry_s=1.0, tries=3)
    assert [gaps.heard(i) for i in (0, 1, 4)] == [True, True, True]
    assert gaps.missing == (2, 3)
    assert gaps.due(10.0) == (2, 3)
    assert gaps.due(10.5) == ()
    assert gaps.heard(2)
    assert not gaps.heard(2)
    assert not gaps.heard(4)
    assert gaps.due(11.0) == (3,)
    assert gaps.due(12.0) == (3,)
    assert gaps.due(13.0) == (), "given up"
    assert gaps.missing == (3,)
    assert gaps.expected == 5


def test_first_picture_sets_the_count_unless_it_is_known():
    free, known = ImageGaps(), ImageGaps(0)
    free.heard(17)
    known.heard(3)
    assert free.missing == ()
    assert known.missing == (0, 1, 2)


def test_total_of_the_vehicle_shows_what_was_lost_at_the_end():
    gaps = ImageGaps(0)
    gaps.heard(0)
    gaps.taken_so_far(3)
    assert gaps.missing == (1, 2)
    assert gaps.heard(2)
    gaps.taken_so_far(2)
    assert gaps.missing == (1,)


def test_memory_is_bounded():
    gaps = ImageGaps(0, most=50)
    gaps.heard(10_000_000)
    assert len(gaps.missing) <= 50
    for index in range(10_000_010, 10_002_000, 40):
        gaps.heard(index)
    gaps.taken_so_far(10_002_030)
    assert len(gaps.missing) <= 51 + 50
