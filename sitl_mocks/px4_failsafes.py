"""The failsafes of the PX4-like vehicle beside the loss of setpoints: ground station, battery, fence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sitl_mocks.dialect import mavlink
from sitl_mocks.fence_rally import FENCE, outside
from sitl_mocks.px4_modes import Mode

if TYPE_CHECKING:
    from sitl_mocks.px4 import Px4Vehicle

STATION_LOSS = "ground station loss"
_EXCEPTIONS = {Mode.MISSION: 1, Mode.LOITER: 2, Mode.TAKEOFF: 2, Mode.OFFBOARD: 4}
"""Bits of COM_DLL_EXCEPT by mode."""


class Px4Failsafes:
    """Watches over a flight.

    Args:
        vehicle: that flies.
    """

    def __init__(self, vehicle: Px4Vehicle) -> None:
        self._vehicle = vehicle
        self._battery_stage = 0
        self._station_lost_s: float | None = None

    def reset(self) -> None:
        """A flight begins or ends, or somebody chose a mode."""
        self._station_lost_s = None

    def battery_changed(self) -> None:
        """A new flight looks at the battery anew."""
        self._battery_stage = 0

    def station_lost(self) -> None:
        """No ground station was heard for COM_DL_LOSS_T of wall time."""
        vehicle = self._vehicle
        exempt = _EXCEPTIONS.get(vehicle.mode, 0) & int(vehicle.parameters["COM_DLL_EXCEPT"])
        if vehicle.in_air and int(vehicle.parameters["NAV_DLL_ACT"]) > 0 and not exempt:
            self._station_lost_s = vehicle.wall_s

    def tick(self) -> None:
        """Act on what is wrong now."""
        self._watch_battery()
        self._watch_fence()
        self._watch_station()
        self._watch_position()

    def _watch_position(self) -> None:
        """Dead reckoning for EKF2_NOAID_TOUT ends the modes that need a position: it comes down."""
        vehicle = self._vehicle
        if vehicle.positioning is None or not vehicle.in_air:
            return
        if vehicle.positioning.unaided_s > vehicle.parameters["EKF2_NOAID_TOUT"] * 1e-6:
            vehicle.fail_to(Mode.LAND, "position loss")

    def _watch_station(self) -> None:
        """Hold for COM_FAIL_ACT_T (wall time), then act."""
        vehicle = self._vehicle
        if self._station_lost_s is None:
            return
        if not vehicle.station_lost:
            if vehicle.failsafe == STATION_LOSS and vehicle.mode is Mode.LOITER:
                vehicle.end_failsafe()
            self._station_lost_s = None
        elif vehicle.failsafe is None:
            vehicle.hold_in_failsafe(STATION_LOSS)
        elif (
            vehicle.failsafe == STATION_LOSS
            and vehicle.mode is Mode.LOITER
            and vehicle.wall_s - self._station_lost_s >= vehicle.parameters["COM_FAIL_ACT_T"]
        ):
            mode = {2: Mode.RTL, 3: Mode.LAND}.get(int(vehicle.parameters["NAV_DLL_ACT"]))
            if mode is not None:
                vehicle.fail_to(mode, STATION_LOSS)

    def _watch_battery(self) -> None:
        vehicle, p = self._vehicle, self._vehicle.parameters
        remaining = vehicle.airframe.battery.remaining
        stage = sum(remaining < p[name] for name in ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"))
        if stage <= self._battery_stage or not vehicle.in_air:
            return
        self._battery_stage = stage
        vehicle.say(mavlink.MAV_SEVERITY_CRITICAL, ("Low battery", "Critical battery", "Battery empty")[stage - 1])
        action = int(p["COM_LOW_BAT_ACT"])
        if stage == 3 and action in {2, 3}:
            vehicle.fail_to(Mode.LAND, "battery")
        elif stage == 2 and action in {1, 3}:
            vehicle.fail_to(Mode.RTL, "battery")
        elif stage == 2 and action == 2:
            vehicle.fail_to(Mode.LAND, "battery")

    def _outside_areas(self) -> bool:
        fence = self._vehicle.missions.others[FENCE].items
        if not fence:
            return False
        place = self._vehicle.frame.geo(self._vehicle.airframe.position_m)
        return outside(fence, place.latitude_deg, place.longitude_deg, of_all=False)

    def _watch_fence(self) -> None:
        vehicle, p = self._vehicle, self._vehicle.parameters
        if not vehicle.in_air or vehicle.failsafe == "fence":
            return
        way = vehicle.airframe.position_m - vehicle.home_m
        far, high = p["GF_MAX_HOR_DIST"], p["GF_MAX_VER_DIST"]
        beyond = (far > 0.0 and np.hypot(way[0], way[1]) > far) or (high > 0.0 and way[2] > high)
        if not beyond and not self._outside_areas():
            return
        mode = {2: Mode.LOITER, 3: Mode.RTL, 5: Mode.LAND}.get(int(p["GF_ACTION"]))
        if mode is not None:
            vehicle.fail_to(mode, "fence")
