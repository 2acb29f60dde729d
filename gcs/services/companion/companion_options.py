"""How a companion is set up."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CompanionOptions:
    """How a companion is set up.

    Attributes:
        stream_hz: setpoints per second of the vehicle's clock, 20 to 50.
        needs_lidar: whether it flies only with fresh scans.
        slab_half_m: the lidar tells of heights within this of the vehicle's.
        lidar_silent_s: without a good scan for so long (vehicle's clock) the vehicle slows to a hover.
        give_up_s: it hovers for so long for want of scans, position or odometry; then the lease ends in a hold.
    """

    stream_hz: float = 50.0
    needs_lidar: bool = True
    slab_half_m: float = 0.5
    lidar_silent_s: float = 0.6
    give_up_s: float = 10.0
