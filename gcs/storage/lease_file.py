"""How far a companion had come with its last lease, in one JSON file, over its restarts."""

from __future__ import annotations

import json
import logging
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import StorageError
from gcs.storage.atomic_files import write_file

if TYPE_CHECKING:
    from pathlib import Path

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class KeptLease:
    """A lease and the progress on its plan.

    Attributes:
        lease: its number.
        state: where it stood, a `LeaseState`.
        plan_hash: SHA-256 of plan.json, 64 hex digits.
        plan_s: how far the plan was flown, in its own time; None before the start.
        done: ids of the viewpoints that are photographed or given up, rising.
    """

    lease: int
    state: int
    plan_hash: str
    plan_s: float | None = None
    done: tuple[int, ...] = ()


class LeaseFile:
    """Keeps the last lease; it never raises nor waits for the disk, once it is made.

    Args:
        path: of the file, in a folder that is there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer = ThreadPoolExecutor(1, "lease")

    def load(self) -> KeptLease | None:
        """What was kept last; None when nothing was, or the file is damaged."""
        try:
            kept = json.loads(self._path.read_bytes())
            plan_s = kept["plan_s"]
            return KeptLease(
                int(kept["lease"]),
                int(kept["state"]),
                bytes.fromhex(kept["plan_hash"]).hex(),
                None if plan_s is None else float(plan_s),
                tuple(int(number) for number in kept["done"]),
            )
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            log.warning("%s holds no lease: a flight that was under way begins anew: %s", self._path, error)
            return None

    def keep(self, lease: KeptLease) -> None:
        """Keep this one instead."""
        self._writer.submit(self._write, json.dumps(asdict(lease)).encode())

    def flush(self) -> None:
        """Wait until it is on the disk."""
        self._writer.submit(lambda: None).result()

    def _write(self, data: bytes) -> None:
        try:
            write_file(self._path, data)
        except StorageError as error:
            log.warning("the progress of this flight is not safe from a restart: %s", error)
