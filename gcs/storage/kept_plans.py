"""Plans on a companion's disk, each in a folder named by its hash."""

from __future__ import annotations

import hashlib
import re
import shutil
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError, InputError
from gcs.storage.atomic_files import open_folder, write_file
from gcs.storage.plan_files import plan_hash

if TYPE_CHECKING:
    from pathlib import Path

PLAN, STRUCTURE = "plan.json", "structure.ply"
SUM = "structure.sha256"
"""The plan's hash says nothing of its structure: this does, of what is on the disk."""

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
        try:
            structure, told = (folder / STRUCTURE).read_bytes(), (folder / SUM).read_text()
            whole = plan_hash(folder) == wanted and hashlib.sha256(structure).hexdigest() == told
        except (OSError, ValueError, GcsError):
            return None
        return folder if whole else None

    def keep(self, wanted: str, plan: bytes, structure: bytes) -> Path:
        """Keep a plan's two files; returns its folder.

        Raises:
            InputError: the plan is not the one of this hash.
            StorageError: the disk does not take them.
        """
        if hashlib.sha256(plan).hexdigest() != wanted:
            raise InputError("what was got is not the plan of this hash", field=wanted[:12])
        folder = self._folder(wanted)
        open_folder(folder)
        write_file(folder / STRUCTURE, structure)
        write_file(folder / SUM, hashlib.sha256(structure).hexdigest().encode())
        write_file(folder / PLAN, plan)
        return folder

    def forget(self, wanted: str) -> None:
        """Keep a plan no longer; errors as of `find`."""
        shutil.rmtree(self._folder(wanted), ignore_errors=True)

    def _folder(self, wanted: str) -> Path:
        if not _HASH.fullmatch(wanted):
            raise InputError("a plan hash has 64 hex digits", field="plan hash")
        return self._directory / wanted
