"""The scenario: what is to be inspected, with which camera and vehicle, and how safely.

Parsed from YAML or JSON and frozen. Field names are those of the file, so that every complaint names a field the
user can find. Positions are scene ENU metres.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from gcs.core.camera import Camera
from gcs.core.camera_library import resolve_camera
from gcs.core.errors import InputError
from gcs.core.fields import Finite, NonNegative, Point2, Point3, Positive, Strict
from gcs.core.frames import GeoPoint
from gcs.core.inspection import Inspection
from gcs.core.rotors import Rotors
from gcs.core.structure_source import StructureSource


class Anchor(Strict):
    """Where the scene's origin is; the altitude is above mean sea level (EGM96)."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    altitude_m: Annotated[float, Field(ge=-500, le=9000)]

    @property
    def point(self) -> GeoPoint:
        """The anchor as a geodetic point."""
        return GeoPoint(self.latitude_deg, self.longitude_deg, self.altitude_m)


class Battery(Strict):
    """Usable energy; `reserve` is the share that must be left after landing."""

    capacity_wh: Positive
    reserve: Annotated[float, Field(ge=0, lt=1)] = 0.25


MOST_VEHICLES = 10


class VehicleSpec(Strict):
    """What the vehicle is and can do.

    `hover_speed_m_s` is how fast it drifts while it holds a position; pictures must be sharp at that speed. A drift of
    0.1 m to and fro in six seconds, as position control keeps in a light wind, is 0.1 m/s at its fastest.
    `rotors` and `drag_area_m2` are as usual for the mass where they are not given; `avionics_w` is what electronics and
    payload take. `max_tilt_deg`, the thrust's angle from the vertical, and `max_thrust_ratio`, thrust over weight, are
    what a plan may ask for in still air, drag left out. `count` vehicles share the work; the first stands at home_m,
    the others on `pads_m`, or in a row beside it.
    """

    radius_m: Positive = 0.5
    max_speed_m_s: Positive = 5.0
    max_acceleration_m_s2: Positive = 2.5
    max_jerk_m_s3: Positive | None = None
    max_tilt_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    max_thrust_ratio: Annotated[float, Field(gt=1)] | None = None
    hover_speed_m_s: NonNegative = 0.1
    mass_kg: Positive = 3.0
    rotors: Rotors | None = None
    drag_area_m2: NonNegative | None = None
    avionics_w: NonNegative = 10.0
    battery: Battery | None = None
    count: Annotated[int, Field(ge=1, le=MOST_VEHICLES)] = 1
    pads_m: tuple[Point3, ...] = ()

    @model_validator(mode="after")
    def _a_pad_each(self) -> Self:
        if self.pads_m and len(self.pads_m) != self.count - 1:
            raise ValueError(
                f"pads_m has {len(self.pads_m)} pads, and {self.count - 1} are needed: one for each vehicle but the "
                "first, which stands at home_m"
            )
        return self


class Safety(Strict):
    """The error budget: all of it is kept between hull and surface.

    `separation_m` is kept between the centres of two vehicles, the tracking and position errors of both on top.
    """

    clearance_m: NonNegative = 1.0
    tracking_m: NonNegative = 0.5
    position_m: NonNegative = 0.3
    model_m: NonNegative = 0.1
    corridor_half_width_m: Positive = 0.5
    separation_m: Positive = 5.0

    @property
    def apart_m(self) -> float:
        """Distance kept between the planned curves of two vehicles' centres."""
        return self.separation_m + 2 * (self.tracking_m + self.position_m)

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
    """Which methods are used; `mu` and `k` are those of the metric `energy`, `k sqrt(dx^2 + dy^2 + mu dz^2)`.

    `trajectory` is the curve of least snap about the path: through its corners (`plain`), through two points in the
    place of each (`corrected`), through four (`geometric`), or anywhere in a corridor about it. Only a corridor holds
    the curve within safety.corridor_half_width_m of the path; the others are refused where they come too near.

    `corridor` says what such a corridor is made of about each straight: axis-aligned `boxes`; `tubes` that hold each
    component of the deviation; or `polytopes`, tubes cut by planes where something stands too near.

    `viewpoints` says how pictures are taken: at rest (`stop`), or in flight (`fly_through`) wherever the camera's
    limits of blur and skew, its shortest interval and the rates of yaw and gimbal allow it and no time is lost by it.
    That is flown as a stream of setpoints; a mission stops for every picture.
    """

    tour: Literal["fast", "genetic", "given"] = "fast"
    metric: Literal["length", "time", "energy"] = "time"
    mu: NonNegative = 3.0
    k: Positive = 1.0
    trajectory: Literal["plain", "corrected", "geometric", "corridor"] = "corridor"
    corridor: Literal["boxes", "tubes", "polytopes"] = "boxes"
    viewpoints: Literal["stop", "fly_through"] = "stop"
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _only_a_corridor_has_a_kind(self) -> Self:
        if self.corridor != "boxes" and self.trajectory != "corridor":
            raise ValueError(f"corridor: {self.corridor} needs trajectory: corridor, not {self.trajectory}")
        return self

    @model_validator(mode="after")
    def _only_a_corridor_is_flown_through(self) -> Self:
        if self.viewpoints == "fly_through" and self.trajectory != "corridor":
            raise ValueError(f"viewpoints: fly_through needs trajectory: corridor, not {self.trajectory}")
        return self


class Scenario(Strict):
    """Everything `gcs plan` needs to know."""

    name: str = Field(default="inspection", min_length=1, max_length=120)
    structure: StructureSource
    anchor: Anchor
    ground_m: Finite | None = None
    camera: Annotated[Camera, BeforeValidator(resolve_camera)]
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
            raise ValueError("inspection is missing: name at least one of surface, points and faces")
        return self

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
