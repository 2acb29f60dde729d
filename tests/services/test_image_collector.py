"""The collector with a vehicle that loses, breaks and forgets pictures, and a disk that fills up."""

from __future__ import annotations

import asyncio
import io
import zlib
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from gcs.core.errors import LinkError, NotFoundError, StorageError
from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.vehicle import ImageReport
from gcs.mavlink.ftp_fetch import BrokenFetchError
from gcs.mavlink.partial_file import PartialFile
from gcs.services import image_collector
from gcs.services.flight_recorder import FlightRecorder
from gcs.services.image_collector import ImageCollector
from gcs.services.live_feed import LiveFeed
from gcs.storage.database import Database
from gcs.storage.image_store import ImageStore
from gcs.storage.records import FlightPath, FlightRecord, FlightState, ImageState, PlanRecord, PlanState

ANCHOR = GeoPoint(31.3622, 121.6155, 4.0)
PLACES = [(0.0, 0.0, 10.0), (8.0, 0.0, 10.0)]
FLIGHT = "flight-1"


def jpeg(colour):
    file = io.BytesIO()
    Image.new("RGB", (16, 12), (colour, 0, 0)).save(file, "JPEG")
    return file.getvalue()


class Camera:
    """Serves files; `faults` are raised before a file is given."""

    def __init__(self):
        self.files = {f"/DCIM/IMG_{k}.JPG": jpeg(10 * k) for k in range(2)}
        self.faults = []
        self.fetched = []
        self.resumed = []
        self.serves_files = True
        self.newest = None
        self.during_request = lambda: None

    async def fetch_file(self, path, resume=None, keep=None):
        self.fetched.append(path)
        self.resumed.append(resume)
        await asyncio.sleep(0)
        if self.faults:
            raise self.faults.pop(0)
        if path not in self.files:
            raise NotFoundError("no such file", field=path)
        data = self.files[path]
        return SimpleNamespace(data=data, crc32=zlib.crc32(data), confirmed=True)

    async def list_files(self, folder):
        if not self.serves_files:
            raise LinkError("the vehicle does not answer to file requests")
        names = [p.removeprefix(f"{folder}/") for p in self.files]
        return SimpleNamespace(entries=tuple(SimpleNamespace(name=n, is_directory=False) for n in names))

    async def request_picture(self):
        await asyncio.sleep(0)
        if self.faults:
            raise self.faults.pop(0)
        self.during_request()
        return SimpleNamespace(data=self.files[f"/DCIM/IMG_{self.newest}.JPG"], suffix="jpg", passes=1)


@pytest.fixture
def camera():
    return Camera()


@pytest.fixture
def recorder(tmp_path):
    database = Database(tmp_path)
    at = "2026-11-22T10:00:00Z"
    database.plans.add(PlanRecord("plan-1", "two", at, {}, PlanState.READY, plan_hash="0" * 64))
    database.flights.add(
        FlightRecord(FLIGHT, "plan-1", "0" * 64, "px4-1", 1, FlightPath.MISSION, FlightState.FLYING, at, at, 2)
    )
    yield FlightRecorder(FLIGHT, database, ImageStore(tmp_path), LiveFeed())
    database.close()


@pytest.fixture
async def collector(camera, recorder, monkeypatch):
    monkeypatch.setattr(image_collector, "RETRY_S", 0.001)
    viewpoints = tuple(
        SimpleNamespace(id=k, name=f"P{k}", position_m=np.array(p), yaw_rad=0.0, gimbal_pitch_rad=0.0)
        for k, p in enumerate(PLACES)
    )
    plan = SimpleNamespace(viewpoints=viewpoints, scenario=SimpleNamespace(anchor=SimpleNamespace(point=ANCHOR)))
    collector = ImageCollector(plan, camera, recorder)
    running = asyncio.create_task(collector.run())
    yield collector
    running.cancel()


def report(k, file="mftp:/DCIM/IMG_{}.JPG"):
    latitude, longitude, altitude = geodetic_from_enu(np.array(PLACES[k]), ANCHOR)
    place = GeoPoint(float(latitude), float(longitude), float(altitude))
    return ImageReport(k, None if file is None else file.format(k), place, 10.0 + k)


def states(recorder):
    return [i.state for i in recorder.database.images.of_flight(FLIGHT)]


async def test_announced_pictures_are_fetched_once_each_however_often_they_are_announced(collector, recorder, camera):
    for k in (0, 1, 0, 1):
        collector.take(report(k))
    account = await collector.finish()
    assert account.complete
    assert collector.count == 2
    assert sorted(set(camera.fetched)) == sorted(camera.fetched) == sorted(camera.files)
    assert account.misses_m == {0: pytest.approx(0.0, abs=0.02), 1: pytest.approx(0.0, abs=0.02)}


async def test_a_lost_link_is_tried_again_until_the_file_is_whole(collector, recorder, camera):
    camera.faults = [LinkError("lost")] * 3
    collector.take(report(0))
    collector.take(report(1))
    assert (await collector.finish()).complete
    assert states(recorder) == [ImageState.STORED] * 2


async def test_after_a_break_a_file_is_gone_on_with(collector, recorder, camera):
    partial = PartialFile(700, bytes(700), ((300, 700),))
    camera.faults = [BrokenFetchError("lost", partial), LinkError("lost"), BrokenFetchError("lost", None)]
    collector.take(report(0))
    await collector.finish()
    assert camera.resumed[:4] == [None, partial, partial, partial]


def parts(tmp_path):
    return list((tmp_path / "images").rglob("*.part"))


async def test_the_part_that_a_killed_station_left_is_gone_on_with(collector, recorder, camera, tmp_path):
    whole = jpeg(0)
    collector.take(report(0))
    (image,) = recorder.database.images.unfinished(FLIGHT)
    part = recorder.image_part(image)
    part.begin(len(whole))
    part.add(0, whole[:239])
    part.close()
    assert len(parts(tmp_path)) == 1
    await collector.finish()
    resumed = camera.resumed[0]
    assert (resumed.size, resumed.gaps, resumed.may_be_stale) == (len(whole), ((239, len(whole)),), True)
    assert resumed.data[:239] == whole[:239]
    assert parts(tmp_path) == [], "it is whole now"


async def test_a_picture_that_fails_keeps_its_part_until_the_flight_is_over(collector, recorder, camera, tmp_path):
    async def breaks(path, resume=None, keep=None):
        keep.begin(700)
        keep.add(0, bytes(239))
        raise LinkError("lost")

    camera.fetch_file = breaks
    collector.take(report(0))
    await collector._waiting.join()
    assert len(parts(tmp_path)) == 1
    recorder.remove_image_parts()
    assert len(parts(tmp_path)) == 1, "the flight is not over"
    recorder.enter(FlightState.INCOMPLETE, "the end")
    recorder.remove_image_parts()
    assert parts(tmp_path) == []


async def test_a_camera_without_files_is_asked_for_each_picture(collector, recorder, camera):
    camera.serves_files = False
    camera.faults = [LinkError("lost")]
    await collector.remember_earlier()
    for k in range(2):
        camera.newest = k
        collector.take(report(k, file=None))
        await collector._waiting.join()
        collector.take(report(k, file=None))
    account = await collector.finish()
    assert account.complete
    assert camera.fetched == []
    assert states(recorder) == [ImageState.STORED] * 2


async def test_a_picture_that_a_newer_one_has_replaced_is_never_given_out_for_it(collector, recorder, camera):
    camera.serves_files = False
    await collector.remember_earlier()
    camera.newest = 0

    def another():
        camera.during_request = lambda: None
        camera.newest = 1
        collector.take(report(1, file=None))

    camera.during_request = another
    collector.take(report(0, file=None))
    account = await collector.finish()
    assert states(recorder) == [ImageState.FAILED, ImageState.STORED]
    assert account.missing == ("P0",)


async def test_pictures_without_names_and_unheard_ones_are_found_in_the_folder_and_earlier_ones_left_out(
    collector, recorder, camera
):
    new = dict(camera.files)
    camera.files = {"/DCIM/OLD.JPG": jpeg(200)}
    await collector.remember_earlier()
    camera.files.update(new)
    collector.take(report(0, file=None))
    account = await collector.finish()
    assert sorted(camera.fetched) == sorted(new)
    assert account.received == 2, "as many as viewpoints, so the order tells which is which"


async def test_a_link_that_is_away_at_the_end_does_not_make_pictures_missing(collector, recorder, camera):
    await collector.remember_earlier()
    camera.files.update({"/DCIM/NEW_0.JPG": jpeg(90), "/DCIM/NEW_1.JPG": jpeg(120)})
    lists, away = camera.list_files, [LinkError("lost")] * 2

    async def list_files(folder):
        if away:
            raise away.pop()
        return await lists(folder)

    camera.list_files = list_files
    assert (await collector.finish()).complete


async def test_a_full_disk_is_said_once_and_nothing_half_written_counts(collector, recorder, camera, monkeypatch):
    def full(*args, **kwargs):
        raise StorageError("no space left on the device", field="images")

    monkeypatch.setattr(recorder._store, "save", full)
    collector.take(report(0))
    collector.take(report(1))
    account = await collector.finish()
    assert (account.received, account.missing) == (0, ("P0", "P1"))
    assert set(states(recorder)) == {ImageState.FAILED}
    problems = recorder.flight.problems
    assert len(problems) == 1
    assert "no space left" in problems[0]
    assert recorder.database.flights.summary(FLIGHT).images_received == 0


@pytest.mark.parametrize("file", ["http://elsewhere/x.jpg", "mftp:" + "a" * 300, "/etc/passwd", ""])
async def test_what_cannot_be_a_file_of_the_camera_is_not_asked_for(file, collector, camera):
    collector.take(report(0, file=file))
    await asyncio.sleep(0.01)
    assert camera.fetched == []


async def test_what_is_here_by_a_deadline_counts(collector, recorder, camera):
    whole = asyncio.Event()
    fetch = camera.fetch_file

    async def slow(path, resume=None, keep=None):
        if path.endswith("1.JPG"):
            await whole.wait()
        return await fetch(path)

    camera.fetch_file = slow
    collector.take(report(0))
    collector.take(report(1))
    assert (await collector.so_far(0.5)).pictured == {0}
    whole.set()
    assert (await collector.so_far(60.0)).complete
