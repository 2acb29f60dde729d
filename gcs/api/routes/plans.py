"""Plans: asked for, watched, drawn, downloaded."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter
from fastapi.responses import FileResponse

from gcs.api.dependencies import PlanHash, PlanId, Services
from gcs.api.doors import REPORT_CSP
from gcs.api.plan_drawing import plan_detail
from gcs.api.schemas.plans import PlanAccepted, PlanDetail, PlanRequest, PlanSummary
from gcs.api.views import job_info, plan_summary

router = APIRouter(prefix="/plans", tags=["plans"])

MEDIA_TYPES = {
    ".json": "application/json",
    ".csv": "text/csv",
    ".ply": "application/octet-stream",
    ".html": "text/html",
    ".plan": "application/json",
    ".waypoints": "text/plain",
}


@router.get("", operation_id="listPlans")
def list_plans(services: Services) -> list[PlanSummary]:
    """Newest first."""
    return [plan_summary(p) for p in services.plans.list()]


@router.post("", status_code=202, operation_id="makePlan")
async def make_plan(services: Services, request: PlanRequest) -> PlanAccepted:
    """Check the scenario and start to plan; the live stream tells how far it is."""
    plan = await services.plans.submit(request.scenario)
    summary = plan_summary(plan)
    assert plan.job is not None
    return PlanAccepted(plan=summary, job=job_info(plan.job))


@router.get(
    "/by-hash/{plan_hash}/{name}",
    operation_id="getPlanFileByHash",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}},
)
def get_plan_file_by_hash(
    services: Services, plan_hash: PlanHash, name: Literal["plan.json", "structure.ply"]
) -> FileResponse:
    """What a companion needs of the plan whose plan.json has this SHA-256."""
    path = services.plans.file_by_hash(plan_hash, name)
    return FileResponse(path, media_type=MEDIA_TYPES[path.suffix])


@router.get("/{plan_id}", operation_id="getPlan")
def get_plan(services: Services, plan_id: PlanId) -> PlanSummary:
    """State, figures and files of a plan."""
    return plan_summary(services.plans.get(plan_id))


@router.get("/{plan_id}/detail", operation_id="getPlanDetail")
def get_plan_detail(services: Services, plan_id: PlanId) -> PlanDetail:
    """A ready plan for drawing."""
    return plan_detail(services.plans.get(plan_id).plan, services.plans.read(plan_id))


@router.get(
    "/{plan_id}/files/{name}",
    operation_id="getPlanFile",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}},
)
def get_plan_file(services: Services, plan_id: PlanId, name: str) -> FileResponse:
    """One of the files that `gcs plan` writes."""
    path = services.plans.file(plan_id, name)
    headers = {"Content-Security-Policy": REPORT_CSP} if path.suffix == ".html" else {}
    return FileResponse(path, media_type=MEDIA_TYPES[path.suffix], headers=headers)


@router.post("/{plan_id}/cancel", operation_id="cancelPlan")
async def cancel_plan(services: Services, plan_id: PlanId) -> PlanSummary:
    """Stop planning; obeyed within a second."""
    return plan_summary(await services.plans.cancel(plan_id))


@router.delete("/{plan_id}", status_code=204, operation_id="deletePlan")
def delete_plan(services: Services, plan_id: PlanId) -> None:
    """Remove a plan that no flight has used."""
    services.plans.delete(plan_id)
