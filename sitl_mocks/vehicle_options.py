"""How a simulated vehicle is set up, and what is counted about it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field

from gcs.core.frames import GeoPoint
from sitl_mocks.lidar import LidarOptions
from sitl_mocks.obstacles import Obstacle
from sitl_mocks.picture import Exposure
from sitl_mocks.positioning import Box


@dataclass(frozen=True)
class VehicleOptions:
    """How a vehicle is set up.

    Attributes:
        system_id: MAVLink system id.
        anchor: origin of the scene.
        home: where it stands at the start.
        draw: draws pictures, in the background or at once.
        seed: of the sensor noise and the gusts.
        parameters: overrides by name.
        parameter_count: how many parameters it has at least; 0 for those that mean something here.
        mission_items: how many items of a mission it takes; 0 for as many as the kind took when it was measured.
        real_start: whether it takes as long to start as the real one did, and not a twentieth of that.
        uid: hardware id, at most 18 bytes.
        battery_wh: capacity.
        wind_m_s: velocity of the air in the mean, ENU.
        gust_m_s: standard deviation of its horizontal components.
        body: name of its body, one of `airframe.BODIES`.
        replan: leave the path once, upward, and report it.
        faults: names of faults that are switched on (`mission_faults`).
        serves_pictures: whether the camera serves its pictures as files; else it sends the newest one packet by packet.
        hidden: boxes in which it receives no satellites; when there is none its position is what it truly is.
        unix_start_s: UTC at the start of the vehicle's clock.
        obstacles: what is there beside it.
        lidar: that it carries; its messages go to the companion's link.
    """

    system_id: int
    anchor: GeoPoint
    home: GeoPoint
    draw: Callable[[Exposure], Future[bytes]]
    seed: int = 0
    parameters: tuple[tuple[str, float], ...] = ()
    parameter_count: int = 0
    mission_items: int = 0
    real_start: bool = False
    uid: bytes = b""
    battery_wh: float = 130.0
    wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust_m_s: float = 0.0
    body: str = "usual"
    replan: bool = False
    faults: tuple[str, ...] = ()
    serves_pictures: bool = True
    hidden: tuple[Box, ...] = ()
    unix_start_s: float = 1_790_000_000.0
    obstacles: tuple[Obstacle, ...] = ()
    lidar: LidarOptions = field(default_factory=LidarOptions)


@dataclass
class Counters:
    """What tests may want to know of what came in."""

    setpoints: int = 0
    setpoints_in_offboard: int = 0
    forced_arms: int = 0
    commands: dict[int, int] = field(default_factory=dict)
    last_setpoint_wall_s: float | None = None
    longest_gap_s: float = 0.0
    """Longest time between two setpoints that were followed, on the vehicle's clock."""
    _followed_s: float | None = None

    def followed(self, now_s: float) -> None:
        """A setpoint was followed at a time of the vehicle's clock."""
        self.setpoints_in_offboard += 1
        if self._followed_s is not None:
            self.longest_gap_s = max(self.longest_gap_s, now_s - self._followed_s)
        self._followed_s = now_s

    def interrupted(self) -> None:
        """Setpoints are not followed any more; the time until the next one is no gap."""
        self._followed_s = None
