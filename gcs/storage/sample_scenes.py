"""The sample scenes by name: which there are, and how each is built from its data file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gcs.storage.sample_bridge_tower import bridge_tower
from gcs.storage.sample_container_yard import container_yard
from gcs.storage.sample_gantry_crane import gantry_crane

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from gcs.core.structure import Structure

SAMPLE_BUILDERS: dict[str, Callable[[Mapping[str, Any]], Structure]] = {
    "gantry-crane": gantry_crane,
    "container-yard": container_yard,
    "bridge-tower": bridge_tower,
}
"""From the content of `samples/NAME.yaml` to the structure."""
