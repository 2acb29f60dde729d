"""Viewpoints for named points: the stand-off along the normal, and tilted ones where that place will not do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.inspection import DEFAULT_POINT_FOOTPRINT_M
from gcs.planning.viewpoint_pose import camera_angles, gimbal_pitch_range_rad, pose_towards

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.camera import Camera
    from gcs.core.inspection import NamedPoint
    from gcs.planning.free_space import FreeSpace
    from gcs.planning.viewpoint_pose import ViewpointPose
    from gcs.planning.visibility import SightLines

TILTS_DEG = (0, 10, 20, 30, 40, 50, 58)
AZIMUTHS = 16
FARTHER = (1.0, 1.05, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0)
"""Distances that are tried for a point without a GSD, in multiples of the stand-off."""

TARGET_GAP_M = 0.02
"""A named point may lie this deep under a bolt, a coat of paint or the mesh's own inaccuracy."""


def stand_off_m(point: NamedPoint, camera: Camera, clearance_m: float) -> float:
    """The distance (m) from which a point is photographed if nothing is in the way.

    With a GSD the furthest place that gives it; else the working distance of a 3 m wide picture (crane paper, eq. 2
    mended), or the clearance where that is more.

    Raises:
        InfeasibleError: the GSD asks for less than the clearance.
    """
    if point.gsd_mm is None:
        return max(camera.distance_for_footprint(DEFAULT_POINT_FOOTPRINT_M), clearance_m)
    distance = camera.distance_for_gsd(point.gsd_mm / 1000)
    if distance < clearance_m:
        best = 1000 * camera.gsd_at(clearance_m)
        raise InfeasibleError(
            f"a GSD of {point.gsd_mm:g} mm asks for {distance:.2f} m, but the vehicle keeps {clearance_m:.2f} m (hull, "
            f"error budget and corridor): the best it can have is {best:.2f} mm",
            field=f"inspection.points.{point.name}",
        )
    return distance


def find_point_viewpoint(
    point: NamedPoint, camera: Camera, space: FreeSpace, sight: SightLines, furthest_m: float
) -> ViewpointPose:
    """The viewpoint of one named point.

    The straight stand-off is taken if it is free, connected with home, in sight of the point and within the gimbal's
    range. Else the least tilted direction within 60 degrees of the normal that is; among equally tilted ones those
    under the open sky first, then the nearest to the wanted distance. With a GSD places go from its distance inwards
    to the clearance, without one from the stand-off outwards to twice as far.

    Args:
        point: the point with its unit normal.
        camera: the camera and its gimbal.
        space: where the vehicle may be.
        sight: what hides the point.
        furthest_m: no place is further away.

    Raises:
        InfeasibleError: there is none; names the point and says what is in the way.
    """
    clearance = space.clearance_m
    wanted = min(stand_off_m(point, camera, clearance), furthest_m)
    if point.gsd_mm is None:
        lengths = np.array([wanted * f for f in FARTHER])
    else:
        lengths = np.linspace(wanted, clearance, len(FARTHER)) if wanted > clearance else np.array([wanted])
    target = np.asarray(point.position_m)
    directions, tilts = _directions(np.asarray(point.normal))
    places = (target + lengths[None, :, None] * directions[:, None, :]).reshape(-1, 3)
    tilt = np.repeat(tilts, len(lengths))
    order = np.tile(np.arange(len(lengths)), len(directions))

    free = space.is_free(places)
    reachable = free.copy()
    reachable[free] = space.is_reachable(places[free])
    seen = reachable.copy()
    seen[reachable] = sight.clear(places[reachable], np.broadcast_to(target, (int(reachable.sum()), 3)), TARGET_GAP_M)
    lowest, highest = gimbal_pitch_range_rad(camera.gimbal.pitch_min_deg, camera.gimbal.pitch_max_deg)
    _, pitch = camera_angles(target - places)
    good = np.flatnonzero(seen & (pitch >= lowest) & (pitch <= highest))
    if not len(good):
        raise InfeasibleError(_reason(free, reachable, seen, clearance), field=f"inspection.points.{point.name}")
    covered = ~space.is_open_sky(places[good])
    best = good[np.lexsort((order[good], covered, tilt[good]))[0]]
    length = float(np.linalg.norm(target - places[best]))
    return pose_towards(point.name, places[best], target - places[best], camera.gsd_at(length))


def _directions(normal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unit vectors about a normal and their tilts (deg), the normal first."""
    reference = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(normal, reference)
    side /= np.linalg.norm(side)
    across = np.cross(normal, side)
    result, tilts = [normal], [0]
    for tilt in TILTS_DEG[1:]:
        c, s = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
        for k in range(AZIMUTHS):
            angle = 2 * math.pi * k / AZIMUTHS
            result.append(c * normal + s * (math.cos(angle) * side + math.sin(angle) * across))
            tilts.append(tilt)
    return np.array(result), np.array(tilts)


def _reason(free: NDArray[np.bool_], reachable: NDArray[np.bool_], seen: NDArray[np.bool_], clearance_m: float) -> str:
    within = "within 60 degrees of its normal"
    if not free.any():
        return (
            f"every stand-off place {within} is inside the structure, nearer than {clearance_m:.2f} m to something, "
            "below the ground or outside the fence: turn the normal outwards, or allow a smaller clearance"
        )
    if not reachable.any():
        return (
            f"the stand-off places {within} are inside the structure or enclosed by it: no way leads there from home; "
            "turn the normal outwards"
        )
    if not seen.any():
        return (
            f"the structure hides it from every free stand-off place {within}, or it lies inside the structure: "
            "check its position and normal"
        )
    return f"the gimbal cannot look at it from any free stand-off place {within}: its pitch range is too small"
