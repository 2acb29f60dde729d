"""Obstacles about a plan, drawn at random, that a vehicle can avoid with a 2D lidar.

What stands or moves in the way reaches above and below every height at which the plan is flown, or it stays well below:
nobody avoids what the lidar cannot see. So people are 8 m tall here and drones 6 m; true ones, of which the lidar's
plane may see nothing, are not in these worlds. What moves is under way from the start: nobody avoids what stands beside
him and sets out at full speed. Nothing comes nearer to home than 7 m, where the autopilot takes off and lands by itself
and nobody evades. What moves passes whatever is there by a gap that is wide enough to stay in. Few things come to stand
where a picture is to be taken. Otherwise they do not care for the vehicle: they cross its way, stop on it, or come up
to where it hovers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Spec = dict[str, Any]
    """As the simulator's file of obstacles has them."""

FROM_HOME_M = 7.0
GAP_M = 2.0
LARGEST_Y_M = 9.0
"""Further north there is the wall."""
ASIDE_M = 3.0
ARRIVES_S = (12.0, 60.0)
GOES_ON_M = (12.0, 25.0)
STOPS_SHARE = 0.3
ON_VIEWPOINT_SHARE = 0.1
"""Of what was drawn to stand too near to a viewpoint so many are kept there."""

TRIES = 100
TIMES_S = np.arange(0.0, 120.0, 0.1)
"""When moving things are looked at; all have stopped by the end."""


@dataclass(frozen=True)
class Kind:
    """Radius, lower end, height, and speed: from, to."""

    name: str
    radius_m: tuple[float, float]
    base_m: float
    height_m: float
    speed_m_s: tuple[float, float]


PARKED = Kind("vehicle", (0.4, 1.2), 0.0, 8.0, (1.0, 1.0))
LOW = Kind("vehicle", (0.8, 2.0), 0.0, 1.5, (1.0, 1.0))
DRIVING = Kind("vehicle", (1.0, 2.0), 0.0, 8.0, (1.5, 3.0))
WALKING = Kind("person", (0.3, 0.4), 0.0, 8.0, (0.7, 1.5))
FLYING = Kind("drone", (0.4, 0.7), 0.6, 6.0, (2.0, 4.0))
"""Both taller than they are, for the lidar's plane to meet them wherever the hull can."""


def random_obstacles(
    rng: np.random.Generator,
    way_m: NDArray[np.float64],
    home_m: NDArray[np.float64],
    viewpoints_m: NDArray[np.float64],
    keep_m: float,
) -> list[Spec]:
    """Draw obstacles, at least one of them in the way.

    Args:
        rng: for everything.
        way_m: places along the plan, shape (N, 3), scene ENU.
        home_m: shape (3,).
        viewpoints_m: where pictures are taken, shape (V, 3).
        keep_m: what the vehicle's centre keeps from obstacles.
    """
    drawn: list[Spec] = []
    most = {PARKED: 2, LOW: 1, FLYING: 1, DRIVING: 2, WALKING: 2}
    counts = {kind: int(rng.integers(0, number + 1)) for kind, number in most.items()}
    if not counts[PARKED] + counts[DRIVING]:
        counts[PARKED] = 1
    for kind, count in counts.items():
        moves = kind in (DRIVING, WALKING, FLYING)
        for _ in range(count):
            for _ in range(TRIES):
                spec = _moving(rng, kind, way_m) if moves else _standing(rng, kind, way_m)
                stays_off = not blocked_in_the_end([spec], viewpoints_m, keep_m).any()
                if _is_fair(spec, drawn, home_m) and (stays_off or rng.random() < ON_VIEWPOINT_SHARE):
                    drawn.append(spec)
                    break
    return drawn


def blocked_in_the_end(specs: list[Spec], places_m: NDArray[np.float64], keep_m: float) -> NDArray[np.bool_]:
    """Whether something stands so near to each of some places (N, 3) for good that a vehicle cannot be there.

    Args:
        specs: obstacles.
        places_m: scene ENU.
        keep_m: what the vehicle's centre keeps from obstacles.
    """
    blocked = np.zeros(len(places_m), dtype=np.bool_)
    for spec in specs:
        away_m = np.linalg.norm(places_m[:, :2] - spec["path_m"][-1], axis=1) - spec["radius_m"]
        above_m = places_m[:, 2] - (spec["base_m"] + spec["height_m"])
        blocked |= (away_m < keep_m) & (above_m < keep_m)
    return blocked


def _standing(rng: np.random.Generator, kind: Kind, way_m: NDArray[np.float64]) -> Spec:
    place = rng.choice(way_m)[:2] + rng.uniform(-ASIDE_M, ASIDE_M, 2)
    return _spec(rng, kind, [place])


def _moving(rng: np.random.Generator, kind: Kind, way_m: NDArray[np.float64]) -> Spec:
    target, course = rng.choice(way_m)[:2], rng.uniform(0.0, 2.0 * math.pi)
    along = np.array([math.cos(course), math.sin(course)])
    speed_m_s = rng.uniform(*kind.speed_m_s)
    before_m = speed_m_s * rng.uniform(*ARRIVES_S)
    path = [
        target - before_m * along,
        target if rng.random() < STOPS_SHARE else target + rng.uniform(*GOES_ON_M) * along,
    ]
    return {**_spec(rng, kind, path), "speed_m_s": float(speed_m_s)}


def _spec(rng: np.random.Generator, kind: Kind, path: list[NDArray[np.float64]]) -> Spec:
    return {
        "kind": kind.name,
        "path_m": [[float(x), float(y)] for x, y in path],
        "radius_m": float(rng.uniform(*kind.radius_m)),
        "base_m": kind.base_m,
        "height_m": kind.height_m,
    }


def _is_fair(spec: Spec, others: list[Spec], home_m: NDArray[np.float64]) -> bool:
    path, radius = _places(spec), spec["radius_m"]
    if path[:, 1].max() + radius > LARGEST_Y_M:
        return False
    if _least(path, np.asarray(home_m)[None, :2]) < FROM_HOME_M + radius:
        return False
    return all(_nearest_m(spec, other) > radius + other["radius_m"] + GAP_M for other in others)


def _nearest_m(one: Spec, other: Spec) -> float:
    """Least distance of their middles at any time: what has stopped stands in the way of what comes later."""
    return float(np.linalg.norm(_places_in_time(one) - _places_in_time(other), axis=1).min())


def _places_in_time(spec: Spec) -> NDArray[np.float64]:
    start, end = np.asarray(spec["path_m"][0]), np.asarray(spec["path_m"][-1])
    share = np.minimum(TIMES_S * spec.get("speed_m_s", 0.0) / max(math.dist(start, end), 1e-9), 1.0)
    return np.asarray(start + share[:, None] * (end - start))


def _places(spec: Spec) -> NDArray[np.float64]:
    path = np.asarray(spec["path_m"])
    return np.asarray(path[0] + np.linspace(0.0, 1.0, 400)[:, None] * (path[-1] - path[0]))


def _least(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(a[:, None] - b[None], axis=2).min())
