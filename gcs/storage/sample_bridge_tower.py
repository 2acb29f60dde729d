"""The sample bridge tower: an H-shaped tower of two columns, its stays as cables, and the deck that they carry."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.structure_source import Cable
from gcs.storage.solid_shapes import box, profile_along, structure_of_solids

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from gcs.core.structure import Structure

Solid = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def _tower(d: Mapping[str, Any]) -> Iterator[Solid]:
    t, c = d["tower"], d["crossbeams"]
    half_x, half_y, middle = t["column_x"] / 2, t["column_y"] / 2, t["column_middle"]
    for side in (-1, 1):
        yield box([side * middle - half_x, -half_y, 0.0], [side * middle + half_x, half_y, t["height"]])
    reach = middle - half_x + c["into_column"]
    for level in c["levels"]:
        yield box([-reach, -c["width"] / 2, level["from"]], [reach, c["width"] / 2, level["to"]])


def _deck(d: Mapping[str, Any]) -> Iterator[Solid]:
    k, overlap = d["deck"], d["deck"]["embedding"]
    girder = np.array(k["girder"]) * [k["width"] / 2, 1.0]
    pieces = int(np.ceil(2 * k["half_length"] / k["piece"]))
    yield profile_along(girder, [0.0, -k["half_length"], k["soffit"]], [0.0, k["half_length"], k["soffit"]], pieces)
    top = _deck_top_m(d)
    p, b, pier = k["parapet"], k["bearing"], k["pier"]
    beam_top = d["crossbeams"]["levels"][0]["to"]
    for side in (-1, 1):
        low, high = side * p["middle"] - p["thickness"] / 2, side * p["middle"] + p["thickness"] / 2
        length = k["half_length"] - overlap
        yield box([low, -length, top - overlap], [high, length, top + p["height"]])
        low, high = side * b["middle"] - b["width"] / 2, side * b["middle"] + b["width"] / 2
        yield box([low, -b["width"] / 2, beam_top - overlap], [high, b["width"] / 2, k["soffit"] + overlap])
        low, high = side * pier["middle"] - pier["length"] / 2, side * pier["middle"] + pier["length"] / 2
        yield box([-pier["width"] / 2, low, 0.0], [pier["width"] / 2, high, k["soffit"] + overlap])


def _deck_top_m(d: Mapping[str, Any]) -> float:
    top: float = d["deck"]["soffit"] + d["deck"]["girder"][-1][1]
    return top


def _stays(d: Mapping[str, Any]) -> Iterator[Cable]:
    s, t = d["stays"], d["tower"]
    anchor_y = t["column_y"] / 2 - s["into_column"]
    deck_z = _deck_top_m(d) - d["deck"]["embedding"]
    for column in (-1, 1):
        for side in (-1, 1):
            for k in range(s["number"]):
                tower = (column * t["column_middle"], side * anchor_y, s["tower_lowest"] + k * s["tower_spacing"])
                deck = (column * s["deck_middle"], side * (s["deck_first"] + k * s["deck_spacing"]), deck_z)
                yield Cable(from_m=tower, to_m=deck, radius_m=s["radius"])


def bridge_tower(dimensions: Mapping[str, Any]) -> Structure:
    """Build the sample bridge tower.

    Args:
        dimensions: the numbers of the sample's data file (m).

    Returns:
        Some 600 triangles of closed solids, and the stays as cables.
    """
    solids = [*_tower(dimensions), *_deck(dimensions)]
    notes = ("sample bridge tower: height, column and deck width are the paper's, all else is our own",)
    return structure_of_solids(solids, tuple(_stays(dimensions)), notes=notes)
