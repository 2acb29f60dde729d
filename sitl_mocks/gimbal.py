"""A gimbal that pitches; yaw is the vehicle's."""

from __future__ import annotations

import math


class Gimbal:
    """Pitch follows its target at a limited rate.

    Args:
        low_deg: lowest pitch, negative looks down.
        high_deg: highest pitch.
        rate_deg_s: how fast it turns.
    """

    def __init__(self, low_deg: float = -90.0, high_deg: float = 45.0, rate_deg_s: float = 60.0) -> None:
        self.low_rad = math.radians(low_deg)
        self.high_rad = math.radians(high_deg)
        self.rate_rad_s = math.radians(rate_deg_s)
        self.pitch_rad = 0.0
        self.target_rad = 0.0

    def point(self, pitch_rad: float) -> bool:
        """Turn to a pitch; False, and nothing happens, when it is no number."""
        if not math.isfinite(pitch_rad):
            return False
        self.target_rad = min(max(pitch_rad, self.low_rad), self.high_rad)
        return True

    def step(self, seconds: float) -> None:
        """Let time pass."""
        most = self.rate_rad_s * seconds
        self.pitch_rad += min(max(self.target_rad - self.pitch_rad, -most), most)
