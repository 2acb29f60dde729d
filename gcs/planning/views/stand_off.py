"""Footprint and stand-off of a camera that looks down at an angle: the yard paper's models, and the crane paper's.

The camera is at a height d above a plane and looks at it at a depression angle θ (90° is straight down); its fields of
view are α_v along the view and α_h across it. Sources: the yard paper (JMSE 2024, 12, 128), eqs 1-7, and the crane
paper (Remote Sensing 2022, 14, 1658), eqs 1-2. Where their printed form cannot be used:

- Yard, eqs 1-2, `v = 2 (d / tan θ - d / tan(θ + α_v/2))` and the same for h: not defined at nadir. Written with cot
  they are, and give `2 d tan(α/2)` there. v doubles the near half of the footprint, so it is safe; h is not: at θ = 45°
  and 40° x 30° it is 31 % more than the near edge shows. `Footprint` is the true trapezium.
- Yard, eqs 3-4, take `h - H` for the inverse, so that a larger position error H brings the camera nearer. To be sure
  of a cell, `cell_stand_off` asks for a footprint of `cell + 2 H`.
- Yard, eqs 5-7, are the inverse of eqs 1-2; they too are written with cot.
- Crane, eq. 2, `d_work = f d_C / Fov`, is upside down: d_work is `f Fov / d_C`.

Functions named `printed_...` are the papers' own forms, to stand beside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import InfeasibleError

if TYPE_CHECKING:
    from gcs.core.camera import Camera


@dataclass(frozen=True)
class Footprint:
    """The trapezium that a picture shows of a plane; distances on the plane from the point below the camera.

    Attributes:
        near_m: to the near edge; negative when it lies behind that point.
        aim_m: to where the optical axis meets the plane.
        far_m: to the far edge; infinite when the picture shows the horizon.
        near_width_m: length of the near edge.
        far_width_m: length of the far edge.
    """

    near_m: float
    aim_m: float
    far_m: float
    near_width_m: float
    far_width_m: float

    @property
    def even_length_m(self) -> float:
        """Length along the view of what is seen on both sides of the aim: twice the near half (yard paper, eq. 1)."""
        return 2 * (self.aim_m - self.near_m)


@dataclass(frozen=True)
class CellStandOff:
    """From where a cell is sure to be in the picture.

    Attributes:
        height_m: d, above the plane.
        distance_m: along the optical axis.
        gsd_m: at the far edge of the cell, with the camera as far away as the position error lets it be.
        limited_by: which extent of the cell asks for the distance.
    """

    height_m: float
    distance_m: float
    gsd_m: float
    limited_by: str


def footprint(camera: Camera, height_m: float, depression_rad: float) -> Footprint:
    """What a picture shows of a plane.

    The near edge is at `d cot(θ + α_v/2)` and `2 d tan(α_h/2) cos(α_v/2) / sin(θ + α_v/2)` long, the far edge the same
    with minus.

    Args:
        camera: its width is across the view.
        height_m: above the plane.
        depression_rad: of the optical axis, over 0 and at most π/2.
    """
    _check_depression(depression_rad)
    half = math.atan(camera.half_height_tangent)
    low, high = depression_rad + half, depression_rad - half
    width = 2 * height_m * camera.half_width_tangent * math.cos(half)
    return Footprint(
        near_m=height_m * _cot(low),
        aim_m=height_m * _cot(depression_rad),
        far_m=height_m * _cot(high) if high > 0 else math.inf,
        near_width_m=width / math.sin(low),
        far_width_m=width / math.sin(high) if high > 0 else math.inf,
    )


def cell_stand_off(
    camera: Camera,
    cell_width_m: float,
    cell_length_m: float,
    depression_rad: float,
    *,
    width_error_m: float = 0.0,
    length_error_m: float = 0.0,
    gsd_m: float | None = None,
) -> CellStandOff:
    """The smallest distance at which a cell about the aim is in the picture, whatever the position error.

    Asks the true trapezium for `cell + 2 V` evenly about the aim and for `cell + 2 H` across the view at the near edge
    of that, and takes the larger of the two distances.

    Args:
        camera: its width is across the view.
        cell_width_m: extent of the cell across the view.
        cell_length_m: extent of the cell along the view, on the plane.
        depression_rad: of the optical axis, over 0 and at most π/2.
        width_error_m: H, largest position error across the view.
        length_error_m: V, largest position error along the view.
        gsd_m: largest ground sampling distance (m a pixel) that will do anywhere on the cell.

    Raises:
        InfeasibleError: from that distance the GSD is not kept.
    """
    length = cell_length_m + 2 * length_error_m
    edge = length / 2 * math.cos(depression_rad)
    along = length / footprint(camera, 1.0, depression_rad).even_length_m / math.sin(depression_rad)
    across = (cell_width_m / 2 + width_error_m) / camera.half_width_tangent + edge
    distance = max(across, along)
    coarsest = camera.gsd_at(distance + edge)
    if gsd_m is not None and coarsest > gsd_m:
        raise InfeasibleError(
            f"a cell of {cell_width_m:g} m x {cell_length_m:g} m is in the picture from {distance:.2f} m only, where a "
            f"pixel is {1000 * coarsest:.2f} mm wide: ask for smaller cells or at least {1000 * coarsest:.2f} mm",
            field="gsd_mm",
        )
    limited_by = "width" if across > along else "length"
    return CellStandOff(distance * math.sin(depression_rad), distance, coarsest, limited_by)


def printed_footprint(height_m: float, depression_rad: float, field_of_view_rad: float) -> float:
    """Extent (m) of a footprint on either axis by the yard paper's eqs 1 and 2, written with cot.

    Args:
        height_m: d, above the plane.
        depression_rad: θ, over 0 and at most π/2.
        field_of_view_rad: α of that axis.
    """
    _check_depression(depression_rad)
    return 2 * height_m * (_cot(depression_rad) - _cot(depression_rad + field_of_view_rad / 2))


def printed_stand_off(extent_m: float, depression_rad: float, field_of_view_rad: float) -> float:
    """Height (m) at which `printed_footprint` is `extent_m`: the yard paper's eqs 5 and 6, written with cot."""
    return extent_m / printed_footprint(1.0, depression_rad, field_of_view_rad)


def printed_compensated_stand_off(
    extent_m: float, error_m: float, depression_rad: float, field_of_view_rad: float
) -> float:
    """Height (m) that the yard paper's eqs 3-6 give for a position error: nearer for a larger error, as printed."""
    return printed_stand_off(extent_m - error_m, depression_rad, field_of_view_rad)


def magnification(sensor_mm: float, field_m: float) -> float:
    """Optical magnification `Om = d_C / Fov` of one axis (crane paper, eq. 1)."""
    return sensor_mm / 1000 / field_m


def working_distance(camera: Camera, width_m: float, height_m: float) -> float:
    """Distance (m) at which a field of that size is in the picture: `d_work = f Fov / d_C`, the larger of both axes."""
    across = width_m / camera.sensor_width_mm
    upward = height_m / camera.sensor_height_mm
    return camera.focal_length_mm * max(across, upward)


def printed_working_distance(focal_length_mm: float, sensor_mm: float, field_m: float) -> float:
    """Distance (m) by the crane paper's eq. 2 as printed, `f d_C / Fov`: millimetres where metres are meant."""
    return focal_length_mm / 1000 * sensor_mm / 1000 / field_m


def _cot(angle_rad: float) -> float:
    return math.cos(angle_rad) / math.sin(angle_rad)


def _check_depression(depression_rad: float) -> None:
    if not 0 < depression_rad <= math.pi / 2 + 1e-12:
        raise ValueError(f"the depression angle is {math.degrees(depression_rad):.1f} degrees: over 0, at most 90")
