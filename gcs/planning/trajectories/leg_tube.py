"""Tubes about straights: where the deviation `d = (p - a) - ((p - a) . t) t` from the line has `|d|_inf <= delta`.

Mellinger and Kumar's corridor, closed at both ends by planes square to the line, `delta` past the straight: tubes about
straights that follow each other then share the room about their joint. For a straight along an axis it is the bounding
box grown by `delta` on all sides.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def _section(direction: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Corner of the bounding box, (3,), and largest length of a deviation with `|d|_inf <= 1` square to a direction.

    Where a component of the direction is larger than the sum of the others, theirs bound that of the deviation.
    """
    share = np.abs(direction)
    extent = np.ones(3)
    k = int(share.argmax())
    others = float(share.sum() - share[k])
    if share[k] >= others:
        extent[k] = others / share[k]
        return extent, math.sqrt(2 + float(extent[k]) ** 2)
    third = np.abs(np.roll(share, 1) - np.roll(share, -1)) / share
    return extent, math.sqrt(2 + float(third.max()) ** 2)


def tube_reach(direction: NDArray[np.float64]) -> float:
    """Largest distance of a point of a tube from its straight, as a multiple of delta, for a direction (3,).

    It is the farthest corner of an end: `delta` along the line and a vertex of the section aside; from sqrt(3) to 2.
    """
    return math.hypot(1.0, _section(direction)[1])


def tubes(ends_m: NDArray[np.float64], delta_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The tubes about the parts of a straight.

    Args:
        ends_m: ends of the parts, all on one straight, shape (n + 1, 3).
        delta_m: of each part's tube, shape (n,).

    Returns:
        Planes `(outward unit normal, offset)`, `normal . p <= offset`, shape (n, m, 4), and the bounding boxes,
        shape (n, 2, 3).
    """
    way = ends_m[-1] - ends_m[0]
    direction = way / np.linalg.norm(way)
    extent, _ = _section(direction)
    across = np.eye(3) - np.outer(direction, direction)
    used = extent == 1.0  # a bound on a component that the other two imply is left out
    lengths = np.linalg.norm(across[used], axis=1)
    sideways = across[used] / lengths[:, None]
    normals = np.concatenate([sideways, -sideways, [direction], [-direction]])
    begin, end = ends_m[:-1], ends_m[1:]
    offsets = np.concatenate(
        [
            begin @ sideways.T + delta_m[:, None] / lengths,
            -begin @ sideways.T + delta_m[:, None] / lengths,
            (end @ direction + delta_m)[:, None],
            (delta_m - begin @ direction)[:, None],
        ],
        axis=1,
    )
    planes = np.concatenate([np.broadcast_to(normals, (len(delta_m), *normals.shape)), offsets[:, :, None]], axis=2)
    past = delta_m[:, None] * direction
    ahead, behind = end + past, begin - past
    aside = delta_m[:, None] * extent
    boxes = np.stack([np.minimum(ahead, behind) - aside, np.maximum(ahead, behind) + aside], axis=1)
    return planes, boxes
