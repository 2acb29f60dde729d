"""Segment times of a detour: a speed profile along it from the speed it starts with to the speed it ends with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_STEPS = 256
_SLOWEST_M_S = 0.05
"""The profile's least speed: at rest there is an acceleration, which its steps do not see."""


def profile_times(
    lengths_m: NDArray[np.float64], cruise_m_s: float, acceleration_m_s2: float, start_m_s: float, end_m_s: float
) -> NDArray[np.float64]:
    """How long each segment takes when speed goes evenly from the start's to the cruise, and from there to the end's.

    Args:
        lengths_m: of the segments, shape (S,).
        cruise_m_s: where there is room for it.
        acceleration_m_s2: of every change of speed.
        start_m_s: speed at the start.
        end_m_s: speed at the end.

    Returns:
        Shape (S,), s.
    """
    ends = np.cumsum(lengths_m)
    along = np.linspace(0.0, ends[-1], _STEPS)
    from_start = _towards(cruise_m_s, start_m_s, 2 * acceleration_m_s2 * along)
    from_end = _towards(cruise_m_s, end_m_s, 2 * acceleration_m_s2 * (ends[-1] - along))
    # Where an end is quicker than the cruise it sets the pace, where it is slower it holds the pace back.
    quick = np.maximum(from_start, from_end)
    slow = np.minimum(from_start, from_end)
    speed = np.maximum(np.where(slow < cruise_m_s, slow, quick), _SLOWEST_M_S)
    times = np.concatenate([[0.0], np.cumsum(2 * np.diff(along) / (speed[1:] + speed[:-1]))])
    return np.asarray(np.diff(np.interp(ends, along, times), prepend=0.0))


def _towards(cruise_m_s: float, speed_m_s: float, gained: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speed after its square has changed by so much at most, on the way to the cruise."""
    square = speed_m_s**2
    if speed_m_s < cruise_m_s:
        return np.sqrt(np.minimum(square + gained, cruise_m_s**2))
    return np.sqrt(np.maximum(square - gained, cruise_m_s**2))
