"""Flying a mission as ArduPilot does: one navigation command, and beside it the other commands one after the other.

When a navigation command is done the next one begins at once; the "do" and "condition" commands that stand between the
two run while the second is being flown. A condition holds up the do commands behind it, not the flight. So a picture
at standstill needs a delay, which is itself a navigation command, behind its do commands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import wrap_angle, yaw_from_heading
from sitl_mocks import mission_items as items
from sitl_mocks.commands import Command
from sitl_mocks.flight_tasks import Land, arrived
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.scene_frame import Array
from sitl_mocks.waypoint_legs import WaypointLeg

if TYPE_CHECKING:
    from sitl_mocks.ardupilot import ArduPilotVehicle

NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 2, 3, 4, 5

_NAVIGATION = {16, 17, 18, 19, 20, 21, 22, 31, 82, 84, 85, 92, 93, 94}
_FLYING = {items.WAYPOINT, items.LOITER_UNLIMITED, items.LOITER_TIME, items.SPLINE_WAYPOINT}
_NAMES = {
    16: "WP",
    17: "LoitUnlim",
    19: "LoitTime",
    20: "RTL",
    21: "Land",
    22: "Takeoff",
    82: "SplineWP",
    93: "Delay",
    115: "CondYaw",
    178: "ChangeSpeed",
    203: "DigiCamCtrl",
    205: "MountControl",
    1000: "GimbalPitchYaw",
    2000: "ImageStartCapture",
}
_YAW_DONE_RAD = math.radians(2.0)


class ArduPilotMissionRun:
    """Where a vehicle is in its mission.

    Args:
        vehicle: that flies it.
    """

    def __init__(self, vehicle: ArduPilotVehicle) -> None:
        self._vehicle = vehicle
        self.state = NOT_STARTED
        self.current = 0
        self._begun = False
        self._since_s: float | None = None
        self._side: int | None = None
        """Sequence of the do or condition command that is running or comes next; None when there is none."""
        self._side_begun = False
        self._side_since_s = 0.0
        self._yaw_rad: float | None = None
        self._target_m: Array | None = None
        self._leg: WaypointLeg | None = None
        """What is flown between waypoints of which at least one is not stopped at."""
        self._passed_m: Array | None = None
        """The waypoint that has just been passed without a stop."""
        self._jumps: dict[int, int] = {}
        self._just_reached: int | None = None

    @property
    def mission(self) -> list[StoredItem]:
        """The stored items with home as the first."""
        return self._vehicle.missions.stored()

    @property
    def total(self) -> int:
        """As MISSION_CURRENT counts: without home."""
        return max(0, len(self._vehicle.missions.items) - 1)

    def reset(self) -> None:
        """Begin from the first item when started the next time; what a completed mission was stays known."""
        if self.state != COMPLETE:
            self.state = NOT_STARTED
        self.current = 0
        self._begun = False
        self._side = None
        self._jumps.clear()

    def start_or_resume(self) -> None:
        """AUTO was entered: go on with the item at which the mission was left."""
        if self.total == 0:
            return
        if self.state in {NOT_STARTED, COMPLETE} or self.current == 0:
            self.state = ACTIVE
            self._go_on_from(max(self.current, 1))
        else:
            self.state = ACTIVE
            self._begun = False

    def leave(self) -> None:
        """AUTO was left; nothing is lost."""
        if self.state == ACTIVE:
            self.state = PAUSED

    def pause(self) -> None:
        """DO_PAUSE_CONTINUE 0."""
        if self.state == ACTIVE:
            self.state = PAUSED

    def go_on(self) -> None:
        """DO_PAUSE_CONTINUE 1."""
        if self.state == PAUSED:
            self.state = ACTIVE
            self._begun = False

    def set_current(self, sequence: int) -> bool:
        """Go on with an item; 0 is a start from the beginning."""
        if not 0 <= sequence < len(self._vehicle.missions.items):
            return False
        self._jumps.clear()
        self._side = None
        if sequence == 0 or self.state != ACTIVE:
            self.state = ACTIVE if self.state == ACTIVE else NOT_STARTED
            self.current = sequence
            self._begun = False
            if self.state == ACTIVE:
                self._go_on_from(1)
        else:
            self._go_on_from(sequence)
        return True

    def mission_changed(self) -> None:
        """Items were written while the mission may be flying: the present command is begun anew."""
        if self.state == ACTIVE and self._begun:
            if self.current > self.total:
                self._complete()
                return
            self._begun = False
            self._vehicle.say_critical("Auto mission changed, restarted command")
        elif self.state == COMPLETE:
            self.state = NOT_STARTED

    def tick(self, dt_s: float) -> None:
        """Go on with the mission; called in AUTO while armed and started."""
        vehicle = self._vehicle
        if self.state != ACTIVE or not 1 <= self.current <= self.total:
            return
        item = self.mission[self.current]
        if not self._begun:
            self._begun = True
            self._since_s = None
            self._leg = None
            self._begin(item)
            self._passed_m = None
        if self._leg is not None:
            self._leg.follow(vehicle.airframe, vehicle.base_limits())
        task_done = vehicle.flight.run(dt_s)
        if vehicle.replanner.on_detour:
            return
        if self._is_done(item, task_done):
            self._navigation_done(item)
            return
        self._run_side()

    # Navigation ------------------------------------------------------------------------------------------------------

    def _begin(self, item: StoredItem) -> None:
        vehicle, airframe = self._vehicle, self._vehicle.airframe
        vehicle.say_info(f"Mission: {self.current} {_NAMES.get(item.command, item.command)}")
        if item.command == items.TAKEOFF:
            up = float(self._place(item)[2])
            self._target_m = np.array([*airframe.position_m[:2], up])
            vehicle.flight.take_off_to(up)
        elif item.command in _FLYING:
            self._target_m = self._place(item)
            facing = vehicle.flight.facing(self._target_m, self._passed_m)
            vehicle.flight.fly_to(self._target_m, facing if self._yaw_rad is None else self._yaw_rad)
            onward = self._onward(item)
            if onward is not None or self._passed_m is not None:
                start = airframe.reference_m if self._passed_m is None else self._passed_m
                self._leg = WaypointLeg(start, self._target_m, onward)
        elif item.command == items.LAND:
            target = self._place(item) if item.x or item.y else airframe.target_m
            vehicle.flight.begin(Land(airframe, vehicle.base_limits(), vehicle.descent(), target))
        elif item.command == items.RETURN:
            vehicle.begin_return()
        elif item.command == items.DELAY:
            vehicle.say_info(f"Delaying {item.params[0]:.0f} sec")
            self._since_s = vehicle.time_s

    def _is_done(self, item: StoredItem, task_done: bool) -> bool:
        vehicle = self._vehicle
        if item.command == items.TAKEOFF:
            return task_done
        if item.command in {items.LAND, items.RETURN}:
            return task_done and vehicle.flight.landed
        if item.command == items.DELAY:
            return self._since_s is not None and vehicle.time_s - self._since_s >= item.params[0]
        if item.command in _FLYING and self._target_m is not None:
            if self._since_s is None and self._is_at(self._target_m):
                self._since_s = vehicle.time_s
            if self._since_s is None or item.command == items.LOITER_UNLIMITED:
                return False
            return vehicle.time_s - self._since_s >= item.params[0]
        return True

    def _is_at(self, target: Array) -> bool:
        """Whether the waypoint is reached: passed on the way to another one, else come to rest at."""
        airframe = self._vehicle.airframe
        radius = self._vehicle.parameters["WPNAV_RADIUS"] * 0.01
        if self._leg is None or self._leg.ends_at_rest:
            return arrived(airframe, target, radius)
        if not self._leg.is_passed(airframe.reference_m) or np.linalg.norm(airframe.position_m - target) >= radius:
            return False
        self._passed_m = target
        return True

    def _onward(self, item: StoredItem) -> Array | None:
        """The waypoint behind this one, if this one is not stopped at."""
        following = self._next_navigation(self.current + 1)
        if item.command != items.WAYPOINT or item.params[0] != 0.0 or following is None:
            return None
        onward = self.mission[following]
        return self._place(onward) if onward.command in {items.WAYPOINT, items.SPLINE_WAYPOINT} else None

    def _navigation_done(self, item: StoredItem) -> None:
        vehicle = self._vehicle
        if item.command in _FLYING:
            vehicle.say_info(f"Reached command #{self.current}")
        following = self.current + 1
        has_side = following <= self.total and self.mission[following].command not in _NAVIGATION
        # A do command right behind it is reached at once and takes the place of this message.
        self._just_reached = self.current if has_side and item.command == items.WAYPOINT else None
        if self._just_reached is None:
            vehicle.tell_item_reached(self.current)
        if item.command in {items.LAND, items.RETURN} or following > self.total:
            self._complete()
            return
        self._go_on_from(following)

    def _go_on_from(self, sequence: int) -> None:
        """Begin the next navigation command from here on; what lies before it runs beside it."""
        if self._vehicle.parameters["WP_YAW_BEHAVIOR"] != 0:
            self._yaw_rad = None  # a yaw condition holds for the leg it stands before
        side = None
        while sequence <= self.total:
            item = self.mission[sequence]
            if item.command == items.JUMP:
                sequence = self._jump(item, sequence)
                continue
            if item.command in _NAVIGATION:
                break
            side = sequence if side is None else side
            sequence += 1
        self._side, self._side_begun = side, False
        self._begun = False
        if sequence > self.total:
            while self._side is not None:
                self._finish_side()
            self._complete()
            return
        self.current = sequence
        self._run_side()

    def _jump(self, item: StoredItem, at: int) -> int:
        left = self._jumps.get(at, int(item.params[1]))
        target = int(item.params[0])
        if left == 0 or not 1 <= target <= self.total:
            return at + 1
        self._jumps[at] = left - 1 if left > 0 else left
        return target

    def _next_navigation(self, sequence: int) -> int | None:
        while sequence <= self.total:
            if self.mission[sequence].command in _NAVIGATION:
                return sequence
            sequence += 1
        return None

    def _complete(self) -> None:
        self.state = COMPLETE
        self._begun = False
        self._side = None
        self.current = 0
        self._vehicle.mission_flown()

    def _place(self, item: StoredItem) -> Array:
        vehicle = self._vehicle
        altitude = item.z + (vehicle.home.altitude_m if item.frame == 3 else 0.0)
        latitude, longitude = item.x, item.y
        if latitude == 0 and longitude == 0:
            here = vehicle.frame.geo(vehicle.airframe.position_m)
            latitude, longitude = round(here.latitude_deg * 1e7), round(here.longitude_deg * 1e7)
        return vehicle.frame.scene_e7(latitude, longitude, altitude)

    # Do and condition commands ---------------------------------------------------------------------------------------

    def _run_side(self) -> None:
        if self._side is None:
            return
        item = self.mission[self._side]
        if not self._side_begun:
            self._side_begun = True
            self._vehicle.say_info(f"Mission: {self._side} {_NAMES.get(item.command, item.command)}")
            if item.command == items.CONDITION_YAW:
                self._yaw_rad = self._commanded_yaw(item)
                self._vehicle.airframe.turn_to(self._yaw_rad)
            elif item.command == items.CONDITION_DELAY:
                self._side_since_s = self._vehicle.time_s
        if item.command == items.CONDITION_YAW and not self._yaw_is_there():
            return
        if item.command == items.CONDITION_DELAY and self._vehicle.time_s - self._side_since_s < item.params[0]:
            return
        self._finish_side()

    def _yaw_is_there(self) -> bool:
        yaw = self._yaw_rad
        return yaw is None or abs(wrap_angle(self._vehicle.airframe.yaw_rad - yaw)) <= _YAW_DONE_RAD

    def _commanded_yaw(self, item: StoredItem) -> float:
        angle, relative = math.radians(item.params[0]), item.params[3] == 1.0
        if not relative:
            return yaw_from_heading(angle)
        clockwise = -1.0 if item.params[2] == -1.0 else 1.0
        return wrap_angle(self._vehicle.airframe.yaw_rad - clockwise * angle)

    def _finish_side(self) -> None:
        if self._side is None:
            return
        item = self.mission[self._side]
        if item.command not in {items.CONDITION_YAW, items.CONDITION_DELAY}:
            params = (*item.params, float(item.x), float(item.y), item.z)
            self._vehicle.run_mission_command(Command(item.command, params))
        if self._just_reached is not None or item.command == items.CONDITION_YAW:
            self._vehicle.tell_item_reached(self._side)
        self._just_reached = None
        following = self._side + 1
        more = following <= self.total and self.mission[following].command not in _NAVIGATION | {items.JUMP}
        self._side, self._side_begun = (following if more else None), False
