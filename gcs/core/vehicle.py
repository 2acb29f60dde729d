"""What the station knows of a vehicle. Every value carries when it was heard; unknown is None, never zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.flight_law import FlightLaw
    from gcs.core.frames import GeoPoint
    from gcs.core.way_home import OwnAction, RetraceMemory, ReturnFlight


T = TypeVar("T")


class Autopilot(Enum):
    """The flight stacks that are told apart."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"
    GENERIC = "generic"


class FlightMode(Enum):
    """Modes in words common to both stacks; anything else is OTHER, with the stack's own name beside it."""

    MISSION = "mission"
    OFFBOARD = "offboard"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    TAKEOFF = "takeoff"
    MANUAL = "manual"
    OTHER = "other"
    UNKNOWN = "unknown"


class LandedState(Enum):
    """MAV_LANDED_STATE in words."""

    UNKNOWN = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKING_OFF = 3
    LANDING = 4


class MissionState(Enum):
    """MISSION_STATE in words."""

    UNKNOWN = 0
    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(frozen=True, slots=True)
class Heard(Generic[T]):
    """A value and the station's monotonic time (s) at which it was heard."""

    value: T
    at_s: float

    def age_s(self, now_s: float) -> float:
        """Seconds since it was heard."""
        return now_s - self.at_s


@dataclass(frozen=True)
class BatteryState:
    """Battery as the vehicle reports it; None where it does not."""

    remaining: float | None
    """Share left, 0 to 1."""
    voltage_v: float | None
    current_a: float | None


@dataclass(frozen=True)
class MissionProgress:
    """MISSION_CURRENT and MISSION_ITEM_REACHED."""

    current: int
    total: int | None
    state: MissionState


@dataclass(frozen=True)
class Telemetry:
    """The newest of everything heard from one vehicle; None until first heard.

    Positions are geodetic with altitude above mean sea level, or local ENU about the estimator's origin.
    """

    armed: Heard[bool] | None = None
    mode: Heard[FlightMode] | None = None
    mode_name: Heard[str] | None = None
    landed: Heard[LandedState] | None = None
    position: Heard[GeoPoint] | None = None
    local_position_m: Heard[NDArray[np.float64]] | None = None
    velocity_m_s: Heard[NDArray[np.float64]] | None = None
    yaw_rad: Heard[float] | None = None
    attitude_rad: Heard[tuple[float, float, float]] | None = None
    gimbal_pitch_rad: Heard[float] | None = None
    battery: Heard[BatteryState] | None = None
    home: Heard[GeoPoint] | None = None
    origin: Heard[GeoPoint] | None = None
    mission: Heard[MissionProgress] | None = None
    gps_fix: Heard[int] | None = None
    satellites: Heard[int] | None = None
    vehicle_time_s: Heard[float] | None = None
    """The vehicle's own clock since boot; runs faster than ours in a sped-up simulation."""
    ready_to_arm: Heard[bool] | None = None


@dataclass(frozen=True, slots=True)
class VehicleIdentity:
    """Who a vehicle is.

    Attributes:
        system_id: MAVLink system id, 1 to 255.
        component_id: of its autopilot.
        autopilot: the flight stack.
        vehicle_type: MAV_TYPE number.
    """

    system_id: int
    component_id: int
    autopilot: Autopilot
    vehicle_type: int

    @property
    def name(self) -> str:
        """The name a confirmation must give, such as `px4-1`."""
        return f"{self.autopilot.value}-{self.system_id}"


@dataclass(frozen=True)
class VehicleLimits:
    """What the vehicle's own parameters allow; None where they do not say.

    Attributes:
        offboard_timeout_s: how long it flies on at the last velocity when setpoints stop.
        return_altitude_m: height above home of its own return.
        return_flight: how its own return flies.
        retrace: how it remembers the path that it came; None when it cannot fly back along it.
        flight_law: how it flies missions and follows setpoints; None when that is not known.
        law_defaults: parameters of the flight law that it did not tell: the usual values stand for them.
        max_tilt_rad: how far its position control leans at most.
    """

    max_speed_m_s: float | None
    max_climb_m_s: float | None
    max_descent_m_s: float | None
    max_acceleration_m_s2: float | None
    offboard_timeout_s: float | None
    return_altitude_m: float | None
    return_flight: ReturnFlight | None = None
    retrace: RetraceMemory | None = None
    flight_law: FlightLaw | None = None
    law_defaults: tuple[str, ...] = ()
    max_tilt_rad: float | None = None


LAST_BATTERY = "nearly empty battery"
"""What the failsafe is about that comes after the one about the battery: a last resort."""


@dataclass(frozen=True)
class Failsafe:
    """One failsafe as the vehicle is set up.

    Attributes:
        name: parameter name, by which an operator accepts it when it is off.
        about: ground-station loss, RC loss, battery, nearly empty battery, fence, offboard loss or return.
        value: the parameter's value; None when the vehicle did not tell.
        active: whether it will do something; None when unknown.
        effect: what it does, in plain words.
        actions: what it makes the vehicle do, by the mode it flies in (MISSION, OFFBOARD, HOLD); a mode that is not in
            it has nothing to fear from this one, or it is not known.
        settings: what to set so that it does something else: action -> parameters and values, in words.
    """

    name: str
    about: str
    value: float | None
    active: bool | None
    effect: str
    actions: Mapping[FlightMode, OwnAction] = field(default_factory=dict)
    settings: Mapping[OwnAction, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ImageReport:
    """A picture the vehicle says it took.

    Attributes:
        index: the vehicle's own running number, from 0.
        file: its name or path as the vehicle tells it (untrusted); None when it tells none.
        position: where it was taken; None when not told.
        at_vehicle_s: the vehicle's clock (s since boot) when taken; None when not told.
        success: False when the vehicle says that the capture failed.
    """

    index: int
    file: str | None
    position: GeoPoint | None
    at_vehicle_s: float | None
    success: bool = True


@dataclass(frozen=True)
class StatusText:
    """A message of the vehicle for people; severity 0 emergency to 7 debug."""

    severity: int
    text: str
