import hashlib

import pytest

from gcs.core.errors import InfeasibleError
from gcs.storage.records import PlanState


def assert_problem(response, status, field=None):
    assert response.headers["content-type"] == "application/problem+json"
    problem = response.json()
    assert (response.status_code, problem["status"]) == (status, status)
    assert problem["instance"] == response.request.url.path
    assert problem["type"].startswith("urn:gcs:problem:")
    assert "Traceback" not in response.text
    if field is not None:
        assert problem["field"] == field
    return problem


def test_a_plan_is_made_drawn_and_downloaded(client, scenario, wait_for_plan):
    response = client.post("/api/plans", json={"scenario": scenario})
    assert response.status_code == 202
    accepted = response.json()
    assert accepted["plan"]["state"] == "planning"
    assert accepted["job"]["plan_id"] == accepted["plan"]["id"]

    plan = wait_for_plan(accepted["plan"]["id"])
    assert plan["state"] == "ready"
    assert plan["name"] == "box <1>"
    assert plan["job"]["state"] == "done"
    assert plan["report"]["min_clearance_m"] == 3.5
    assert plan["report"]["mission_items"] == 5
    assert {"plan.json", "structure.ply", "report.html"} <= set(plan["files"])
    assert client.get("/api/plans").json() == [plan]

    content = client.get(f"/api/plans/{plan['id']}/files/plan.json").content
    assert hashlib.sha256(content).hexdigest() == plan["plan_hash"]
    page = client.get(f"/api/plans/{plan['id']}/files/report.html")
    assert page.headers["content-type"].startswith("text/html")
    assert "sandbox" in page.headers["content-security-policy"]


def test_the_drawing_is_in_degrees_and_millimetres(client, ready_plan):
    detail = client.get(f"/api/plans/{ready_plan['id']}/detail").json()
    assert detail["anchor"] == {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.0}
    (viewpoint,) = detail["viewpoints"]
    assert viewpoint["gsd_mm"] == pytest.approx(1.1)
    assert viewpoint["position_m"] == [8, 0, 10]
    trajectory = detail["trajectory"]
    columns = {len(trajectory[name]) for name in ("t_s", "position_m", "speed_m_s", "yaw_deg", "gimbal_pitch_deg")}
    assert len(columns) == 1
    assert trajectory["t_s"][-1] == pytest.approx(22.013)
    assert trajectory["yaw_deg"][0] == pytest.approx(28.648, abs=1e-3)
    assert trajectory["position_m"][-1] == pytest.approx([0, 0, 0], abs=1e-4)
    assert detail["coverage"]["seen"] == [True, True, True, False, False, False]
    assert detail["coverage"]["samples"] == 6
    assert len(detail["corridor"]) == 4
    assert detail["cables"][0]["radius_m"] == 0.05


def test_a_scenario_that_is_wrong_names_its_field(client, scenario):
    scenario["vehicle"] = {"max_speed_m_s": -1}
    problem = assert_problem(client.post("/api/plans", json={"scenario": scenario}), 422, "vehicle.max_speed_m_s")
    assert "greater than 0" in problem["detail"]
    assert client.get("/api/plans").json() == []


@pytest.mark.parametrize("body", [{}, {"scenario": 3}, {"scenario": {}, "colour": "red"}, []])
def test_a_request_that_is_wrong_is_a_problem_too(client, body):
    assert_problem(client.post("/api/plans", json=body), 422)


def test_a_body_that_is_not_json_is_a_problem_too(client):
    assert_problem(client.post("/api/plans", content=b"{", headers={"Content-Type": "application/json"}), 422)


@pytest.mark.parametrize("file", ["/etc/passwd", "../token", "mesh-1/../../token", "mesh-2/mesh.stl", "mesh-1"])
def test_meshes_come_from_the_stations_own_folder_only(client, scenario, file):
    scenario["structure"] = {"meshes": [{"file": file}]}
    assert_problem(client.post("/api/plans", json={"scenario": scenario}), 422, "structure.meshes.0.file")


def test_a_plan_that_cannot_be_says_why(client, scenario, jobs, wait_for_plan):
    jobs.error = InfeasibleError("no way between A and B: less clearance would help", field="safety.clearance_m")
    plan = wait_for_plan(client.post("/api/plans", json={"scenario": scenario}).json()["plan"]["id"])
    assert plan["state"] == "failed"
    assert plan["failure"] == {
        "title": "No feasible plan",
        "message": "no way between A and B: less clearance would help",
        "field": "safety.clearance_m",
    }
    assert plan["files"] == []
    assert_problem(client.get(f"/api/plans/{plan['id']}/detail"), 409)


def test_a_fault_in_the_planner_is_a_failed_plan(client, scenario, jobs, wait_for_plan):
    jobs.error = ZeroDivisionError("x")
    plan = wait_for_plan(client.post("/api/plans", json={"scenario": scenario}).json()["plan"]["id"])
    assert (plan["state"], plan["failure"]["title"]) == ("failed", "Internal fault")


def test_planning_is_cancelled(client, scenario, jobs):
    jobs.hold = True
    plan_id = client.post("/api/plans", json={"scenario": scenario}).json()["plan"]["id"]
    assert_problem(client.delete(f"/api/plans/{plan_id}"), 409)
    cancelled = client.post(f"/api/plans/{plan_id}/cancel").json()
    assert (cancelled["state"], cancelled["job"]["state"]) == ("cancelled", "cancelled")
    assert_problem(client.post(f"/api/plans/{plan_id}/cancel"), 409)
    assert client.delete(f"/api/plans/{plan_id}").status_code == 204
    assert_problem(client.get(f"/api/plans/{plan_id}"), 404)


def test_a_station_that_ends_while_planning_says_interrupted_afterwards(app, client, scenario, jobs):
    jobs.hold = True
    plan_id = client.post("/api/plans", json={"scenario": scenario}).json()["plan"]["id"]
    client.__exit__(None, None, None)
    client.__enter__()
    plan = client.get(f"/api/plans/{plan_id}").json()
    assert (plan["state"], plan["job"]["state"]) == (PlanState.INTERRUPTED, "interrupted")


@pytest.mark.parametrize("name", ["plan.schema.json", "..%2f..%2ftoken", "token", "report.html.bak", "%2e%2e"])
def test_only_files_of_a_plan_are_given_out(client, ready_plan, name):
    assert client.get(f"/api/plans/{ready_plan['id']}/files/{name}").status_code == 404


def test_a_plan_that_is_not_there_is_a_problem(client):
    assert_problem(client.get("/api/plans/plan-9"), 404, "plan_id")
    assert_problem(client.get("/api/nothing"), 404)
    assert_problem(client.put("/api/plans", json={}), 405)
