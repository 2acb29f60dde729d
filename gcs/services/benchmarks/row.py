"""One figure of a benchmark, and how figures are taken."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes:
        case: what it was measured on.
        figure: what was measured.
        value: the figure.
        unit: its unit; `1` for ratios and counts.
        reference: what it stands beside, when there is something.
        reference_value: that one's figure in the same unit; None when it is not installed or does not exist.
    """

    case: str
    figure: str
    value: float
    unit: str
    reference: str | None = None
    reference_value: float | None = None


def milliseconds(action: Callable[[], object]) -> float:
    """Wall-clock time (ms) that an action takes."""
    begin = time.perf_counter()
    action()
    return 1e3 * (time.perf_counter() - begin)
