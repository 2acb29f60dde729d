"""A public crane and its published interest points: planned, verified, and checked from outside; skipped without."""

from __future__ import annotations

import asyncio
import collections
import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from gcs.core.surface_coverage import Verdict

pytestmark = pytest.mark.system

SHARED = Path(__file__).resolve().parents[2] / "../shared"
MESH = SHARED / "meshes/caric_construction_crane_1.stl"
POINTS = SHARED / "meshes/caric_construction_crane_1_interest_points.csv"
CHECK = SHARED / "verify/check_plan.py"


@pytest.mark.skipif(
    not all(file.is_file() for file in (MESH, POINTS, CHECK)), reason="the folder with the mesh and the check is absent"
)
async def test_every_interest_point_is_seen_or_named_and_an_outside_check_agrees(tmp_path, gcs):
    scenario = {
        "name": "tower crane",
        "structure": {"meshes": [{"file": str(MESH.resolve())}]},
        "anchor": {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.0},
        "ground_m": 0.0,
        "camera": {
            "sensor_width_mm": 13.2,
            "sensor_height_mm": 8.8,
            "focal_length_mm": 8.8,
            "image_width_px": 5472,
            "image_height_px": 3648,
        },
        "inspection": {"surface": {"gsd_mm": 8, "overlap": 0.3, "spots": str(POINTS.resolve())}},
        "home_m": [-20, -20, 0],
    }
    (tmp_path / "crane.yaml").write_text(yaml.safe_dump(scenario))
    out = tmp_path / "out"
    planned = await gcs("plan", tmp_path / "crane.yaml", "-o", out)
    assert planned.status == 0, planned.text
    report = json.loads((out / "report.json").read_text())
    assert report["coverage"] > 0.95
    assert {file.name for file in out.iterdir()} == {
        *("plan.json", "viewpoints.csv", "path.csv", "structure.ply", "trajectory.csv"),
        *("mission.plan", "mission.waypoints", "report.json", "report.html"),
    }
    verified = await gcs("verify", out, "--points", POINTS.resolve())
    assert verified.status == 0, verified.text
    by_words = {v.words: v for v in Verdict}
    lines = [line.split(": ", 1) for line in verified.text.splitlines() if line.startswith("line ")]
    found = collections.Counter(by_words[words] for _, words in lines)
    assert found.total() == len(POINTS.read_text().splitlines()) - 1
    assert sum(report["spots"].values()) == found.total()
    assert report["spots"]["seen"] == found[Verdict.SEEN] > 550
    assert found[Verdict.LEFT_OUT] == 0
    line = [sys.executable, str(CHECK), str(out), "--samples", "2000"]
    checked = await asyncio.to_thread(subprocess.run, line, capture_output=True, text=True)
    print(planned.seconds, report["stages_s"], checked.stdout)
    assert checked.returncode == 0, checked.stdout + checked.stderr
