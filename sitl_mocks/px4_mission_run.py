"""Flying a mission as PX4 does: one item at a time, and all instant items behind a place at once."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import wrap_angle, yaw_from_heading
from sitl_mocks import mission_items as items
from sitl_mocks.commands import Command
from sitl_mocks.flight_tasks import Land
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.px4_events import NOT_FLYABLE, Event
from sitl_mocks.px4_feasibility import flaw_of
from sitl_mocks.scene_frame import Array

if TYPE_CHECKING:
    from sitl_mocks.px4 import Px4Vehicle

_PLACES = {items.WAYPOINT, items.LOITER_UNLIMITED, items.LOITER_TIME}
_REPEAT_REACHED_S, _REPEATS = 1.0, 10
_RELATIVE_FRAMES = {3, 6}


class Px4MissionRun:
    """Where a vehicle is in its mission.

    Args:
        vehicle: that flies it.
    """

    def __init__(self, vehicle: Px4Vehicle) -> None:
        self._vehicle = vehicle
        self.current = 0
        self.complete = False
        self._active: int | None = None
        self._since_s: float | None = None
        self._reached: int | None = None
        self._told_s = 0.0
        self._repeats = 0
        self._jumps: dict[int, int] = {}

    @property
    def mission(self) -> list[StoredItem]:
        """The stored items."""
        return self._vehicle.missions.items

    def mission_replaced(self) -> None:
        """After an upload: PX4 keeps the old index unless an item is marked as the current one."""
        marked = [i for i, item in enumerate(self.mission) if item.current]
        if marked:
            self.current = marked[0]
        self.current = max(0, min(self.current, len(self.mission) - 1))
        self._active = None
        self.complete = False
        self._reached = None
        self._jumps.clear()

    def set_current(self, sequence: int) -> bool:
        """Go on with an item; False when there is no such."""
        if not 0 <= sequence < len(self.mission):
            return False
        self.current = sequence
        self._active = None
        self.complete = False
        self._reached = None
        self._jumps.clear()
        return True

    def leave(self) -> None:
        """Another mode took over; the present item is begun anew when the mission goes on."""
        self._active = None

    def flaw(self) -> Event | None:
        """What PX4's feasibility check, which an accepted upload has yet to pass, has to tell of."""
        found = flaw_of(self.mission)
        return NOT_FLYABLE if found is None and not self._first_is_near() else found

    def _first_is_near(self) -> bool:
        first = next((i for i in self.mission if items.has_place(i) and (i.x or i.y)), None)
        if first is None:
            return True
        way = self._place(first) - self._vehicle.home_m
        return float(np.hypot(way[0], way[1])) <= self._vehicle.parameters["MIS_DIST_1WP"]

    def repeat_reached(self) -> None:
        """Tell again which item was reached last, for a while, in whatever mode the vehicle is by then."""
        vehicle = self._vehicle
        if self._reached is not None and self._repeats and vehicle.time_s - self._told_s >= _REPEAT_REACHED_S:
            self._repeats -= 1
            self._told_s = vehicle.time_s
            vehicle.tell_item_reached(self._reached)

    def tick(self, dt_s: float) -> None:
        """Go on with the mission; called in mission mode while armed."""
        vehicle = self._vehicle
        if self._active != self.current:
            self._active = self.current
            self._since_s = None
            self._begin(self.mission[self.current])
        if self._active is None:
            return  # the item changed the mode
        task_done = vehicle.flight.run(dt_s)
        if vehicle.replanner.on_detour:
            return
        item = self.mission[self.current]
        if item.command == items.LAND and task_done:
            self._tell_reached(self.current)
            self.complete = True
            vehicle.mission_landed()
        elif self._is_done(item, task_done):
            self._advance()

    def _begin(self, item: StoredItem) -> None:
        vehicle, airframe = self._vehicle, self._vehicle.airframe
        if item.command == items.TAKEOFF:
            up = float(self._place(item)[2])
            vehicle.say_info(f"Climb to {up - vehicle.home_m[2]:.1f} meters above home")
            vehicle.flight.take_off_to(up)
        elif item.command in _PLACES:
            target = self._place(item)
            if vehicle.flight.landed:
                # Without a take-off item PX4 climbs first.
                height = max(float(target[2]), float(vehicle.home_m[2]) + vehicle.parameters["MIS_TAKEOFF_ALT"])
                vehicle.flight.take_off_to(height)
            else:
                vehicle.flight.fly_to(target, self._yaw(item, target))
        elif item.command == items.LAND:
            target = self._place(item) if item.x or item.y else airframe.target_m
            vehicle.flight.begin(Land(airframe, vehicle.base_limits(), vehicle.descent(), target))
        elif item.command == items.RETURN:
            self.complete = self.current == len(self.mission) - 1
            self._tell_reached(self.current)
            vehicle.return_from_mission()

    def _is_done(self, item: StoredItem, task_done: bool) -> bool:
        vehicle = self._vehicle
        if item.command == items.TAKEOFF:
            if not task_done and self._since_s is None:
                return False
            target = self._place(item)
            if self._since_s is None:
                self._since_s = vehicle.time_s
                if item.x or item.y:
                    vehicle.flight.fly_to(target, self._yaw(item, target))
            return not (item.x or item.y) or self._near(target, item)
        if item.command in _PLACES:
            return self._stayed(item, task_done)
        if item.command == items.DELAY:
            if self._since_s is None:
                self._since_s = vehicle.time_s
            return vehicle.time_s - self._since_s >= item.params[0]
        return item.command not in {items.LAND, items.RETURN}

    def _stayed(self, item: StoredItem, task_done: bool) -> bool:
        """Whether the place was reached, the yaw is right, and the hold time is over."""
        vehicle = self._vehicle
        target = self._place(item)
        if task_done and self._since_s is None and np.linalg.norm(vehicle.airframe.target_m - target) > 0.01:
            vehicle.flight.fly_to(target, self._yaw(item, target))  # the climb without a take-off item is done
        if self._since_s is None:
            yaw = self._yaw(item, target) if math.isfinite(item.params[3]) else None
            off = 0.0 if yaw is None else abs(wrap_angle(vehicle.airframe.yaw_rad - yaw))
            if not self._near(target, item) or off > math.radians(vehicle.parameters["MIS_YAW_ERR"]):
                return False
            self._since_s = vehicle.time_s
        if item.command == items.LOITER_UNLIMITED:
            return False
        return vehicle.time_s - self._since_s >= max(item.params[0], 0.0)

    def _near(self, target: Array, item: StoredItem) -> bool:
        given = item.params[1] if item.command == items.WAYPOINT else 0.0
        radius = given if given > 0.0 else self._vehicle.parameters["NAV_ACC_RAD"]
        way = self._vehicle.airframe.position_m - target
        height = min(radius, self._vehicle.parameters["NAV_MC_ALT_RAD"])
        return bool(np.hypot(way[0], way[1]) <= radius and abs(way[2]) <= height)

    def _place(self, item: StoredItem) -> Array:
        altitude = item.z + (self._vehicle.home.altitude_m if item.frame in _RELATIVE_FRAMES else 0.0)
        if item.command in {items.TAKEOFF, items.LAND} and not (item.x or item.y):
            x, y, _ = self._vehicle.airframe.position_m
            return np.array(
                [
                    x,
                    y,
                    self._vehicle.frame.scene_e7(
                        round(self._vehicle.home.latitude_deg * 1e7),
                        round(self._vehicle.home.longitude_deg * 1e7),
                        altitude,
                    )[2],
                ]
            )
        return self._vehicle.frame.scene_e7(item.x, item.y, altitude)

    def _yaw(self, item: StoredItem, target: Array) -> float | None:
        if math.isfinite(item.params[3]):
            return yaw_from_heading(math.radians(item.params[3]))
        return self._vehicle.flight.facing(target)

    def _advance(self) -> None:
        """Go to the next item with a place or a duration; what lies between is done now."""
        told = self.current
        following = self.current + 1
        while following < len(self.mission):
            item = self.mission[following]
            if item.command in _PLACES | {items.TAKEOFF, items.LAND, items.RETURN, items.DELAY}:
                break
            if item.command == items.JUMP:
                following = self._jump(item, following)
                continue
            self._do(item)
            told = following
            following += 1
        # Of a run of items that are done at once only the last one is told.
        self._tell_reached(told)
        if following >= len(self.mission):
            self.current = len(self.mission) - 1
            self.complete = True
            self._vehicle.mission_flown()
        else:
            self.current = following

    def _jump(self, item: StoredItem, at: int) -> int:
        left = self._jumps.get(at, int(item.params[1]))
        target = int(item.params[0])
        if left <= 0 or not 0 <= target < len(self.mission):
            return at + 1
        self._jumps[at] = left - 1
        return target

    def _do(self, item: StoredItem) -> None:
        params = (*item.params, float(item.x), float(item.y), item.z)
        self._vehicle.forward_mission_command(Command(item.command, params))

    def _tell_reached(self, sequence: int) -> None:
        self._reached = sequence
        self._repeats = _REPEATS
        self._told_s = self._vehicle.time_s
        self._vehicle.tell_item_reached(sequence)
