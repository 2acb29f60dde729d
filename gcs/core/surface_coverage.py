"""What becomes of each sampled side of the surface: seen, left out, or why no picture can show it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Verdict(IntEnum):
    """What becomes of a side.

    After `LEFT_OUT` come the reasons why no picture can show a side as asked, each with the limit that stands in the
    way. When several limits could be given up to see it, the first in this order is named: first what a setting or
    another camera changes, the clearance last but for what nothing changes.
    """

    SEEN = 0
    LEFT_OUT = 1
    GIMBAL = 2
    INCIDENCE = 3
    TOO_FAR = 4
    NOT_SHARP = 5
    FENCE = 6
    GROUND = 7
    NOT_REACHABLE = 8
    TOO_CLOSE = 9
    OCCLUDED = 10

    @property
    def label(self) -> str:
        """Its name in files: `seen`, `left_out`, ..."""
        return self.name.lower()

    @property
    def words(self) -> str:
        """The same for people."""
        return WORDS[self]


WORDS: dict[Verdict, str] = {
    Verdict.SEEN: "seen as asked",
    Verdict.LEFT_OUT: "could be seen, but is left out: it would take more viewpoints",
    Verdict.GIMBAL: "the camera cannot be pointed at it within its pitch range",
    Verdict.INCIDENCE: "seen only at more than the largest incidence",
    Verdict.TOO_FAR: "seen only from further away than the GSD allows",
    Verdict.NOT_SHARP: "seen only from nearer than the camera is sharp",
    Verdict.FENCE: "seen only from outside the fence",
    Verdict.GROUND: "seen only from nearer to the ground than the clearance",
    Verdict.NOT_REACHABLE: "seen only from places that no way leads to",
    Verdict.TOO_CLOSE: "seen only from nearer to the structure than the clearance",
    Verdict.OCCLUDED: "hidden: inside the structure, or covered by it",
}


@dataclass(frozen=True, eq=False)
class SurfaceCoverage:
    """How well the sampled sides of the surface are seen.

    Attributes:
        points_m: the sampled points twice, once for each side, shape (2 N, 3): the second half repeats the first.
        normals: the side of each, unit, shape (2 N, 3): the second half is minus the first.
        verdicts: of each side, values of `Verdict`, shape (2 N,) uint8.
        area_m2: of all sides together, that is twice the area of the surface that was asked for.
    """

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    verdicts: NDArray[np.uint8]
    area_m2: float

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Sides that a viewpoint shows as asked, shape (2 N,)."""
        return np.asarray(self.verdicts == Verdict.SEEN)

    @property
    def coverable(self) -> NDArray[np.bool_]:
        """Sides that some viewpoint could show as asked, shape (2 N,); every seen one is."""
        return np.asarray(self.verdicts <= Verdict.LEFT_OUT)

    @property
    def share_seen(self) -> float:
        """Seen share of what is coverable; 0 when nothing is."""
        return float(self.seen.sum() / max(int(self.coverable.sum()), 1))

    @property
    def share_coverable(self) -> float:
        """Coverable share of all sampled sides."""
        return float(self.coverable.mean())

    def shares(self) -> dict[Verdict, float]:
        """Share of all sides of every verdict that there is, in the order of the verdicts."""
        counts = np.bincount(self.verdicts, minlength=len(Verdict))
        return {v: float(counts[v] / len(self.verdicts)) for v in Verdict if counts[v]}

    def not_covered_m2(self) -> dict[str, float]:
        """Area (m²) of the sides that are not seen, by the verdict's label."""
        return {v.label: share * self.area_m2 for v, share in self.shares().items() if v is not Verdict.SEEN}
