"""The camera and its mount: what it shows, how sharp, and how still it must be held."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

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
    """A pinhole camera by its numbers, and the optics and shutter that limit where a picture of it is sharp.

    The limits apply only as far as they are known: without `f_number` everything is in focus, without `exposure_s`
    nothing is blurred, and without `readout_s` of a rolling shutter nothing is skewed.

    Attributes:
        model: its name in the camera library, when its numbers come from there.
        focal_range_mm: shortest and longest focal length of a zoom lens; None for a fixed one.
        focal_length_mm: the lens's own focal length, not its 35 mm equivalent.
        min_interval_s: least time between two pictures.
        f_number: aperture at which pictures are taken.
        nearest_focus_m: nearest distance that can be focused on.
        exposure_s: how long each pixel is exposed.
        shutter: `global` when all rows are exposed at once (a leaf shutter too), `rolling` when they are one after
            the other (a focal-plane shutter's curtains too).
        readout_s: time from the first row to the last of a rolling shutter.
        max_blur_px: how far the image may move during the exposure. One pixel is what its own width hides.
        blur_circle_px: largest circle of confusion. Two pixels: colour interpolation spreads a point as far anyway.
        max_skew_px: how far the image may move between the first row and the last. Two pixels are what photogrammetry
            takes without a model of the shutter (Vautherin et al., "Photogrammetric accuracy and modeling of rolling
            shutter cameras", ISPRS Annals III-3, 2016).
    """

    model: str | None = None
    sensor_width_mm: Positive
    sensor_height_mm: Positive
    focal_range_mm: tuple[Positive, Positive] | None = None
    focal_length_mm: Positive
    image_width_px: Annotated[int, Field(gt=0)]
    image_height_px: Annotated[int, Field(gt=0)]
    min_interval_s: NonNegative = 1.0
    f_number: Positive | None = None
    nearest_focus_m: NonNegative = 0.0
    exposure_s: Positive | None = None
    shutter: Literal["global", "rolling"] = "global"
    readout_s: Positive | None = None
    max_blur_px: Positive = 1.0
    blur_circle_px: Positive = 2.0
    max_skew_px: Positive = 2.0
    gimbal: Gimbal = Gimbal()

    @field_validator("focal_length_mm")
    @classmethod
    def _within_zoom(cls, focal_length_mm: float, info: ValidationInfo) -> float:
        low, high = info.data.get("focal_range_mm") or (0.0, math.inf)
        if not low <= focal_length_mm <= high:
            raise ValueError(f"{focal_length_mm:g} is outside the zoom range of {low:g} to {high:g} mm")
        return focal_length_mm

    @model_validator(mode="after")
    def _readout_of_rolling(self) -> Self:
        if self.readout_s is not None and self.shutter != "rolling":
            raise ValueError("readout_s is a rolling shutter's: say `shutter: rolling`, or leave it out")
        return self

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

    @property
    def hyperfocal_m(self) -> float:
        """Nearest focus distance (m) at which everything beyond is sharp, `f^2 / (N c) + f`; 0 without `f_number`."""
        if self.f_number is None:
            return 0.0
        circle_mm = self.blur_circle_px * self.sensor_width_mm / self.image_width_px
        return (self.focal_length_mm**2 / (self.f_number * circle_mm) + self.focal_length_mm) / 1000

    def sharp_between_m(self, focus_m: float) -> tuple[float, float]:
        """Depth of field: the nearest and furthest depth that are sharp in a picture.

        A thin lens images a point at depth d as a circle of diameter `c = f^2 |d - s| / (N d (s - f))` when it is
        focused at depth s; what keeps `c` within `blur_circle_px` is sharp.

        Args:
            focus_m: depth (m) that is focused on; the lens focuses at `nearest_focus_m` when that is further away.

        Returns:
            Depths (m) along the optical axis: (0, inf) when no `f_number` is given, to inf from the hyperfocal distance
            on, and (inf, inf) within the focal length, where there is no image.
        """
        if self.f_number is None:
            return 0.0, math.inf
        focal, focus, hyperfocal = self.focal_length_mm / 1000, max(focus_m, self.nearest_focus_m), self.hyperfocal_m
        if focus <= focal:
            return math.inf, math.inf
        nearest = focus * (hyperfocal - focal) / (hyperfocal + focus - 2 * focal)
        furthest = focus * (hyperfocal - focal) / (hyperfocal - focus) if focus < hyperfocal else math.inf
        return nearest, furthest

    def blur_px(self, speed_m_s: float, depth_m: float) -> float | None:
        """Motion blur (pixels) of a point at a depth (m) at a speed across the view; None without `exposure_s`."""
        return None if self.exposure_s is None else speed_m_s * self.exposure_s / self.gsd_at(depth_m)

    def skew_px(self, speed_m_s: float, depth_m: float) -> float | None:
        """Shift (pixels) between the first row and the last of a point at a depth (m); None without `readout_s`."""
        return None if self.readout_s is None else speed_m_s * self.readout_s / self.gsd_at(depth_m)

    def fastest_m_s(self, depth_m: float) -> float:
        """Largest speed (m/s) across the view at which blur and skew stay within their limits at a depth (m).

        Turning of the camera is not counted: gimbal and vehicle have settled when a picture is taken.
        """
        blurred = math.inf if self.exposure_s is None else self.max_blur_px / self.exposure_s
        skewed = math.inf if self.readout_s is None else self.max_skew_px / self.readout_s
        return min(blurred, skewed) * self.gsd_at(depth_m)
