"""The part of `report.html` that tells of the surface: what is seen of it, what is not, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.surface_coverage import Verdict
from gcs.services.report_pictures import coverage_view

if TYPE_CHECKING:
    from gcs.core.plan import Plan
    from gcs.core.structure import Structure

COLOURS: dict[Verdict, str] = {
    Verdict.LEFT_OUT: "#c0392b",
    Verdict.GIMBAL: "#6b5b95",
    Verdict.INCIDENCE: "#e08e0b",
    Verdict.TOO_FAR: "#8d6e63",
    Verdict.NOT_SHARP: "#00897b",
    Verdict.FENCE: "#3949ab",
    Verdict.GROUND: "#7cb342",
    Verdict.NOT_REACHABLE: "#ad1457",
    Verdict.TOO_CLOSE: "#0b6fb8",
}
"""What is occluded is not drawn: there is much of it in closed structures, and nobody can see it."""

STYLE = "".join(f".k{v.value}{{stroke:{colour};stroke-width:3;stroke-linecap:round}}" for v, colour in COLOURS.items())
SIDES = ((0, 1), (0, 2), (1, 2))


def coverage_section(plan: Plan, structure: Structure) -> str:
    """The section; empty when no surface was asked for."""
    coverage = plan.coverage
    if coverage is None:
        return ""
    able = coverage.share_coverable * coverage.area_m2
    seen = coverage.share_seen * able
    text = (
        f"{coverage.share_seen:.2%} of the surface that can be seen at all is seen as asked: {seen:.0f} m² of "
        f"{able:.0f} m². Of all {coverage.area_m2:.0f} m² (both sides of every face count) "
        f"{coverage.share_coverable:.1%} can be seen. {len(coverage.verdicts)} sides were looked at."
    )
    views = "".join(f"<figure>{coverage_view(coverage, structure, axes, COLOURS)}</figure>" for axes in SIDES)
    return f'<h2>Coverage</h2><p>{text}</p>{_bound(plan)}{_spots(plan)}{_table(plan)}<div class="views">{views}</div>\n'


def _bound(plan: Plan) -> str:
    bound, told = plan.certificates.viewpoints_lower_bound, plan.certificates.viewpoints
    if not bound:
        return ""
    more = "" if plan.certificates.viewpoints_bound_solved else " Time ran out: a longer search might raise that bound."
    return (
        f"<p>{told} viewpoints; no choice from the same candidate places that covers as much has fewer than "
        f"{bound:.1f}, so there are at most {told / bound - 1:.1%} too many.{more}</p>"
    )


def _spots(plan: Plan) -> str:
    counts = plan.certificates.spots
    if not counts:
        return ""
    text = "; ".join(f"{Verdict[label.upper()].words}: {count}" for label, count in counts.items())
    return f"<p>Of the {sum(counts.values())} named spots: {text}.</p>"


def _table(plan: Plan) -> str:
    if plan.coverage is None:
        return ""
    shares = plan.coverage.shares()
    rows = "".join(
        f'<tr><td><svg width="12" height="12" role="img"><path class="k{v.value}" d="M2 6h8"/></svg></td>'
        f'<td>{v.words}</td><td class="n">{share * plan.coverage.area_m2:.1f}</td><td class="n">{share:.2%}</td></tr>'
        if v in COLOURS
        else f'<tr><td></td><td>{v.words}</td><td class="n">{share * plan.coverage.area_m2:.1f}</td>'
        f'<td class="n">{share:.2%}</td></tr>'
        for v, share in shares.items()
    )
    return f"<table><tr><th></th><th>sides</th><th>m²</th><th>share</th></tr>{rows}</table>"
