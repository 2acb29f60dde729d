"""Pictures on a flight by lease: the camera is pointed, the vehicle settles, the picture is commanded and confirmed."""

from __future__ import annotations

import math
from collections import deque
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import GcsError, LinkError
from gcs.core.frames import wrap_angle

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.core.plan import Viewpoint
    from gcs.mavlink.flight_commands import FlightCommands
    from gcs.services.companion.own_vehicle import OwnVehicle

SETTLE_TIMEOUT_S = 10.0
SETTLED_M, SETTLED_M_S = 0.3, 0.3
SETTLED_YAW_RAD, SETTLED_PITCH_RAD = math.radians(5.0), math.radians(3.0)
TRIES, TIMEOUT_S = 3, 4.0
LATEST, LONGEST_LAG_S = 5, 1.0


class ViewpointPictures:
    """Takes the pictures of one flight; its coroutines run on the vehicle's stepped channel.

    Args:
        vehicle: with the camera.
        say: takes what the operator should read.
    """

    def __init__(self, vehicle: OwnVehicle, say: Callable[[str], None]) -> None:
        self._vehicle = vehicle
        self._say = say
        self._lags_s: deque[float] = deque(maxlen=LATEST)

    @property
    def lag_s(self) -> float:
        """From a command to its picture, on the vehicle's clock (s); 0 until a picture has shown it."""
        return median(self._lags_s) if self._lags_s else 0.0

    async def point_camera(self, commands: FlightCommands, viewpoint: Viewpoint) -> None:
        """Turn the camera to where a viewpoint looks; a gimbal that refuses is said, and the flight goes on."""
        try:
            await self._vehicle.point_gimbal(commands, viewpoint.gimbal_pitch_rad)
        except GcsError as error:
            self._say(f"{viewpoint.name}: gimbal not pointed: {error.message}")

    async def settle(self, viewpoint: Viewpoint, place_m: NDArray[np.float64]) -> None:
        """Wait until vehicle and camera stand still at a place (local ENU) and look as they should, but not forever."""
        vehicle = self._vehicle
        try:
            await vehicle.channel.until(lambda: self._settled(viewpoint, place_m), SETTLE_TIMEOUT_S, "it to settle")
        except LinkError:
            self._say(f"{viewpoint.name}: not settled, pictured all the same")
        if viewpoint.hold_s:
            await vehicle.channel.sleep(viewpoint.hold_s)

    async def take(self, commands: FlightCommands, viewpoint: Viewpoint) -> bool:
        """Have a picture taken, and again while none is announced; returns whether one was."""
        for _ in range(TRIES):
            before = self._vehicle.pictures
            try:
                await self._vehicle.take_picture(commands)
                await self._announced(before)
            except LinkError as error:
                self._say(f"{viewpoint.name}: {error.message}")
            else:
                return True
        self._say(f"{viewpoint.name}: no picture was announced")
        return False

    async def take_in_passing(self, commands: FlightCommands, viewpoint: Viewpoint) -> bool:
        """Have one picture taken now, and learn how long that takes; returns whether one was announced."""
        began_s, before = self._vehicle.now_s(), self._vehicle.pictures
        try:
            await self._vehicle.take_picture(commands)
            await self._announced(before)
        except LinkError:
            self._say(f"{viewpoint.name}: no picture was announced")
            return False
        picture = self._vehicle.picture
        if began_s is not None and picture is not None and picture.at_vehicle_s is not None:
            lag_s = picture.at_vehicle_s - began_s
            if 0.0 <= lag_s <= LONGEST_LAG_S:
                self._lags_s.append(lag_s)
        return True

    async def _announced(self, before: int) -> None:
        await self._vehicle.channel.until(lambda: self._vehicle.pictures > before, TIMEOUT_S, "the picture")

    def _settled(self, viewpoint: Viewpoint, place_m: NDArray[np.float64]) -> bool:
        newest, telemetry = self._vehicle.poses.newest, self._vehicle.telemetry
        if newest is None or telemetry.yaw_rad is None:
            return False
        off_m, speed = np.linalg.norm(newest.position_m - place_m), np.linalg.norm(newest.velocity_m_s)
        turned = abs(wrap_angle(telemetry.yaw_rad.value - viewpoint.yaw_rad))
        pitch = telemetry.gimbal_pitch_rad
        looks = pitch is None or abs(wrap_angle(pitch.value - viewpoint.gimbal_pitch_rad)) <= SETTLED_PITCH_RAD
        return bool(off_m <= SETTLED_M and speed <= SETTLED_M_S and turned <= SETTLED_YAW_RAD and looks)
