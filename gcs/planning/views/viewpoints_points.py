"""Viewpoints for named points: the stand-off along the normal, and tilted ones where that place will not do."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.inspection import DEFAULT_POINT_FOOTPRINT_M
from gcs.planning.scene.fence import room_in_fence
from gcs.planning.scene.widest_way import STEP_M
from gcs.planning.views.picture_limits import distance_for
from gcs.planning.views.viewpoint_pose import camera_angles, gimbal_pitch_range_rad, pose_towards

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.camera import Camera
    from gcs.core.inspection import NamedPoint
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.scene.visibility import SightLines
    from gcs.planning.views.picture_limits import NearestPlace
    from gcs.planning.views.viewpoint_pose import ViewpointPose

TILTS_DEG = (0, 10, 20, 30, 40, 50, 58)
AZIMUTHS = 16
FARTHER = (1.0, 1.05, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0)
"""Distances that are tried for a point without a GSD, in multiples of the stand-off."""

MOST_VIEWPOINTS = 6
"""How many are offered for a point at most."""

OFFERED_TILT_DEG = 30.0
"""How far others than the best viewpoint may be tilted: their pictures are squeezed by 13 % at most."""

OFFERED_DISTANCE = 1.2
"""How much further or nearer than the best they may be, as a factor; to keep clear of a wall tilted ones need 1.15."""

LEAST_APART_M = 0.5
"""Viewpoints of a point that are nearer to each other make no difference to the way."""

WITHIN = "within 60 degrees of its normal"

TARGET_GAP_M = 0.02
"""A named point may lie this deep under a bolt, a coat of paint or the mesh's own inaccuracy."""


def stand_off_m(point: NamedPoint, camera: Camera, nearest: NearestPlace, furthest_m: float) -> float:
    """The distance (m) from which a point is photographed if nothing is in the way.

    With a GSD the furthest place that gives it; else the working distance of a 3 m wide picture (crane paper, eq. 2
    mended), or the nearest possible one where that is more.

    Raises:
        InfeasibleError: the GSD asks for less than the nearest, or that is too far away.
    """
    furthest = distance_for(camera, point.gsd_mm, nearest, furthest_m, _field(point))
    if point.gsd_mm is not None:
        return furthest
    return min(max(camera.distance_for_footprint(DEFAULT_POINT_FOOTPRINT_M), nearest.distance_m), furthest)


def find_point_viewpoints(
    point: NamedPoint, camera: Camera, nearest: NearestPlace, space: FreeSpace, sight: SightLines, furthest_m: float
) -> list[ViewpointPose]:
    """The best viewpoint of one named point, and after it others that would do as well, well apart.

    The best is the straight stand-off if it is free, connected with home, in sight of the point and within the
    gimbal's range. Else it is the least tilted direction within 60 degrees of the normal that is; among equally tilted
    ones those under the open sky first, then the nearest to the wanted distance. With a GSD places go from its distance
    inwards to the nearest, without one from the stand-off outwards to twice as far. The others keep the same limits and
    the GSD, are about as far from the point, under the open sky if the best is, and tilted by at most 30 degrees or as
    much as the best.

    Args:
        point: the point with its unit normal.
        camera: the camera and its gimbal.
        nearest: smallest distance from the point.
        space: where the vehicle may be.
        sight: what hides the point.
        furthest_m: no place is further away.

    Raises:
        InfeasibleError: there is none; names the point and says what is in the way.
    """
    wanted = stand_off_m(point, camera, nearest, furthest_m)
    if point.gsd_mm is None:
        lengths = wanted * np.array(FARTHER)
    else:
        lengths = np.linspace(wanted, nearest.distance_m, len(FARTHER))
    target = np.asarray(point.position_m)
    directions, tilts = tilted_directions(np.asarray(point.normal), TILTS_DEG)
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
        would_do = sight.clear(places, np.broadcast_to(target, places.shape), TARGET_GAP_M)
        would_do &= (pitch >= lowest) & (pitch <= highest)
        reason = _fence_in_the_way(places, would_do, free, space)
        if reason is None:
            room = None if reachable.any() else space.largest_clearance_m(places[would_do])
            reason = _reason(free, reachable, seen, space.clearance_m, room)
        raise InfeasibleError(reason, field=_field(point))
    covered = ~space.is_open_sky(places[good])
    ranking = np.lexsort((order[good], covered, tilt[good]))
    ranked, covered = good[ranking], covered[ranking]
    distance = np.linalg.norm(target - places[ranked], axis=1)
    alike = np.abs(np.log(distance / distance[0])) <= math.log(OFFERED_DISTANCE) + 1e-9
    alike &= (tilt[ranked] <= max(tilt[ranked[0]], OFFERED_TILT_DEG)) & (covered <= covered[0])
    offered = places[ranked[alike]]
    return [_pose(point, place, camera) for place in offered[_well_apart(offered)]]


def _pose(point: NamedPoint, place: NDArray[np.float64], camera: Camera) -> ViewpointPose:
    towards = np.asarray(point.position_m) - place
    pose = pose_towards(point.name, place, towards, camera.gsd_at(float(np.linalg.norm(towards))))
    return replace(pose, hold_s=point.hold_s or 0.0)


def _well_apart(places: NDArray[np.float64]) -> list[int]:
    """The first of some places, and again and again the one that is furthest from those that are taken."""
    taken, away = [0], np.linalg.norm(places - places[0], axis=1)
    while len(taken) < MOST_VIEWPOINTS and away.max() >= LEAST_APART_M:
        taken.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(places - places[taken[-1]], axis=1))
    return taken


def tilted_directions(
    normal: NDArray[np.float64], tilts_deg: Sequence[float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors about a unit normal, AZIMUTHS for every tilt but 0, and their tilts (deg), in the tilts' order."""
    reference = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(normal, reference)
    side /= np.linalg.norm(side)
    across = np.cross(normal, side)
    result, tilts = [], []
    for tilt in tilts_deg:
        c, s = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
        for k in range(AZIMUTHS if tilt else 1):
            angle = 2 * math.pi * k / AZIMUTHS
            result.append(c * normal + s * (math.cos(angle) * side + math.sin(angle) * across))
            tilts.append(tilt)
    return np.array(result), np.array(tilts, dtype=np.float64)


def _field(point: NamedPoint) -> str:
    return f"inspection.points.{point.name}"


def _fence_in_the_way(
    places: NDArray[np.float64], would_do: NDArray[np.bool_], free: NDArray[np.bool_], space: FreeSpace
) -> str | None:
    """What the fence has to do with it that no place is left; None where it would be the same without one.

    `would_do`: the camera could look at the point from there, if the vehicle could be there.
    """
    fence, tolerance = space.model.fence, space.model.tolerance
    if not len(fence.corners) and math.isinf(fence.max_height_m):
        return None
    outside = room_in_fence(places, fence) < tolerance
    unfenced_m = space.largest_clearance_m(places[would_do], fenced=False)
    if not outside.all() and unfenced_m < space.clearance_m - STEP_M:
        return None
    if (free & would_do).any():
        return (
            f"the fence cuts off the stand-off places {WITHIN} from home: widen it so that a way leads there, or leave "
            "the point out"
        )
    limit = "widen it"
    if (room_in_fence(places[would_do], fence._replace(max_height_m=math.inf)) >= tolerance).any():
        limit = "raise its max_height_m"
    return (
        f"the fence leaves out every stand-off place {WITHIN} from which the camera could look at it, the vehicle's "
        f"size and its errors counted in: {limit}, or leave the point out"
    )


def _reason(
    free: NDArray[np.bool_],
    reachable: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    clearance_m: float,
    room_m: float | None,
) -> str:
    """What is in the way; `room_m` is the largest clearance that would leave a place, where it was looked for."""
    if not free.any():
        return (
            f"every stand-off place {WITHIN} is inside the structure, nearer than {clearance_m:.2f} m to something or "
            f"below the ground: turn the normal outwards, or {_smaller(room_m)}"
        )
    if not reachable.any():
        return (
            f"the stand-off places {WITHIN} are inside the structure or enclosed by it: no way leads there from home "
            f"with {clearance_m:.2f} m about the vehicle's centre: turn the normal outwards, or {_smaller(room_m)}"
        )
    if not seen.any():
        return (
            f"the structure hides it from every free stand-off place {WITHIN}, or it lies inside the structure: "
            "check its position and normal"
        )
    return f"the gimbal cannot look at it from any free stand-off place {WITHIN}: its pitch range is too small"


def _smaller(room_m: float | None) -> str:
    if not room_m:
        return "leave it out: no smaller clearance leaves a place either"
    return f"allow a smaller clearance: with {room_m:.2f} m about the vehicle's centre it can be reached"
