"""From a report on the link to the difference that is shown, and to the plan that is offered for what was skipped."""

import io
import re
import time
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from gcs.core.errors import InfeasibleError
from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.replanning import ReplanReason, ReplanReport, SeenObstacle, ViewpointChange, ViewpointFate
from gcs.mavlink.events import ReplanEvent, StationEvent
from gcs.services.flight_recorder import FlightRecorder
from gcs.storage.records import FlightState, ImageRecord, ImageState, TrackPoint

ANCHOR = GeoPoint(31.3622, 121.6155, 4.0)
AFTER, AT = "01" * 32, "2026-11-22T10:00:00Z"


def geo(*place_m):
    return GeoPoint(*(float(v) for v in geodetic_from_enu(np.array(place_m, float), ANCHOR)))


@pytest.fixture
def services(client):
    return client.app.state.services


@pytest.fixture
def started(services, flight):
    """A flight that has left the ground."""
    services.database.flights.update(flight["id"], state=FlightState.FLYING, started_at="2026-11-22T10:00:00Z")
    return flight


@pytest.fixture
def report(flight):
    """The only viewpoint is skipped for something that drives through."""
    return ReplanReport(
        boot_id=7,
        number=1,
        plan_hash=flight["plan_hash"],
        plan_hash_after=AFTER,
        reason=ReplanReason.MOVING_OBSTACLE,
        mission_item=-1,
        left_at_s=10.0,
        rejoined_at_s=14.0,
        obstacle=SeenObstacle(geo(8, 1, 10), 0.7, (1.0, -0.5)),
        path=(geo(6, 0, 10), geo(6, 2, 10), geo(6, 0, 10)),
        viewpoints=(ViewpointChange(0, ViewpointFate.SKIPPED, None),),
    )


@pytest.fixture
def tell(client, mavlink):
    """Have the vehicle send reports; gives the numbers that were acknowledged."""
    acknowledged = []
    mavlink.vehicles[1].acknowledge_replan = lambda report: acknowledged.append(report.number)

    def send(*reports):
        for report in reports:
            client.portal.call(mavlink.stream.publish, StationEvent(1, ReplanEvent(report)))
        return acknowledged

    return send


@pytest.fixture
def over(client, services, started):
    """End the flight as its recorder does."""

    def end():
        recorder = FlightRecorder(started["id"], services.database, services.images, services.feed)
        client.portal.call(recorder.enter, FlightState.INCOMPLETE, "0 of 1 images are here")

    return end


def until(ask, holds):
    for _ in range(300):
        answer = ask()
        if holds(answer):
            return answer
        time.sleep(0.02)
    raise AssertionError(answer)


@pytest.fixture
def replans(client, flight):
    return lambda: client.get(f"/api/flights/{flight['id']}/replans").json()


@pytest.fixture
def offers(client, flight):
    return lambda: client.get(f"/api/flights/{flight['id']}/offers").json()


@pytest.fixture
def offered(started, report, tell, over, offers):
    """An offer that stands."""
    tell(report)
    over()
    (offer,) = until(offers, lambda found: found and found[0]["state"] == "offered")
    return offer


def lines(client, flight, kind):
    return [e["text"] for e in client.get(f"/api/flights/{flight['id']}/events").json() if e["kind"] == kind]


def test_a_report_is_stored_once_acknowledged_always_and_shown_as_a_difference(client, started, report, tell, replans):
    until(lambda: len(tell(report)), lambda count: count >= 3)
    (shown,) = replans()
    assert shown["reason"] == "a moving obstacle"
    assert (shown["chain"], shown["plan_hash"], shown["plan_hash_after"]) == ("known", started["plan_hash"], AFTER)
    assert shown["obstacle"]["position_m"] == pytest.approx([8, 1, 10], abs=0.02)
    assert (shown["obstacle"]["radius_m"], shown["obstacle"]["velocity_m_s"]) == (0.7, [1.0, -0.5])
    assert shown["viewpoints"] == [{"viewpoint_id": 0, "name": "A, west", "fate": "skipped", "position_m": None}]
    assert shown["left_out"]["length_m"] == pytest.approx(4.0, abs=0.3)  # out to the viewpoint at 8 m, and back
    assert shown["left_out"]["from_s"] < shown["left_out"]["to_s"]
    assert (shown["flown_length_m"], shown["flown_duration_s"]) == (pytest.approx(4.0, abs=0.02), 4.0)
    assert lines(client, started, "replan") == ["the vehicle left the plan: a moving obstacle"]


def test_the_flights_page_has_a_row_for_each_departure(client, started, report, tell, over, replans, offers, services):
    url = f"/api/flights/{started['id']}/report.html"
    assert "None was reported." in client.get(url).text
    back = replace(
        report,
        number=2,
        plan_hash="ee" * 32,
        plan_hash_after="02" * 32,
        rejoined_at_s=None,
        obstacle=None,
        viewpoints=(),
    )
    tell(report, back)
    until(replans, lambda found: len(found) == 2)
    services.database.flights.add_track(started["id"], (TrackPoint(1.0, (0, 0, 10)), TrackPoint(2.0, (60, 0, 10))))
    over()
    until(offers, lambda found: found and found[0]["state"] == "offered")
    answer = client.get(url)
    assert answer.headers["content-type"].startswith("text/html")
    assert "sandbox" in answer.headers["content-security-policy"]
    first, second = re.findall("<tr>(<td>.*?)</tr>", re.search('<table class="d">.*?</table>', answer.text)[0])
    for words in (
        "a moving obstacle",
        "moving at 1.1 m/s, 1.4 m wide, at 8.0 / 1.0 / 10.0 m",
        "4.0 m in 4.0 s",  # flown instead
        "A, west: skipped",
        "10.0 s of the vehicle",
    ):
        assert words in first, first
    for words in ("does not know", "none told", "not known", "never back on the plan", "all taken"):
        assert words in second, second
    assert re.search("A, west, [0-9]+ m in [0-9]+ s: offered", answer.text)
    above = ElementTree.fromstring(answer.text[answer.text.index("<svg") : answer.text.index("</svg>") + 6])
    drawn = {e.get("class"): e.get("points").split() for e in above if e.tag == "polyline"}
    assert set(drawn) == {"p", "t", "f", "o", "r", "x"}
    xs = [float(pair.split(",")[0]) for pair in drawn["f"]]
    assert 0 <= min(xs) < max(xs) <= float(above.get("width")), "the frame holds what was flown, too"
    assert "<script" not in answer.text


def test_a_plan_that_is_not_known_is_said_once_and_its_reports_are_kept(client, started, report, tell, replans):
    strange = replace(report, plan_hash="ff" * 32)
    tell(strange, replace(strange, number=2, plan_hash=AFTER), replace(strange, number=3, plan_hash="ee" * 32))
    shown = until(replans, lambda found: len(found) == 3)
    assert [(r["chain"], r["left_out"]) for r in shown] == [("unknown", None)] * 3
    assert sum("does not know" in line for line in lines(client, started, "replan")) == 1


def test_viewpoints_of_a_plan_that_is_not_known_are_not_those_of_the_flight(
    client, started, report, tell, over, replans, offers
):
    tell(replace(report, plan_hash="ff" * 32))
    (shown,) = until(replans, bool)
    assert [(v["viewpoint_id"], v["name"]) for v in shown["viewpoints"]] == [(0, None)]
    over()
    refused = client.post(f"/api/flights/{started['id']}/offers")
    assert (refused.status_code, offers()) == (409, [])
    page = client.get(f"/api/flights/{started['id']}/report.html").text
    assert "viewpoint 0 of that plan: skipped" in page
    assert "as planned" in page
    tell(replace(report, boot_id=8))  # and one of this flight's own plan
    until(offers, lambda found: [o["viewpoints"] for o in found] == [[0]])


def test_a_report_that_comes_late_closes_the_gap(client, started, report, tell, replans):
    second = replace(report, number=2, plan_hash=AFTER, plan_hash_after="02" * 32)
    tell(second)
    assert [r["chain"] for r in until(replans, bool)] == ["gap"]
    assert any("missing" in line for line in lines(client, started, "replan"))
    tell(report)
    shown = until(replans, lambda found: len(found) == 2)
    assert [(r["number"], r["chain"]) for r in shown] == [(1, "known"), (2, "known")]


def test_a_vehicle_that_flew_nothing_for_this_station_keeps_its_reports(flight, report, tell, replans):
    assert tell(report, report) == []  # prepared, but never started
    assert replans() == []


def test_what_was_skipped_is_offered_when_the_flight_is_over_and_not_before(
    client, started, report, tell, over, replans, offers
):
    tell(report)
    until(replans, bool)
    assert offers() == []
    over()
    (offer,) = until(offers, lambda found: found and found[0]["state"] == "offered")
    assert (offer["viewpoints"], offer["names"]) == ([0], ["A, west"])
    assert offer["length_m"] > 0
    assert offer["duration_s"] > 0
    assert offer["plan_id"] is None
    assert len(client.get("/api/plans").json()) == 1  # not a plan of the station until somebody accepts it
    assert any("new plan is offered" in line for line in lines(client, started, "offer"))
    assert client.post(f"/api/flights/{started['id']}/offers").json()["id"] == offer["id"]


def test_an_accepted_offer_is_a_plan_that_can_be_flown(client, started, offered, jobs, services):
    url = f"/api/offers/{offered['id']}"
    accepted = client.post(f"{url}/accept").json()
    assert (accepted["state"], accepted["decided_at"] is not None) == ("accepted", True)
    plan = client.get(f"/api/plans/{accepted['plan_id']}").json()
    assert plan["state"] == "ready"
    flown = client.post("/api/flights", json={"plan_id": plan["id"], "vehicle": "px4-1"})
    assert flown.status_code in {201, 409}
    assert client.post(f"{url}/accept").json() == accepted
    refused = client.post(f"{url}/refuse")
    assert (refused.status_code, "accepted" in refused.json()["detail"]) == (409, True)
    assert not list((services.data_dir / "offers").iterdir())
    assert len([line for line in lines(client, started, "offer") if "accepted" in line]) == 1


def test_a_refused_offer_is_kept_with_its_time_and_can_be_asked_for_again(client, started, offered, offers):
    url = f"/api/offers/{offered['id']}"
    refused = client.post(f"{url}/refuse").json()
    assert (refused["state"], refused["plan_id"]) == ("refused", None)
    assert refused["decided_at"] is not None
    assert client.post(f"{url}/refuse").json() == refused
    accepted = client.post(f"{url}/accept")
    assert accepted.status_code == 409
    assert f"refused since {refused['decided_at']}" in accepted.json()["detail"]
    again = client.post(f"/api/flights/{started['id']}/offers")
    assert again.status_code == 202
    assert again.json()["id"] != offered["id"]
    assert [o["state"] for o in until(offers, lambda found: found[-1]["state"] == "offered")] == ["refused", "offered"]


def test_where_there_is_no_plan_the_offer_says_why(client, started, report, tell, over, offers, jobs):
    jobs.error = InfeasibleError("no way leads to A, west", field="viewpoints")
    tell(report)
    over()
    (offer,) = until(offers, lambda found: found and found[0]["state"] == "failed")
    assert offer["failure"]["message"] == "no way leads to A, west"
    response = client.post(f"/api/offers/{offer['id']}/accept")
    assert (response.status_code, "failed" in response.json()["detail"]) == (409, True)
    assert any("no way leads to A, west" in line for line in lines(client, started, "offer"))
    jobs.error = None
    assert client.post(f"/api/flights/{started['id']}/offers").json()["state"] == "planning"
    until(offers, lambda found: [o["state"] for o in found] == ["failed", "offered"])


def test_an_offer_that_is_still_being_made_cannot_be_accepted_and_moved_is_not_skipped(
    client, started, report, tell, over, offers, jobs
):
    jobs.hold = True
    moved_first = replace(report, viewpoints=(ViewpointChange(0, ViewpointFate.MOVED, geo(7, 0, 10)),))
    tell(moved_first)
    over()
    time.sleep(0.2)
    assert offers() == []  # a picture from another place is a picture
    tell(replace(report, number=2, plan_hash=AFTER, plan_hash_after="02" * 32))
    (offer,) = until(offers, bool)
    assert offer["state"] == "planning"
    assert client.post(f"/api/offers/{offer['id']}/accept").status_code == 409


def test_nothing_is_offered_where_nothing_was_skipped(client, flight):
    response = client.post(f"/api/flights/{flight['id']}/offers")
    assert response.status_code == 409
    assert "skipped no viewpoint" in response.json()["detail"]
    assert client.post("/api/offers/offer-9/accept").status_code == 404
    assert client.post("/api/flights/flight-9/offers").status_code == 404


def test_a_move_that_is_told_after_the_landing_gives_the_picture_to_its_viewpoint(
    client, services, started, report, tell, over
):
    place = np.array([6.0, 2.4, 10.0])
    file = io.BytesIO()
    Image.new("RGB", (16, 12)).save(file, "JPEG")
    recorder = FlightRecorder(started["id"], services.database, services.images, services.feed)
    image = ImageRecord("a", started["id"], 0, None, None, ImageState.ANNOUNCED, "link", AT, position_m=tuple(place))
    recorder.store_image(recorder.image(image), file.getvalue())
    over()
    tell(replace(report, viewpoints=(ViewpointChange(0, ViewpointFate.MOVED, geo(*place)),)))
    shown = until(lambda: client.get(f"/api/flights/{started['id']}").json(), lambda f: f["state"] == "completed")
    assert shown["problems"] == []
    (image,) = client.get(f"/api/flights/{started['id']}/images").json()
    assert image["viewpoint_id"] == 0
