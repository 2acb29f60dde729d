import pytest

from gcs.api.schemas.live import LiveMessage
from gcs.core.clock import utc_now
from gcs.core.vehicle import StatusText
from gcs.mavlink.events import StationEvent, StatusTextEvent
from gcs.services import live_feed
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
