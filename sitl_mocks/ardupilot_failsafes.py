"""The failsafes of the ArduPilot-like vehicle: ground station, battery, fence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sitl_mocks.ardupilot_modes import Mode
from sitl_mocks.fence_rally import FENCE, outside

if TYPE_CHECKING:
    from sitl_mocks.ardupilot import ArduPilotVehicle

_CONTINUE_AUTO = 2
"""Bit of FS_OPTIONS: a mission goes on without a ground station."""

_CONTINUE_PILOT = 16
"""Bit of FS_OPTIONS: modes that are not the autopilot's own go on without a ground station."""

_UNION = 2
"""Bit of FENCE_OPTIONS: inside any included area, and not inside all of them."""

_DEAD_RECKONING_S = 10.0
"""So long the estimator's position counts without a fix."""

_PILOT_MODES = {Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.POSHOLD, Mode.BRAKE}


class ArduPilotFailsafes:
    """Watches over a flight.

    Args:
        vehicle: that flies.
    """

    def __init__(self, vehicle: ArduPilotVehicle) -> None:
        self._vehicle = vehicle
        self._battery_stage = 0
        self._fence_breached = False

    def reset(self) -> None:
        """A flight begins."""
        self._battery_stage = 0
        self._fence_breached = False

    def tick(self) -> None:
        """Act on what is wrong now."""
        self._watch_battery()
        self._watch_fence()
        self._watch_position()

    def _watch_position(self) -> None:
        """FS_EKF_ACTION, when the estimator has gone without position fixes for too long."""
        vehicle = self._vehicle
        if vehicle.positioning is None or not vehicle.in_air or vehicle.mode is Mode.LAND:
            return
        if vehicle.positioning.unaided_s > _DEAD_RECKONING_S and int(vehicle.parameters["FS_EKF_ACTION"]) == 1:
            vehicle.say_critical("EKF Failsafe: changed to LAND Mode")
            vehicle.fail_to(Mode.LAND, "position loss")

    def station_lost(self) -> None:
        """No ground station was heard for FS_GCS_TIMEOUT of wall time."""
        vehicle, p = self._vehicle, self._vehicle.parameters
        action = int(p["FS_GCS_ENABLE"])
        if not vehicle.in_air or action == 0 or vehicle.mode in {Mode.LAND, Mode.RTL, Mode.SMART_RTL}:
            return
        vehicle.say_critical("GCS Failsafe")
        goes_on = action == 2 or int(p["FS_OPTIONS"]) & _CONTINUE_AUTO
        if vehicle.mode is Mode.AUTO and goes_on:
            vehicle.say_info("GCS Failsafe - Continuing Auto Mode")
            return
        if vehicle.mode in _PILOT_MODES and int(p["FS_OPTIONS"]) & _CONTINUE_PILOT:
            vehicle.say_info("GCS Failsafe - Continuing Pilot Control")
            return
        vehicle.fail_to(self._mode({5: Mode.LAND, 7: Mode.BRAKE}, action), "ground station loss")

    def _mode(self, choices: dict[int, Mode], action: int) -> Mode:
        """The mode of a choice; 3 and 4 of all parameters fly back the way it came, if that is remembered."""
        if action in {3, 4}:
            if self._vehicle.can_retrace:
                return Mode.SMART_RTL
            return Mode.RTL if action == 3 else Mode.LAND
        return choices.get(action, Mode.RTL)

    def _watch_battery(self) -> None:
        vehicle, p = self._vehicle, self._vehicle.parameters
        left_mah = vehicle.airframe.battery.remaining * p["BATT_CAPACITY"]
        stage = sum(left_mah < p[name] for name in ("BATT_LOW_MAH", "BATT_CRT_MAH"))
        if stage <= self._battery_stage or not vehicle.in_air:
            return
        self._battery_stage = stage
        vehicle.say_critical(f"Battery 1 is {('low', 'critical')[stage - 1]}")
        action = int(p["BATT_FS_LOW_ACT" if stage == 1 else "BATT_FS_CRT_ACT"])
        if action:
            vehicle.fail_to(self._mode({1: Mode.LAND, 7: Mode.BRAKE}, action), "battery")

    def _outside_areas(self) -> bool:
        fence = self._vehicle.missions.others[FENCE].items
        if not fence:
            return False
        place = self._vehicle.frame.geo(self._vehicle.airframe.position_m)
        of_all = not int(self._vehicle.parameters["FENCE_OPTIONS"]) & _UNION
        return outside(fence, place.latitude_deg, place.longitude_deg, of_all=of_all)

    def _watch_fence(self) -> None:
        vehicle, p = self._vehicle, self._vehicle.parameters
        if not vehicle.in_air or self._fence_breached or not p["FENCE_ENABLE"]:
            return
        way = vehicle.airframe.position_m - vehicle.home_m
        kinds = int(p["FENCE_TYPE"])
        high = kinds & 1 and way[2] > p["FENCE_ALT_MAX"]
        far = kinds & 2 and np.hypot(way[0], way[1]) > p["FENCE_RADIUS"]
        if high or far or (kinds & 4 and self._outside_areas()):
            self._fence_breached = True
            vehicle.say_critical("Fence Breached")
            action = int(p["FENCE_ACTION"])
            if action:
                vehicle.fail_to({2: Mode.LAND, 4: Mode.BRAKE}.get(action, Mode.RTL), "fence")
