"""The published interest points of a public crane: each is seen as asked, or named with the reason; skipped without."""

from __future__ import annotations

import collections
import json
from pathlib import Path

import pytest
import yaml

from gcs.core.surface_coverage import Verdict

pytestmark = pytest.mark.system

MESHES = Path(__file__).resolve().parents[2] / "../shared/meshes"
MESH = MESHES / "caric_construction_crane_1.stl"
POINTS = MESHES / "caric_construction_crane_1_interest_points.csv"


@pytest.mark.skipif(not (MESH.is_file() and POINTS.is_file()), reason="the folder with the mesh is absent")
async def test_every_interest_point_is_seen_or_named_with_the_reason(tmp_path, gcs):
    scenario = {
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
        "inspection": {"surface": {"gsd_mm": 8, "overlap": 0.0, "spots": str(POINTS.resolve())}},
        "home_m": [-20, -20, 0],
    }
    (tmp_path / "crane.yaml").write_text(yaml.safe_dump(scenario))
    planned = await gcs("plan", tmp_path / "crane.yaml", "-o", tmp_path / "out")
    assert planned.status == 0, planned.text
    verified = await gcs("verify", tmp_path / "out", "--points", POINTS.resolve())
    assert verified.status == 0, verified.text
    by_words = {v.words: v for v in Verdict}
    lines = [line.split(": ", 1) for line in verified.text.splitlines() if line.startswith("line ")]
    found = collections.Counter(by_words[words] for _, words in lines)
    assert found.total() == len(POINTS.read_text().splitlines()) - 1
    told = json.loads((tmp_path / "out" / "report.json").read_text())["spots"]
    assert sum(told.values()) == found.total()
    assert told["seen"] == found[Verdict.SEEN] > 550
    assert found[Verdict.LEFT_OUT] == 0
