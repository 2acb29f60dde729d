"""Rows of benchmark `paths`: legs that are cut by a stay of the sample bridge tower, by double arc and by search."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.structure_source import StructureSource
from gcs.planning.paths.double_arc import APEXES, DoubleArc, cable_distance, cut_by_cable, double_arc
from gcs.planning.paths.path_search import find_path
from gcs.planning.paths.string_pulling import path_length
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.free_space import FreeSpace
from gcs.services.benchmarks.row import Row, milliseconds
from gcs.storage.mesh_files import load_structure

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.structure import Structure
    from gcs.planning.paths.double_arc import Reading

CASE = "stays-bridge-tower"
CLEARANCE_M = 2.4
ROOM_M = 14.0
HOME_M = (-24.0, -40.0, 20.0)
LEGS, QUICK_LEGS = 60, 6


def stay_legs(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few legs on a coarse grid.
    """
    structure, _ = load_structure(StructureSource(sample="bridge-tower"), Path())
    low, high = structure.bounds_m + np.array([[-ROOM_M], [ROOM_M]])
    field = build_distance_field(structure, low, high, 1.5 if quick else 0.75)
    space = FreeSpace(field, CLEARANCE_M, None, HOME_M)
    legs = _cut_legs(space, structure, QUICK_LEGS if quick else LEGS)
    ends, radii = structure.cable_ends_m, structure.cable_radii_m
    find_path(space, legs[0][0], legs[0][1], prefer_open_sky=False)  # loads the compiled kernels
    searched = [find_path(space, a, b, prefer_open_sky=False) for a, b in legs]
    search_ms = [milliseconds(lambda a=a, b=b: find_path(space, a, b, prefer_open_sky=False)) for a, b in legs]  # type: ignore[misc]
    rows = [
        Row(CASE, "legs", float(len(legs)), "1"),
        Row(CASE, "search_median_ms", float(np.median(search_ms)), "ms"),
        Row(CASE, "search_least_cable_clearance", min(_clearance(p, structure) for p in searched), "m"),
    ]
    for reading in APEXES:
        arcs = [double_arc(a, b, ends, radii, CLEARANCE_M, readings=(reading,)) for a, b in legs]
        times = [_arc_ms(a, b, structure, reading) for a, b in legs]
        clear = [(arc, path) for arc, path in zip(arcs, searched, strict=True) if isinstance(arc, DoubleArc)]
        free = [(arc, path) for arc, path in clear if _is_free(arc, space)]
        name = f"double_arc_{reading}"
        rows += [
            Row(CASE, f"{name}_clears_stays", len(clear) / len(legs), "1"),
            Row(CASE, f"{name}_free", len(free) / len(legs), "1"),
            Row(CASE, f"{name}_median_ms", float(np.median(times)), "ms", "search", float(np.median(search_ms))),
        ]
        if free:
            longer = [path_length(arc.polyline_m) / path_length(path) for arc, path in free]
            least = min(arc.clearance_m for arc, _ in free)
            searched_least = min(_clearance(path, structure) for _, path in free)
            rows += [
                Row(CASE, f"{name}_length", float(np.mean(longer)), "1", "search", 1.0),
                Row(CASE, f"{name}_least_cable_clearance", least, "m", "search", searched_least),
            ]
    return rows


def _arc_ms(a: NDArray[np.float64], b: NDArray[np.float64], structure: Structure, reading: Reading) -> float:
    ends, radii = structure.cable_ends_m, structure.cable_radii_m
    return milliseconds(lambda: double_arc(a, b, ends, radii, CLEARANCE_M, readings=(reading,)))


def _is_free(arc: DoubleArc, space: FreeSpace) -> bool:
    chords = arc.polyline_m
    return bool(space.segments_free(chords[:-1], chords[1:], strict=True).all())


def _cut_legs(space: FreeSpace, structure: Structure, count: int) -> list[NDArray[np.float64]]:
    """Legs of one height across the stays, each (2, 3): the ends are free, the straight line is cut by a stay."""
    rng = np.random.default_rng(4)
    kept = CLEARANCE_M + structure.cable_radii_m
    legs: list[NDArray[np.float64]] = []
    while len(legs) < count:
        middle = rng.uniform((-16.0, -40.0, 24.0), (-11.0, -6.0, 80.0))
        half = rng.uniform(3.0, 10.0)
        leg = middle + np.array([[-half, 0.0, 0.0], [half, 0.0, 0.0]])
        if not space.is_reachable(leg).all():
            continue
        if cut_by_cable(leg[0], leg[1], structure.cable_ends_m, kept).any():
            legs.append(leg)
    return legs


def _clearance(path_m: NDArray[np.float64], structure: Structure) -> float:
    """Least distance of a polyline from the stays' hulls, sampled every 2 cm."""
    points = [
        a + np.linspace(0, 1, max(2, int(np.linalg.norm(b - a) / 0.02)))[:, None] * (b - a)
        for a, b in itertools.pairwise(path_m)
    ]
    return float(cable_distance(np.vstack(points), structure.cable_ends_m, structure.cable_radii_m).min())
