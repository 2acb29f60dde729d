"""The camera and its mount."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from gcs.core.fields import NonNegative, Point2, Positive, Strict


class Gimbal(Strict):
    """What the camera mount can do; without `yaw_range_deg` the vehicle turns."""

    pitch_min_deg: Annotated[float, Field(ge=-90, le=90)] = -90.0
    pitch_max_deg: Annotated[float, Field(ge=-90, le=90)] = 30.0
    rate_deg_s: Positive = 60.0
    yaw_range_deg: Point2 | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.pitch_min_deg >= self.pitch_max_deg:
            raise ValueError("pitch_min_deg must be below pitch_max_deg")
        return self


class Camera(Strict):
    """A pinhole camera by its numbers."""

    sensor_width_mm: Positive
    sensor_height_mm: Positive
    focal_length_mm: Positive
    image_width_px: Annotated[int, Field(gt=0)]
    image_height_px: Annotated[int, Field(gt=0)]
    min_interval_s: NonNegative = 1.0
    gimbal: Gimbal = Gimbal()

    @model_validator(mode="before")
    @classmethod
    def _no_library_yet(cls, data: object) -> object:
        if isinstance(data, dict) and "model" in data:
            raise ValueError("`model` needs the camera library, which this version does not have: give the numbers")
        return data

    @property
    def half_width_tangent(self) -> float:
        """Tangent of half the horizontal field of view."""
        return self.sensor_width_mm / (2 * self.focal_length_mm)

    @property
    def half_height_tangent(self) -> float:
        """Tangent of half the vertical field of view."""
        return self.sensor_height_mm / (2 * self.focal_length_mm)

    def distance_for_gsd(self, gsd_m: float) -> float:
        """Largest distance (m) along the optical axis at which a pixel's width is at most `gsd_m` on the surface."""
        return gsd_m * self.focal_length_mm * self.image_width_px / self.sensor_width_mm

    def gsd_at(self, distance_m: float) -> float:
        """Ground sampling distance (m a pixel) at a distance (m) along the optical axis."""
        return distance_m * self.sensor_width_mm / (self.focal_length_mm * self.image_width_px)

    def distance_for_footprint(self, width_m: float) -> float:
        """Working distance (m) at which the picture is `width_m` wide: `f Fov / d_C` (crane paper, eq. 2 mended)."""
        return width_m * self.focal_length_mm / self.sensor_width_mm
