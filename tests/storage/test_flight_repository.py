import math

import pytest

from gcs.core.clock import utc_now
from gcs.core.errors import NotFoundError, StorageError
from gcs.core.mission import MissionItem, mission_crc32
from gcs.storage.records import FlightState, ImageRecord, ImageState, TrackPoint, UploadState


def make_image(index, state=ImageState.ANNOUNCED, viewpoint=None, source="link"):
    return ImageRecord(f"image-{source}-{index}", "flight-1", index, viewpoint, None, state, source, utc_now())


def test_a_flight_changes_and_its_end_is_dated(database, flight):
    updated = database.flights.update(flight.id, state=FlightState.FLYING, accepted_failsafes=("NAV_DLL_ACT",))
    assert updated.state is FlightState.FLYING
    assert updated.accepted_failsafes == ("NAV_DLL_ACT",)
    assert updated.ended_at is None
    assert [f.id for f in database.flights.open_flights()] == [flight.id]
    ended = database.flights.update(flight.id, state=FlightState.COMPLETED)
    assert ended.ended_at is not None
    assert database.flights.open_flights() == ()
    assert database.flights.get(flight.id) == ended


def test_what_a_flight_is_cannot_be_changed(database, flight):
    for change in ({"plan_hash": "x"}, {"id": "y"}, {"colour": "red"}):
        with pytest.raises(TypeError, match="not to be changed"):
            database.flights.update(flight.id, **change)


def test_the_log_only_grows_and_is_read_on_from_where_one_was(database, flight):
    first = database.flights.log(flight.id, "state", "uploading")
    second = database.flights.log(flight.id, "problem", "no answer", severity=3, data={"tries": 5})
    assert second.id > first.id
    assert [e.text for e in database.flights.events(flight.id)] == ["uploading", "no answer"]
    (event,) = database.flights.events(flight.id, after=first.id)
    assert (event.severity, event.data) == (3, {"tries": 5})
    assert len(database.flights.events(flight.id, limit=1)) == 1
    assert not any(hasattr(database.flights, name) for name in ("update_event", "delete_event", "delete"))


def test_events_of_no_flight_are_refused(database, flight):
    with pytest.raises(NotFoundError):
        database.flights.events("flight-2")
    with pytest.raises(StorageError):
        database.flights.log("flight-2", "state", "lost")


def test_the_track_comes_back_in_order(database, flight):
    points = [TrackPoint(100.0 + k, (float(k), 0.5, 10.0), None if k == 0 else 0.1 * k) for k in range(5)]
    database.flights.add_track(flight.id, points[3:])
    database.flights.add_track(flight.id, points[:3])
    assert list(database.flights.track(flight.id)) == points
    assert list(database.flights.track(flight.id, after_s=102.0)) == points[3:]


def test_a_viewpoint_is_reached_once_and_the_smallest_miss_stays(database, flight):
    assert database.flights.add_visit(flight.id, 2, 0.4)
    assert not database.flights.add_visit(flight.id, 2, 0.1)
    assert not database.flights.add_visit(flight.id, 2, 0.3)
    (visit,) = database.flights.visits(flight.id)
    assert (visit.viewpoint_id, visit.miss_m) == (2, 0.1)


def test_counts_are_of_viewpoints_not_of_pictures(database, flight):
    for image in (
        make_image(0, ImageState.STORED, viewpoint=0),
        make_image(1, ImageState.STORED, viewpoint=0),
        make_image(2, ImageState.STORED, viewpoint=1),
        make_image(3, ImageState.FAILED, viewpoint=2),
        make_image(4, ImageState.STORED),
    ):
        database.images.add(image)
    database.flights.add_visit(flight.id, 1, None)
    overview = database.flights.summary(flight.id)
    assert (overview.viewpoints_reached, overview.images_received) == (1, 2)
    assert database.flights.summaries() == (overview,)


def test_an_upload_counts_only_when_it_ended(database, flight):
    begun = database.flights.begin_upload(flight.id, 12)
    assert begun.state is UploadState.RUNNING
    item = MissionItem(0, 5, 16, (0.0, 1.5, math.nan, 2.0), 313622000, 1216155000, 14.25)
    proved = database.flights.end_upload(
        begun.id, UploadState.PROVED, items_read=12, how="mission protocol", canonical_crc32=2**32 - 1, items=[item]
    )
    latest = database.flights.latest_upload(flight.id)
    assert latest is not None
    assert (latest.id, latest.state, latest.how) == (begun.id, UploadState.PROVED, "mission protocol")
    assert proved.canonical_crc32 == 2**32 - 1
    assert mission_crc32(proved.items) == mission_crc32((item,))
    assert math.isnan(proved.items[0].params[2])


def test_after_a_restart_an_upload_under_way_proves_nothing(database, flight):
    database.flights.begin_upload(flight.id, 12)
    assert database.flights.mark_uploads_interrupted() == 1
    upload = database.flights.latest_upload(flight.id)
    assert upload is not None
    assert upload.state is UploadState.INTERRUPTED
    assert "not known" in (upload.problem or "")


def test_a_picture_announced_twice_is_one(database, flight):
    first = database.images.add(make_image(7))
    again = database.images.add(make_image(7))
    assert first == again
    assert len(database.images.of_flight(flight.id)) == 1
    database.images.add(make_image(7, source="card"))
    assert len(database.images.of_flight(flight.id)) == 2


def test_pictures_that_are_not_stored_are_still_to_be_fetched(database, flight):
    database.images.add(make_image(0))
    stored = database.images.add(make_image(1))
    database.images.update(
        stored.id, state=ImageState.STORED, file_name="image-link-1.jpg", size_bytes=5, crc32=1, position_m=(1, 2, 3)
    )
    assert [i.index for i in database.images.unfinished(flight.id)] == [0]
    assert database.images.get(stored.id).position_m == (1, 2, 3)
