"""Case `tower` of the benchmark `papers`: the bridge-tower paper's tour over one face, each in both metrics.

The paper does not state its grid, so 4 x 88 cells are an instance of ours. It sets an energy of its tour against a
length of the Z path; here every way has both, open, without the way back.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gcs.planning.tours.genetic_tour import GeneticOptions, genetic_tour
from gcs.planning.tours.tour_bound import counting_bound
from gcs.planning.tours.tour_costs import TourCosts
from gcs.planning.tours.tour_solver import solve_point_tour
from gcs.services.benchmarks.row import Row
from gcs.services.benchmarks.tours import (
    FACE_HEIGHT,
    FACE_WIDTH,
    METRIC,
    PAPER_COST,
    PAPER_SAVING,
    tower_face,
    z_path,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

PAPER = "bridge tower paper, grid not stated"
PAPER_Z_LENGTH_M = 680.0
QUICK_HEIGHT = 12


def tower_rows(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: a low face, which the paper's figures are not of, and few in the genetic algorithm's population.
    """
    face = tower_face(QUICK_HEIGHT if quick else FACE_HEIGHT)
    stretched = METRIC.stretched(face)
    energies, lengths = TourCosts.of_points(stretched), TourCosts.of_points(face)
    options = GeneticOptions(population=100) if quick else GeneticOptions()
    bound = counting_bound(stretched, closed=False) or math.nan
    z_order = z_path(FACE_WIDTH, len(face) // FACE_WIDTH)
    z_energy = energies.of_tour(z_order, closed=False)

    paper_energy, paper_z_m, paper_saving = (None,) * 3 if quick else (PAPER_COST, PAPER_Z_LENGTH_M, PAPER_SAVING)

    def both(name: str, order: NDArray[np.int64]) -> list[Row]:
        energy = energies.of_tour(order, closed=False)
        return [
            Row("tower", f"{name}.energy", energy, "1", PAPER, paper_energy),
            Row("tower", f"{name}.gap", energy / bound - 1, "1"),
            Row("tower", f"{name}.length_m", lengths.of_tour(order, closed=False), "m"),
            Row("tower", f"{name}.saving", 1 - energy / z_energy, "1", "paper, two metrics", paper_saving),
        ]

    return [
        Row("tower", "z_path.energy", z_energy, "1"),
        Row("tower", "z_path.length_m", lengths.of_tour(z_order, closed=False), "m", PAPER, paper_z_m),
        *both("genetic", genetic_tour(energies, closed=False, options=options).order),
        *both("ours", solve_point_tour(stretched, closed=False)),
    ]
