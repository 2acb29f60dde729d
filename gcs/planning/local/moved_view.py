"""Taking the picture of a viewpoint from another place, when its own is blocked.

The same target is looked at from the same height, which is what the lidar scans: from about as far, so that what was
asked of the picture still holds, and turned by little, so that it shows the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.hover import hover
from gcs.planning.local.way_back import WayBack
from gcs.planning.views.viewpoint_pose import camera_angles, camera_axes, gimbal_pitch_range_rad, pose_towards

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from gcs.core.camera import Camera
    from gcs.core.plan import Viewpoint
    from gcs.planning.local.binary_map import BinaryMap
    from gcs.planning.local.evasion import EvasionOptions
    from gcs.planning.local.flown_leg import FlownLeg
    from gcs.planning.local.room import Room
    from gcs.planning.local.search_budget import SearchBudget
    from gcs.planning.local.surroundings import Scene
    from gcs.planning.trajectories.flight_limits import FlightLimits

MOST_TURN_RAD = math.radians(20.0)
"""The camera is turned by no more than this, its picture not rolled by more either ..."""

NEAREST_SHARE = 0.9
"""... from no nearer than this share of the distance, or the picture shows less ..."""

COARSER = 1.1
"""... and where no GSD is asked, with one that is coarser by no more than this."""

MOST_ASIDE_M = 5.0
"""A place is no further from the viewpoint than this along either axis."""

STEPS = 30
"""The places are a grid whose step is the distance over this."""

LEAST_STEP_M, MOST_STEP_M = 0.1, 0.5

SPARES_M = (0.5, 0.1)
"""Places with so much more room than asked come first: from nearby what stands may turn out to be larger."""

GAP_M, GAP_SHARE = 0.8, 0.3
"""What is seen so near to the target, or in this last share of the way to it, is taken for what is to be pictured."""

LOOKS_A_CELL = 4
"""A line of sight is looked at so many times a cell."""

APART_M = 0.5
MOST_TRIED = 4
"""Ways are looked for to so many places at most, this far apart."""


@dataclass(frozen=True, eq=False)
class MovedViews:
    """Places from which the picture of one viewpoint can be taken as well, as far as was known before the flight.

    Attributes:
        places_m: the least turned first, scene ENU, shape (K, 3).
        target_m: what the picture shows in its middle, shape (3,).
    """

    places_m: NDArray[np.float64]
    target_m: NDArray[np.float64]

    def open_now(self, scene: Scene, room: Room, safe_m: float) -> Iterator[NDArray[np.float64]]:
        """Those few to go for: with room, at a height that is scanned, and in sight of the target.

        Args:
            scene: what is about the vehicle.
            room: how far everything is from what stands or is forbidden.
            safe_m: what the vehicle keeps.
        """
        low, high = scene.slab_m or (-math.inf, math.inf)
        tried: list[NDArray[np.float64]] = []
        scanned = self.places_m[(low <= self.places_m[:, 2]) & (self.places_m[:, 2] <= high)]
        rooms_m = [_room(place, scene, room) for place in scanned]
        for spare_m in SPARES_M:
            for place, room_m in zip(scanned, rooms_m, strict=True):
                near = any(np.linalg.norm(place - other) < APART_M for other in tried)
                if room_m >= safe_m + spare_m and not near and _sees(place, self.target_m, scene.seen):
                    tried.append(place)
                    yield place
                if len(tried) == MOST_TRIED:
                    return


def target_of(viewpoint: Viewpoint, camera: Camera) -> NDArray[np.float64]:
    """What a viewpoint's picture shows in its middle, scene ENU, shape (3,)."""
    return np.asarray(viewpoint.position_m + camera.distance_for_gsd(viewpoint.gsd_m) * viewpoint.direction)


def moved_viewpoint(viewpoint: Viewpoint, place_m: NDArray[np.float64], camera: Camera) -> Viewpoint:
    """The viewpoint with its picture taken of the same target from another place (3,)."""
    towards = target_of(viewpoint, camera) - place_m
    pose = pose_towards(viewpoint.name, place_m, towards, camera.gsd_at(float(np.linalg.norm(towards))))
    return replace(
        viewpoint,
        position_m=pose.position_m,
        direction=pose.direction,
        up=pose.up,
        gsd_m=pose.gsd_m,
        yaw_rad=pose.yaw_rad,
        gimbal_pitch_rad=pose.gimbal_pitch_rad,
    )


def moved_places(viewpoint: Viewpoint, camera: Camera, asked_gsd_m: float | None) -> NDArray[np.float64]:
    """Places from which a picture of the same target is as good, whatever is in the way.

    Args:
        viewpoint: of the plan.
        camera: its optics and what its gimbal can do.
        asked_gsd_m: what the target's ground sampling distance must not exceed (m a pixel); None when none was asked.

    Returns:
        Of the viewpoint's height, the least turned first, shape (K, 3).
    """
    distance = camera.distance_for_gsd(viewpoint.gsd_m)
    nearest = max(NEAREST_SHARE * distance, camera.nearest_focus_m)
    furthest = camera.distance_for_gsd(COARSER * viewpoint.gsd_m if asked_gsd_m is None else asked_gsd_m)
    step = min(max(distance / STEPS, LEAST_STEP_M), MOST_STEP_M)
    thickness = max(furthest - distance, distance - nearest)
    reach = min(thickness + 2 * distance * math.sin(MOST_TURN_RAD / 2), MOST_ASIDE_M)
    line = step * np.arange(-math.floor(reach / step), math.floor(reach / step) + 1)
    east, north = (axis.ravel() for axis in np.meshgrid(line, line, indexing="ij"))
    aside = np.column_stack([east, north, np.zeros(len(east))])[np.hypot(east, north) > step / 2]
    places = viewpoint.position_m + aside
    towards = target_of(viewpoint, camera) - places
    lengths = np.linalg.norm(towards, axis=1)
    yaws, pitches = camera_angles(towards)
    turns = _turns(viewpoint, *camera_axes(yaws, pitches))
    lowest, highest = gimbal_pitch_range_rad(camera.gimbal.pitch_min_deg, camera.gimbal.pitch_max_deg)
    good = (nearest <= lengths) & (lengths <= furthest) & (turns <= MOST_TURN_RAD)
    good &= (lowest <= pitches) & (pitches <= highest)
    order = np.lexsort((np.linalg.norm(aside, axis=1), turns))
    return np.asarray(places[order[good[order]]])


def _turns(viewpoint: Viewpoint, directions: NDArray[np.float64], ups: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angles of the single turns that bring the viewpoint's camera into others (N, 3), shape (N,)."""
    right, rights = np.cross(viewpoint.direction, viewpoint.up), np.cross(directions, ups)
    trace = directions @ viewpoint.direction + ups @ viewpoint.up + rights @ right
    return np.asarray(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))


def way_to_moved_view(
    views: MovedViews,
    place_m: NDArray[np.float64],
    scene: Scene,
    room: Room,
    limits: FlightLimits,
    options: EvasionOptions,
    budget: SearchBudget,
) -> tuple[NDArray[np.float64], FlownLeg] | None:
    """The place (3,) to take the picture from, and the way there as one onto a leg that hovers there; None without.

    Args:
        views: of the viewpoint.
        place_m: where the vehicle stands, shape (3,).
        scene: what is about the vehicle.
        room: how far everything is from what stands.
        limits: kept on the true extrema.
        options: what is kept.
        budget: what may be spent on looking for the way.
    """
    for goal in views.open_now(scene, room, options.safe_m):
        leg = hover(goal)
        found = WayBack(leg, 0.0, leg.duration_s, scene, room, limits, options, budget).find(place_m, 0.0)
        if found is not None and found.joins_s < math.inf:
            return goal, found
    return None


def _room(place_m: NDArray[np.float64], scene: Scene, room: Room) -> float:
    """The room at a place; of what is round the map has only the side that was seen, and is to have the rest soon."""
    beside = np.linalg.norm(scene.discs[:, :2] - place_m[:2], axis=1) - scene.discs[:, 2] - math.sqrt(2) * room.cell_m
    return min(room.at(place_m), float(beside.min(initial=math.inf)))


def _sees(place_m: NDArray[np.float64], target_m: NDArray[np.float64], seen: BinaryMap) -> bool:
    """Whether nothing that was seen stands between a place and the target; it is taken to be upright."""
    length = float(np.linalg.norm(target_m - place_m))
    upto = 1.0 - min(GAP_M / max(length, GAP_M), GAP_SHARE)
    way = upto * (target_m - place_m)[:2]
    count = math.ceil(LOOKS_A_CELL * float(np.linalg.norm(way)) / seen.cell_m) + 1
    cells = np.floor(seen.cells(place_m[:2] + np.linspace(0.0, 1.0, count)[:, None] * way)).astype(np.int64)
    cells = cells[((cells >= 0) & (cells < seen.blocked.shape)).all(axis=1)]
    return not seen.blocked[tuple(cells.T)].any()
