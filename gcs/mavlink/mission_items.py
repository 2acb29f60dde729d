"""A plan as mission items, in the words of each autopilot.

Altitudes are above mean sea level throughout, so that a mission has one height datum. At every viewpoint the vehicle
stops and holds, the gimbal and the heading are commanded, a delay lets both settle, one picture is taken, and a short
delay lets it be taken at rest. That is so at viewpoints that the plan flies through, too: an item behind a waypoint
runs when the waypoint is accepted, somewhere within its radius and with the nose already turning to the next one, so
that nothing would say where and which way the picture is taken.

| | PX4 and others | ArduPilot |
| --- | --- | --- |
| item 0 | NAV_TAKEOFF with current = 1 | a waypoint at home, which the vehicle replaces by its own |
| speed | DO_CHANGE_SPEED | three: ground, climb, descent; all before the first waypoint, later ones do nothing |
| heading | param4 of every waypoint | CONDITION_YAW, after the gimbal's item: a condition holds up what follows it |
| gimbal | DO_GIMBAL_MANAGER_PITCHYAW | DO_MOUNT_CONTROL |
| picture | IMAGE_START_CAPTURE, numbered | DO_DIGICAM_CONTROL |
| frames | 5, and 2 for items without a place | 0 |
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import geodetic_from_enu, heading_from_yaw
from gcs.core.mission import Command, Frame, Mission, MissionItem
from gcs.core.vehicle import Autopilot

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.plan import Plan, Viewpoint

_HOLD_S = 1.0
_SETTLE_S = 1.0
_YAW_RATE_DEG_S = 30.0
_GIMBAL_LOCKS_ROLL_AND_PITCH = 12
_MOUNT_POINTS_BY_ANGLE = 2.0
_SHOOT = 1
_VIEWPOINT_RADIUS_M = 0.5
_PATH_RADIUS_M = 1.0
_RADIUS_OF_SPACING = 0.4
NAN = math.nan


@dataclass(frozen=True)
class MissionLimits:
    """What the vehicle can take; None where it does not say.

    Attributes:
        max_speed_m_s: horizontal speed.
        max_climb_m_s: upward speed.
        max_descent_m_s: downward speed.
    """

    max_speed_m_s: float | None = None
    max_climb_m_s: float | None = None
    max_descent_m_s: float | None = None


def build_mission(
    plan: Plan,
    takeoff_m: ArrayLike,
    legs_m: Sequence[NDArray[np.float64]],
    autopilot: Autopilot,
    limits: MissionLimits | None = None,
) -> Mission:
    """Write a plan as a mission.

    Args:
        plan: the plan; its viewpoints and its home count.
        takeoff_m: top of the vertical climb over home, scene ENU, shape (3,).
        legs_m: for each viewpoint the points that lead there, the viewpoint last, then those that lead to above home;
            scene ENU, each of shape (K, 3).
        autopilot: whose words to use.
        limits: what the vehicle can take.
    """
    if len(legs_m) != len(plan.viewpoints) + 1:
        raise ValueError("one leg for each viewpoint and one back are needed")
    limits = limits if limits is not None else MissionLimits()
    writer = _ArduPilotWriter(plan) if autopilot is Autopilot.ARDUPILOT else _Px4Writer(plan)
    speed = min(plan.scenario.vehicle.max_speed_m_s, limits.max_speed_m_s or math.inf)
    writer.take_off(np.asarray(takeoff_m, dtype=np.float64))
    writer.speeds(speed, min(speed, limits.max_climb_m_s or math.inf), min(speed, limits.max_descent_m_s or math.inf))
    before: Viewpoint | None = None
    at = np.asarray(takeoff_m, dtype=np.float64)
    for viewpoint, leg in zip(plan.viewpoints, legs_m, strict=False):
        heading = math.degrees(heading_from_yaw(viewpoint.yaw_rad))
        writer.path(at, leg[:-1], leg[-1], heading)
        faced = writer.facing_on_the_way([at, *leg])
        writer.viewpoint(viewpoint, heading, *_settle_times_s(plan, before, faced, viewpoint))
        before, at = viewpoint, leg[-1]
    heading = math.degrees(heading_from_yaw(before.yaw_rad)) if before is not None else 0.0
    writer.path(at, legs_m[-1], None, heading)
    writer.land(heading)
    return Mission(tuple(writer.items), writer.pictures)


def _settle_times_s(
    plan: Plan, before: Viewpoint | None, faced_rad: Sequence[float], viewpoint: Viewpoint
) -> tuple[float, float]:
    """Delays before and after a picture (s), rounded up to tenths: turns, the camera's shortest interval, and the hold.

    `faced_rad` are the yaw angles that the vehicle has on its way to the viewpoint by itself.
    """
    camera = plan.scenario.camera
    if before is None:
        tilt, turn = math.pi / 2, math.pi
    else:
        tilt = abs(viewpoint.gimbal_pitch_rad - before.gimbal_pitch_rad)
        yaws = (before.yaw_rad, *faced_rad)
        turn = max(abs(math.remainder(viewpoint.yaw_rad - yaw, 2 * math.pi)) for yaw in yaws)
    moving = max(math.degrees(tilt) / camera.gimbal.rate_deg_s, math.degrees(turn) / _YAW_RATE_DEG_S)
    settle = math.ceil(10 * (moving + _SETTLE_S)) / 10
    after = math.ceil(10 * max(_SETTLE_S, camera.min_interval_s - settle, viewpoint.hold_s - _SETTLE_S)) / 10
    return settle, after


class _Writer(ABC):
    """Collects items; the two subclasses are the two dialects."""

    place_frame: int
    action_frame: int

    def __init__(self, plan: Plan) -> None:
        self.items: list[MissionItem] = []
        self.pictures: dict[int, int] = {}
        self._anchor = plan.scenario.anchor.point
        self._home = np.array(plan.scenario.home_m, dtype=np.float64)

    def place(
        self,
        command: Command,
        point_m: NDArray[np.float64],
        params: tuple[float, float, float, float],
        current: int = 0,
    ) -> None:
        latitude, longitude, altitude = geodetic_from_enu(point_m, self._anchor)
        self.items.append(
            MissionItem(
                sequence=len(self.items),
                frame=self.place_frame,
                command=command,
                params=params,
                x=round(float(latitude) * 1e7),
                y=round(float(longitude) * 1e7),
                z=round(float(altitude), 2),
                current=current,
            )
        )

    def action(
        self, command: Command, params: tuple[float, float, float, float], x: int = 0, y: int = 0, z: float = 0.0
    ) -> None:
        self.items.append(MissionItem(len(self.items), self.action_frame, command, params, x, y, z))

    def delay(self, seconds: float) -> None:
        self.action(Command.NAV_DELAY, (seconds, -1.0, -1.0, -1.0))

    @abstractmethod
    def take_off(self, top_m: NDArray[np.float64]) -> None:
        """The climb over home."""

    @abstractmethod
    def speeds(self, ground_m_s: float, climb_m_s: float, descent_m_s: float) -> None:
        """What limits the flight between waypoints."""

    def path(
        self,
        start_m: NDArray[np.float64],
        points_m: NDArray[np.float64],
        end_m: NDArray[np.float64] | None,
        heading_deg: float,
    ) -> None:
        """Waypoints to fly through; `end_m` is where a stop follows that `viewpoint` writes."""
        ways = [start_m, *points_m, *([] if end_m is None else [end_m])]
        for k in range(1, len(points_m) + 1):
            spacing = min(float(np.linalg.norm(ways[k] - ways[j])) for j in (k - 1, k + 1) if j < len(ways))
            radius = min(_PATH_RADIUS_M, max(_RADIUS_OF_SPACING * spacing, 0.1))
            self.place(Command.NAV_WAYPOINT, ways[k], self.waypoint_params(0.0, radius, heading_deg))

    @abstractmethod
    def waypoint_params(self, hold_s: float, radius_m: float, heading_deg: float) -> tuple[float, float, float, float]:
        """param1 to param4 of a waypoint."""

    @abstractmethod
    def facing_on_the_way(self, points_m: Sequence[NDArray[np.float64]]) -> tuple[float, ...]:
        """Yaw angles (rad) that the vehicle turns to by itself while it flies from point to point."""

    def viewpoint(self, viewpoint: Viewpoint, heading_deg: float, settle_s: float, after_s: float) -> None:
        params = self.waypoint_params(_HOLD_S, _VIEWPOINT_RADIUS_M, heading_deg)
        self.place(Command.NAV_WAYPOINT, viewpoint.position_m, params)
        self.point_camera(math.degrees(viewpoint.gimbal_pitch_rad), heading_deg)
        self.delay(settle_s)
        self.pictures[viewpoint.id] = len(self.items)
        self.picture(viewpoint.id + 1)
        self.delay(after_s)

    @abstractmethod
    def point_camera(self, pitch_deg: float, heading_deg: float) -> None:
        """Turn nose and camera."""

    @abstractmethod
    def picture(self, number: int) -> None:
        """Take one picture."""

    @abstractmethod
    def land(self, heading_deg: float) -> None:
        """Come down at home."""


class _Px4Writer(_Writer):
    place_frame = Frame.GLOBAL_INT
    action_frame = Frame.MISSION

    def take_off(self, top_m: NDArray[np.float64]) -> None:
        # Without current = 1 a new mission is "resumed" at the old one's index.
        self.place(Command.NAV_TAKEOFF, top_m, (0.0, 0.0, 0.0, NAN), current=1)

    def speeds(self, ground_m_s: float, climb_m_s: float, descent_m_s: float) -> None:
        del climb_m_s, descent_m_s  # its own limits; the command knows the ground speed only
        self.action(Command.DO_CHANGE_SPEED, (1.0, ground_m_s, -1.0, 0.0))

    def waypoint_params(self, hold_s: float, radius_m: float, heading_deg: float) -> tuple[float, float, float, float]:
        return (hold_s, radius_m, 0.0, heading_deg)

    def facing_on_the_way(self, points_m: Sequence[NDArray[np.float64]]) -> tuple[float, ...]:
        del points_m  # the waypoints' param4 has it look to where the picture will be taken
        return ()

    def point_camera(self, pitch_deg: float, heading_deg: float) -> None:
        del heading_deg  # the waypoint's param4 holds it
        self.action(Command.DO_GIMBAL_MANAGER_PITCHYAW, (pitch_deg, 0.0, NAN, NAN), x=_GIMBAL_LOCKS_ROLL_AND_PITCH)

    def picture(self, number: int) -> None:
        self.action(Command.IMAGE_START_CAPTURE, (0.0, 0.0, 1.0, float(number)))

    def land(self, heading_deg: float) -> None:
        self.place(Command.NAV_LAND, self._home, (0.0, 0.0, 0.0, heading_deg))


class _ArduPilotWriter(_Writer):
    place_frame = Frame.GLOBAL
    action_frame = Frame.GLOBAL

    def take_off(self, top_m: NDArray[np.float64]) -> None:
        self.place(Command.NAV_WAYPOINT, self._home, (0.0, 0.0, 0.0, 0.0))
        self.place(Command.NAV_TAKEOFF, top_m, (0.0, 0.0, 0.0, 0.0))

    def speeds(self, ground_m_s: float, climb_m_s: float, descent_m_s: float) -> None:
        for kind, speed in ((1.0, ground_m_s), (2.0, climb_m_s), (3.0, descent_m_s)):
            self.action(Command.DO_CHANGE_SPEED, (kind, speed, -1.0, 0.0))

    def waypoint_params(self, hold_s: float, radius_m: float, heading_deg: float) -> tuple[float, float, float, float]:
        del radius_m, heading_deg  # not stored by the vehicle
        return (hold_s, 0.0, 0.0, 0.0)

    def facing_on_the_way(self, points_m: Sequence[NDArray[np.float64]]) -> tuple[float, ...]:
        # The nose turns to the next waypoint (WP_YAW_BEHAVIOR), whatever a CONDITION_YAW said before.
        steps = np.diff(np.asarray(points_m, dtype=np.float64), axis=0)
        return tuple(float(np.arctan2(step[1], step[0])) for step in steps)

    def point_camera(self, pitch_deg: float, heading_deg: float) -> None:
        # A condition holds up the actions behind it, and they are dropped when the delay ends: the gimbal goes first.
        self.action(Command.DO_MOUNT_CONTROL, (pitch_deg, 0.0, 0.0, 0.0), z=_MOUNT_POINTS_BY_ANGLE)
        self.action(Command.CONDITION_YAW, (heading_deg, _YAW_RATE_DEG_S, 0.0, 0.0))

    def picture(self, number: int) -> None:
        del number  # DO_DIGICAM_CONTROL has no place for it
        self.action(Command.DO_DIGICAM_CONTROL, (0.0, 0.0, 0.0, 0.0), x=_SHOOT)

    def land(self, heading_deg: float) -> None:
        del heading_deg
        self.place(Command.NAV_LAND, self._home, (0.0, 0.0, 0.0, 0.0))
