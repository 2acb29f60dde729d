"""What a vehicle is doing in the air, or whether it stands on the ground."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sitl_mocks.airframe import Airframe, FlightLimits
from sitl_mocks.flight_tasks import FlightTask, GoTo, Hold, Land, ReturnAlong, ReturnHome, Sink, TakeOff
from sitl_mocks.scene_frame import Array

ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
_OFF_THE_GROUND_M = 0.3
_SET_DOWN_S = 1.0


class FlightControl:
    """Runs one task at a time on an airframe.

    Args:
        airframe: of the vehicle.
        limits: of the autopilot in its present mode.
    """

    def __init__(self, airframe: Airframe, limits: Callable[[], FlightLimits]) -> None:
        self._airframe = airframe
        self._limits = limits
        self.task: FlightTask | None = None
        self.landed = True
        self._taking_off = False
        self._touching_s = 0.0
        self.grounded_s: float | None = None
        """Time on the ground after a landing on setpoints; None otherwise."""

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        if self.landed:
            return ON_GROUND
        if self._taking_off:
            return TAKING_OFF
        return LANDING if isinstance(self.task, Land | Sink) else IN_AIR

    def reset(self) -> None:
        """Stop the motors and do nothing."""
        self.task = None
        self._taking_off = False
        self.landed = self._airframe.on_ground
        self.grounded_s = None
        self._airframe.cut_motors()
        self.refresh_limits()

    def refresh_limits(self) -> None:
        """Fly within what the mode and the parameters say now."""
        self._airframe.set_limits(self._limits())

    def watch_ground(self, dt_s: float) -> None:
        """Notice that the vehicle has left the ground, or has been set down on it by setpoints."""
        if self._airframe.height_m > _OFF_THE_GROUND_M:
            self.landed = False
            self.grounded_s = None
        if self.grounded_s is not None:
            self.grounded_s += dt_s
        touching = self.task is None and self._airframe.on_ground and not self.landed
        self._touching_s = self._touching_s + dt_s if touching else 0.0
        if self._touching_s >= _SET_DOWN_S:
            self.landed = True
            self.grounded_s = 0.0

    def begin(self, task: FlightTask, *, taking_off: bool = False) -> None:
        """Be busy with something else from now on."""
        self.refresh_limits()
        self._taking_off = taking_off
        self.task = task
        task.begin()

    def follow_setpoints(self) -> None:
        """The reference comes from outside: there is no task."""
        self.task = None
        self._taking_off = False

    def hold(self) -> None:
        """Brake and stay; on the ground wait with idle motors."""
        if self.landed:
            self.task = None
            self._airframe.cut_motors()
        else:
            self.begin(Hold(self._airframe))

    def take_off_to(self, up_m: float) -> None:
        """Climb straight up to a height of the scene."""
        self.begin(TakeOff(self._airframe, up_m), taking_off=True)

    def fly_to(self, target_m: Array, yaw_rad: float | None = None) -> None:
        """Fly straight to a point; a yaw of None keeps the yaw."""
        self.begin(GoTo(self._airframe, target_m, yaw_rad))

    def run(self, dt_s: float) -> bool:
        """Go on with the present task; True when it has just been done."""
        if self.task is None or not self.task.tick(dt_s):
            return False
        if isinstance(self.task, Land | ReturnAlong | ReturnHome | Sink):
            self.landed = True
            self._airframe.cut_motors()
        self._taking_off = False
        return True

    def facing(self, target_m: Array, from_m: Array | None = None) -> float | None:
        """Yaw toward a point from another one, or from where the vehicle is led; None if it is straight up or down."""
        if from_m is None:
            from_m = self._airframe.target_m if self._airframe.running else self._airframe.position_m
        way = target_m[:2] - from_m[:2]
        return math.atan2(way[1], way[0]) if float(np.hypot(*way)) > 1.0 else None
