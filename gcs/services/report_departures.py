"""The part of a flight's report about its departures from the plan, and the plans offered for what it skipped."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from gcs.services.replan_difference import Chain
from gcs.storage.records import OfferState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.services.replan_difference import ReplanView
    from gcs.storage.records import PlanOfferRecord, ReplanObstacle

HEADS = ("", "when", "reason", "obstacle", "left out of the plan", "flown instead", "viewpoints")
ODD_CHAINS = {
    Chain.GAP: "A report before this one is missing.",
    Chain.UNKNOWN: "It left a plan that this station does not know, so nothing is compared.",
}
STANDING_M_S = 0.1


def departures_section(views: Sequence[ReplanView], offers: Sequence[PlanOfferRecord]) -> str:
    """One row for each replanning report, in the order of the flight, and one line for each offered plan."""
    if not views:
        return "<h2>Departures from the plan</h2><p>None was reported.</p>\n"
    heads = "".join(f"<th>{head}</th>" for head in HEADS)
    rows = "".join(_row(number, view) for number, view in enumerate(views, start=1))
    offered = "".join(f"<li>{_offer(offer)}</li>" for offer in offers)
    plans = f"<p>Plans offered for what was skipped:</p><ul>{offered}</ul>" if offered else ""
    return f'<h2>Departures from the plan</h2><table class="d"><tr>{heads}</tr>{rows}</table>{plans}\n'


def _row(number: int, view: ReplanView) -> str:
    record = view.record
    odd = ODD_CHAINS.get(view.chain)
    cells = (
        str(number),
        _when(view),
        escape(record.reason) + (f"<br><em>{odd}</em>" if odd else ""),
        "none told" if record.obstacle is None else _obstacle(record.obstacle),
        _left_out(view),
        _flown(view),
        _fates(view),
    )
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _when(view: ReplanView) -> str:
    record = view.record
    at = "" if view.left_out is None else f"{view.left_out.from_s:.1f} s of the plan<br>"
    return f"{at}{record.left_at_s:.1f} s of the vehicle's clock<br>here {escape(record.received_at)}"


def _obstacle(obstacle: ReplanObstacle) -> str:
    speed = float(np.hypot(*obstacle.velocity_m_s))
    east, north, up = obstacle.position_m
    how = "standing" if speed < STANDING_M_S else f"moving at {speed:.1f} m/s"
    return f"{how}, {2 * obstacle.radius_m:.1f} m wide, at {east:.1f} / {north:.1f} / {up:.1f} m"


def _left_out(view: ReplanView) -> str:
    piece = view.left_out
    if not view.record.path_m:
        return "no piece is told"
    return "not known" if piece is None else f"{piece.length_m:.1f} m in {piece.duration_s:.1f} s"


def _flown(view: ReplanView) -> str:
    took = view.flown_duration_s
    if not view.record.path_m:
        return "no piece is told"
    return f"{view.flown_length_m:.1f} m" + (", never back on the plan" if took is None else f" in {took:.1f} s")


def _fates(view: ReplanView) -> str:
    said = []
    whose = "of that plan" if view.chain is Chain.UNKNOWN else "that the plan does not have"
    for change, name in zip(view.record.viewpoints, view.viewpoint_names, strict=True):
        called = f"viewpoint {change.viewpoint_id} {whose}" if name is None else escape(name)
        where = "" if change.position_m is None else f" to {' / '.join(f'{c:.1f}' for c in change.position_m)} m"
        said.append(f"{called}: {change.fate}{where}")
    return "<br>".join(said) or "all taken"


def _offer(offer: PlanOfferRecord) -> str:
    figures = "" if offer.length_m is None else f", {offer.length_m:.0f} m in {offer.duration_s or 0.0:.0f} s"
    when = "" if offer.decided_at is None else f" {escape(offer.decided_at)}"
    why = f": {escape(offer.failure.message)}" if offer.state is OfferState.FAILED and offer.failure else ""
    return f"{escape(', '.join(offer.names))}{figures}: {offer.state}{when}{why}"
