"""Which benchmarks there are, and running one of them."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.core.errors import InputError, NotFoundError

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.services.benchmarks.row import Row

BENCHMARKS = {
    "coverage": "viewpoints for a surface: coverage, views over their lower bound, seconds (--mesh FILE: of your own)",
    "local": "ways round obstacles: milliseconds, length; the yard paper's planners; flights: collisions",
    "mavlink": "transfers under faults, gateway, setpoint stream, images: false answers, seconds, losses, rates",
    "papers": "the papers' experiments: deviation, length, duration and tracking of every variant of the curve; tours",
    "paths": "grid search and string pulling: milliseconds, and length above a closed form",
    "predictions": "what autopilots make of missions and setpoints; --records FOLDER: beside recorded flights",
    "tours": "tours and their proven lower bounds: cost, gap, seconds",
    "trajectories": "minimum snap, flight times and a whole plan: milliseconds, cost, violation, ratios",
}
"""Name (also of the module beside this one that has `run(quick)`) and what it measures."""

WITH_MESH = {"coverage"}
"""Those whose `run(quick, mesh)` takes a mesh of the user's own."""

WITH_RECORDS = {"predictions"}
"""Those whose `run(quick, records)` takes a folder of recorded flights."""


def list_benchmarks() -> dict[str, str]:
    """Names of the benchmarks and what they measure."""
    return dict(BENCHMARKS)


def run_benchmark(
    name: str, quick: bool = False, mesh: Path | None = None, records: Path | None = None
) -> dict[str, Any]:
    """Run a benchmark.

    Args:
        name: which one.
        quick: run a small version, in seconds.
        mesh: a mesh of the user's own, for the benchmarks that take one.
        records: a folder of recorded flights, likewise.

    Returns:
        The object that `gcs bench NAME --json` prints: `benchmark`, `machine`, `rows`.

    Raises:
        NotFoundError: there is no benchmark of that name.
        InputError: the benchmark takes no mesh, or no records.
    """
    if name not in BENCHMARKS:
        raise NotFoundError(f"there is no benchmark {name!r}; there are {', '.join(BENCHMARKS)}", field="NAME")
    if mesh is not None and name not in WITH_MESH:
        raise InputError(f"the benchmark {name!r} takes no mesh: leave the option out", field="--mesh")
    if records is not None and name not in WITH_RECORDS:
        raise InputError(f"the benchmark {name!r} takes no records: leave the option out", field="--records")
    run: Callable[..., list[Row]] = import_module(f"gcs.services.benchmarks.{name}").run
    given = mesh or records
    rows = run(quick) if given is None else run(quick, given)
    machine = {"cpu": _processor(), "cores": os.cpu_count(), "python": platform.python_version()}
    return {"benchmark": name, "machine": machine, "rows": [asdict(row) for row in rows]}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
