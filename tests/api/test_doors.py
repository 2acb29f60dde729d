"""Safety rule 10: no web page opened by chance can command a vehicle."""

import os
from dataclasses import replace

import pytest
from fastapi.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from gcs.api.app import create_app
from gcs.api.doors import split_host
from gcs.api.session_token import session_token
from gcs.services.station import StationServices


def assert_problem(response, status):
    assert response.status_code == status
    assert response.headers["content-type"] == "application/problem+json"
    assert response.json()["status"] == status


def test_without_a_token_nothing_of_the_api_answers(outside):
    for path in ("/api/status", "/api/vehicles", "/api/openapi.json", "/api", "/api/nothing"):
        assert_problem(outside.get(path), 401)
    assert_problem(outside.post("/api/links", json={"url": "udpin:127.0.0.1:14550"}), 401)


@pytest.mark.parametrize("token", ["wrong", "", "ü", "Bearer"])
def test_a_wrong_token_is_refused(outside, token):
    assert_problem(outside.get("/api/status", headers={"Authorization": f"Bearer {token}".encode()}), 401)
    assert_problem(outside.get("/api/status", headers={"Cookie": f"gcs_session={token}".encode()}), 401)


def test_the_token_is_never_taken_from_the_url(outside, settings):
    token = session_token(settings.data_dir)
    for name in ("token", "gcs_session", "access_token"):
        assert_problem(outside.get(f"/api/status?{name}={token}"), 401)


def test_the_page_brings_the_session_as_a_cookie_that_scripts_cannot_read(outside):
    response = outside.get("/")
    assert response.status_code == 200
    cookie = response.headers["set-cookie"].lower()
    assert "gcs_session=" in cookie
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert outside.get("/api/status").status_code == 200


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "https://127.0.0.1:8080", "http://127.0.0.1:8081", "http://localhost:8080", "null", ""],
)
def test_a_page_of_another_origin_is_refused_even_with_the_session(client, origin):
    for method, path in (("POST", "/api/links"), ("GET", "/api/status"), ("GET", "/"), ("OPTIONS", "/api/links")):
        response = client.request(method, path, headers={"Origin": origin}, json={"url": "udpin:127.0.0.1:14550"})
        assert_problem(response, 403)
        assert "access-control-allow-origin" not in response.headers
    assert client.get("/api/links").json() == []


def test_the_own_page_may_call(client):
    response = client.get("/api/status", headers={"Origin": "http://127.0.0.1:8080"})
    assert response.status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8080", "127.0.0.1", "127.0.0.1:80", "192.168.1.7:8080", "[::1", "", "a:b"]
)
def test_a_request_that_names_another_host_is_refused(client, host):
    """A page whose name was led to this machine (DNS rebinding) still names itself in the Host header."""
    assert_problem(client.get("/api/status", headers={"Host": host}), 403)
    assert_problem(client.get("/", headers={"Host": host}), 403)


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080"])
def test_loopback_names_with_the_right_port_are_own(client, host):
    assert client.get("/api/status", headers={"Host": host}).status_code == 200


def test_host_headers_are_split():
    assert split_host("a.example") == ("a.example", 80)
    assert split_host("[::1]:8080") == ("::1", 8080)
    for bad in ("", ":8080", "a:b", "a:123456", "[::1]8080", "a:", "a:-1", "a:１"):
        assert split_host(bad) is None


def test_the_live_stream_has_the_same_doors(outside, settings):
    token = session_token(settings.data_dir)
    host = {"Host": "127.0.0.1:8080"}
    good = {**host, "Authorization": f"Bearer {token}"}
    for headers in (host, {**good, "Origin": "http://evil.example"}, {**good, "Host": "evil.example:8080"}):
        with pytest.raises(WebSocketDisconnect) as closed, outside.websocket_connect("/api/live", headers=headers):
            pass
        assert closed.value.code == 1008
    with outside.websocket_connect("/api/live", headers={**good, "Origin": "http://127.0.0.1:8080"}) as live:
        assert live.receive_json()["type"] == "snapshot"


def test_pages_load_nothing_from_elsewhere(client):
    for path in ("/", "/assets/main.js", "/api/status"):
        response = client.get(path)
        assert response.status_code == 200
        policy = response.headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert response.headers["x-content-type-options"] == "nosniff"


def test_files_outside_the_dashboard_are_not_served(client, settings):
    for path in ("/../data/token", "/%2e%2e/data/token", "/assets/..%2f..%2fdata%2ftoken"):
        response = client.get(path)
        assert response.status_code == 404
        assert session_token(settings.data_dir) not in response.text


def test_the_token_is_readable_by_its_owner_alone_and_stays(tmp_path):
    first = session_token(tmp_path)
    assert (tmp_path / "token").stat().st_mode & 0o777 == 0o600
    (tmp_path / "token").chmod(0o644)
    assert session_token(tmp_path) == first
    assert (tmp_path / "token").stat().st_mode & 0o777 == 0o600
    (tmp_path / "token").write_text("")
    assert len(session_token(tmp_path)) >= 32
    assert os.stat(tmp_path / "token").st_mode & 0o777 == 0o600  # noqa: PTH116


def test_a_browser_on_another_machine_must_give_the_token(settings, jobs, mavlink):
    services = StationServices(settings.data_dir, make_mavlink=lambda: mavlink, make_jobs=lambda: jobs)
    app = create_app(replace(settings, host="0.0.0.0"), services)
    with TestClient(app, base_url="http://192.168.1.7:8080", client=("192.168.1.50", 4711)) as remote:
        page = remote.get("/")
        assert "set-cookie" not in page.headers
        assert "Token" in page.text
        own = {"Origin": "http://192.168.1.7:8080"}
        assert remote.post("/session", data={"token": "guess"}, headers=own).status_code == 403
        assert_problem(remote.get("/api/status"), 401)
        given = {"token": session_token(settings.data_dir)}
        assert remote.post("/session", data=given, headers=own, follow_redirects=False).status_code == 303
        assert remote.get("/api/status").status_code == 200
        assert_problem(remote.get("/api/status", headers={"Host": "station.example:8080"}), 403)


def test_without_a_built_dashboard_the_page_says_how_to_build_it(settings, jobs, mavlink, tmp_path):
    services = StationServices(settings.data_dir, make_mavlink=lambda: mavlink, make_jobs=lambda: jobs)
    app = create_app(replace(settings, dashboard_dir=tmp_path / "not built"), services)
    with TestClient(app, base_url="http://localhost:8080", client=("127.0.0.1", 50000)) as client:
        response = client.get("/")
        assert response.status_code == 503
        assert "make run" in response.text
        assert client.get("/api/status").status_code == 200
