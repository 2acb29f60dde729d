"""What the navigator keeps from obstacles, and how long it waits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.planning.local.detour import DetourOptions
from gcs.planning.local.evasion import EvasionOptions
from gcs.planning.local.known_room import KnownRoom
from gcs.planning.local.lidar_map import LidarMap
from gcs.planning.local.space_time import MovingClearance
from gcs.planning.local.surroundings import Surroundings

if TYPE_CHECKING:
    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.binary_map import BinaryMap
    from gcs.planning.local.stream_loss_pace import StreamLossRule
    from gcs.planning.local.surroundings import Scene


@dataclass(frozen=True)
class NavigatorOptions:
    """What is kept from obstacles, and how long is waited.

    Attributes:
        safe_m: R, between the vehicle's centre and what stands: hull, tracking, errors of the lidar, clearance.
        keep_moving_m: the same from what moves; what is not sure of its motion comes on top.
        slab_half_m: what the lidar sees counts for heights so far above and below the vehicle; None for all heights.
        known: cells that the known structure blocks, scene ENU; in the plane they count at every height.
        wait_s: a viewpoint that cannot be reached is waited for so long.
        give_up_s: without any progress for so long the flight is given up.
        map_side_m: edge of the square about the vehicle that is remembered.
        cell_m: edge of its cells.
        fade_s: time after which what is not seen again is down to 1/e.
        stream_loss: what has to stay clear when setpoints stop; None where that need not be minded.
    """

    safe_m: float = 1.2
    keep_moving_m: float = 1.4
    slab_half_m: float | None = 1.0
    known: BinaryMap | None = None
    wait_s: float = 15.0
    give_up_s: float = 60.0
    map_side_m: float = 50.0
    cell_m: float = 0.2
    fade_s: float = 4.0
    stream_loss: StreamLossRule | None = None

    def surroundings(self, plan: PiecewisePolynomial) -> Surroundings:
        """An empty map and no tracks."""
        known = None if self.known is None else KnownRoom(self.known, plan)
        return Surroundings(LidarMap(self.map_side_m, self.cell_m, self.fade_s), known, self.slab_half_m)

    def evasion(self, scene: Scene) -> EvasionOptions:
        """The same for one decision."""
        moving = MovingClearance(keep_m=self.keep_moving_m)
        return EvasionOptions(self.safe_m, moving, DetourOptions(slab_m=scene.slab_m, known=scene.known))
