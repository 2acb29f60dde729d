"""Plans on a companion's disk, each in a folder named by its hash."""

from __future__ import annotations

import hashlib
import re
from typing import TYPE_CHECKING

from gcs.core.errors import InputError
from gcs.storage.atomic_files import write_file
from gcs.storage.plan_files import plan_hash

if TYPE_CHECKING:
    from pathlib import Path

PLAN, STRUCTURE = "plan.json", "structure.ply"
_HASH = re.compile(r"[0-9a-f]{64}")


class KeptPlans:
    """The folder in which a companion keeps plans, over restarts.

    Args:
        directory: made when there is none.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def find(self, wanted: str) -> Path | None:
        """The folder of a plan, whole and undamaged; None when it is not kept.

        Raises:
            InputError: not a hash.
        """
        folder = self._folder(wanted)
        if not (folder / STRUCTURE).is_file() or not (folder / PLAN).is_file():
            return None
        return folder if plan_hash(folder) == wanted else None

    def keep(self, wanted: str, plan: bytes, structure: bytes) -> Path:
        """Keep a plan's two files; returns its folder.

        Raises:
            InputError: the plan is not the one of this hash.
            StorageError: the disk does not take them.
        """
        if hashlib.sha256(plan).hexdigest() != wanted:
            raise InputError("what was got is not the plan of this hash", field=wanted[:12])
        folder = self._folder(wanted)
        folder.mkdir(parents=True, exist_ok=True)
        write_file(folder / STRUCTURE, structure)
        write_file(folder / PLAN, plan)
        return folder

    def _folder(self, wanted: str) -> Path:
        if not _HASH.fullmatch(wanted):
            raise InputError("a plan hash has 64 hex digits", field="plan hash")
        return self._directory / wanted
