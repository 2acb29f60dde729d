"""The MAVLink dialect this project speaks: the one place where the untyped pymavlink module is named."""

from __future__ import annotations

from typing import Any, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Message: TypeAlias = Any
"""A decoded `MAVLink_message`; its fields are untrusted input."""

__all__ = ["Message", "mavlink"]
