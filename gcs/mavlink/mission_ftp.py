"""Missions by MAVLink FTP, where the autopilot serves its lists as files: chosen where that takes fewer round trips.

What is written is read back and compared like every other upload; whatever goes wrong here is no verdict, as the
mission protocol is there to try again with.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from gcs.core.errors import RefusedError
from gcs.core.mission import MissionItem
from gcs.core.progress import Progress, SilentProgress
from gcs.core.vehicle import Autopilot
from gcs.mavlink.canonical_form import compare
from gcs.mavlink.ftp_protocol import CHUNK, OnBytes
from gcs.mavlink.ftp_store import WRITES
from gcs.mavlink.mission_file import HEADER_BYTES, ITEM_BYTES, decode_mission_file, encode_mission_file
from gcs.mavlink.mission_proof import UploadProof
from gcs.mavlink.mission_protocol import MissionType
from gcs.mavlink.transaction import Clock

FOLDER = "@MISSION"
NAMES = {MissionType.MISSION: "mission.dat", MissionType.FENCE: "fence.dat", MissionType.RALLY: "rally.dat"}
_READ_TRIPS = 5
"""Opening, one burst, looking for its end twice, closing."""
_ITEMS_AT_ONCE = 10
"""Items that are asked for at once by the mission protocol, where the vehicle allows (as those with files do)."""


class FilePeer(Protocol):
    """A vehicle whose autopilot serves files."""

    async def read_made_up(self, path: str) -> bytes:
        """Read a file that the vehicle makes up as it is read."""
        ...

    async def write_to_autopilot(self, path: str, data: bytes, on_bytes: OnBytes | None = None) -> None:
        """Write a file, which is used when it has been closed."""
        ...


def path_of(mission_type: MissionType) -> str:
    """The file of a list."""
    return f"{FOLDER}/{NAMES[mission_type]}"


def writing_is_faster(count: int) -> bool:
    """Whether a file of so many items is written and read back in fewer round trips than its items."""
    pieces = math.ceil((HEADER_BYTES + count * ITEM_BYTES) / CHUNK)
    return 2 + math.ceil(pieces / WRITES) + _READ_TRIPS < 1 + count + _item_read_trips(count)


def reading_is_faster(count: int) -> bool:
    """Whether a file of so many items is read in fewer round trips than its items."""
    return _item_read_trips(count) > _READ_TRIPS


def _item_read_trips(count: int) -> int:
    return 1 + math.ceil(count / _ITEMS_AT_ONCE)


async def read_as_file(vehicle: FilePeer, mission_type: MissionType) -> tuple[MissionItem, ...]:
    """Read one of a vehicle's lists as a file.

    Raises:
        GcsError: it has no such file, or it came damaged, or the link is gone.
    """
    return decode_mission_file(await vehicle.read_made_up(path_of(mission_type)), mission_type)


async def upload_as_file(
    items: Sequence[MissionItem],
    mission_type: MissionType,
    vehicle: FilePeer,
    target: tuple[int, int],
    autopilot: Autopilot,
    clock: Clock,
    progress: Progress | None = None,
) -> UploadProof:
    """Replace one of a vehicle's lists by a file and prove it by reading that back.

    Args:
        items: what the list is to hold, numbered 0 to n - 1.
        mission_type: which list.
        vehicle: serves the files.
        target: system and component of its autopilot.
        autopilot: its family, which decides the canonical form.
        clock: monotonic seconds.
        progress: stages `upload` and `read back`.

    Raises:
        RefusedError: the vehicle does not take it, or holds something else.
        NotFoundError: it has no such file.
        GcsError: what it holds is unknown.
    """
    told = progress if progress is not None else SilentProgress()
    data = encode_mission_file(items, mission_type, target)
    begin_s = clock()
    await vehicle.write_to_autopilot(path_of(mission_type), data, lambda done, all_: told.report("upload", done / all_))
    sent_s = clock()
    read = await read_as_file(vehicle, mission_type)
    told.report("read back", 1.0)
    comparison = compare(items, read, autopilot, mission_type)
    if not comparison.equal:
        raise RefusedError(f"the vehicle holds something else than the file that was written: {comparison.summary}")
    how = f"written as a file, read back {len(read)} of {len(items)} items, all equal in the vehicle's own form"
    return UploadProof(
        len(items), len(read), how, comparison.canonical_crc32, tuple(read), sent_s - begin_s, clock() - sent_s
    )
