"""Mesh files as they are: bytes on disk to vertices and triangles, with every complaint about the file in one line."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

FORMATS = {".stl": "STL", ".obj": "OBJ", ".ply": "PLY", ".glb": "GLB", ".gltf": "GLTF", ".off": "OFF", ".dae": "DAE"}

SLIVER = 1e-9
"""A triangle whose height is less than this share of its longest side is a line."""


@dataclass(frozen=True, eq=False)
class MeshContent:
    """What a mesh file holds, in its own units and axes.

    Attributes:
        vertices: shape (V, 3); may have values that are not finite.
        faces: indices of vertices, shape (F, 3), F > 0.
        file_format: such as `STL`.
        sha256: of the file's bytes.
        units: the unit that is written in the file, if one is; it is not used.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    file_format: str
    sha256: str
    units: str | None

    @property
    def finite_faces(self) -> NDArray[np.bool_]:
        """Faces whose corners are all finite, shape (F,)."""
        finite = np.asarray(np.isfinite(self.vertices).all(axis=1))
        return np.asarray(finite[self.faces].all(axis=1))


def is_degenerate(triangles: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Triangles that are only a line or a point, shape (F, 3, 3) -> (F,)."""
    sides = np.roll(triangles, -1, axis=1) - triangles
    longest_squared = (sides**2).sum(axis=2).max(axis=1)
    doubled_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    degenerate: NDArray[np.bool_] = doubled_area <= SLIVER * longest_squared
    return degenerate


def read_mesh(path: Path) -> MeshContent:
    """Read a mesh file; objects of a scene are put together where its scene graph places them.

    Raises:
        InputError: the file is missing, empty, of a format that is not read, or not a mesh.
    """
    name = str(path)
    file_format = FORMATS.get(path.suffix.lower())
    if file_format is None:
        known = ", ".join(FORMATS.values())
        raise InputError(f"this kind of file is not read; a mesh is one of {known}", field=name)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError("there is no such file", field=name) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", field=name) from None
    if not data:
        raise InputError("the file is empty", field=name)
    vertices, faces, units = _parse(data, path, file_format)
    if not len(faces):
        raise InputError("there are no triangles in it: it is not a surface mesh", field=name)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError("a triangle names a vertex that is not there: the file is damaged", field=name)
    return MeshContent(vertices, faces, file_format, hashlib.sha256(data).hexdigest(), units)


def _parse(data: bytes, path: Path, file_format: str) -> tuple[NDArray[np.float64], NDArray[np.int64], str | None]:
    import trimesh
    from trimesh.resolvers import FilePathResolver

    options = {"skip_materials": True} if file_format == "OBJ" else {}
    try:
        scene = trimesh.load_scene(
            io.BytesIO(data),
            file_type=file_format.lower(),
            resolver=FilePathResolver(str(path)),
            process=False,
            **options,
        )
        parts = []
        units = None
        for node in scene.graph.nodes_geometry:
            transform, geometry = scene.graph[node]
            mesh = scene.geometry[geometry]
            if isinstance(mesh, trimesh.Trimesh):
                placed = np.asarray(mesh.vertices, dtype=np.float64) @ transform[:3, :3].T + transform[:3, 3]
                parts.append((placed, np.asarray(mesh.faces, dtype=np.int64)))
                units = units or mesh.metadata.get("units")
    except Exception as error:  # the readers raise whatever a damaged file leads them to
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        if isinstance(error, ImportError):  # it took a damaged file for one in some other encoding
            reason = "it is neither binary nor text as this format asks"
        raise InputError(f"is not a mesh in {file_format} format, or is damaged ({reason})", field=str(path)) from error
    if not parts:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), None
    offsets = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    vertices = np.concatenate([v for v, _ in parts])
    faces = np.concatenate([f + o for (_, f), o in zip(parts, offsets, strict=True)])
    return vertices, faces, str(units) if units and file_format == "DAE" else None
