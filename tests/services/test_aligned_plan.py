"""A plan of a mesh that was placed by surveyed points, read as a program would that knows nothing of alignment."""

import csv
import json
import math

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.planning.scene.point_distance import TriangleDistance
from gcs.services.plan_service import write_planned
from gcs.services.plan_verification import verify_plan

TURN = Rotation.from_euler("zyx", [30, 88, 1], degrees=True).as_matrix()
SHIFT = np.array([0.5, -0.5, 5.2])
PICKED = np.array([[-2, -2, -5], [2, -2, -5], [2, 2, -5], [-2, 2, 5], [2, -2, 5.0]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory, box_scenario):
    folder = tmp_path_factory.mktemp("aligned")
    trimesh.creation.box((4, 4, 10)).export(folder / "lying.stl")
    world = PICKED @ TURN.T + SHIFT
    world[1] += [0.1, 0.1, -0.05]
    points = [{"mesh": m, "world_m": w} for m, w in zip(PICKED.tolist(), world.tolist(), strict=True)]
    task = {"points": [{"name": "top", "position_m": (PICKED[3] @ TURN.T + SHIFT).tolist(), "normal": [0, 0, 1]}]}
    scenario = box_scenario | {
        "structure": {"meshes": [{"file": "lying.stl", "align": {"points": points}}]},
        "inspection": task,
        "safety": {"model_m": 0.2},
    }
    written = write_planned(parse_scenario(scenario), folder, folder / "out", SilentProgress())
    (folder / "notes.json").write_text(json.dumps(written.notes))
    return folder


def placed(scenario, base):
    """What scale, up, rotation and position alone make of the recorded meshes."""
    parts = []
    for mesh in scenario["structure"]["meshes"]:
        loaded = trimesh.load(base / mesh["file"], force="mesh", process=False)
        v = np.asarray(loaded.vertices) * mesh["scale"]
        assert mesh["up"] == "z"
        angle = math.radians(mesh["rotation_deg"])
        c, s = math.cos(angle), math.sin(angle)
        v = v @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + mesh["position_m"]
        parts.append(v[loaded.faces])
    return np.concatenate(parts)


def test_the_recorded_scenario_places_the_structure_and_has_the_whole_budget(folder):
    scenario = json.loads((folder / "out" / "plan.json").read_text())["scenario"]
    triangles = placed(scenario, folder / "out")
    world = np.array([p["world_m"] for p in scenario["structure"]["placed_from"][0]["align"]["points"]])
    residuals = TriangleDistance(triangles).distance(world)
    assert 0.01 < residuals.max() < 0.2  # the surveyed points are corners of the box
    fit, _ = Rotation.align_vectors(world - world.mean(axis=0), PICKED - PICKED.mean(axis=0))
    worst = np.linalg.norm(fit.apply(PICKED - PICKED.mean(axis=0)) + world.mean(axis=0) - world, axis=1).max()
    assert scenario["safety"]["model_m"] >= 0.2 + worst - 1e-9
    box = trimesh.creation.box((4, 4, 10))
    expected = fit.apply(box.vertices - PICKED.mean(axis=0)) + world.mean(axis=0)
    found = np.unique(triangles.reshape(-1, 3).round(6), axis=0)
    np.testing.assert_allclose(found, np.unique(expected.round(6), axis=0), atol=2e-6)


def test_the_flight_keeps_the_whole_budget(folder):
    scenario = json.loads((folder / "out" / "plan.json").read_text())["scenario"]
    rows = list(csv.DictReader((folder / "out" / "trajectory.csv").read_text().splitlines()))
    path = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    hull = TriangleDistance(placed(scenario, folder / "out")).distance(path).min() - scenario["vehicle"]["radius_m"]
    keys = ("clearance_m", "tracking_m", "position_m", "model_m")
    assert hull >= sum(scenario["safety"][key] for key in keys) - 1e-6


def test_verify_agrees_and_the_notes_say_it(folder):
    failed = [check for check in verify_plan(folder / "out") if not check.ok]
    assert failed == []
    assert any("come on top of safety.model_m" in note for note in json.loads((folder / "notes.json").read_text()))


def test_planning_the_recorded_scenario_again_adds_nothing(folder):
    recorded = parse_scenario(json.loads((folder / "out" / "plan.json").read_text())["scenario"])
    again = write_planned(recorded, folder / "out", folder / "again", SilentProgress())
    assert again.plan.scenario.safety == recorded.safety
    assert (folder / "again" / "structure.ply").read_bytes() == (folder / "out" / "structure.ply").read_bytes()
