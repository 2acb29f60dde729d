"""Listing a folder over MAVLink FTP."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.core.errors import OperationCancelled
from gcs.mavlink.ftp_protocol import (
    DirectoryEntry,
    FtpError,
    FtpPayload,
    Opcode,
    SequenceNumbers,
    parse_listing,
)
from gcs.mavlink.ftp_transaction import FtpTransaction
from gcs.mavlink.transaction import Clock, Send

_MOST_ENTRIES = 20_000


@dataclass(frozen=True)
class DirectoryListing:
    """What a folder of the vehicle holds.

    Attributes:
        entries: files and folders with plain names, in the vehicle's order, each name once.
        dropped: what was left out and why, in plain words.
    """

    entries: tuple[DirectoryEntry, ...]
    dropped: tuple[str, ...] = ()


class ListDirectory(FtpTransaction[DirectoryListing]):
    """Read the names in a folder.

    Args:
        path: the folder on the vehicle.
        target_system: system id of the vehicle.
        target_component: the component that serves files.
        send: puts a message on the link.
        clock: monotonic seconds.
        sequence: numbers shared by all exchanges with this component.
        own_system: system id of the station.

    Raises (from `result`):
        NotFoundError: there is no such folder.
        RefusedError: the vehicle does not list it.
        LinkError: no answer.
    """

    def __init__(
        self,
        path: str,
        target_system: int,
        target_component: int,
        send: Send,
        clock: Clock,
        *,
        sequence: SequenceNumbers | None = None,
        own_system: int | None = None,
    ) -> None:
        super().__init__(path, target_system, target_component, send, clock, sequence=sequence, own_system=own_system)
        self._offset = 0
        self._entries: dict[str, DirectoryEntry] = {}
        self._dropped: list[str] = []

    def start(self) -> None:
        """Ask for the first entries."""
        self._ask(Opcode.LIST_DIRECTORY, data=self._raw_path)

    def cancel(self) -> None:
        """End; nothing is open on the vehicle."""
        self._fail_with(OperationCancelled(f"listing {self._path} was cancelled"))

    def _answered(self, request: FtpPayload, answer: FtpPayload) -> None:
        del request
        error = answer.error
        if error is FtpError.END_OF_FILE:
            self._finish()
        elif error is not None:
            self._fail_with(self._refusal(error, "list", "folder"))
        else:
            count, entries, dropped = parse_listing(answer.data)
            for entry in entries:
                self._entries.setdefault(entry.name, entry)
            self._dropped += dropped
            self._offset += count
            if count == 0:
                self._finish()
            elif self._offset > _MOST_ENTRIES:
                self._dropped.append(f"everything after {_MOST_ENTRIES} entries")
                self._finish()
            else:
                self._ask(Opcode.LIST_DIRECTORY, offset=self._offset, data=self._raw_path)

    def _finish(self) -> None:
        self._succeed(DirectoryListing(tuple(self._entries.values()), tuple(self._dropped)))
