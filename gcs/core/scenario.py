"""The scenario: what is to be inspected, with which camera and vehicle, and how safely.

Parsed from YAML or JSON and frozen. Field names are those of the file, so that every complaint names a field the
user can find. Positions are scene ENU metres.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from gcs.core.errors import InputError
from gcs.core.frames import GeoPoint

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Point3 = tuple[Finite, Finite, Finite]
Point2 = tuple[Finite, Finite]

DEFAULT_POINT_FOOTPRINT_M = 3.0
"""Width of the picture of a named point when no GSD is asked (the gantry-crane paper's field of view)."""


class Strict(BaseModel):
    """Base of all scenario models: frozen, and a field that is not known is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class MeshSource(Strict):
    """A mesh file and how it stands in the scene. Order: scale, up, rotation, position."""

    file: str = Field(min_length=1)
    scale: Positive = 1.0
    up: Literal["z", "y"] = "z"
    position_m: Point3 = (0.0, 0.0, 0.0)
    rotation_deg: Finite = 0.0
    sha256: str | None = None


class Cable(Strict):
    """A straight stay: a capsule."""

    from_m: Point3
    to_m: Point3
    radius_m: Positive


class StructureSource(Strict):
    """Meshes and cables, or a sample scene."""

    meshes: tuple[MeshSource, ...] = ()
    cables: tuple[Cable, ...] = ()
    sample: Literal["gantry-crane", "container-yard", "bridge-tower"] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if bool(self.meshes) == (self.sample is not None):
            raise ValueError("give either meshes or a sample")
        return self


class Anchor(Strict):
    """Where the scene's origin is; the altitude is above mean sea level (EGM96)."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    altitude_m: Annotated[float, Field(ge=-500, le=9000)]

    @property
    def point(self) -> GeoPoint:
        """The anchor as a geodetic point."""
        return GeoPoint(self.latitude_deg, self.longitude_deg, self.altitude_m)


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


class Region(Strict):
    """An axis-aligned box that selects surface."""

    min_m: Point3
    max_m: Point3

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if any(a >= b for a, b in zip(self.min_m, self.max_m, strict=True)):
            raise ValueError("min_m must be below max_m on every axis")
        return self


class SurfaceTask(Strict):
    """Everything that can be seen from outside, or what lies in `regions`."""

    gsd_mm: Positive
    overlap: Annotated[float, Field(ge=0, lt=0.95)] = 0.3
    max_incidence_deg: Annotated[float, Field(gt=0, lt=90)] = 60.0
    regions: tuple[Region, ...] = ()


class NamedPoint(Strict):
    """A point to be photographed, with its outward normal; without a GSD the picture is 3 m wide."""

    name: str = Field(min_length=1, max_length=80)
    position_m: Point3
    normal: Point3
    gsd_mm: Positive | None = None

    @field_validator("normal")
    @classmethod
    def _unit(cls, normal: Point3) -> Point3:
        length = math.sqrt(sum(c * c for c in normal))
        if length < 1e-9:
            raise ValueError("the normal must not be zero")
        return (normal[0] / length, normal[1] / length, normal[2] / length)


class FaceTask(Strict):
    """A rectangular face inspected on a fixed grid of cells."""

    name: str = Field(min_length=1, max_length=80)
    origin_m: Point3
    along_m: Point3
    up_m: Point3
    normal: Point3
    cell_m: Positive


class Inspection(Strict):
    """What is to be seen: one or more of surface, points and faces."""

    surface: SurfaceTask | None = None
    points: tuple[NamedPoint, ...] = ()
    faces: tuple[FaceTask, ...] = ()

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.surface is None and not self.points and not self.faces:
            raise ValueError("name at least one of surface, points and faces")
        if self.faces:
            raise ValueError("`faces` is not part of this version: use surface with a region, or points")
        names = [p.name for p in self.points]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"the names of points must differ; given twice: {', '.join(twice)}")
        return self


class Battery(Strict):
    """Usable energy; `reserve` is the share that must be left after landing."""

    capacity_wh: Positive
    reserve: Annotated[float, Field(ge=0, lt=1)] = 0.25


class VehicleSpec(Strict):
    """What the vehicle is and can do."""

    radius_m: Positive = 0.5
    max_speed_m_s: Positive = 5.0
    max_acceleration_m_s2: Positive = 2.5
    max_jerk_m_s3: Positive | None = None
    mass_kg: Positive = 3.0
    battery: Battery | None = None
    count: Annotated[int, Field(ge=1)] = 1

    @field_validator("count")
    @classmethod
    def _one_for_now(cls, count: int) -> int:
        if count != 1:
            raise ValueError("sharing the work between vehicles is not part of this version: use 1")
        return count


class Safety(Strict):
    """The error budget: all of it is kept between hull and surface."""

    clearance_m: NonNegative = 1.0
    tracking_m: NonNegative = 0.5
    position_m: NonNegative = 0.3
    model_m: NonNegative = 0.1
    corridor_half_width_m: Positive = 0.5

    @property
    def hull_clearance_m(self) -> float:
        """Distance kept between hull and any surface: clearance and all errors at once."""
        return self.clearance_m + self.tracking_m + self.position_m + self.model_m


class Fence(Strict):
    """Where the vehicle may fly: polygons in scene metres and a height."""

    include: tuple[tuple[Point2, ...], ...] = ()
    exclude: tuple[tuple[Point2, ...], ...] = ()
    max_height_m: Positive | None = None

    @field_validator("include", "exclude")
    @classmethod
    def _polygons(cls, polygons: tuple[tuple[Point2, ...], ...]) -> tuple[tuple[Point2, ...], ...]:
        if any(len(p) < 3 for p in polygons):
            raise ValueError("a polygon needs at least three corners")
        return polygons


class PlannerOptions(Strict):
    """Which methods are used."""

    tour: Literal["fast", "given"] = "fast"
    metric: Literal["length", "time"] = "time"
    trajectory: Literal["corridor"] = "corridor"
    seed: Annotated[int, Field(ge=0)] = 0


class Scenario(Strict):
    """Everything `gcs plan` needs to know."""

    name: str = Field(default="inspection", min_length=1, max_length=120)
    structure: StructureSource
    anchor: Anchor
    ground_m: Finite | None = None
    camera: Camera
    inspection: Inspection | None = None
    vehicle: VehicleSpec = VehicleSpec()
    safety: Safety = Safety()
    home_m: Point3 = (0.0, 0.0, 0.0)
    fence: Fence | None = None
    rally_m: tuple[Point3, ...] = ()
    planner: PlannerOptions = PlannerOptions()

    @model_validator(mode="after")
    def _inspection_unless_sample(self) -> Self:
        if self.inspection is None and self.structure.sample is None:
            raise ValueError("inspection is missing: name at least one of surface and points")
        return self

    @field_validator("rally_m")
    @classmethod
    def _no_rally_yet(cls, rally: tuple[Point3, ...]) -> tuple[Point3, ...]:
        if rally:
            raise ValueError("rally points are not part of this version: leave them out")
        return rally

    @property
    def centre_clearance_m(self) -> float:
        """Smallest allowed distance between the vehicle's centre and any surface (m)."""
        return self.vehicle.radius_m + self.safety.hull_clearance_m


def parse_scenario(data: object) -> Scenario:
    """Check the content of a scenario file.

    Args:
        data: what the YAML or JSON parser gave.

    Raises:
        InputError: in one line, naming the first field that is wrong.
    """
    if not isinstance(data, dict):
        raise InputError("a scenario is a mapping with structure, anchor, camera, inspection, ...", field="scenario")
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "scenario"
        message = first["msg"].removeprefix("Value error, ")
        known = {
            "extra_forbidden": "unknown field; see the scenario format",
            "missing": "this field is missing",
        }
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise InputError(known.get(first["type"], message) + more, field=field) from None
