"""Files that are whole or not there: written beside their place, flushed to the disk, then renamed."""

from __future__ import annotations

import os
import secrets
import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.core.errors import InputError
from gcs.storage.errors import storage_error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PARTIAL = ".partial-"
"""Begins the name of everything that is not whole yet."""


def write_file(path: Path, data: bytes, mode: int = 0o666) -> None:
    """Put a whole file at `path`, in place of one that may be there.

    Args:
        path: where.
        data: what is in it.
        mode: who may read it, less what the process leaves out (umask).

    Raises:
        StorageError: the disk did not take it; what was at `path` is as before.
    """
    partial = path.with_name(f"{PARTIAL}{secrets.token_hex(4)}-{path.name}")
    try:
        try:
            _write_through(partial, data, mode)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
        _flush_directory(path.parent)
    except OSError as error:
        raise storage_error(error, path) from error


@contextmanager
def new_directory(path: Path, is_ours: Callable[[Path], bool]) -> Iterator[Path]:
    """Fill a directory that appears at `path` whole, when the `with` block ends without an error.

    Args:
        path: where it is to be. A directory that is there already is replaced if it is empty or ours.
        is_ours: tells whether a directory holds nothing but what this program wrote.

    Yields:
        The folder to write into.

    Raises:
        InputError: something else is at `path`.
        StorageError: the disk did not take it; what was at `path` is as before.
    """
    path = path.absolute()
    check_replaceable(path, is_ours)
    partial = path.parent / f"{PARTIAL}{secrets.token_hex(4)}-{path.name}"
    try:
        try:
            partial.mkdir(parents=True)
            yield partial
            for file in partial.rglob("*"):
                _flush_directory(file)
            _flush_directory(partial)
            _put_in_place(partial, path)
            _flush_directory(path.parent)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise storage_error(error, path) from error


def open_folder(folder: Path) -> None:
    """Make a folder unless it is there, and remove what a killed process left half-written in it.

    Raises:
        StorageError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(error, folder) from error
    remove_partials(folder)


def remove_partials(directory: Path) -> None:
    """Remove what a killed process left half-written in a directory."""
    for left in directory.glob(f"{PARTIAL}*"):
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def check_replaceable(path: Path, is_ours: Callable[[Path], bool]) -> None:
    """Tell whether `new_directory` would take this place.

    Raises:
        InputError: something else is there, or nothing can be written there.
    """
    above = next(folder for folder in path.parents if folder.exists())
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise InputError("nothing can be written there: give another place for the output", field=str(above))
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise InputError("this is not a folder: give another name for the output", field=str(path))
    if path.is_dir() and any(path.iterdir()) and not is_ours(path):
        raise InputError("this folder has other files in it: give an empty or a new one", field=str(path))


def _put_in_place(partial: Path, path: Path) -> None:
    if path.is_dir():
        old = path.parent / f"{PARTIAL}{secrets.token_hex(4)}-old-{path.name}"
        path.rename(old)
        try:
            partial.rename(path)
        except OSError:
            old.rename(path)
            raise
        shutil.rmtree(old, ignore_errors=True)
    else:
        partial.rename(path)


def _write_through(path: Path, data: bytes, mode: int) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode), "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _flush_directory(path: Path) -> None:
    """Flush a file or the entries of a directory to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
