"""Position and yaw errors and motor thrusts are where a user sees them: in the report, which is checked again."""

import json
import re
import shutil
from xml.etree import ElementTree

import numpy as np
import pytest

from gcs.api.schemas.plans import PlanReport
from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2
from gcs.services.plan_verification import verify_plan
from gcs.services.report_tracking import tracking_section
from gcs.services.tracking_forecast import forecast_tracking


def test_the_history_is_that_of_the_whole_plan_and_has_its_extremes(small_plan):
    found = forecast_tracking(small_plan)
    history, figures = found.history, found.figures
    duration = small_plan.trajectory.duration_s
    assert len(history.time_s) == np.ceil(duration)
    assert history.time_s == pytest.approx(np.arange(len(history.time_s)) + 0.5, abs=0.5)
    assert history.weight.sum() == pytest.approx(1.0)
    assert figures.deviation_m == history.deviation_m.max()
    assert figures.mean_deviation_m < figures.deviation_m <= figures.distance_m
    hover = found.mass_kg * GRAVITY_M_S2 / 4
    # It pushes up at the start of the climb and lets go at its end, and the other way round in the descent.
    assert history.thrust_n[:3, 1].max() > 1.1 * hover > 0.9 * hover > history.thrust_n[3:6, 0].min()
    assert history.thrust_n[-6:-3, 0].min() < 0.9 * hover < 1.1 * hover < history.thrust_n[-3:, 1].max()
    assert figures.thrust_n == (history.thrust_n.min(), history.thrust_n.max())
    assert figures.thrust_n[1] < found.most_thrust_n


def test_the_section_tells_the_figures_and_draws_them_over_time(small_plan):
    found = forecast_tracking(small_plan)
    section = tracking_section(found)
    assert f"at most {found.figures.deviation_m:.2f} m beside the curve" in section
    assert f"of {found.most_thrust_n:.1f} N" in section
    charts = [ElementTree.fromstring(svg) for svg in re.findall(r"<svg.*?</svg>", section)]
    assert [len(chart.findall("polyline")) for chart in charts] == [3, 1, 2]
    for chart in charts:
        for line in chart.findall("polyline"):
            points = np.array([[float(c) for c in p.split(",")] for p in line.get("points").split()])
            assert len(points) == len(found.history.time_s)
            assert (np.diff(points[:, 0]) > 0).all()
            assert ((points >= 0) & (points <= [float(chart.get("width")), float(chart.get("height"))])).all()


def test_a_written_plan_has_it_and_verify_finds_a_report_that_flatters(box_plan, tmp_path):
    report = json.loads((box_plan / "report.json").read_text())
    told = PlanReport.model_validate(report).tracking
    assert 0.0 < told.mean_deviation_m < told.deviation_m < 0.5
    assert told.thrust_n[1] < told.most_thrust_n
    assert [p.autopilot for p in PlanReport.model_validate(report).predictions] == ["px4", "ardupilot"]
    assert "<h2>Tracking</h2>" in (box_plan / "report.html").read_text()
    copy = shutil.copytree(box_plan, tmp_path / "copy")

    def check():
        (found,) = [c for c in verify_plan(copy) if c.name == "tracking"]
        return found.ok

    assert check()
    report["tracking"]["deviation_m"] -= 0.01
    (copy / "report.json").write_text(json.dumps(report))
    assert not check()
