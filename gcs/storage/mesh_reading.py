"""Mesh files as they are: bytes on disk to vertices and triangles, with every complaint about the file in one line."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.storage.mesh_collada import read_collada
from gcs.storage.mesh_text import has_single_precision, obj_with_absolute_indices, ply_in_double

if TYPE_CHECKING:
    from numpy.typing import NDArray

FORMATS = {".stl": "STL", ".obj": "OBJ", ".ply": "PLY", ".glb": "GLB", ".gltf": "GLTF", ".off": "OFF", ".dae": "DAE"}

STL_HEAD_BYTES = 84
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True, eq=False)
class MeshContent:
    """What a mesh file holds, in its own units and axes.

    Attributes:
        vertices: shape (V, 3); may have values that are not finite.
        faces: indices of vertices, shape (F, 3), F > 0.
        file_format: such as `STL`.
        sha256: of the file's bytes.
        units: the unit that is written in the file, if one is; it is not used.
        step: distance between neighbouring numbers that the file can hold at its largest coordinate, when it holds
            single precision; else 0.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    file_format: str
    sha256: str
    units: str | None
    step: float

    @property
    def finite_faces(self) -> NDArray[np.bool_]:
        """Faces whose corners are all finite, shape (F,)."""
        finite = np.asarray(np.isfinite(self.vertices).all(axis=1))
        if finite.all():
            return np.ones(len(self.faces), dtype=np.bool_)
        return np.asarray(finite[self.faces].all(axis=1))


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
    parsed = _parse(data, path, file_format)
    if not len(parsed.faces):
        raise InputError("there are no triangles in it: it is not a surface mesh", field=name)
    if parsed.faces.min() < 0 or parsed.faces.max() >= len(parsed.vertices):
        raise InputError("a triangle names a vertex that is not there: the file is damaged", field=name)
    return parsed


@dataclass
class _Part:
    """A mesh of a file where its scene places it; `step` as in `MeshContent`."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    step: float = 0.0


def _parse(data: bytes, path: Path, file_format: str) -> MeshContent:
    units = None
    try:
        if file_format == "DAE":
            placed, units = read_collada(data)
            parts = [_Part(v, f) for v, f in placed]
        else:
            binary = _binary_stl(data) if file_format == "STL" else None
            parts = _read_scene(data, path, file_format) if binary is None else [binary]
    except Exception as error:  # the readers raise whatever a damaged file leads them to
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        if isinstance(error, ImportError):  # it took a damaged file for one in some other encoding
            reason = "it is neither binary nor text as this format asks"
        raise InputError(f"is not a mesh in {file_format} format, or is damaged ({reason})", field=str(path)) from error
    vertices, faces = _joined(parts)
    step = max((p.step for p in parts), default=0.0)
    return MeshContent(vertices, faces, file_format, hashlib.sha256(data).hexdigest(), units, step)


def _binary_stl(data: bytes) -> _Part | None:
    """A binary STL, or None when it is not one."""
    count = int.from_bytes(data[STL_HEAD_BYTES - 4 : STL_HEAD_BYTES], "little")
    if len(data) < STL_HEAD_BYTES or len(data) != STL_HEAD_BYTES + count * STL_TRIANGLE.itemsize:
        return None
    corners = np.frombuffer(data, dtype=STL_TRIANGLE, offset=STL_HEAD_BYTES)["corners"].reshape(-1, 3)
    vertices = corners.astype(np.float64)
    return _Part(vertices, np.arange(3 * count).reshape(-1, 3), _single_step(vertices))


def _read_scene(data: bytes, path: Path, file_format: str) -> list[_Part]:
    import trimesh
    from trimesh.resolvers import FilePathResolver

    options = {"skip_materials": True} if file_format == "OBJ" else {}
    is_single = file_format in {"GLB", "GLTF"} or (file_format == "PLY" and has_single_precision(data))
    ready = {"PLY": ply_in_double, "OBJ": obj_with_absolute_indices}.get(file_format, bytes)(data)
    scene = trimesh.load_scene(
        io.BytesIO(ready),
        file_type=file_format.lower(),
        resolver=FilePathResolver(str(path)),
        process=False,
        **options,
    )
    parts = []
    for node in scene.graph.nodes_geometry:
        transform, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if isinstance(mesh, trimesh.Trimesh):
            own = np.asarray(mesh.vertices, dtype=np.float64)
            placed = own @ transform[:3, :3].T + transform[:3, 3]
            faces = np.asarray(mesh.faces, dtype=np.int64)
            stretch = float(np.linalg.norm(transform[:3, :3], ord=2))
            parts.append(_Part(placed, faces, _single_step(own) * stretch if is_single else 0.0))
    return parts


def _single_step(vertices: NDArray[np.float64]) -> float:
    """Distance between neighbouring single precision numbers at the largest finite coordinate."""
    low, high = float(vertices.min(initial=0.0)), float(vertices.max(initial=0.0))
    if not np.isfinite(high - low):
        finite = vertices[np.isfinite(vertices)]
        low, high = float(finite.min(initial=0.0)), float(finite.max(initial=0.0))
    return float(np.spacing(np.float32(max(-low, high))))


def _joined(parts: list[_Part]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    if not parts:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    if len(parts) == 1:
        return parts[0].vertices, parts[0].faces
    offsets = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    faces = [p.faces + offset for p, offset in zip(parts, offsets, strict=True)]
    return np.concatenate([p.vertices for p in parts]), np.concatenate(faces)
