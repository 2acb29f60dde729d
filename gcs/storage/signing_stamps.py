"""How far the time stamps of signatures have come, over restarts: a small computer's clock may begin anew with each."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from gcs.storage.atomic_files import write_file

if TYPE_CHECKING:
    from pathlib import Path

log = logging.getLogger(__name__)


class SigningStamps:
    """A file with a time stamp that no signature has reached yet.

    It is written ahead, so that signing never waits for the disk.

    Args:
        path: of the file.
        ahead: so many ticks are claimed at a time.
    """

    def __init__(self, path: Path, ahead: int) -> None:
        self._path = path
        self._ahead = ahead
        self._claimed = 0

    def read(self) -> int:
        """What was claimed before; 0 when nothing was, or the file is damaged."""
        try:
            return max(int(self._path.read_text()), 0)
        except FileNotFoundError:
            return 0
        except (OSError, ValueError) as error:
            log.warning("%s holds no time stamp: old signed packets may be taken for new: %s", self._path, error)
            return 0

    def needs_claim(self, newest: int) -> bool:
        """Whether half of what is claimed is used up."""
        return newest + self._ahead // 2 >= self._claimed

    def claim(self, newest: int) -> None:
        """Claim the stamps behind the newest one that was used.

        Raises:
            StorageError: the disk does not take it.
        """
        self._claimed = newest + self._ahead
        write_file(self._path, str(self._claimed).encode())

    def give_back(self, newest: int) -> None:
        """Nothing behind this one is used any more; errors as of `claim`."""
        self._claimed = newest
        write_file(self._path, str(newest).encode())
