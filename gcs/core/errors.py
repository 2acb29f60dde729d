"""The one error tree of the project.

    GcsError
    ├── InputError            bad input: names the field or file and what to do           exit 2
    │   └── NotFoundError     something asked for by name does not exist                  exit 2
    ├── InfeasibleError       no feasible plan: the reason and what would help            exit 3
    ├── LinkError             nobody answers, or the link is gone                         exit 4
    ├── RefusedError          refused by the station's checks or by the vehicle           exit 5
    │   └── ConflictError     not now: something else owns it or is still running         exit 5
    ├── IncompleteError       flown, but not all of it happened                           exit 6
    ├── StorageError          the disk or the database did not take it                    exit 1
    └── OperationCancelled    somebody asked for it to stop                               exit 130

A message is one sentence for the person who must act on it; `field` names what to mend.
"""

from __future__ import annotations


class GcsError(Exception):
    """Base of every error that a user of gcs may see.

    Args:
        message: what is wrong and what to do, in one line.
        field: the scenario field, file, parameter or vehicle that it is about, if one can be named.
    """

    exit_status = 1
    title = "Error"

    def __init__(self, message: str, *, field: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.field = field

    def __str__(self) -> str:
        return f"{self.field}: {self.message}" if self.field else self.message


class InputError(GcsError):
    """What the user gave cannot be used as it is."""

    exit_status = 2
    title = "Bad input"


class NotFoundError(InputError):
    """Something asked for by name does not exist."""

    title = "Not found"


class InfeasibleError(GcsError):
    """The input is well formed, but no plan can satisfy it."""

    exit_status = 3
    title = "No feasible plan"


class LinkError(GcsError):
    """The vehicle does not answer, or stopped answering."""

    exit_status = 4
    title = "No link"


class RefusedError(GcsError):
    """The station's own checks or the vehicle said no."""

    exit_status = 5
    title = "Refused"


class ConflictError(RefusedError):
    """It cannot be done now, because something else owns it or is still running."""

    title = "Conflict"


class IncompleteError(GcsError):
    """The flight took place, but not all of what it was for."""

    exit_status = 6
    title = "Incomplete"


class StorageError(GcsError):
    """The disk or the database did not take what was to be kept."""

    title = "Storage failed"


class OperationCancelled(GcsError):  # noqa: N818 - the word users know
    """A running operation was asked to stop and did."""

    exit_status = 130
    title = "Cancelled"
