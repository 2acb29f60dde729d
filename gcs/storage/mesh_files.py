"""Structures from mesh files and from the sample scenes."""

from __future__ import annotations

import hashlib
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from gcs.core.errors import InputError
from gcs.core.inspection import Inspection
from gcs.core.structure import Structure
from gcs.core.structure_source import MeshSource
from gcs.storage.mesh_loading import LoadedMesh, load_mesh
from gcs.storage.mesh_plausibility import check_distance, check_sizes
from gcs.storage.ply_files import ply_bytes
from gcs.storage.sample_scenes import SAMPLE_BUILDERS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from gcs.core.structure_source import StructureSource

PLACED_FILE = "structure.ply"
"""The placed structure in the folder of a plan."""

AVAILABLE_SAMPLES = tuple(SAMPLE_BUILDERS)


def load_structure(source: StructureSource, base: Path) -> tuple[Structure, StructureSource]:
    """Load and place what a scenario names.

    A mesh is placed by hand in the order scale, upward axis (y: x, y, z -> x, -z, y), rotation about the vertical and
    position, or by its surveyed points. Units and axes that are written in a file are ignored. Triangles without area
    and repeated ones are dropped; the notes say so. A file that is named several times is read once.

    Args:
        source: meshes and cables, or a sample.
        base: folder that relative file names start from.

    Returns:
        The structure in scene ENU, and the source as a plan should keep it: with the SHA-256 of every file filled in.
        A turn in space cannot be written as rotation about the vertical, and an error found while loading must not
        count twice: then `meshes` becomes the plan's own `structure.ply`, and `placed_from` the meshes that were given.

    Raises:
        InputError: a file is missing, empty, not a mesh, changed since its SHA-256 was taken, or has values that are
            not finite; a mesh is of unlikely size, far away, or its surveyed points do not fit.
    """
    if source.sample is not None:
        sample = _sample_structure(source.sample)
        return _with_cables(sample, source), source
    read: dict[str, LoadedMesh] = {}
    vertices: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    notes: list[str] = []
    bounds: list[NDArray[np.float64]] = []
    count, error = 0, 0.0
    for k, mesh in enumerate(source.meshes):
        loaded = read.get(mesh.file)
        if loaded is None:
            loaded = read[mesh.file] = load_mesh(base / mesh.file)
            notes += loaded.notes
        loaded.check_unchanged(mesh.sha256)
        placed = loaded.placed(mesh, f"structure.meshes.{k}")
        bounds.append(placed.bounds_m)
        vertices.append(placed.vertices_m)
        faces.append(loaded.faces + count)
        count += len(placed.vertices_m)
        error = max(error, placed.error_m)
        notes += placed.notes
    if not source.size_is_right:
        check_sizes(bounds, source.meshes, base)
    for k, mesh in enumerate(source.meshes):
        check_distance(bounds[k], mesh, f"structure.meshes.{k}")
    structure = Structure(
        np.concatenate(vertices), np.concatenate(faces), source.cables, (), tuple(notes), placement_error_m=error
    )
    given = tuple(m.model_copy(update={"sha256": read[m.file].sha256}) for m in source.meshes)
    if error > 0 or any(m.align for m in given):
        content = hashlib.sha256(ply_bytes(structure.vertices_m, structure.faces)).hexdigest()
        as_placed = MeshSource(file=PLACED_FILE, sha256=content)
        return structure, source.model_copy(update={"meshes": (as_placed,), "placed_from": given})
    return structure, source.model_copy(update={"meshes": given})


def sample_scenario(name: str) -> dict[str, Any]:
    """The complete scenario of a sample scene, as its file would be parsed.

    Raises:
        InputError: the sample is not part of this version.
    """
    return _read_sample(name, f"{name}.scenario.yaml")


def sample_inspection(name: str | None, structure: Structure) -> Inspection:
    """What is inspected when a scenario names only the sample: as its own scenario says, or its named points.

    Args:
        name: of the sample; a structure without one has to say what is inspected.
        structure: gives the named points.

    Raises:
        InputError: there is no such sample.
    """
    if name is None:
        raise InputError("this field is missing: name what is to be seen", field="inspection")
    own = sample_scenario(name).get("inspection")
    return Inspection(points=structure.named_points) if own is None else Inspection.model_validate(own)


def _sample_structure(name: str) -> Structure:
    return SAMPLE_BUILDERS[name](_read_sample(name, f"{name}.yaml"))


def _with_cables(structure: Structure, source: StructureSource) -> Structure:
    if not source.cables:
        return structure
    return Structure(
        structure.vertices_m,
        structure.faces,
        structure.cables + source.cables,
        structure.named_points,
        structure.notes,
    )


def _read_sample(name: str, file: str) -> dict[str, Any]:
    if name not in AVAILABLE_SAMPLES:
        known = ", ".join(AVAILABLE_SAMPLES)
        raise InputError(f"the sample {name} is not part of this version: use {known}", field="structure.sample")
    content = resources.files("gcs.storage").joinpath("samples", file).read_text(encoding="utf-8")
    data: dict[str, Any] = yaml.safe_load(content)
    return data
