"""A flight's report for people: what was flown, reached, pictured and changed, complete in one HTML file."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from gcs.services.replan_difference import viewpoint_fates
from gcs.services.report_departures import departures_section
from gcs.services.report_page import STYLE
from gcs.services.report_pictures import Drawn, scene_view
from gcs.storage.plan_files import read_structure
from gcs.storage.records import ImageState, ViewpointFateName

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.core.plan import Plan
    from gcs.services.plan_service import PlanService
    from gcs.services.replan_difference import ReplanView
    from gcs.services.replan_reports import ReplanReports
    from gcs.storage.database import Database
    from gcs.storage.records import FlightOverview, TrackPoint

FLIGHT_STYLE = """
.f{stroke:#1e8449;fill:none;stroke-width:1.5}.o{stroke:#111827;fill:none;stroke-width:2;stroke-dasharray:3 3}
.r{stroke:#c0392b;fill:none;stroke-width:2}.x{stroke:#d35400;fill:#d3540055}
table.d td{vertical-align:top}em{color:#c0392b;font-style:normal}
"""
LEGEND = (
    "Grey: structure. Blue: the plan's trajectory. Green: flown. Red: pieces flown instead of the plan, as the vehicle "
    "reported them. Black, dashed: what they left out. Orange: obstacles. Red dots: viewpoints. Metres."
)
SIDES = (
    ((0, 1), "from above (east, north)"),
    ((0, 2), "from the south (east, up)"),
    ((1, 2), "from the east (north, up)"),
)
CIRCLE = np.linspace(0.0, 2 * np.pi, 25)
MOST_TRACK_POINTS = 3000


def flight_report_page(database: Database, plans: PlanService, replans: ReplanReports, flight_id: str) -> str:
    """The page, of what is on record now.

    Raises:
        NotFoundError: there is no such flight.
        InputError: the files of its plan were damaged.
    """
    overview = database.flights.summary(flight_id)
    plan_id = overview.flight.plan_id
    plan, structure = plans.read(plan_id), read_structure(plans.directory(plan_id))
    views = replans.of_flight(flight_id)
    drawn = list(_drawn(views, database.flights.track(flight_id)))
    pictures = "".join(
        f"<figure>{scene_view(plan, structure, axes, drawn)}<figcaption>{caption}</figcaption></figure>"
        for axes, caption in SIDES
    )
    title = f"{escape(plans.get(plan_id).plan.name)}: flight of {escape(overview.flight.vehicle)}"
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{STYLE}{FLIGHT_STYLE}</style></head><body>\n<h1>{title}</h1>\n{_summary(overview)}\n"
        f'<h2>Views</h2><div class="views">{pictures}</div><p>{LEGEND}</p>\n'
        f"{departures_section(views, database.offers.of_flight(flight_id))}"
        f"<h2>Viewpoints</h2>{_viewpoints(database, flight_id, plan, views)}\n</body></html>\n"
    )


def _summary(overview: FlightOverview) -> str:
    flight = overview.flight
    problems = "".join(f"<li><em>{escape(problem)}</em></li>" for problem in flight.problems)
    off_m = flight.max_cross_track_m
    rows = (
        ("state", flight.state),
        ("steered by", flight.mode),
        ("started", flight.started_at or "never"),
        ("ended", flight.ended_at or "not yet"),
        ("viewpoints reached", f"{overview.viewpoints_reached} of {flight.viewpoints}"),
        ("viewpoints with a picture here", f"{overview.images_received} of {flight.viewpoints}"),
        ("largest distance from the planned curve", "not known" if off_m is None else f"{off_m:.2f} m"),
        ("SHA-256 of plan.json", flight.plan_hash),
    )
    table = "".join(f"<tr><td>{name}</td><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{table}</table>" + (f"<ul>{problems}</ul>" if problems else "")


def _drawn(views: list[ReplanView], track: tuple[TrackPoint, ...]) -> Iterator[Drawn]:
    """What is drawn over the plan: the way flown, and each departure with what it left out and its obstacle."""
    if track:
        chosen = np.unique(np.linspace(0, len(track) - 1, MOST_TRACK_POINTS).astype(np.int64))
        yield Drawn("f", np.array([track[k].position_m for k in chosen]))
    for view in views:
        if view.left_out is not None:
            yield Drawn("o", view.left_out.path_m)
        if view.record.path_m:
            yield Drawn("r", np.array(view.record.path_m))
        obstacle = view.record.obstacle
        if obstacle is not None:
            ring = np.stack([np.cos(CIRCLE), np.sin(CIRCLE), np.zeros_like(CIRCLE)], axis=1)
            yield Drawn("x", np.array(obstacle.position_m) + obstacle.radius_m * ring)


def _viewpoints(database: Database, flight_id: str, plan: Plan, views: list[ReplanView]) -> str:
    visits = {v.viewpoint_id: v for v in database.flights.visits(flight_id)}
    stored = {i.viewpoint_id for i in database.images.of_flight(flight_id) if i.state is ImageState.STORED}
    fates = viewpoint_fates(views)
    rows = []
    for viewpoint in plan.viewpoints:
        visit = visits.get(viewpoint.id)
        miss = "" if visit is None or visit.miss_m is None else f"{visit.miss_m:.2f}"
        cells = (
            escape(viewpoint.name),
            "" if visit is None else escape(visit.at),
            miss,
            "here" if viewpoint.id in stored else "<em>none</em>",
            _fate(fates.get(viewpoint.id), pictured=viewpoint.id in stored),
        )
        rows.append(f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    heads = "".join(f"<th>{head}</th>" for head in ("name", "reached", "missed by, m", "picture", "fate"))
    return f"<table><tr>{heads}</tr>{''.join(rows)}</table>"


def _fate(told: ViewpointFateName | None, *, pictured: bool) -> str:
    if told is None:
        return "as planned"
    return "skipped, and taken later" if told is ViewpointFateName.SKIPPED and pictured else told
