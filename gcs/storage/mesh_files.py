"""Structures from mesh files and from the sample scenes."""

from __future__ import annotations

import math
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from gcs.core.errors import InputError
from gcs.core.structure import Structure
from gcs.storage.mesh_reading import is_degenerate, read_mesh
from gcs.storage.sample_scenes import gantry_crane

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from gcs.core.structure_source import MeshSource, StructureSource

AVAILABLE_SAMPLES = ("gantry-crane",)


def load_structure(source: StructureSource, base: Path) -> tuple[Structure, StructureSource]:
    """Load and place what a scenario names.

    Order of placement: scale, upward axis (y: x, y, z -> x, -z, y), rotation about the vertical, position. Units and
    axes that are written in a file are ignored. Degenerate triangles are dropped; the notes say so.

    Args:
        source: meshes and cables, or a sample.
        base: folder that relative file names start from.

    Returns:
        The structure in scene ENU, and the source with the SHA-256 of every file filled in.

    Raises:
        InputError: a file is missing, empty, not a mesh, changed since its SHA-256 was taken, or has values that are
            not finite; or the sample is not part of this version.
    """
    if source.sample is not None:
        sample = _sample_structure(source.sample)
        return _with_cables(sample, source), source
    vertices: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    notes: list[str] = []
    placed_sources = []
    count = 0
    for mesh in source.meshes:
        v, f, mesh_notes, sha256 = _load_mesh(mesh, base)
        vertices.append(v)
        faces.append(f + count)
        count += len(v)
        notes += mesh_notes
        placed_sources.append(mesh.model_copy(update={"sha256": sha256}))
    structure = Structure(np.concatenate(vertices), np.concatenate(faces), source.cables, (), tuple(notes))
    return structure, source.model_copy(update={"meshes": tuple(placed_sources)})


def sample_scenario(name: str) -> dict[str, Any]:
    """The complete scenario of a sample scene, as its file would be parsed.

    Raises:
        InputError: the sample is not part of this version.
    """
    return _read_sample(name, f"{name}.scenario.yaml")


def _sample_structure(name: str) -> Structure:
    return gantry_crane(_read_sample(name, f"{name}.yaml"))


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


def _load_mesh(source: MeshSource, base: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], list[str], str]:
    path = base / source.file
    content = read_mesh(path)
    if source.sha256 is not None and source.sha256 != content.sha256:
        raise InputError("the file has changed since the plan was made (its SHA-256 differs)", field=str(path))
    bad = int((~content.finite_faces).sum())
    if bad:
        which = "1 triangle has" if bad == 1 else f"{bad} triangles have"
        raise InputError(f"{which} corners that are not finite (NaN): mend the file", field=str(path))
    vertices = _place(content.vertices, source)
    degenerate = is_degenerate(vertices[content.faces])
    notes = []
    if degenerate.all():
        raise InputError("all its triangles are only lines or points: it is not a surface mesh", field=str(path))
    if degenerate.any():
        notes.append(f"{path.name}: {int(degenerate.sum())} triangles without area were left out")
    if content.units is not None:
        notes.append(f"{path.name}: the unit written in the file ({content.units}) is ignored; `scale` counts")
    faces = content.faces[~degenerate]
    used = np.unique(faces)  # loose vertices may be anything, even NaN
    number = np.zeros(len(vertices), dtype=np.int64)
    number[used] = np.arange(len(used))
    return vertices[used], number[faces], notes, content.sha256


def _place(vertices: NDArray[np.float64], source: MeshSource) -> NDArray[np.float64]:
    v = vertices * source.scale
    if source.up == "y":
        v = np.column_stack([v[:, 0], -v[:, 2], v[:, 1]])
    angle = math.radians(source.rotation_deg)
    c, s = math.cos(angle), math.sin(angle)
    turned = np.column_stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]])
    placed: NDArray[np.float64] = turned + np.asarray(source.position_m)
    return placed
