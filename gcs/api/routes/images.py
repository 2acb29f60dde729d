"""Pictures."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import FileResponse

from gcs.api.dependencies import ImageId, Services
from gcs.api.schemas.flights import ImageInfo
from gcs.api.views import image_info

router = APIRouter(prefix="/images", tags=["images"])

MEDIA_TYPES = {".jpg": "image/jpeg", ".png": "image/png"}


@router.get("/{image_id}", operation_id="getImage")
def get_image(services: Services, image_id: ImageId) -> ImageInfo:
    """What is known of a picture."""
    return image_info(services.database.images.get(image_id))


@router.get(
    "/{image_id}/file",
    operation_id="getImageFile",
    response_class=FileResponse,
    responses={200: {"content": {"image/jpeg": {"schema": {"type": "string", "format": "binary"}}}}},
)
def get_image_file(services: Services, image_id: ImageId) -> FileResponse:
    """The picture itself, once it is stored."""
    path = services.images.path(services.database.images.get(image_id))
    return FileResponse(path, media_type=MEDIA_TYPES.get(path.suffix, "application/octet-stream"))
