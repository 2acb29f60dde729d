"""Signing keys of links, in one encrypted file of the data directory.

It is encrypted (Fernet: AES-128-CBC with HMAC-SHA-256) under a key that scrypt makes of the operator's passphrase,
which is never stored. Whoever has the file without the passphrase has nothing; whoever has both has all keys.

A key that was sent to a vehicle and is not proved to have been taken is kept as pending beside the link's present one.
"""

from __future__ import annotations

import base64
import json
import os
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import ConflictError, InputError, NotFoundError, StorageError
from gcs.storage.atomic_files import write_file
from gcs.storage.data_directory import make_data_directory

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography.fernet import Fernet

FILE = "signing_keys.json"
PASSPHRASE_VARIABLE = "GCS_KEY"
SHORTEST_PASSPHRASE = 8
_COST, _BLOCK, _PARALLEL = 2**15, 8, 1
_SALT_BYTES = 16
_PENDING = "pending "
"""Before the URL: no URL begins like it."""


@dataclass(frozen=True)
class StoredKey:
    """A link's key and policy.

    Attributes:
        key: 32 bytes.
        rejects_unsigned: whether packets without a signature are refused.
        rotated_at: when it took the place of an older key, UTC ISO 8601; None while it is the first.
    """

    key: bytes
    rejects_unsigned: bool
    rotated_at: str | None = None

    def __repr__(self) -> str:  # keys belong in no log
        return f"StoredKey(rejects_unsigned={self.rejects_unsigned})"


class SigningKeyStore:
    """Keys by link URL.

    Args:
        directory: the data directory.
        passphrase: of the file; None when there is none, which is an error only where a key is to be read or written.
    """

    def __init__(self, directory: Path, passphrase: str | None) -> None:
        self._path = directory / FILE
        self._passphrase = passphrase

    def get(self, url: str) -> StoredKey | None:
        """The key of a link; None when it is not signed.

        Raises:
            InputError: there is a file, but no passphrase or a wrong one.
            StorageError: the file cannot be read.
        """
        return self._read().get(url)

    def known(self, url: str) -> StoredKey:
        """The key of a link that must have one: its present one, else its pending one.

        Raises:
            NotFoundError: it is not signed.
            GcsError: as of `get`.
        """
        keys = self._read()
        stored = keys.get(url) or keys.get(_PENDING + url)
        if stored is None:
            raise NotFoundError("this link is not signed", field=url)
        return stored

    def proved(self, url: str) -> StoredKey:
        """The key of a link whose vehicle is known to hold it.

        Raises:
            NotFoundError: it is not signed.
            ConflictError: it has a pending key.
            GcsError: as of `get`.
        """
        stored = self.known(url)
        if self.pending(url) is not None:
            words = "nothing shows which key the vehicle holds, the present or the new one: set signing up again first"
            raise ConflictError(words, field=url)
        return stored

    def urls(self) -> tuple[str, ...]:
        """The links that are signed; errors as of `get`."""
        return tuple(dict.fromkeys(url.removeprefix(_PENDING) for url in self._read()))

    def pending(self, url: str) -> StoredKey | None:
        """The key that the vehicle on a link may have taken; errors as of `get`."""
        return self._read().get(_PENDING + url)

    def put(self, url: str, stored: StoredKey) -> None:
        """Keep a link's key, in place of its present and its pending one; errors as of `get`."""
        self._write({**self._others(url), url: stored})

    def put_pending(self, url: str, stored: StoredKey) -> None:
        """Keep a key beside the present one of a link; errors as of `get`."""
        self._write({**self._read(), _PENDING + url: stored})

    def delete(self, url: str) -> None:
        """Forget a link's keys; errors as of `get`."""
        self._write(self._others(url))

    def _others(self, url: str) -> dict[str, StoredKey]:
        return {other: stored for other, stored in self._read().items() if other.removeprefix(_PENDING) != url}

    def check_passphrase(self) -> None:
        """See that a key could be kept, before a vehicle is given one.

        Raises:
            InputError: there is no passphrase, it is too short, or not the file's.
        """
        passphrase = self._passphrase or ""
        if len(passphrase) < SHORTEST_PASSPHRASE:
            words = (
                f"set it to a passphrase of at least {SHORTEST_PASSPHRASE} letters; signing keys are encrypted with it"
            )
            raise InputError(words, field=PASSPHRASE_VARIABLE)
        self._read()

    def _read(self) -> dict[str, StoredKey]:
        from cryptography.fernet import InvalidToken

        try:
            stored = json.loads(self._path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            raise StorageError(f"the signing keys cannot be read: {error}", field=str(self._path)) from error
        if not self._passphrase:
            words = f"signing keys are stored: set {PASSPHRASE_VARIABLE} to their passphrase"
            raise InputError(words, field=PASSPHRASE_VARIABLE)
        try:
            salt, token = base64.b64decode(stored["salt"]), stored["keys"].encode()
            keys = json.loads(_cipher(self._passphrase, salt).decrypt(token))
        except InvalidToken:
            words = "this passphrase does not open the stored signing keys; give the one that they were made with"
            raise InputError(words, field=PASSPHRASE_VARIABLE) from None
        except (KeyError, ValueError, AttributeError, TypeError) as error:
            raise StorageError("this is no file of signing keys", field=str(self._path)) from error
        return {
            url: StoredKey(bytes.fromhex(each["key"]), bool(each["rejects_unsigned"]), each.get("rotated_at"))
            for url, each in keys.items()
        }

    def _write(self, keys: dict[str, StoredKey]) -> None:
        salt = os.urandom(_SALT_BYTES)
        plain = {url: {**asdict(each), "key": each.key.hex()} for url, each in keys.items()}
        token = _cipher(self._passphrase or "", salt).encrypt(json.dumps(plain).encode())
        text = json.dumps({"salt": base64.b64encode(salt).decode(), "keys": token.decode()})
        make_data_directory(self._path.parent)
        write_file(self._path, text.encode(), mode=0o600)


def _cipher(passphrase: str, salt: bytes) -> Fernet:
    from cryptography.fernet import Fernet as Cipher
    from cryptography.hazmat.primitives.kdf.scrypt import Scrypt

    key = Scrypt(salt=salt, length=32, n=_COST, r=_BLOCK, p=_PARALLEL).derive(passphrase.encode())
    return Cipher(base64.urlsafe_b64encode(key))
