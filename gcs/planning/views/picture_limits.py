"""From how near a picture can be taken: clearance, focus, blur at hover, and what has to be in the picture."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from gcs.core.errors import InfeasibleError

if TYPE_CHECKING:
    from gcs.core.camera import Camera
    from gcs.core.scenario import Scenario, VehicleSpec


class NearestPlace(NamedTuple):
    """The smallest distance along the optical axis from which something can be photographed, and what limits it."""

    distance_m: float
    because: str


def nearest_sharp_m(camera: Camera, vehicle: VehicleSpec, position_error_m: float) -> float:
    """Smallest depth (m) from which a camera that focuses on its target takes a sharp picture of it.

    The lens can focus there, and what moves across the image while the vehicle drifts stays within the camera's limits
    of blur and skew; both from the nearest place that the vehicle may be at by its position error.

    Args:
        camera: its optics and shutter.
        vehicle: gives the speed of its drift.
        position_error_m: how much nearer than planned it may be.

    Returns:
        0 when the camera's numbers set no limit.
    """
    focus = camera.sharp_between_m(camera.nearest_focus_m)[0] if camera.nearest_focus_m > 0 else 0.0
    # blur and skew in pixels grow with the inverse of the depth, so the speed allowed at 1 m says it all
    still = vehicle.hover_speed_m_s / camera.fastest_m_s(1.0)
    nearest = max(focus, still)
    return nearest + position_error_m if nearest > 0 else 0.0


def nearest_place(
    scenario: Scenario, clearance_m: float, half_width_m: float = 0.0, half_height_m: float = 0.0
) -> NearestPlace:
    """From how near a target square to the optical axis can be photographed whole and sharp.

    The footprint has to be the target's size and the position error H on every side: `2 (half_width + H)` wide, the
    same for the height (yard paper, eqs 3-4, turned the right way round).

    Args:
        scenario: camera, vehicle and position error.
        clearance_m: what the vehicle's centre keeps from the target.
        half_width_m: half of the target's extent across the image; 0 for a point.
        half_height_m: the same upwards.
    """
    camera, error = scenario.camera, scenario.safety.position_m
    held = max((half_width_m + error) / camera.half_width_tangent, (half_height_m + error) / camera.half_height_tangent)
    sharp = nearest_sharp_m(camera, scenario.vehicle, error)
    return max(
        NearestPlace(clearance_m, f"the vehicle keeps {clearance_m:.2f} m (hull and error budget)"),
        NearestPlace(sharp, f"pictures are sharp only from {sharp:.2f} m (focus, and blur at hover)"),
        NearestPlace(held, f"all of it is in the picture, whatever the position error, only from {held:.2f} m"),
        key=lambda place: place.distance_m,
    )


def distance_for(camera: Camera, gsd_mm: float | None, nearest: NearestPlace, furthest_m: float, field: str) -> float:
    """The largest distance (m) from which a target may be photographed.

    Args:
        camera: gives the distance of the GSD.
        gsd_mm: the largest that will do; None when none is asked.
        nearest: the smallest distance.
        furthest_m: no place is further away.
        field: the scenario's field that asks.

    Raises:
        InfeasibleError: it is less than the smallest; says the best GSD that can be had.
    """
    distance = math.inf if gsd_mm is None else camera.distance_for_gsd(gsd_mm / 1000)
    if distance < nearest.distance_m:
        best = math.ceil(round(1e5 * camera.gsd_at(nearest.distance_m), 6)) / 100  # rounded up, so that it can be had
        raise InfeasibleError(
            f"a GSD of {gsd_mm:g} mm asks for {distance:.2f} m, but {nearest.because}: the best it can have is "
            f"{best:.2f} mm",
            field=field,
        )
    if nearest.distance_m > furthest_m:
        raise InfeasibleError(f"{nearest.because}, and viewpoints are at most {furthest_m:g} m away", field=field)
    return min(distance, furthest_m)
