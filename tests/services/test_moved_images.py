"""The picture of a viewpoint that was moved is taken for it at the place that the report tells, and only there."""

import io
import math

import numpy as np
import pytest
from PIL import Image

from gcs.core.replanning import ViewpointFate
from gcs.services.flight_recorder import FlightRecorder
from gcs.services.image_account import ImageAccounting, complete_by_pictures, count_pictures_as_visits
from gcs.services.live_feed import LiveFeed
from gcs.storage.database import Database
from gcs.storage.image_store import ImageStore
from gcs.storage.records import (
    FlightPath,
    FlightRecord,
    FlightState,
    ImageRecord,
    ImageState,
    PlanRecord,
    PlanState,
    ReplanRecord,
    ViewpointFateName,
    ViewpointFateRecord,
)

AT, PLAN, AFTER, STRANGE = "2026-11-22T10:00:00Z", "ab" * 32, "01" * 32, "ff" * 32
ASIDE_M = np.array([0.0, 2.4, 0.0])


@pytest.fixture
def recorder(tmp_path):
    database = Database(tmp_path)
    database.plans.add(PlanRecord("plan-1", "one", AT, {}, PlanState.READY, plan_hash=PLAN))
    database.flights.add(
        FlightRecord("f", "plan-1", PLAN, "px4-1", 1, FlightPath.COMPANION, FlightState.INCOMPLETE, AT, AT, 1)
    )
    yield FlightRecorder("f", database, ImageStore(tmp_path), LiveFeed())
    database.close()


@pytest.fixture
def take(recorder):
    """Stores a picture taken at a place."""

    def take(name, place_m):
        file = io.BytesIO()
        Image.new("RGB", (16, 12), (len(name), 0, 0)).save(file, "JPEG")
        record = ImageRecord(
            name, "f", 0, None, None, ImageState.ANNOUNCED, "link", AT, position_m=tuple(float(c) for c in place_m)
        )
        recorder.store_image(recorder.image(record), file.getvalue())

    return take


@pytest.fixture
def tell(recorder):
    """Stores a report of the viewpoint's fate."""

    def tell(number, fate, place_m=None, before=PLAN):
        change = ViewpointFateRecord(0, ViewpointFateName[fate.name], None if place_m is None else tuple(place_m))
        path = ((6.0, 0.0, 10.0), (7.0, 2.4, 10.0), (6.0, 0.0, 10.0))
        report = ReplanRecord(
            0, "f", 1, 7, number, AT, before, "blocked", -1, 1.0, 9.0, path, plan_hash_after=AFTER, viewpoints=(change,)
        )
        recorder.database.replans.add(report)

    return tell


def test_a_moved_picture_belongs_to_its_viewpoint_once_it_is_told(small_plan, recorder, take, tell):
    (viewpoint,) = small_plan.viewpoints
    place = viewpoint.position_m + ASIDE_M
    take("a", place + np.array([0.1, -0.1, 0.0]))
    accounting = ImageAccounting(small_plan, recorder)
    account = accounting.settle()
    assert (account.missing, account.unmatched) == ((viewpoint.name,), 1)

    tell(1, ViewpointFate.MOVED, place)
    account = accounting.settle()
    assert account.complete and account.unmatched == 0
    assert account.misses_m[0] == pytest.approx(math.hypot(0.1, 2.3)), "the viewpoint stays where it was planned"
    (image,) = recorder.database.images.of_flight("f")
    assert (image.viewpoint_id, image.viewpoint_name) == (0, viewpoint.name)
    count_pictures_as_visits(account, small_plan, recorder)
    (visit,) = recorder.database.flights.visits("f")
    assert visit.miss_m == pytest.approx(math.hypot(0.1, 2.3))
    assert complete_by_pictures(account, recorder)


@pytest.mark.parametrize("off_m", [(0.0, -2.4, 0.0), (1.6, 0.0, 0.0)])
def test_a_picture_from_elsewhere_is_not_taken_for_it(small_plan, recorder, take, tell, off_m):
    (viewpoint,) = small_plan.viewpoints
    tell(1, ViewpointFate.MOVED, viewpoint.position_m + ASIDE_M)
    take("a", viewpoint.position_m + ASIDE_M + off_m)
    account = ImageAccounting(small_plan, recorder).settle()
    assert account.missing and account.unmatched == 1 and not account.at_place


def test_what_is_told_of_another_plan_or_taken_back_moves_nothing(small_plan, recorder, take, tell):
    (viewpoint,) = small_plan.viewpoints
    take("a", viewpoint.position_m)
    tell(1, ViewpointFate.MOVED, viewpoint.position_m + ASIDE_M, before=STRANGE)
    assert ImageAccounting(small_plan, recorder).settle().complete
    tell(2, ViewpointFate.MOVED, viewpoint.position_m + ASIDE_M)
    assert not ImageAccounting(small_plan, recorder).settle().complete
    tell(3, ViewpointFate.SKIPPED, before=AFTER)
    assert ImageAccounting(small_plan, recorder).settle().complete
