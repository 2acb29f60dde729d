"""A mesh file read, cleaned and ready to be placed, once or several times."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gcs.core.errors import InputError
from gcs.storage.mesh_cleaning import clean_mesh
from gcs.storage.mesh_placement import PlacedVertices, place
from gcs.storage.mesh_reading import read_mesh

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from gcs.core.structure_source import MeshSource

COARSE_STEP_M = 0.001
"""Single precision numbers that are further apart than this are said, and their rounding counts as error."""


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """A clean mesh in its file's units and axes.

    Attributes:
        path: of the file.
        vertices: shape (V, 3), finite.
        faces: shape (F, 3).
        sha256: of the file.
        step: as in `MeshContent`.
        notes: what was found and left out, in plain words.
    """

    path: Path
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    sha256: str
    step: float
    notes: tuple[str, ...]

    def check_unchanged(self, sha256: str | None) -> None:
        """Compare with what a plan says of the file.

        Raises:
            InputError: it is another file.
        """
        if sha256 is not None and sha256 != self.sha256:
            raise InputError("the file has changed since the plan was made (its SHA-256 differs)", field=str(self.path))

    def placed(self, source: MeshSource, field: str) -> PlacedVertices:
        """The vertices in the scene, with the error of the file's own numbers counted in.

        Args:
            source: how the mesh stands.
            field: of `source` in the scenario.

        Raises:
            InputError: its surveyed points do not fit.
        """
        result = place(self.vertices, source, field)
        notes = [f"{self.path.name}: {note}" for note in result.notes]
        step = self.step * result.scale
        error = result.error_m
        if step > COARSE_STEP_M:
            rounding = math.sqrt(3.0) / 2 * step
            error += rounding
            notes.append(
                f"{self.path.name}: it keeps large coordinates in single precision, in steps of {step:.2g} m: "
                f"export it about a local origin; {rounding:.2g} m come on top of safety.model_m"
            )
        return replace(result, error_m=error, notes=tuple(notes))


def load_mesh(path: Path) -> LoadedMesh:
    """Read and clean a mesh file.

    Raises:
        InputError: it is missing, empty, not a mesh, or has values that are not finite.
    """
    content = read_mesh(path)
    bad = int((~content.finite_faces).sum())
    if bad:
        which = "1 triangle has" if bad == 1 else f"{bad} triangles have"
        raise InputError(f"{which} corners that are not finite (NaN): mend the file", field=str(path))
    clean = clean_mesh(content.vertices, content.faces)
    if not len(clean.faces):
        raise InputError("all its triangles are only lines or points: it is not a surface mesh", field=str(path))
    notes = []
    if clean.degenerate:
        notes.append(f"{path.name}: {_triangles(clean.degenerate)} without area were left out")
    if clean.duplicates:
        notes.append(f"{path.name}: {_triangles(clean.duplicates)} that repeat another one were left out")
    if content.units is not None:
        notes.append(f"{path.name}: the unit written in the file ({content.units}) is ignored; `scale` counts")
    return LoadedMesh(path, clean.vertices, clean.faces, content.sha256, content.step, tuple(notes))


def _triangles(number: int) -> str:
    return f"{number:,} {'triangle' if number == 1 else 'triangles'}"
