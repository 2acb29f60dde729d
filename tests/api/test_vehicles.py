from dataclasses import replace

import pytest

from gcs.core.vehicle import Heard
from gcs.mavlink.routing import WayInfo
from gcs.mavlink.signing import SigningStatus, Verdict


def test_every_value_has_its_age_and_unknown_is_null(client):
    (vehicle,) = client.get("/api/vehicles").json()
    assert vehicle["name"] == "px4-1"
    assert vehicle["link_quality"] == pytest.approx(0.9)
    assert vehicle["round_trip_s"] == pytest.approx(0.05)
    assert vehicle["armed"]["value"] is False
    assert vehicle["armed"]["stale"] is False
    assert vehicle["mode"]["value"] == "hold"
    assert vehicle["landed"]["value"] == "on_ground"
    assert vehicle["yaw_deg"]["value"] == pytest.approx(90)
    assert vehicle["velocity_m_s"]["value"] == [1, 2, 3]
    assert vehicle["position"]["stale"] is True
    assert vehicle["position"]["age_s"] == pytest.approx(60, abs=10)
    assert vehicle["battery"]["value"] == {"remaining": 0.8, "voltage_v": 15.2, "current_a": None}
    for unknown in ("attitude", "gimbal_pitch_deg", "home", "mission", "gps_fix", "satellites", "ready_to_arm"):
        assert vehicle[unknown] is None
    assert client.get("/api/vehicles/px4-1").json()["system_id"] == 1
    assert client.get("/api/vehicles/1").json()["name"] == "px4-1"


def test_nothing_of_a_vehicle_that_is_not_heard_looks_fresh(client, mavlink):
    mavlink.vehicles[1].connected = False
    (vehicle,) = client.get("/api/vehicles").json()
    assert vehicle["connected"] is False
    assert all(v["stale"] for v in vehicle.values() if isinstance(v, dict))


def test_a_value_that_stays_unheard_grows_old(client, mavlink):
    vehicle = mavlink.vehicles[1]
    armed = vehicle.telemetry.armed
    vehicle.telemetry = replace(vehicle.telemetry, armed=Heard(True, armed.at_s - 3.5))
    assert client.get("/api/vehicles").json()[0]["armed"]["stale"] is True


def test_an_unknown_vehicle_is_a_problem(client):
    response = client.get("/api/vehicles/px4-7")
    assert (response.status_code, response.json()["title"]) == (404, "Not found")
    assert client.get("/api/vehicles/px4-7/messages").status_code == 404


def test_links_are_opened_kept_and_closed(client):
    opened = client.post("/api/links", json={"url": "udpin:127.0.0.1:14550"})
    assert opened.status_code == 201
    link = opened.json()
    assert link["state"] == "open"
    again = client.post("/api/links", json={"url": "udpin://127.0.0.1:14550"}).json()
    assert again["id"] == link["id"]
    (listed,) = client.get("/api/links").json()
    assert (listed["messages_per_s"], listed["peers"]) == (12.5, ["127.0.0.1:14550"])

    client.__exit__(None, None, None)
    client.__enter__()
    assert [entry["id"] for entry in client.get("/api/links").json()] == [link["id"]]

    assert client.delete(f"/api/links/{link['id']}").status_code == 204
    assert client.get("/api/links").json() == []
    assert client.delete(f"/api/links/{link['id']}").status_code == 404


def test_a_link_that_cannot_be_opened_is_a_problem_and_not_kept(client):
    assert client.post("/api/links", json={"url": "carrier pigeon"}).status_code == 422
    response = client.post("/api/links", json={"url": "udpin:127.0.0.1:1"})
    assert (response.status_code, response.json()["title"]) == (504, "No link")
    assert client.get("/api/links").json() == []


def test_the_status_counts(client):
    client.post("/api/links", json={"url": "udpin:127.0.0.1:14550"})
    status = client.get("/api/status").json()
    assert (status["vehicles"], status["links"], status["jobs_running"], status["flights_open"]) == (1, 1, 0, 0)
    assert status["version"]


def test_signing_needs_an_open_link_and_a_passphrase_to_keep_the_key_with(client, monkeypatch):
    monkeypatch.delenv("GCS_KEY", raising=False)
    assert client.post("/api/links/none/signing", json={"vehicle": "px4-1"}).status_code == 404
    link = client.post("/api/links", json={"url": "udpin:127.0.0.1:14550"}).json()
    assert link["signing"] is None
    response = client.post(f"/api/links/{link['id']}/signing", json={"vehicle": "px4-1"})
    assert response.status_code == 422
    assert "GCS_KEY" in response.text
    response = client.delete(f"/api/links/{link['id']}/signing", params={"vehicle": "px4-1"})
    assert (response.status_code, "not signed" in response.text) == (404, True)


def test_a_vehicle_tells_its_ways_with_their_signing_and_a_clash_of_ids(client, mavlink, monkeypatch):
    counts = {**dict.fromkeys(Verdict, 0), Verdict.GOOD: 90, Verdict.UNSIGNED: 4}
    signing = SigningStatus(True, counts, "unsigned packets come in", "2026-11-22T10:00:00Z")
    ways = (
        WayInfo("serial:/dev/ttyUSB0:57600", "serial", True, 0.02, 0.3, 0.1, signing),
        WayInfo("udpin:127.0.0.1:14550", "127.0.0.1:14550", False, 0.2, None, 1.2),
    )
    monkeypatch.setattr(mavlink, "ways", lambda vehicle: ways)
    mavlink.vehicles[1].id_clash = "clocks 30 s apart are heard in turns"
    vehicle = client.get("/api/vehicles/px4-1").json()
    used, spare = vehicle["ways"]
    figures = {"used": True, "loss": 0.02, "round_trip_s": 0.3, "age_s": 0.1, "peer": "serial"}
    assert used | figures == used
    assert (used["signing"]["good"], used["signing"]["unsigned"], used["signing"]["rejects_unsigned"]) == (90, 4, True)
    assert used["signing"]["problem"] == "unsigned packets come in"
    assert used["signing"]["rotated_at"] == "2026-11-22T10:00:00Z"
    assert (spare["used"], spare["signing"]) == (False, None)
    assert vehicle["id_clash"] == "clocks 30 s apart are heard in turns"
