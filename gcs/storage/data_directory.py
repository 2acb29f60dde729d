"""The station's data directory: where it is, and that one station at a time uses it."""

from __future__ import annotations

import fcntl
import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.core.errors import ConflictError, StorageError

if TYPE_CHECKING:
    from collections.abc import Iterator


def default_data_directory() -> Path:
    """`GCS_DATA` of the environment, else `~/.local/share/gcs`."""
    given = os.environ.get("GCS_DATA")
    return Path(given).expanduser() if given else Path.home() / ".local" / "share" / "gcs"


def make_data_directory(directory: Path) -> None:
    """Make the directory, readable by its owner alone.

    Raises:
        StorageError: it cannot be made.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise StorageError(f"the data directory cannot be made: {error.strerror}", field=str(directory)) from error


@contextmanager
def owned_data_directory(directory: Path) -> Iterator[None]:
    """Own the directory for the time of a `with` block; the system gives it free when the process dies.

    Raises:
        ConflictError: another station uses it.
        StorageError: it cannot be written.
    """
    make_data_directory(directory)
    try:
        lock = (directory / "station.lock").open("w")
    except OSError as error:
        raise StorageError(f"the data directory cannot be written: {error.strerror}", field=str(directory)) from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConflictError(
                "another station uses this data directory: end it, or give another one with --data",
                field=str(directory),
            ) from None
        yield
