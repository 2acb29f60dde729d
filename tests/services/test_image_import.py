"""Pictures from a card: matched, checked, not doubled, and nothing on the card is trusted."""

from __future__ import annotations

import io
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from gcs.core.errors import ConflictError, InputError, NotFoundError
from gcs.core.frames import GeoPoint, geodetic_from_enu, heading_from_yaw
from gcs.services import image_import
from gcs.services.image_import import import_folder
from gcs.storage.data_directory import owned_data_directory
from gcs.storage.database import Database
from gcs.storage.records import FlightPath, FlightRecord, FlightState, ImageRecord, ImageState, PlanRecord, PlanState

ANCHOR = GeoPoint(31.3622, 121.6155, 4.0)
PLACES = [(0.0, 0.0, 10.0), (8.0, 0.0, 10.0), (8.0, 8.0, 10.0)]
FLIGHT = "flight-1"


def picture(place, yaw_rad=0.0, second=0, colour=(10, 20, 30)):
    """A JPEG with EXIF as a camera writes it."""
    latitude, longitude, altitude = geodetic_from_enu(np.asarray(place), ANCHOR)
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x9003] = f"2026:11:22 10:00:{second:02d}"
    gps = exif.get_ifd(0x8825)
    gps.update({1: "N", 2: _dms(latitude), 3: "E", 4: _dms(longitude), 5: b"\0", 6: float(altitude)})
    gps.update({16: "T", 17: float(np.degrees(heading_from_yaw(yaw_rad)) % 360)})
    file = io.BytesIO()
    Image.new("RGB", (32, 24), colour).save(file, "JPEG", exif=exif)
    return file.getvalue()


def _dms(degrees):
    whole = int(degrees)
    minutes = int((degrees - whole) * 60)
    return float(whole), float(minutes), float(((degrees - whole) * 60 - minutes) * 60)


@pytest.fixture
def plan():
    viewpoints = [
        SimpleNamespace(id=k, name=f"P{k}", position_m=np.array(p), yaw_rad=0.0, gimbal_pitch_rad=0.0)
        for k, p in enumerate(PLACES)
    ]
    scenario = SimpleNamespace(anchor=SimpleNamespace(point=ANCHOR))
    return SimpleNamespace(viewpoints=tuple(viewpoints), scenario=scenario)


@pytest.fixture
def data(tmp_path, plan, monkeypatch):
    """A data directory with a flight that ended without pictures."""
    monkeypatch.setattr(image_import, "read_plan", lambda directory: plan)
    directory = tmp_path / "data"
    with owned_data_directory(directory):
        database = Database(directory)
        at = "2026-11-22T10:00:00Z"
        database.plans.add(PlanRecord("plan-1", "three", at, {}, PlanState.READY, plan_hash="0" * 64))
        database.flights.add(
            FlightRecord(
                id=FLIGHT,
                plan_id="plan-1",
                plan_hash="0" * 64,
                vehicle="px4-1",
                system_id=1,
                mode=FlightPath.MISSION,
                state=FlightState.INCOMPLETE,
                created_at=at,
                updated_at=at,
                viewpoints=3,
                problems=("3 images are missing: P0, P1, P2", "1 viewpoints were not reached: P2", "a wing fell off"),
            )
        )
        database.flights.add_visit(FLIGHT, 0, 0.1)
        database.flights.add_visit(FLIGHT, 1, 0.1)
        database.close()
    return directory


def flight(directory):
    database = Database(directory)
    try:
        return database.flights.get(FLIGHT), database.images.of_flight(FLIGHT), database.flights.visits(FLIGHT)
    finally:
        database.close()


@pytest.fixture
def card(tmp_path):
    folder = tmp_path / "card"
    (folder / "100MEDIA").mkdir(parents=True)
    return folder


def test_all_pictures_of_a_card_complete_the_flight(card, data):
    for k, place in enumerate(PLACES):
        (card / "100MEDIA" / f"DSC_{k}.JPG").write_bytes(picture(place, second=k, colour=(k, 0, 0)))
    result = import_folder(FLIGHT, card, data)
    assert (result.stored, result.known, result.missing, result.completed) == (3, 0, (), True)
    assert result.lines()[-1] == "the flight is complete"
    record, images, visits = flight(data)
    assert record.state is FlightState.COMPLETED
    assert record.problems == ("a wing fell off",), "what the pictures solved is no problem any more"
    assert {i.viewpoint_name for i in images} == {"P0", "P1", "P2"}
    assert {i.source for i in images} == {"card"}
    assert {v.viewpoint_id for v in visits} == {0, 1, 2}, "the picture taken at P2 shows that it was reached"


def test_the_order_is_that_of_the_camera_not_of_the_names(card, data):
    for name, k in (("c.jpg", 0), ("b.jpg", 1), ("a.jpg", 2)):
        (card / name).write_bytes(picture(PLACES[k], second=k, colour=(k, 0, 0)))
    assert import_folder(FLIGHT, card, data).missing == ()


def test_a_card_that_is_brought_again_doubles_nothing(card, data):
    for k in (0, 1):
        (card / f"{k}.jpg").write_bytes(picture(PLACES[k], second=k, colour=(k, 0, 0)))
    first = import_folder(FLIGHT, card, data)
    assert (first.stored, first.missing, first.completed) == (2, ("P2",), False)
    assert flight(data)[0].state is FlightState.INCOMPLETE
    (card / "2.jpg").write_bytes(picture(PLACES[2], second=2, colour=(2, 0, 0)))
    second = import_folder(FLIGHT, card, data)
    assert (second.stored, second.known, second.completed) == (1, 2, True)
    assert len(flight(data)[1]) == 3


def test_a_picture_that_never_came_over_the_link_is_filled(card, data):
    database = Database(data)
    database.images.add(
        ImageRecord(
            id="image-1",
            flight_id=FLIGHT,
            index=0,
            viewpoint_id=None,
            viewpoint_name=None,
            state=ImageState.FAILED,
            source="link",
            announced_at="2026-11-22T10:00:00Z",
            vehicle_path="/DCIM/IMG_0001.JPG",
        )
    )
    database.close()
    (card / "IMG_0001.JPG").write_bytes(picture(PLACES[0]))
    import_folder(FLIGHT, card, data)
    (image,) = flight(data)[1]
    assert (image.id, image.state, image.viewpoint_name) == ("image-1", ImageState.STORED, "P0")


def test_broken_files_links_and_hidden_ones_are_left_out_and_broken_ones_named(card, data, tmp_path):
    (card / "whole.jpg").write_bytes(picture(PLACES[0]))
    (card / "half.jpg").write_bytes(picture(PLACES[1])[:500])
    (card / "no\npicture.txt").write_bytes(b"hello")
    (card / "empty.jpg").write_bytes(b"")
    (card / ".hidden.jpg").write_bytes(picture(PLACES[1]))
    secret = tmp_path / "secret.jpg"
    secret.write_bytes(picture(PLACES[2]))
    (card / "link.jpg").symlink_to(secret)
    result = import_folder(FLIGHT, card, data)
    assert result.stored == 1
    assert [name for name, _ in result.skipped] == ["empty.jpg", "half.jpg", "no?picture.txt"]
    assert result.missing == ("P1", "P2")
    stored = list((data / "images" / FLIGHT).iterdir())
    assert len(stored) == 1
    assert "whole" not in stored[0].name, "names on our disk are our own"


def test_a_picture_in_the_wrong_direction_or_from_elsewhere_belongs_to_no_viewpoint(card, data):
    (card / "a.jpg").write_bytes(picture(PLACES[0], yaw_rad=np.pi))
    (card / "b.jpg").write_bytes(picture((50.0, 0.0, 10.0), second=1))
    result = import_folder(FLIGHT, card, data)
    assert (result.stored, result.unmatched, len(result.missing)) == (2, 2, 3)


def test_what_is_not_there_is_said(card, data, tmp_path):
    with pytest.raises(NotFoundError):
        import_folder("flight-x", card, data)
    with pytest.raises(InputError, match="no such folder"):
        import_folder(FLIGHT, tmp_path / "nowhere", data)
    with owned_data_directory(data), pytest.raises(ConflictError):
        import_folder(FLIGHT, card, data)
