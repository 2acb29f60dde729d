import zlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.clock import utc_now
from gcs.core.errors import ConflictError, LinkError, RefusedError, StorageError
from gcs.storage.records import ImageRecord, ImageState, TrackPoint


@pytest.fixture
def services(client):
    return client.app.state.services


def test_a_flight_is_prepared_and_nothing_is_sent(client, flight, services):
    assert flight["state"] == "created"
    assert flight["vehicle"] == "px4-1"
    assert (flight["viewpoints"], flight["viewpoints_reached"], flight["images_received"]) == (1, 0, 0)
    assert flight["actions"] == ["upload"]
    assert services.flights.asked == ["open"]
    assert client.get("/api/flights").json() == [flight]


@pytest.mark.parametrize("change", [{"plan_id": "plan-9"}, {"vehicle": "px4-9"}])
def test_a_flight_of_nothing_is_not_found(client, ready_plan, change):
    body = {"plan_id": ready_plan["id"], "vehicle": "px4-1", **change}
    assert client.post("/api/flights", json=body).status_code == 404


@pytest.mark.parametrize("action", ["start", "resume"])
@pytest.mark.parametrize("body", [{}, {"confirm": ""}, {"confirm": "px4-2"}, {"confirm": "yes"}, {"confirm": "PX4-1"}])
def test_start_and_resume_need_a_confirmation_that_names_the_vehicle(client, flight, services, action, body):
    response = client.post(f"/api/flights/{flight['id']}/{action}", json=body)
    assert response.status_code in {403, 422}
    assert response.json()["field"] == "confirm"
    assert services.flights.asked == ["open"]


@pytest.mark.parametrize("name", ["px4-1", "1"])
def test_a_flight_is_uploaded_started_paused_resumed_and_brought_home(client, flight, services, name):
    def post(action, **body):
        response = client.post(f"/api/flights/{flight['id']}/{action}", json=body)
        return response.status_code, response.json()["state"]

    assert post("upload", accept=["NAV_DLL_ACT"]) == (202, "uploading")
    assert post("start", confirm=name) == (200, "flying")
    assert post("pause") == (200, "paused")
    assert post("resume", confirm=name) == (200, "flying")
    assert post("return", confirm=name) == (200, "returning")
    assert post("land") == (200, "landing")
    assert services.flights.asked == [
        "open",
        ("upload", ("NAV_DLL_ACT",)),
        ("start", name, ()),
        ("pause",),
        ("resume", name, ()),
        ("return",),
        ("land",),
    ]


def test_a_command_that_confirms_another_vehicle_is_refused(client, flight, services):
    response = client.post(f"/api/flights/{flight['id']}/land", json={"confirm": "px4-2"})
    assert response.status_code == 403
    assert services.flights.asked == ["open"]


def test_no_get_commands_anything(client, flight, services):
    for action in ("upload", "cancel-transfer", "start", "pause", "resume", "return", "land", "read-back"):
        assert client.get(f"/api/flights/{flight['id']}/{action}").status_code in {404, 405}
    assert services.flights.asked == ["open"]


@pytest.mark.parametrize(
    ("error", "status"),
    [(RefusedError("no"), 403), (ConflictError("busy"), 409), (LinkError("gone"), 504), (StorageError("full"), 507)],
)
def test_what_a_vehicle_or_the_disk_refuses_is_a_problem(client, flight, services, error, status):
    services.flights.error = error
    response = client.post(f"/api/flights/{flight['id']}/start", json={"confirm": "px4-1"})
    assert (response.status_code, response.json()["detail"]) == (status, error.message)
    assert response.json()["title"] == error.title


def test_preflight_names_what_can_be_accepted(client, flight):
    report = client.get(f"/api/flights/{flight['id']}/preflight").json()
    assert report["ok"] is False
    assert report["checks"][0]["accept"] == "NAV_DLL_ACT"


def test_what_is_on_the_vehicle_has_scene_positions_and_nulls_for_unset(client, flight):
    held = client.get(f"/api/flights/{flight['id']}/on-vehicle").json()
    assert held["state"] == "proved"
    assert held["equal"] is True
    take_off, photo = held["items"]
    assert take_off["position_m"] == pytest.approx([0, 0, 10], abs=0.02)
    assert take_off["params"][3] is None
    assert photo["position_m"] is None
    assert photo["viewpoint_id"] == 0
    assert client.post(f"/api/flights/{flight['id']}/read-back").json()["items"] == held["items"]


def test_the_records_of_a_flight_are_read(client, flight, services):
    flights, flight_id = services.database.flights, flight["id"]
    first = flights.log(flight_id, "state", "armed")
    flights.log(flight_id, "problem", "a gust", severity=4, data={"speed_m_s": 12})
    flights.add_track(flight_id, [TrackPoint(1000.0 + k, (k, 0, 10), 0.1) for k in range(3)])
    flights.add_visit(flight_id, 0, 0.12)

    url = f"/api/flights/{flight_id}"
    events = client.get(f"{url}/events").json()
    assert [e["text"] for e in events] == ["armed", "a gust"]
    assert [e["text"] for e in client.get(f"{url}/events?after={first.id}").json()] == ["a gust"]
    track = client.get(f"{url}/track?after_s=1000").json()
    assert [p["position_m"][0] for p in track["points"]] == [1, 2]
    detail = client.get(url).json()
    assert detail["viewpoints_reached"] == 1
    assert detail["visits"][0]["miss_m"] == 0.12
    for part in ("", "/events", "/track", "/replans", "/offers"):
        assert client.get(f"/api/flights/flight-9{part}").status_code == 404


def test_pictures_are_listed_and_given_out_once_they_are_stored(client, flight, services):
    jpeg = b"\xff\xd8\xff" + b"picture" * 100
    image = services.database.images.add(
        ImageRecord(
            "image-1", flight["id"], 0, 0, "A, west", ImageState.ANNOUNCED, "link", utc_now(), vehicle_path="/../x.jpg"
        )
    )
    (listed,) = client.get(f"/api/flights/{flight['id']}/images").json()
    assert (listed["state"], listed["viewpoint_name"]) == ("announced", "A, west")
    assert client.get("/api/images/image-1/file").status_code == 404
    stored = services.images.save(image, jpeg)
    services.database.images.update("image-1", state=ImageState.STORED, **vars(stored))
    assert client.get("/api/images/image-1").json()["crc32"] == zlib.crc32(jpeg)
    file = client.get("/api/images/image-1/file")
    assert (file.content, file.headers["content-type"]) == (jpeg, "image/jpeg")
    assert client.get("/api/images/image-9").status_code == 404


def test_a_plan_that_was_flown_is_kept(client, flight):
    assert client.delete(f"/api/plans/{flight['plan_id']}").status_code == 409


def test_the_telemetry_log_is_downloaded_under_the_flights_name(client, flight, services):
    url = f"/api/flights/{flight['id']}/telemetry-log"
    assert client.get(f"/api/flights/{flight['id']}").json()["telemetry_log"] is None
    missing = client.get(url)
    assert (missing.status_code, missing.json()["field"]) == (404, flight["id"])
    log = services.telemetry_logs.open(flight["id"], pytest.fail)
    packet = bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(mavlink.MAVLink(None)))
    for _ in range(10):
        log.record(packet)
    log.close()
    name, size = f"{flight['id']}.tlog", 10 * (8 + len(packet))
    assert client.get(f"/api/flights/{flight['id']}").json()["telemetry_log"] == {"name": name, "size_bytes": size}
    file = client.get(url)
    assert file.status_code == 200
    assert file.headers["content-disposition"] == f'attachment; filename="{name}"'
    assert (file.headers["content-type"], file.headers["content-length"]) == ("application/octet-stream", str(size))
    assert file.content == log.path.read_bytes()


@pytest.mark.parametrize("flight_id", ["flight-9", "..%2f..%2fgcs.sqlite3", "%2e%2e", "a%00b"])
def test_there_is_no_telemetry_log_of_a_flight_that_is_not(client, flight, flight_id):
    assert client.get(f"/api/flights/{flight_id}/telemetry-log").status_code == 404


def test_the_telemetry_log_needs_the_session(outside):
    assert outside.get("/api/flights/flight-1/telemetry-log").status_code == 401
