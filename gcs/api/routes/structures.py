"""Structures: samples and meshes that were brought in."""

from __future__ import annotations

import tempfile
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from gcs.api.dependencies import Services, StructureId
from gcs.api.schemas.structures import StructureDetail, StructureSummary
from gcs.api.views import structure_detail, structure_summary
from gcs.core.errors import InputError
from gcs.services.structure_service import MAX_UPLOAD_BYTES

router = APIRouter(prefix="/structures", tags=["structures"])

PLY = "application/octet-stream"


@router.get("", operation_id="listStructures")
def list_structures(services: Services) -> list[StructureSummary]:
    """Samples first, then what was brought in, newest first."""
    return [structure_summary(s) for s in services.structures.list()]


@router.post(
    "",
    status_code=201,
    operation_id="addStructure",
    openapi_extra={
        "requestBody": {
            "required": True,
            "description": "The mesh file itself.",
            "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        }
    },
)
async def add_structure(
    services: Services,
    request: Request,
    file_name: Annotated[
        str, Query(min_length=1, max_length=200, description="STL, OBJ, PLY, GLB, GLTF, OFF or DAE, by its ending.")
    ],
    name: Annotated[str | None, Query(max_length=120)] = None,
    scale: Annotated[float, Query(gt=0, allow_inf_nan=False, description="File units to metres.")] = 1.0,
    up: Literal["z", "y"] = "z",
    rotation_deg: Annotated[float, Query(allow_inf_nan=False)] = 0.0,
    x_m: Annotated[float, Query(allow_inf_nan=False, description="Of the file's origin, ENU.")] = 0.0,
    y_m: Annotated[float, Query(allow_inf_nan=False)] = 0.0,
    z_m: Annotated[float, Query(allow_inf_nan=False)] = 0.0,
) -> StructureDetail:
    """Bring in a mesh; it is loaded and checked before it is kept."""
    with tempfile.TemporaryFile() as body:
        total = 0
        async for chunk in request.stream():
            total += len(chunk)
            if total > MAX_UPLOAD_BYTES:
                raise InputError(f"a mesh file may have at most {MAX_UPLOAD_BYTES // 1_000_000} MB", field="file_name")
            body.write(chunk)
        body.seek(0)
        structure = await run_in_threadpool(
            services.structures.add,
            body,
            original_name=file_name,
            name=name,
            scale=scale,
            up=up,
            rotation_deg=rotation_deg,
            position_m=(x_m, y_m, z_m),
        )
    return structure_detail(structure)


@router.get("/{structure_id}", operation_id="getStructure")
def get_structure(services: Services, structure_id: StructureId) -> StructureDetail:
    """A structure with its bounds, cables, named points and notes."""
    return structure_detail(services.structures.get(structure_id))


@router.get(
    "/{structure_id}/mesh",
    operation_id="getStructureMesh",
    response_class=Response,
    responses={200: {"content": {PLY: {"schema": {"type": "string", "format": "binary"}}}}},
)
def get_structure_mesh(services: Services, structure_id: StructureId) -> Response:
    """The placed triangles as a binary little-endian PLY (float32 vertices, scene metres)."""
    return Response(services.structures.mesh_ply(structure_id), media_type=PLY)


@router.get("/{structure_id}/scenario", operation_id="getStructureScenario")
def get_structure_scenario(services: Services, structure_id: StructureId) -> dict[str, Any]:
    """A scenario to start from: the sample's own, or for a mesh one with common numbers that must be looked at."""
    return services.structures.starting_scenario(structure_id)


@router.delete("/{structure_id}", status_code=204, operation_id="deleteStructure")
def delete_structure(services: Services, structure_id: StructureId) -> None:
    """Remove a mesh; plans keep their own copy of the structure."""
    services.structures.delete(structure_id)
