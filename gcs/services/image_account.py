"""The account of a flight's pictures: which viewpoint each belongs to, and which are missing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError, NotFoundError
from gcs.core.frames import enu_from_geodetic
from gcs.planning.image_matching import match_images
from gcs.services.image_metadata import read_metadata
from gcs.storage.records import ImageState

if TYPE_CHECKING:
    from gcs.core.frames import GeoPoint
    from gcs.core.plan import Plan
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.storage.records import ImageRecord

STEEP_RAD = math.radians(60.0)
"""A view steeper than this has no heading worth comparing."""


@dataclass(frozen=True)
class ImageAccount:
    """Where the pictures of a flight stand.

    Attributes:
        expected: one a viewpoint.
        received: viewpoints that have a stored picture.
        missing: names of the viewpoints that have none.
        unmatched: stored pictures that belong to no viewpoint.
    """

    expected: int
    received: int
    missing: tuple[str, ...]
    unmatched: int

    @property
    def complete(self) -> bool:
        """Whether every viewpoint has its picture."""
        return not self.missing


def scene_position(plan: Plan, place: GeoPoint | None) -> tuple[float, float, float] | None:
    """A geodetic place in the plan's scene frame (m)."""
    if place is None:
        return None
    enu = enu_from_geodetic(place.latitude_deg, place.longitude_deg, place.altitude_m, plan.scenario.anchor.point)
    return (float(enu[0]), float(enu[1]), float(enu[2]))


class ImageAccounting:
    """Matches the stored pictures of one flight with its viewpoints.

    Positions come from the vehicle's announcements, else from the files; headings come from the files. What a file says
    is read once.
    """

    def __init__(self, plan: Plan, recorder: FlightRecorder) -> None:
        self._plan = plan
        self._recorder = recorder
        self._told: dict[str, tuple[float | None, tuple[float, float, float] | None]] = {}

    def settle(self) -> ImageAccount:
        """Match anew, write changed matches down, and count."""
        plan, recorder = self._plan, self._recorder
        images = [i for i in recorder.database.images.of_flight(recorder.flight_id) if i.state is ImageState.STORED]
        images.sort(key=_order)
        positions, headings = np.full((len(images), 3), np.nan), np.full(len(images), np.nan)
        for k, image in enumerate(images):
            yaw, place = self._from_file(image)
            position = image.position_m or place
            if position is not None:
                positions[k] = position
            if yaw is not None:
                headings[k] = yaw
        matches = match_images(positions, headings, *_wanted(plan))
        for image, match in zip(images, matches, strict=True):
            viewpoint = None if match is None else plan.viewpoints[match]
            viewpoint_id, name = (None, None) if viewpoint is None else (viewpoint.id, viewpoint.name)
            if image.viewpoint_id != viewpoint_id:
                recorder.change_image(image.id, viewpoint_id=viewpoint_id, viewpoint_name=name)
        seen = {m for m in matches if m is not None}
        missing = tuple(v.name for k, v in enumerate(plan.viewpoints) if k not in seen)
        return ImageAccount(len(plan.viewpoints), len(seen), missing, sum(m is None for m in matches))

    def _from_file(self, image: ImageRecord) -> tuple[float | None, tuple[float, float, float] | None]:
        if image.id not in self._told:
            try:
                metadata = read_metadata(self._recorder.image_data(image), image.id)
                told = (metadata.yaw_rad, scene_position(self._plan, metadata.position))
            except (InputError, NotFoundError):
                told = (None, None)
            self._told[image.id] = told
        return self._told[image.id]


def _wanted(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    positions = np.array([v.position_m for v in plan.viewpoints]).reshape(-1, 3)
    headings = [math.nan if abs(v.gimbal_pitch_rad) > STEEP_RAD else v.yaw_rad for v in plan.viewpoints]
    return positions, np.array(headings)


def _order(image: ImageRecord) -> tuple[float, int, str]:
    """Order in which pictures were taken, as far as it is known."""
    index = image.index if image.index is not None else 0
    time_s = image.vehicle_time_s if image.vehicle_time_s is not None else 0.0
    return (time_s, index, image.vehicle_path or image.id)
