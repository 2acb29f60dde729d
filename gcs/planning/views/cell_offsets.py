"""From where an empty scene would show a whole cell of a face as asked: distances and tilts, relative to its middle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.views.camera_footprint import faces_camera
from gcs.planning.views.face_grid import outward_normal
from gcs.planning.views.picture_limits import NearestPlace, distance_for, nearest_place, nearest_sharp_m
from gcs.planning.views.viewpoint_pose import camera_angles, camera_axes, gimbal_pitch_range_rad
from gcs.planning.views.viewpoints_points import tilted_directions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.inspection import FaceTask
    from gcs.core.scenario import Scenario
    from gcs.planning.views.face_grid import FaceCell

TILT_STEPS = 6
STEEPEST = 0.97
"""Share of the incidence limit that the most tilted places have."""

LENGTHS = 10
FARTHEST = 3.0
"""Without a GSD places go out to this many times the wanted distance."""

VERTICAL = 1e-6
"""A view with less than this of a level part is straight up or down: the picture is turned to go with the face."""

ROUNDING_M = 1e-9
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class CellOffsets:
    """Places relative to the middle of a cell.

    Attributes:
        offset_m: from the cell's middle, shape (K, 3); the first is the wanted place straight in front.
        tilt_deg: angle to the normal, shape (K,), ascending.
        length_m: shape (K,).
        in_gimbal: whether the gimbal can look from there at the middle, shape (K,).
    """

    offset_m: NDArray[np.float64]
    tilt_deg: NDArray[np.float64]
    length_m: NDArray[np.float64]
    in_gimbal: NDArray[np.bool_]


def cell_view_angles(view: NDArray[np.float64], up: NDArray[np.float64]) -> tuple[float, float]:
    """Yaw and pitch (rad) of a view direction (3,); straight up or down the picture goes with the face's `up` (3,)."""
    if math.hypot(view[0], view[1]) < VERTICAL:
        return math.atan2(up[1], up[0]), math.copysign(math.pi / 2, view[2])
    yaw, pitch = camera_angles(view)
    return float(yaw), float(pitch)


def nearest_cell_place(cell: FaceCell, face: FaceTask, scenario: Scenario, clearance_m: float) -> NearestPlace:
    """The place straight in front of a cell's middle that is nearest to it, and what keeps it from being nearer."""
    axes = _axes(-outward_normal(face), cell)
    wide, high = (np.abs(_corners(cell) @ axis).max() for axis in axes[:2])
    nearest = nearest_place(scenario, clearance_m, float(wide), float(high))
    half_diagonal = float(np.linalg.norm(cell.along_m + cell.up_m))
    square = half_diagonal / math.tan(math.radians(face.max_incidence_deg))
    if square <= nearest.distance_m:
        return nearest
    limit = f"{face.max_incidence_deg:g} degrees"
    return NearestPlace(square, f"all of it is seen within {limit} of its normal only from {square:.2f} m")


def furthest_cell_place_m(
    cell: FaceCell, face: FaceTask, scenario: Scenario, clearance_m: float, furthest_m: float
) -> float:
    """The largest distance (m) from which a cell's middle may be looked at.

    Raises:
        InfeasibleError: it is less than the nearest; says the best GSD that can be had.
    """
    nearest = nearest_cell_place(cell, face, scenario, clearance_m)
    furthest = distance_for(scenario.camera, face.gsd_mm, nearest, furthest_m, f"inspection.faces.{face.name}")
    return furthest if face.gsd_mm is not None else min(furthest, FARTHEST * nearest.distance_m)


def cell_offsets(
    cell: FaceCell, face: FaceTask, scenario: Scenario, clearance_m: float, furthest_m: float
) -> CellOffsets:
    """All places from which an empty scene would show a whole cell, the position error around it, as asked.

    Args:
        cell: its size counts, not its place.
        face: GSD, incidence and orientation.
        scenario: camera, vehicle and position error.
        clearance_m: what is kept from the cell's plane.
        furthest_m: no place is further away.

    Raises:
        InfeasibleError: there is none, because the GSD asks for less than the nearest.
    """
    normal, camera, error = outward_normal(face), scenario.camera, scenario.safety.position_m
    wanted = nearest_cell_place(cell, face, scenario, clearance_m).distance_m
    furthest = furthest_cell_place_m(cell, face, scenario, clearance_m, furthest_m)
    sharp_m = nearest_sharp_m(camera, scenario.vehicle, error)
    lowest, highest = gimbal_pitch_range_rad(camera.gimbal.pitch_min_deg, camera.gimbal.pitch_max_deg)
    incidence = math.radians(face.max_incidence_deg)
    corners = _corners(cell)
    tilts = [face.max_incidence_deg * step / TILT_STEPS for step in range(TILT_STEPS)]
    tilts.append(STEEPEST * face.max_incidence_deg)
    offset, tilt_deg, length_m, in_gimbal = [], [], [], []
    for direction, tilt in zip(*tilted_directions(normal, tilts), strict=True):
        right, up, view = _axes(-direction, cell)
        forward = corners @ view
        held = np.maximum(
            (np.abs(corners @ right) + error) / camera.half_width_tangent,
            (np.abs(corners @ up) + error) / camera.half_height_tangent,
        )
        low = max(
            float((held - forward).max()), clearance_m / math.cos(math.radians(tilt)), sharp_m - float(forward.min())
        )
        low = max(low, wanted) if tilt == 0 else low
        top = furthest - (float(forward.max()) if face.gsd_mm is not None else 0.0)
        if low > top + ROUNDING_M:
            continue
        _, pitch = camera_angles(-direction)
        for length in np.geomspace(low, max(low, top), LENGTHS):
            near, far = camera.sharp_between_m(float(length))
            sharp = near <= length + forward.min() and length + forward.max() <= far
            place = length * direction
            if sharp and faces_camera(place, corners, np.broadcast_to(normal, (4, 3)), incidence + 1e-9).all():
                offset.append(place)
                tilt_deg.append(tilt)
                length_m.append(length)
                in_gimbal.append(lowest <= pitch <= highest)
    return CellOffsets(np.array(offset), np.array(tilt_deg), np.array(length_m), np.array(in_gimbal, dtype=np.bool_))


def _axes(view: NDArray[np.float64], cell: FaceCell) -> NDArray[np.float64]:
    """Right, up and forward of the camera that looks along a direction, shape (3, 3)."""
    forward, up = camera_axes(*cell_view_angles(view, cell.up_m))
    return np.stack([np.cross(forward, up), up, forward])


def _corners(cell: FaceCell) -> NDArray[np.float64]:
    """From the cell's middle to its corners, shape (4, 3)."""
    return np.asarray(cell.at(CORNERS) - cell.middle_m)
