"""Reports that a companion has not delivered yet, one JSON file each, over its restarts."""

from __future__ import annotations

import json
import logging
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gcs.core.errors import StorageError
from gcs.core.frames import GeoPoint
from gcs.core.replanning import ReplanReason, ReplanReport, SeenObstacle, ViewpointChange, ViewpointFate
from gcs.storage.atomic_files import remove_partials, write_file
from gcs.storage.errors import storage_error

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

log = logging.getLogger(__name__)

ASIDE = "aside"
MOST_ASIDE = 100


class ReportOutboxFiles:
    """A folder of reports, in the order of their names.

    Those that the station refused, and files that cannot be read, are kept in its folder `aside`, the last 100 of them.
    Writing is done in a thread of its own: flushing a memory card can take longer than a vehicle waits for its next
    setpoint. What the disk does not take is said in the log, and is not there after a restart.

    Args:
        directory: the folder; made if it is not there.

    Raises:
        StorageError: it cannot be made.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._paths: dict[tuple[int, int], Path] = {}
        self._last = 0
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="reports")
        try:
            (directory / ASIDE).mkdir(parents=True, exist_ok=True)
            remove_partials(directory)
        except OSError as error:
            raise storage_error(error, directory) from error

    def load(self) -> list[ReplanReport]:
        """What is kept, in the order in which it was added; a file that cannot be read is moved aside."""
        reports = []
        for path in sorted(self._directory.glob("*.json")):
            try:
                report = _report(json.loads(path.read_bytes()))
                self._last = int(path.name.partition("-")[0])
            except (OSError, ValueError, KeyError, TypeError) as error:
                log.warning("%s holds no report and is moved aside: %s", path, error)
                self._soon(self._move_aside, path)
                continue
            self._paths[report.boot_id, report.number] = path
            reports.append(report)
        return reports

    def keep(self, report: ReplanReport) -> None:
        """Add a report."""
        self._last += 1
        path = self._directory / f"{self._last:08d}-{report.boot_id:08x}-{report.number}.json"
        self._paths[report.boot_id, report.number] = path
        self._soon(lambda of: write_file(of, json.dumps(asdict(report), indent=1).encode()), path)

    def remove(self, report: ReplanReport) -> None:
        """A report was delivered."""
        path = self._paths.pop((report.boot_id, report.number), None)
        if path is not None:
            self._soon(lambda of: of.unlink(missing_ok=True), path)

    def set_aside(self, report: ReplanReport) -> None:
        """The station refused a report."""
        path = self._paths.pop((report.boot_id, report.number), None)
        if path is not None:
            self._soon(self._move_aside, path)

    def flush(self) -> None:
        """Wait until all of this is on the disk."""
        self._writer.submit(lambda: None).result()

    def _soon(self, action: Callable[[Path], object], path: Path) -> None:
        def act() -> None:
            try:
                action(path)
            except (OSError, StorageError) as error:
                log.warning("reports in %s are not safe from a restart: %s", self._directory, error)

        self._writer.submit(act)

    def _move_aside(self, path: Path) -> None:
        aside = self._directory / ASIDE
        path.replace(aside / path.name)
        for old in sorted(aside.iterdir())[:-MOST_ASIDE]:
            old.unlink(missing_ok=True)


def _report(document: dict[str, Any]) -> ReplanReport:
    obstacle = document["obstacle"]
    east, north = obstacle["velocity_m_s"] if obstacle else (0.0, 0.0)
    return ReplanReport(
        **{
            **document,
            "reason": ReplanReason(document["reason"]),
            "obstacle": SeenObstacle(GeoPoint(**obstacle["place"]), obstacle["radius_m"], (east, north))
            if obstacle
            else None,
            "path": tuple(GeoPoint(**place) for place in document["path"]),
            "viewpoints": tuple(
                ViewpointChange(
                    v["viewpoint"], ViewpointFate(v["fate"]), GeoPoint(**v["place"]) if v["place"] else None
                )
                for v in document["viewpoints"]
            ),
        }
    )
