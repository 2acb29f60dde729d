"""The token that opens the API: made once for each data directory, readable by its owner alone."""

from __future__ import annotations

import hmac
import os
import secrets
from pathlib import Path

from gcs.core.errors import StorageError

COOKIE = "gcs_session"


def session_token(data_dir: Path) -> str:
    """The token in `DIR/token`; made with mode 0600 when there is none.

    It stays the same over restarts, so that an open dashboard goes on.

    Raises:
        StorageError: the file cannot be written or read.
    """
    path = data_dir / "token"
    try:
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            path.chmod(0o600)
            token = path.read_text().strip()
            if len(token) >= 32:
                return token
            descriptor = os.open(path, os.O_WRONLY | os.O_TRUNC, 0o600)
        token = secrets.token_urlsafe(32)
        with os.fdopen(descriptor, "w") as file:
            file.write(token + "\n")
    except OSError as error:
        raise StorageError(f"the session token cannot be kept: {error.strerror}", field=str(path)) from error
    return token


def same_token(given: str | None, token: str) -> bool:
    """Compare in constant time."""
    return given is not None and hmac.compare_digest(given.encode(), token.encode())
