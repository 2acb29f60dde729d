"""A mesh that nobody made for this: planned, verified, and looked at by an outside check; skipped without."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

pytestmark = pytest.mark.system

SHARED = Path(__file__).resolve().parents[2] / "../shared"
MESH = SHARED / "meshes/caric_construction_crane_1.stl"
CHECK = SHARED / "verify/check_plan.py"


@pytest.mark.skipif(not (MESH.is_file() and CHECK.is_file()), reason="the folder with the mesh and the check is absent")
async def test_the_tower_crane_agrees_with_an_outside_check(tmp_path, gcs):
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
        "inspection": {"surface": {"gsd_mm": 8, "overlap": 0.3}},
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
    verified = await gcs("verify", out)
    assert verified.status == 0, verified.text
    line = [sys.executable, str(CHECK), str(out), "--samples", "2000"]
    checked = await asyncio.to_thread(subprocess.run, line, capture_output=True, text=True)
    print(planned.seconds, report["stages_s"], checked.stdout)
    assert checked.returncode == 0, checked.stdout + checked.stderr
