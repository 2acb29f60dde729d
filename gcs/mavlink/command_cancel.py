"""COMMAND_CANCEL, which the bundled dialect lacks (common.xml, message 80)."""

from __future__ import annotations

import struct

from gcs.mavlink.dialect import mavlink

_WIRE = struct.Struct("<HBB")
_CRC_EXTRA = 14
"""Checksum of the names and types of its fields, as the protocol defines it."""


class CommandCancel(mavlink.MAVLink_message):  # type: ignore[misc]  # the packing library is untyped
    """Asks a component to stop a long-running command.

    Args:
        target_system: system id of the component.
        target_component: its component id.
        command: MAV_CMD.
    """

    id = 80
    crc_extra = _CRC_EXTRA

    def __init__(self, target_system: int, target_component: int, command: int) -> None:
        super().__init__(self.id, "COMMAND_CANCEL")
        self._fieldnames = ["target_system", "target_component", "command"]
        self.target_system = target_system
        self.target_component = target_component
        self.command = command

    def pack(self, mav: mavlink.MAVLink, force_mavlink1: bool = False) -> bytes:
        """The packet, as the packing library makes it for all messages."""
        wire = _WIRE.pack(self.command, self.target_system, self.target_component)
        return bytes(self._pack(mav, self.crc_extra, wire, force_mavlink1=force_mavlink1))
