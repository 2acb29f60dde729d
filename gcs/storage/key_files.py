"""One signing key in a file of its own, for a computer that shall have no other: 64 hex digits, its owner's alone."""

from __future__ import annotations

import stat
from typing import TYPE_CHECKING

from gcs.core.errors import InputError
from gcs.storage.atomic_files import write_file

if TYPE_CHECKING:
    from pathlib import Path

KEY_BYTES = 32


def read_key_file(path: Path) -> bytes:
    """The key (32 bytes) in a file.

    Raises:
        InputError: it cannot be read, others can read it, or it holds no key.
    """
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="ascii").strip()
    except OSError as error:
        raise InputError(f"the key cannot be read: {error.strerror}", field=str(path)) from None
    except UnicodeDecodeError:
        text = ""
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise InputError("others can read this key: take their rights to it away (chmod 600)", field=str(path))
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise InputError("this is no key: `gcs signing export` writes one (64 hex digits)", field=str(path))
    return key


def write_key_file(path: Path, key: bytes) -> None:
    """Write a key, for its owner alone.

    Raises:
        StorageError: the disk does not take it.
    """
    write_file(path, f"{key.hex()}\n".encode(), mode=0o600)
