"""Time stamps and names that the station makes."""

from __future__ import annotations

import secrets
from datetime import UTC, datetime


def utc_now() -> str:
    """The present as UTC ISO 8601 with milliseconds, such as `2026-11-22T06:34:12.345Z`."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def new_id(kind: str) -> str:
    """A name that sorts by time and is not used twice, such as `plan-20261122-063412-3fa2c1`."""
    return f"{kind}-{datetime.now(UTC):%Y%m%d-%H%M%S}-{secrets.token_hex(3)}"
