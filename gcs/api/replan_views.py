"""From stored replanning reports and offers to what the API says."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.api.schemas.replans import PlanOfferInfo, PlanPieceInfo, ReplanInfo, ReplanObstacleInfo, ViewpointFateInfo

if TYPE_CHECKING:
    from gcs.services.replan_difference import PlanPiece, ReplanView
    from gcs.storage.records import PlanOfferRecord


def replan_info(view: ReplanView) -> ReplanInfo:
    """A report as a difference from its plan."""
    r = view.record
    return ReplanInfo(
        id=r.id,
        flight_id=r.flight_id,
        boot_id=r.boot_id,
        number=r.number,
        received_at=r.received_at,
        reason=r.reason,
        mission_item=r.mission_item,
        left_at_s=r.left_at_s,
        rejoined_at_s=r.rejoined_at_s,
        plan_hash=r.plan_hash,
        plan_hash_after=r.plan_hash_after,
        chain=view.chain,
        left_out=None if view.left_out is None else _piece(view.left_out),
        path_m=list(r.path_m),
        flown_length_m=view.flown_length_m,
        flown_duration_s=view.flown_duration_s,
        obstacle=None if r.obstacle is None else ReplanObstacleInfo.model_validate(r.obstacle),
        viewpoints=[
            ViewpointFateInfo(viewpoint_id=v.viewpoint_id, name=name, fate=v.fate, position_m=v.position_m)
            for v, name in zip(r.viewpoints, view.viewpoint_names, strict=True)
        ],
    )


def offer_info(offer: PlanOfferRecord) -> PlanOfferInfo:
    """An offered plan."""
    return PlanOfferInfo.model_validate(offer)


def _piece(piece: PlanPiece) -> PlanPieceInfo:
    return PlanPieceInfo(
        from_s=piece.from_s,
        to_s=piece.to_s,
        path_m=piece.path_m.tolist(),
        length_m=piece.length_m,
        duration_s=piece.duration_s,
    )
