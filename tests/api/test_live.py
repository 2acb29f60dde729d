import time

import pytest

from gcs.api.schemas.live import LiveMessage
from gcs.core.clock import utc_now
from gcs.core.vehicle import StatusText
from gcs.mavlink.companion_lease import LeaseState, LeaseStatus
from gcs.mavlink.events import StationEvent, StatusTextEvent
from gcs.services import live_feed
from gcs.services.flight_types import LeaseView
from gcs.storage.records import TrackPoint


@pytest.fixture
def services(client):
    return client.app.state.services


@pytest.fixture
def live(client):
    with client.websocket_connect("/api/live", headers={**client.headers, "Host": "127.0.0.1:8080"}) as stream:
        yield stream


def next_of(live, kind):
    for _ in range(200):
        message = LiveMessage.model_validate(live.receive_json()).root
        if message.type == kind:
            return message
    raise AssertionError(kind)


def test_the_first_message_is_all_that_is_known(live):
    message = LiveMessage.model_validate(live.receive_json()).root
    assert (message.type, message.reason) == ("snapshot", "start")
    assert [v.name for v in message.vehicles] == ["px4-1"]


def test_planning_is_told_as_it_goes(live, client, scenario, jobs):
    jobs.hold = True
    accepted = client.post("/api/plans", json={"scenario": scenario}).json()
    assert next_of(live, "plan").plan.state == "planning"
    job = next_of(live, "job").job
    assert (job.id, job.stage) == (accepted["job"]["id"], "viewpoints")
    client.post(f"/api/plans/{accepted['plan']['id']}/cancel")
    assert next_of(live, "job").job.state == "cancelled"
    assert next_of(live, "plan").plan.state == "cancelled"


def test_a_vehicle_is_told_again_so_that_its_ages_stay_true(live):
    first = next_of(live, "telemetry").vehicle
    second = next_of(live, "telemetry").vehicle
    assert second.last_heard_age_s > first.last_heard_age_s


def test_what_a_vehicle_says_is_told_and_kept(live, client, services, mavlink):
    event = StationEvent(1, StatusTextEvent(StatusText(4, "Compass <b>inconsistent</b>")))
    client.portal.call(lambda: mavlink.stream.publish(event))
    message = next_of(live, "message").message
    assert (message.vehicle, message.severity) == ("px4-1", 4)
    (kept,) = client.get("/api/vehicles/px4-1/messages").json()
    assert kept["text"] == "Compass <b>inconsistent</b>"
    assert client.get(f"/api/vehicles/px4-1/messages?after={kept['number']}").json() == []


def test_a_flight_and_its_records_are_told(live, client, flight, services):
    client.post(f"/api/flights/{flight['id']}/upload", json={})
    records = services.database.flights
    services.feed.publish(live_feed.FlightChanged(records.summary(flight["id"])))
    assert next_of(live, "flight").flight.state == "uploading"
    services.feed.publish(live_feed.UploadProgressed(flight["id"], "send", 0.5))
    assert next_of(live, "upload").fraction == 0.5
    services.feed.publish(live_feed.EventLogged(records.log(flight["id"], "state", "armed")))
    assert next_of(live, "event").event.text == "armed"
    services.feed.publish(live_feed.TrackGrew(flight["id"], (TrackPoint(1.0, (1, 2, 3), None),)))
    assert next_of(live, "track").points[0].position_m == (1, 2, 3)


def test_a_silent_stream_still_beats(live, mavlink, services):
    mavlink.vehicles.clear()
    assert next_of(live, "heartbeat").at <= utc_now()


def test_a_client_that_left_is_forgotten(client, services):
    with client.websocket_connect("/api/live", headers={**client.headers, "Host": "127.0.0.1:8080"}) as stream:
        stream.receive_json()
        assert services.feed.clients == 1
    for _ in range(100):
        if services.feed.clients == 0:
            break
        client.get("/api/status")
    assert services.feed.clients == 0


def test_where_a_companions_lease_stands_is_told_and_in_every_snapshot(live, client, flight, services):
    status = LeaseStatus(
        lease=0xC0FFEE,
        state=LeaseState.LEADING,
        away=2,
        plan_hash="ab" * 32,
        plan_time_s=12.5,
        reports_pending=3,
        lidar_age_s=0.125,
        odometry_quality=87,
        text="leads, <b>lease</b>",
    )
    assert client.get(f"/api/flights/{flight['id']}").json()["lease"] is None
    view = LeaseView(flight["id"], status, time.monotonic() - 2.0)
    services.flights.leases[flight["id"]] = view
    services.feed.publish(live_feed.LeaseTold(view))
    told = next_of(live, "lease").lease.model_dump()
    assert 2.0 <= told.pop("age_s") < 60.0
    assert told == {
        "flight_id": flight["id"],
        "lease": "00c0ffee",
        "state": "leading",
        "text": "leads, <b>lease</b>",
        "away": "a moving obstacle",
        "plan_time_s": 12.5,
        "reports_pending": 3,
        "lidar_age_s": 0.125,
        "odometry_quality": 87,
    }
    answered = client.get(f"/api/flights/{flight['id']}").json()["lease"]
    with client.websocket_connect("/api/live", headers={**client.headers, "Host": "127.0.0.1:8080"}) as stream:
        (shown,) = stream.receive_json()["leases"]
    assert {**answered, "age_s": 0} == {**shown, "age_s": 0} == {**told, "age_s": 0}


def test_what_a_companion_does_not_have_is_null_and_a_reason_from_later_is_said_to_be_unknown(live, flight, services):
    status = LeaseStatus(lease=1, state=LeaseState.TAKEN_OVER, away=77)
    services.feed.publish(live_feed.LeaseTold(LeaseView(flight["id"], status, time.monotonic())))
    told = next_of(live, "lease").lease
    assert (told.state, told.lidar_age_s, told.odometry_quality) == ("taken_over", None, None)
    assert told.away == "a reason that this station does not know (77)"
