"""The sample container yard: stacks between the rails of rail-mounted gantry cranes, and lighting masts.

The cranes themselves are left out, as in the container-yard paper.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.storage.solid_shapes import box, profile_along, structure_of_solids, tube

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from gcs.core.structure import Structure

Solid = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def rail_axes_m(dimensions: Mapping[str, Any]) -> NDArray[np.float64]:
    """Where the rails run: y of their middles, ascending, shape (2 blocks,)."""
    b = dimensions["blocks"]
    return np.sort(np.concatenate([_block_middles(dimensions) + s * b["gauge"] / 2 for s in (-1, 1)]))


def rail_top_m(dimensions: Mapping[str, Any]) -> float:
    """Height of the running surface above the ground (m)."""
    t = dimensions["track"]
    height: float = t["beam"]["height"] + t["plate"]["thickness"] - 2 * t["embedding"]
    return height + float(dimensions["rail"]["profile"][-1][1])


def _block_middles(d: Mapping[str, Any]) -> NDArray[np.float64]:
    b = d["blocks"]
    number = np.arange(b["count"]) - (b["count"] - 1) / 2
    middles: NDArray[np.float64] = number * (b["gauge"] + b["lane"])
    return middles


def _track(d: Mapping[str, Any], y: float) -> Iterator[Solid]:
    t, rail = d["track"], d["rail"]["profile"]
    length, beam, plate, stop = t["length"], t["beam"], t["plate"], t["end_stop"]
    pieces = int(np.ceil(length / t["piece"]))
    yield profile_along(
        [[beam["half_width"], 0.0], [beam["half_width"], beam["height"]]], [0.0, y, 0.0], [length, y, 0.0], pieces
    )
    foot = rail_top_m(d) - rail[-1][1]
    yield profile_along(rail, [0.0, y, foot], [length, y, foot], pieces)
    low = beam["height"] - t["embedding"]
    for x in np.arange(plate["spacing"] / 2, length, plate["spacing"]):
        half_x, half_y = plate["width"] / 2, plate["length"] / 2
        yield box([x - half_x, y - half_y, low], [x + half_x, y + half_y, low + plate["thickness"]])
    for start in (stop["from_end"], length - stop["from_end"] - stop["length"]):
        half_width = stop["width"] / 2
        yield box([start, y - half_width, low], [start + stop["length"], y + half_width, stop["height"]])


def _stacks(d: Mapping[str, Any], y_middle: float, rng: np.random.Generator) -> Iterator[Solid]:
    """One solid for each stack: containers stand on each other without a gap."""
    c = d["containers"]
    row_pitch, bay_pitch = c["width"] + c["row_gap"], c["length_40"] + c["bay_gap"]
    for start, end in c["sections"]:
        for bay in range(int((end - start + c["bay_gap"]) / bay_pitch + 1e-9)):
            x = start + bay * bay_pitch
            for row in range(c["rows"]):
                y = y_middle + (row - (c["rows"] - 1) / 2) * row_pitch - c["width"] / 2
                stacks = [(x, c["length_40"])]
                if rng.random() < c["share_20"]:
                    stacks = [(x, c["length_20"]), (x + c["length_40"] - c["length_20"], c["length_20"])]
                for low_x, length in stacks:
                    tiers = int(rng.choice(len(c["tier_shares"]), p=c["tier_shares"]))
                    if tiers:
                        yield box([low_x, y, 0.0], [low_x + length, y + c["width"], tiers * c["height"]])


def _masts(d: Mapping[str, Any]) -> Iterator[Solid]:
    m = d["masts"]
    base, head = m["base"], m["head"]
    for lane in (_block_middles(d)[:-1] + _block_middles(d)[1:]) / 2:
        for x in m["x"]:
            half = base["width"] / 2
            yield box([x - half, lane - half, 0.0], [x + half, lane + half, base["height"]])
            yield tube(
                [x, lane, base["height"] / 2], [x, lane, m["height"]], m["base_radius"], end_radius=m["top_radius"]
            )
            half = head["width"] / 2
            top = m["height"] + head["height"] / 2
            yield box([x - half, lane - half, top - head["height"]], [x + half, lane + half, top])


def container_yard(dimensions: Mapping[str, Any]) -> Structure:
    """Build the sample container yard.

    Args:
        dimensions: the numbers of the sample's data file (m).

    Returns:
        About 35,000 triangles, all of them of closed solids.
    """
    d = dimensions
    rng = np.random.default_rng(d["containers"]["seed"])
    solids = [solid for y in rail_axes_m(d) for solid in _track(d, float(y))]
    solids += [solid for y in _block_middles(d) for solid in _stacks(d, float(y), rng)]
    solids += list(_masts(d))
    notes = ("sample container yard: own layout with standard rails and containers; the cranes are left out",)
    return structure_of_solids(solids, notes=notes)
