"""What planners with one tree share: it grows from the start, and the goal becomes one of its nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.planning.local.sampling_planner import SamplingOptions, SamplingPlanner
from gcs.planning.local.search_tree import NONE, rooted_tree, way_from_root

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.local.binary_map import BinaryMap


class SingleTreePlanner(SamplingPlanner):
    """See `SamplingPlanner`."""

    def __init__(
        self, area: BinaryMap, start_m: ArrayLike, goal_m: ArrayLike, options: SamplingOptions | None = None
    ) -> None:
        super().__init__(area, start_m, goal_m, options)
        self._tree = rooted_tree(self._start, self._options.iterations + 2)
        self._reached = NONE

    def _best_cells(self) -> NDArray[np.float64] | None:
        return None if self._reached == NONE else way_from_root(self._tree, self._reached)
