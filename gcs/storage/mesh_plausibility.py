"""Is it as large, and where, as a structure that is inspected by a vehicle may be?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from gcs.core.structure_source import MeshSource

LARGEST_M = 3000.0
SMALLEST_M = 0.5
USUAL_EXTENT_M = (5.0, 500.0)
USUAL_MISTAKES = (0.001, 1000.0, 0.01, 100.0, 0.0254, 10.0, 0.1)
"""Factors between the units that were taken and those that were meant, likeliest first."""

FURTHEST_M = 5000.0
"""From the anchor: beyond it the flat scene is no longer the earth's surface."""


def check_sizes(bounds_m: list[NDArray[np.float64]], sources: tuple[MeshSource, ...], base: Path) -> None:
    """Ask about meshes of which the largest is so large or so small that its units must be in doubt.

    Args:
        bounds_m: lowest and highest corner of each mesh as placed, shape (2, 3).
        sources: how they were placed.
        base: folder that relative file names start from.

    Raises:
        InputError: with the scale that was likely meant.
    """
    extents = [float((high - low).max()) for low, high in bounds_m]
    largest = int(np.argmax(extents))
    extent, source = extents[largest], sources[largest]
    if SMALLEST_M <= extent <= LARGEST_M:
        return
    size = f"{extent / 1000:.3g} km" if extent > LARGEST_M else f"{extent * 1000:.3g} mm"
    low, high = USUAL_EXTENT_M
    likely = next((f for f in USUAL_MISTAKES if low <= extent * f <= high), None)
    hint = ""
    if likely is not None:
        hint = f"set `scale: {source.scale * likely:g}` for {extent * likely:.3g} m, "
    raise InputError(
        f"with scale {source.scale:g} it is {size} in size: is that right? Else {hint}or give its true scale; "
        "`size_is_right: true` under structure confirms it",
        field=str(base / source.file),
    )


def check_distance(bounds_m: NDArray[np.float64], source: MeshSource, field: str) -> None:
    """Refuse a mesh that is not where the scene is, such as one in map coordinates.

    Args:
        bounds_m: lowest and highest corner as placed, shape (2, 3).
        source: how it was placed.
        field: of `source` in the scenario.

    Raises:
        InputError: with the position that would bring it to the anchor.
    """
    beyond = np.maximum(np.abs(bounds_m).max(axis=0) - FURTHEST_M, 0.0)
    if not beyond.any():
        return
    middle = bounds_m.mean(axis=0)
    away = f"{source.file} would stand {np.linalg.norm(middle) / 1000:.4g} km from the anchor"
    if source.align is not None:
        raise InputError(
            f"{away}: `world_m` is in metres east, north and up of the anchor, not in map coordinates",
            field=f"{field}.align.points",
        )
    centred = np.round(np.asarray(source.position_m) - [middle[0], middle[1], bounds_m[0, 2]])
    position = ", ".join(f"{c:.0f}" for c in centred + 0.0)
    raise InputError(
        f"{away}: it may be in map coordinates. [{position}] would put its foot at the anchor; "
        "for its true place take the anchor's map coordinates with a minus",
        field=f"{field}.position_m",
    )
