"""`report.html`: a plan for people, with pictures, complete in one file."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.planning.flights.own_ways import describe_own_ways
from gcs.services.report_coverage import STYLE as COVERAGE_STYLE
from gcs.services.report_coverage import coverage_section
from gcs.services.report_pictures import scene_view, speed_chart
from gcs.services.report_tracking import tracking_section

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.core.plan import CellNote, Plan
    from gcs.core.structure import Structure
    from gcs.services.tracking_forecast import TrackingForecast

FIGURES: tuple[tuple[str, str, str], ...] = (
    ("min_clearance_m", "smallest hull clearance", "m"),
    ("length_m", "length of the trajectory", "m"),
    ("path_length_m", "length of the path", "m"),
    ("duration_s", "duration", "s"),
    ("mean_deviation_m", "mean deviation from the path", "m"),
    ("max_deviation_m", "largest deviation from the path", "m"),
    ("max_speed_m_s", "highest speed", "m/s"),
    ("max_acceleration_m_s2", "highest acceleration", "m/s²"),
    ("max_jerk_m_s3", "highest jerk", "m/s³"),
    ("corridor_violation_m", "corridor violation", "m"),
    ("worst_viewpoint_miss_m", "worst miss of a viewpoint", "m"),
    ("viewpoints", "viewpoints", ""),
    ("viewpoints_lower_bound", "lower bound of the viewpoints", ""),
    ("coverage", "seen share of what is coverable", ""),
    ("coverable", "coverable share of all sampled sides", ""),
    ("tour_cost", "cost of the tour", ""),
    ("tour_lower_bound", "lower bound of any tour", ""),
    ("tour_metric", "metric of the tour", ""),
    ("energy_wh", "energy", "Wh"),
    ("open_sky", "share of the time under open sky", ""),
    ("max_blur_px", "largest motion blur", "px"),
    ("max_skew_px", "largest rolling-shutter skew", "px"),
    ("mission_items", "mission items", ""),
)

STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:68rem;padding:0 1rem;color:#1b2530}
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}
table{border-collapse:collapse;font-variant-numeric:tabular-nums}
td,th{padding:.15rem .8rem .15rem 0;text-align:left;border-bottom:1px solid #dde3e8}
td.n{text-align:right}.views{display:flex;flex-wrap:wrap;gap:1rem}figure{margin:0}figcaption{color:#5a6b7b}
svg{background:#f6f8fa;border:1px solid #dde3e8}
.s{stroke:#9aa7b3;fill:none;stroke-width:.5}.c{stroke:#6b5b95;fill:none;stroke-width:1}
.p{stroke:#e08e0b;fill:none;stroke-width:1;stroke-dasharray:4 3}.t{stroke:#0b6fb8;fill:none;stroke-width:1.5}
.v{fill:#c0392b}.h{fill:#1e8449}.a{stroke:#5a6b7b;stroke-width:1}text{font:11px system-ui,sans-serif;fill:#3c4a57}
"""


def report_page(
    plan: Plan, structure: Structure, report: dict[str, Any], tracking: TrackingForecast | None = None
) -> str:
    """The page.

    Args:
        plan: a finished plan.
        structure: what is inspected.
        report: content of `report.json`.
        tracking: how closely it can be flown; left out when None.
    """
    scenario = plan.scenario
    title = escape(scenario.name)
    views = "".join(
        f"<figure>{scene_view(plan, structure, axes)}<figcaption>{caption}</figcaption></figure>"
        for axes, caption in (
            ((0, 1), "from above (east, north)"),
            ((0, 2), "from the south (east, up)"),
            ((1, 2), "from the east (north, up)"),
        )
    )
    legend = (
        "Grey: structure. Violet: cables. Orange, dashed: path. Blue: trajectory. Red: viewpoints. Green: home. Metres."
    )
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{STYLE}{COVERAGE_STYLE}</style>"
        f"</head><body>\n<h1>{title}</h1>\n<p>{_summary(plan)}</p>\n"
        f'<h2>Views</h2><div class="views">{views}</div><p>{legend}</p>\n'
        f"<h2>Speed over time</h2>{speed_chart(plan)}\n"
        f"<h2>Certificates</h2>{_figures(report)}\n"
        f"{coverage_section(plan, structure)}"
        f"{_sorties(plan)}"
        f"{_faces(plan)}"
        f"<h2>Clearance budget</h2>{_budget(plan)}\n"
        f"{_own_ways(plan)}"
        f"{_predictions(report)}"
        f"{'' if tracking is None else tracking_section(tracking)}"
        f"<h2>Viewpoints</h2>{_viewpoints(plan)}\n"
        f"<h2>Planning time</h2>{_stages(plan)}\n</body></html>\n"
    )


def _summary(plan: Plan) -> str:
    anchor, camera = plan.scenario.anchor, plan.scenario.camera
    name = f"{escape(camera.model)}, " if camera.model else ""
    return (
        f"{len(plan.viewpoints)} pictures in {plan.certificates.duration_s:.0f} s. "
        f"Anchor {anchor.latitude_deg:.7f}°, {anchor.longitude_deg:.7f}°, {anchor.altitude_m:.2f} m above sea level. "
        f"Camera {name}{camera.sensor_width_mm:g} x {camera.sensor_height_mm:g} mm, f = {camera.focal_length_mm:g} mm, "
        f"{camera.image_width_px} x {camera.image_height_px} px."
    )


def _value(value: object) -> str:
    if value is None:
        return "not asked"
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))


def _figures(report: dict[str, Any]) -> str:
    rows = "".join(
        f'<tr><td>{name}</td><td class="n">{_value(report.get(key))}</td><td>{unit}</td></tr>'
        for key, name, unit in FIGURES
    )
    return f"<table>{rows}</table>"


def _budget(plan: Plan) -> str:
    safety, vehicle = plan.scenario.safety, plan.scenario.vehicle
    parts = (
        ("clearance", safety.clearance_m),
        ("tracking error", safety.tracking_m),
        ("position error", safety.position_m),
        ("model error", safety.model_m),
    )
    rows = "".join(f'<tr><td>{name}</td><td class="n">{value:.2f}</td><td>m</td></tr>' for name, value in parts)
    return (
        f'<table>{rows}<tr><th>asked between hull and surface</th><td class="n">{safety.hull_clearance_m:.2f}</td>'
        f"<td>m</td></tr><tr><th>certified</th>"
        f'<td class="n">{plan.certificates.min_clearance_m:.2f}</td><td>m</td></tr></table>'
        f"<p>The hull's radius of {vehicle.radius_m:.2f} m comes on top of it.</p>"
    )


def _own_ways(plan: Plan) -> str:
    """What the vehicle can do by itself, and when it cannot."""
    ways = plan.own_ways
    if ways is None:
        return ""
    kinds = (
        (
            "return",
            ways.return_blocked_s if ways.return_altitude_m is not None else ((0.0, plan.trajectory.duration_s),),
        ),
        ("landing on the spot", ways.landing_blocked_s),
        ("hold", ways.hold_blocked_s),
    )
    rows = "".join(
        f'<tr><td>{name}</td><td class="n">{sum(b - a for a, b in blocked):.1f}</td>'
        f"<td>{', '.join(f'{a:.0f}-{b:.0f}' for a, b in blocked)}</td></tr>"
        for name, blocked in kinds
    )
    return (
        "<h2>Ways home of the vehicle by itself</h2>"
        f"<p>{escape(describe_own_ways(ways, plan.trajectory.duration_s))}.</p>"
        f"<table><tr><th></th><th>blocked for s</th><th>from - to, s</th></tr>{rows}</table>\n"
    )


def _predictions(report: dict[str, Any]) -> str:
    """What usual vehicles will make of it, as a mission and as setpoints."""
    predictions = report.get("predictions", [])
    if not predictions:
        return ""
    rows = "".join(
        f'<tr><td>{p["autopilot"]}, {way}</td><td class="n">{p[way]["time_s"]:.0f}</td>'
        f'<td class="n">{p[way]["max_deviation_m"]:.2f}</td><td class="n">{p[way]["min_clearance_m"]:.2f}</td></tr>'
        for p in predictions
        for way in ("mission", "offboard")
    )
    said = "".join(f"<p>{p['autopilot']}: {escape(p['why'])}.</p>" for p in predictions)
    return (
        f"<h2>What the autopilots will fly, with their usual settings</h2>{said}"
        "<table><tr><th></th><th>time, s</th><th>largest deviation, m</th><th>hull clearance, m</th></tr>"
        f"{rows}</table>\n"
    )


def _sorties(plan: Plan) -> str:
    """The flights of a plan that one battery is not enough for."""
    rows = "".join(
        f'<tr><td>{number}</td><td class="n">{len(s.viewpoints)}</td><td class="n">{s.start_s:.0f}</td>'
        f'<td class="n">{s.duration_s:.0f}</td><td class="n">{s.energy_wh:.1f}</td></tr>'
        for number, s in enumerate(plan.sorties, start=1)
    )
    heads = "<tr><th>sortie</th><th>viewpoints</th><th>take-off, s</th><th>in the air, s</th><th>Wh</th></tr>"
    return f"<h2>Sorties</h2><table>{heads}{rows}</table>\n" if rows else ""


def _faces(plan: Plan) -> str:
    """Cells of the faces that were asked for: how many are seen whole, and the others by their reasons."""
    if not plan.faces:
        return ""
    rows = "".join(
        f'<tr><td>{escape(f.name)}</td><td class="n">{f.cells}</td><td class="n">{f.covered}</td>'
        f'<td class="n">{len(f.moved)}</td><td class="n">{len(f.not_covered)}</td></tr>'
        for f in plan.faces
    )
    heads = ("face", "cells", "seen whole", "of these moved or tilted", "not covered")
    table = f"<table><tr>{''.join(f'<th>{h}</th>' for h in heads)}</tr>{rows}</table>"
    notes = "".join(
        f"<h3>{escape(f.name)}: {title}</h3><ul>{_by_reason(cells)}</ul>"
        for f in plan.faces
        for title, cells in (("not covered", f.not_covered), ("seen from another place", f.moved))
        if cells
    )
    return f"<h2>Faces</h2>{table}{notes}\n"


def _by_reason(notes: Sequence[CellNote]) -> str:
    cells: dict[str, list[str]] = {}
    for note in notes:
        cells.setdefault(note.reason, []).append(note.cell)
    return "".join(
        f"<li>{escape(reason)} ({len(names)}): {escape(', '.join(names))}</li>" for reason, names in cells.items()
    )


def _viewpoints(plan: Plan) -> str:
    head = "".join(
        f"<th>{h}</th>" for h in ("", "name", "time s", "east m", "north m", "up m", "yaw °", "pitch °", "GSD mm")
    )
    rows = []
    for v in plan.viewpoints:
        numbers = (
            f"{v.time_s:.1f}",
            *(f"{c:.2f}" for c in v.position_m),
            f"{np.degrees(v.yaw_rad):.1f}",
            f"{np.degrees(v.gimbal_pitch_rad):.1f}",
            f"{v.gsd_m * 1000:.2f}",
        )
        cells = "".join(f'<td class="n">{n}</td>' for n in numbers)
        rows.append(f'<tr><td class="n">{v.id}</td><td>{escape(v.name)}</td>{cells}</tr>')
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"


def _stages(plan: Plan) -> str:
    rows = "".join(
        f'<tr><td>{escape(name)}</td><td class="n">{seconds:.2f}</td><td>s</td></tr>'
        for name, seconds in plan.stages_s.items()
    )
    return f"<table>{rows}</table>"
