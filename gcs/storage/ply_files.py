"""Triangles as binary little-endian PLY: the one form that this project writes, and reads back."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

_HEADER = (
    "ply\nformat binary_little_endian 1.0\ncomment scene ENU, metres\n"
    "element vertex {vertices}\nproperty {kind} x\nproperty {kind} y\nproperty {kind} z\n"
    "element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
)
_PATTERN = re.compile(
    re.escape(_HEADER).replace(r"\{vertices\}", r"(\d+)").replace(r"\{faces\}", r"(\d+)").replace(r"\{kind\}", "double")
)
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def ply_bytes(vertices_m: NDArray[np.float64], faces: NDArray[np.int64], *, single: bool = False) -> bytes:
    """The content of a PLY file.

    Args:
        vertices_m: shape (V, 3).
        faces: shape (F, 3), indices of vertices.
        single: float32 vertices, for drawing; float64 otherwise.
    """
    kind = "float" if single else "double"
    header = _HEADER.format(vertices=len(vertices_m), faces=len(faces), kind=kind)
    body = np.empty(len(faces), dtype=_FACE)
    body["count"] = 3
    body["corners"] = faces
    return header.encode() + np.asarray(vertices_m, dtype="<f4" if single else "<f8").tobytes() + body.tobytes()


def read_ply(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) and faces (F, 3) of a file that `ply_bytes` made with float64 vertices.

    Raises:
        InputError: it is missing, or not such a file.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}): plan again", field=str(path)) from None
    end = data.find(b"end_header\n") + len(b"end_header\n")
    found = _PATTERN.fullmatch(data[:end].decode("ascii", "replace"))
    if found is None:
        raise InputError("this is not a structure file that gcs wrote", field=str(path))
    vertices, faces = int(found[1]), int(found[2])
    if len(data) != end + vertices * 24 + faces * _FACE.itemsize:
        raise InputError("this file is not whole: plan again", field=str(path))
    points = np.frombuffer(data, dtype="<f8", count=vertices * 3, offset=end).reshape(-1, 3)
    corners = np.frombuffer(data, dtype=_FACE, count=faces, offset=end + vertices * 24)["corners"]
    if not np.isfinite(points).all():
        raise InputError("it has corners that are not finite (NaN): plan again", field=str(path))
    if len(corners) and not (corners.min() >= 0 and corners.max() < vertices):
        raise InputError("a triangle names a vertex that is not there", field=str(path))
    return points.astype(np.float64), corners.astype(np.int64)
