"""What `plan.json` says of the sampled surface, kept small: a digit for each side."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from gcs.core.surface_coverage import SurfaceCoverage, Verdict

DIGITS = "0123456789a"
LEGEND = {DIGITS[verdict]: verdict.label for verdict in Verdict}
NORMAL_SCALE = 10_000

Whole = tuple[int, int, int]
Codes = Annotated[str, Field(pattern=f"^[{DIGITS}]*$")]


class CoverageEntry(BaseModel):
    """How the sides of the sampled surface are seen: for each point a character for its front and one for its back."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    legend: dict[str, str] = Field(default=LEGEND, description="What the characters mean.")
    points_mm: list[Whole] = Field(description="Millimetres, scene ENU.")
    normals: list[Whole] = Field(description=f"Of the front, times {NORMAL_SCALE}.")
    front: Codes
    back: Codes
    area_m2: float = Field(gt=0, allow_inf_nan=False, description="Of all sides together.")

    @model_validator(mode="after")
    def _columns_fit(self) -> Self:
        if not len(self.points_mm) == len(self.normals) == len(self.front) == len(self.back) > 0:
            raise ValueError("does not fit the other parts: coverage")
        if self.legend != LEGEND:
            raise ValueError("the legend is not that of this version")
        return self


def coverage_entry(coverage: SurfaceCoverage) -> CoverageEntry:
    """The entry of a coverage."""
    n = len(coverage.points_m) // 2
    letters = np.array(list(DIGITS))[coverage.verdicts].tolist()
    return CoverageEntry(
        points_mm=_whole(1000 * coverage.points_m[:n]),
        normals=_whole(NORMAL_SCALE * coverage.normals[:n]),
        front="".join(letters[:n]),
        back="".join(letters[n:]),
        area_m2=coverage.area_m2,
    )


def coverage_of(entry: CoverageEntry) -> SurfaceCoverage:
    """The coverage that an entry holds; points to half a millimetre."""
    points = np.array(entry.points_mm, dtype=np.float64).reshape(-1, 3) / 1000
    normals = np.array(entry.normals, dtype=np.float64).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-9)[:, None]
    verdicts = np.array([DIGITS.index(letter) for letter in entry.front + entry.back], dtype=np.uint8)
    return SurfaceCoverage(
        np.concatenate([points, points]), np.concatenate([normals, -normals]), verdicts, entry.area_m2
    )


def _whole(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[Whole]:
    return [(x, y, z) for x, y, z in np.rint(values).astype(np.int64).tolist()]
