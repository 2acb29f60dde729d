"""Failures of the disk and the database as one clear sentence."""

from __future__ import annotations

import errno
from contextlib import contextmanager
from typing import TYPE_CHECKING

from gcs.core.errors import StorageError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

DISK_FULL = "the disk is full: free some space and try again; nothing half-written was kept"


def storage_error(error: OSError, path: Path) -> StorageError:
    """What to tell the user of an error of the file system."""
    if error.errno in {errno.ENOSPC, errno.EDQUOT}:
        return StorageError(DISK_FULL, field=str(path))
    return StorageError(f"cannot be written: {error.strerror or error}", field=str(path))


@contextmanager
def database_errors(path: Path) -> Iterator[None]:
    """Turn errors of the database into `StorageError`."""
    from sqlalchemy.exc import OperationalError, SQLAlchemyError

    try:
        yield
    except OperationalError as error:
        if "full" in str(error.orig):
            raise StorageError(DISK_FULL, field=str(path)) from error
        raise StorageError(f"the database did not take it: {error.orig}", field=str(path)) from error
    except SQLAlchemyError as error:
        raise StorageError(f"the database did not take it: {error}", field=str(path)) from error
