"""Gusts: wind that changes at random, and the same way again with the same seed.

Each component is a first-order Gauss-Markov process, the form that Dryden's spectrum has along the wind (MIL-F-8785C):
`x(t + dt) = a x(t) + sigma sqrt(1 - a^2) n`, `a = exp(-dt / T)`, with n standard normal. It is exact for any step.
Gusts carry no energy upward near the ground; the vertical part is half as strong as the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.planning.numerics.compiled import compiled

_VERTICAL_SHARE = 0.5


@dataclass(frozen=True)
class WindGusts:
    """Wind with gusts.

    Attributes:
        mean_m_s: velocity of the air in the mean, ENU.
        deviation_m_s: standard deviation of each horizontal component about it.
        time_constant_s: after which a gust has decayed to 1/e; Dryden's length scale over the airspeed.
    """

    mean_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    deviation_m_s: float = 1.0
    time_constant_s: float = 3.0

    def first(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Wind at a moment of which nothing is known, ENU, shape (3,)."""
        return np.asarray(self.mean_m_s + self._spread() * rng.standard_normal(3))

    def after(self, wind_m_s: NDArray[np.float64], dt_s: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Wind a time step after `wind_m_s`, ENU, shape (3,)."""
        stays = math.exp(-dt_s / self.time_constant_s)
        fresh = math.sqrt(1.0 - stays**2) * self._spread() * rng.standard_normal(3)
        return np.asarray(self.mean_m_s + stays * (wind_m_s - self.mean_m_s) + fresh)

    def sampled(self, count: int, dt_s: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Wind at times `dt_s` apart, ENU, shape (count, 3)."""
        wind = self._spread() * rng.standard_normal((count, 3))
        stays = math.exp(-dt_s / self.time_constant_s)
        wind[1:] *= math.sqrt(1.0 - stays**2)
        _accumulate(wind, stays)
        return np.asarray(wind + self.mean_m_s)

    def _spread(self) -> NDArray[np.float64]:
        return self.deviation_m_s * np.array([1.0, 1.0, _VERTICAL_SHARE])


@compiled
def _accumulate(noise: NDArray[np.float64], stays: float) -> None:
    for i in range(1, len(noise)):
        noise[i] += stays * noise[i - 1]
