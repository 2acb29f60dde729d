"""From a report that viewpoints were skipped to a plan for them, made by the real planner in its worker processes."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.errors import ConflictError
from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.replanning import ReplanReason, ReplanReport, ViewpointChange, ViewpointFate
from gcs.mavlink.events import EventStream
from gcs.services.flight_recorder import FlightRecorder
from gcs.services.plan_verification import verify_plan
from gcs.services.station import StationServices
from gcs.storage.plan_files import plan_hash, read_plan
from gcs.storage.records import FlightState, OfferState, PlanState

pytestmark = pytest.mark.system

FLIGHT = "flight-1"


class NoLinks:
    """A MAVLink side on which nothing is heard."""

    links = ()

    def __init__(self):
        self.vehicles = {}
        self.events = EventStream().read

    async def close_all(self):
        pass


@pytest.fixture
async def station(tmp_path, make_no_flights, flight_on_record):
    """A station on whose record is a flight of the box that has begun."""
    services = StationServices(tmp_path, make_mavlink=NoLinks, make_flights=make_no_flights)
    async with services.running(lambda event: ""):
        flight_on_record(services)
        yield services


@pytest.fixture
def skip(station, box_plan):
    """Have the vehicle report that it skipped some viewpoints, and see the report stored."""
    plan = read_plan(box_plan)
    acknowledged = []
    vehicle = SimpleNamespace(
        identity=SimpleNamespace(system_id=1, name="px4-1"),
        acknowledge_replan=lambda report: acknowledged.append(report.number),
    )
    told = [plan_hash(box_plan)]

    def report(*viewpoints):
        where = plan.trajectory.value(np.array([plan.viewpoints[0].time_s]))
        latitude, longitude, altitude = geodetic_from_enu(where[0], plan.scenario.anchor.point)
        number = len(told)
        told.append(f"{number:02x}" * 32)
        station.replans.take(
            vehicle,
            ReplanReport(
                boot_id=7,
                number=number,
                plan_hash=told[-2],
                plan_hash_after=told[-1],
                reason=ReplanReason.VIEWPOINT_BLOCKED,
                mission_item=-1,
                left_at_s=10.0 * number,
                rejoined_at_s=10.0 * number + 5.0,
                obstacle=None,
                path=(GeoPoint(float(latitude), float(longitude), float(altitude)),) * 2,
                viewpoints=tuple(ViewpointChange(v, ViewpointFate.SKIPPED, None) for v in viewpoints),
            ),
        )
        assert acknowledged[-1] == number

    return report


def land(station):
    recorder = FlightRecorder(FLIGHT, station.database, station.images, station.feed)
    recorder.enter(FlightState.INCOMPLETE, "some pictures are missing")


async def offers(station, *states):
    """The offers of the flight, as soon as they stand like this."""
    end = time.monotonic() + 200
    while (found := station.offers.of_flight(FLIGHT)) is None or tuple(o.state for o in found) != states:
        assert time.monotonic() < end, found
        await asyncio.sleep(0.05)
    return found


async def test_an_offered_plan_flies_exactly_what_was_skipped_and_holds_by_itself(station, skip, box_plan):
    flown = read_plan(box_plan)
    skip(1, 2)
    land(station)
    (offer,) = await offers(station, OfferState.OFFERED)
    accepted = station.offers.accept(offer.id)
    assert accepted.state is OfferState.ACCEPTED
    view = station.plans.get(accepted.plan_id)
    assert view.plan.state is PlanState.READY
    assert "report.html" in view.files
    made = station.plans.read(accepted.plan_id)
    wanted = {v.name: v for v in flown.viewpoints if v.id in (1, 2)}
    assert {v.name for v in made.viewpoints} == set(wanted) == set(offer.names)
    for viewpoint in made.viewpoints:
        assert np.allclose(viewpoint.position_m, wanted[viewpoint.name].position_m, atol=1e-6)
        assert np.allclose(viewpoint.direction, wanted[viewpoint.name].direction, atol=1e-6)
    ends = made.trajectory.value(np.array([0.0, made.trajectory.duration_s]))
    assert np.allclose(ends, flown.scenario.home_m, atol=1e-6)
    assert made.trajectory.duration_s == pytest.approx(offer.duration_s, rel=0.01)
    checks = verify_plan(station.plans.directory(accepted.plan_id))
    whole_inspection = {"W", "coverage"}  # which the other viewpoints see
    assert {check.name for check in checks if not check.ok} <= whole_inspection
    assert {"min_clearance_m", "corridor_violation_m"} <= {check.name for check in checks if check.ok}
    with pytest.raises(ConflictError, match="accepted"):
        station.offers.refuse(offer.id)


async def test_a_later_report_makes_the_offer_stale_whether_it_is_made_or_being_made(station, skip):
    skip(1)
    land(station)
    (first,) = await offers(station, OfferState.OFFERED)
    folder = station.data_dir / "offers"
    assert (folder / first.id / "plan.json").is_file()
    skip(2)  # one that the companion delivers after the landing
    first, second = await offers(station, OfferState.SUPERSEDED, OfferState.PLANNING)
    assert not (folder / first.id).exists()
    with pytest.raises(ConflictError, match="superseded"):
        station.offers.accept(first.id)
    skip(0)
    *_, third = await offers(station, OfferState.SUPERSEDED, OfferState.SUPERSEDED, OfferState.OFFERED)
    assert (first.viewpoints, second.viewpoints, set(third.viewpoints)) == ((1,), (1, 2), {0, 1, 2})
    assert [entry.name for entry in folder.iterdir()] == [third.id]
    refused = station.offers.refuse(third.id)
    assert (refused.state, refused.plan_id) == (OfferState.REFUSED, None)
    assert list(folder.iterdir()) == []
    assert len(station.plans.list()) == 1, "nothing that was not accepted is a plan of the station"
    with pytest.raises(ConflictError, match="refused since"):
        station.offers.accept(third.id)
