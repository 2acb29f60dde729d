"""What one decision may spend on looking for another way: counted, so that its time is bounded whatever is about."""

from __future__ import annotations

from dataclasses import dataclass

MOST_WORK = 1_500_000
"""Some 10 ms, on a map of mere noise; what is met in fact takes a hundredth of it."""

MOST_CURVES = 60


@dataclass
class SearchBudget:
    """What is left of it: all searches of the decision take from the same.

    Attributes:
        work: of searches on maps, as `tangent_search` counts it.
        curves: along the ways that were found, that may be tried.
    """

    work: int = MOST_WORK
    curves: int = MOST_CURVES
