"""What is inspected, as arrays: triangles and cables placed in the scene frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.inspection import NamedPoint
    from gcs.core.structure_source import Cable


@dataclass(frozen=True, eq=False)
class Structure:
    """A placed structure in scene ENU.

    Attributes:
        vertices_m: shape (V, 3), finite.
        faces: vertex indices of the triangles, shape (F, 3).
        cables: straight capsules.
        named_points: the scene's own inspection points (sample scenes only).
        notes: what was found and done while loading, in plain words.
        placement_error_m: how far surface may be from where it is said to be, by what was found while loading (residual
            of an alignment, coarse numbers in a file); comes on top of the scenario's `model_m`.
    """

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    cables: tuple[Cable, ...] = ()
    named_points: tuple[NamedPoint, ...] = ()
    notes: tuple[str, ...] = ()
    placement_error_m: float = 0.0

    @cached_property
    def triangles_m(self) -> NDArray[np.float64]:
        """Corner points of the triangles, shape (F, 3, 3)."""
        return self.vertices_m[self.faces]

    @property
    def cable_ends_m(self) -> NDArray[np.float64]:
        """Axis ends of the cables, shape (C, 2, 3)."""
        return np.array([[c.from_m, c.to_m] for c in self.cables], dtype=np.float64).reshape(-1, 2, 3)

    @property
    def cable_radii_m(self) -> NDArray[np.float64]:
        """Radii of the cables, shape (C,)."""
        return np.array([c.radius_m for c in self.cables], dtype=np.float64)

    @cached_property
    def bounds_m(self) -> NDArray[np.float64]:
        """Lowest and highest corner over triangles and cables, shape (2, 3)."""
        is_used = np.zeros(len(self.vertices_m), dtype=np.bool_)
        is_used[self.faces] = True
        used = self.vertices_m[is_used]
        low, high = used.min(axis=0), used.max(axis=0)
        for (a, b), r in zip(self.cable_ends_m, self.cable_radii_m, strict=True):
            low, high = np.minimum(low, np.minimum(a, b) - r), np.maximum(high, np.maximum(a, b) + r)
        return np.stack([low, high])
