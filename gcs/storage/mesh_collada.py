"""COLLADA (DAE) with the numbers as they are written.

pycollada keeps coordinates and transforms in single precision and takes NaN for 0; what it does not touch, the text in
the document, is read again here in double precision.
"""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

Placed = tuple["NDArray[np.float64]", "NDArray[np.int64]"]


def read_collada(data: bytes) -> tuple[list[Placed], str | None]:
    """Vertices (V, 3) and faces (F, 3) of every instance in the scene, placed, and the unit that is written.

    Raises:
        Exception: whatever a damaged file leads the reader to.
    """
    import collada

    document = collada.Collada(io.BytesIO(data), ignore=[collada.common.DaeError])
    if document.scene is None:
        return [], None
    parts = []
    for geometry, matrix in _instances(document.scene.nodes, np.eye(4)):
        for vertices, faces in _triangles(geometry):
            parts.append((vertices @ matrix[:3, :3].T + matrix[:3, 3], faces))
    unit = document.assetInfo.unitmeter
    return parts, None if unit is None else f"{unit:g} metres"


def _instances(nodes: list[Any], matrix: NDArray[np.float64]) -> Iterator[tuple[Any, NDArray[np.float64]]]:
    from collada.scene import GeometryNode, Node, NodeNode

    for node in nodes:
        if isinstance(node, GeometryNode):
            yield node.geometry, matrix
        elif isinstance(node, Node):
            own = node.node if isinstance(node, NodeNode) else node
            here = matrix
            for transform in own.transforms:
                here = here @ _matrix(transform)
            yield from _instances(own.children, here)


def _matrix(transform: Any) -> NDArray[np.float64]:
    """A transform of a node, shape (4, 4)."""
    from collada.scene import MatrixTransform, RotateTransform, ScaleTransform, TranslateTransform

    result = np.eye(4)
    if isinstance(transform, (MatrixTransform, RotateTransform, ScaleTransform, TranslateTransform)):
        values = _numbers(transform.xmlnode.text)
    if isinstance(transform, MatrixTransform):
        return values.reshape(4, 4)
    if isinstance(transform, TranslateTransform):
        result[:3, 3] = values
    elif isinstance(transform, ScaleTransform):
        result[:3, :3] = np.diag(values)
    elif isinstance(transform, RotateTransform):
        x, y, z = values[:3] / np.linalg.norm(values[:3])
        across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angle = math.radians(values[3])
        result[:3, :3] += math.sin(angle) * across + (1 - math.cos(angle)) * across @ across
    else:
        result = np.asarray(transform.matrix, dtype=np.float64)
    return result


def _triangles(geometry: Any) -> Iterator[Placed]:
    from collada.polylist import Polylist
    from collada.triangleset import TriangleSet

    for primitive in geometry.primitives:
        triangles = primitive.triangleset() if isinstance(primitive, Polylist) else primitive
        if not isinstance(triangles, TriangleSet) or triangles.vertex_index is None:
            continue
        source = triangles.sources["VERTEX"][0][4]
        text = next(child.text for child in source.xmlnode if child.tag.endswith("float_array"))
        width = len(source.components)
        vertices = _numbers(text).reshape(-1, width)[:, [source.components.index(axis) for axis in "XYZ"]]
        yield vertices, np.asarray(triangles.vertex_index, dtype=np.int64).reshape(-1, 3)


def _numbers(text: str) -> NDArray[np.float64]:
    return np.array(text.split(), dtype=np.float64)
