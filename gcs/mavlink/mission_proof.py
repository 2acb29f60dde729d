"""Upload with proof: send, read back, compare in the vehicle's canonical form, send again where it differs.

"Uploaded" means that every item was read back from the vehicle and is, to the vehicle, the item that was sent, or that
the vehicle, asked for its list afterwards, names it by the id of the items that were sent (`plan_id`). An
acknowledgement alone proves nothing: it can be lost although all is well, or come although items are missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

from gcs.core.errors import LinkError, RefusedError
from gcs.core.mission import Mission, MissionItem
from gcs.core.progress import Progress, SilentProgress
from gcs.core.vehicle import Autopilot
from gcs.mavlink.canonical_form import MissionComparison, compare
from gcs.mavlink.mission_download import MissionDownload
from gcs.mavlink.mission_protocol import MissionType, OnItems, TransferTiming, UnknownStateError
from gcs.mavlink.mission_upload import UNKNOWN, MissionUpload
from gcs.mavlink.round_trip import RoundTrip
from gcs.mavlink.transaction import Clock, Send, Transaction

R = TypeVar("R")
_ATTEMPTS = 3
_ALL_EQUAL = "all equal in the vehicle's own form"
_NAMED = "the vehicle tells the id of the very list that was sent, a CRC-32 of all its items, and their number"


class RunTransaction(Protocol):
    """Drives a transaction to its end, such as `transaction.run` bound to a vehicle's messages."""

    async def __call__(self, transaction: Transaction[R], /) -> R:
        """The transaction's result; raises its error."""
        ...


@dataclass(frozen=True)
class MissionPeer:
    """Everything a mission transfer needs to know of a vehicle.

    Attributes:
        target_system: its system id.
        target_component: the component that holds the mission.
        autopilot: its family, which decides the canonical form.
        send: puts a message on its link.
        clock: monotonic seconds.
        run: drives transactions.
        own_system: the station's system id, to ignore answers meant for another station.
        timing: timers of the transfers.
        round_trip: what they have measured so far.
    """

    target_system: int
    target_component: int
    autopilot: Autopilot
    send: Send
    clock: Clock
    run: RunTransaction
    own_system: int | None = None
    timing: TransferTiming = field(default_factory=TransferTiming)
    round_trip: RoundTrip = field(default_factory=TransferTiming().round_trip)


@dataclass(frozen=True)
class UploadProof:
    """Evidence that a vehicle holds a mission.

    Attributes:
        items_sent: number of items.
        items_read: number of items that were found equal: read back, or all of them named by the list's id.
        how: the way it was proved, in plain words.
        canonical_crc32: fingerprint of the mission in the vehicle's canonical form.
        items: as they were read back; as they were sent where the vehicle named their list.
        transfer_s: how long sending took, all attempts together.
        proof_s: how long finding out took.
    """

    items_sent: int
    items_read: int
    how: str
    canonical_crc32: int
    items: tuple[MissionItem, ...]
    transfer_s: float = 0.0
    proof_s: float = 0.0


async def upload_and_prove(
    mission: Mission,
    peer: MissionPeer,
    progress: Progress | None = None,
) -> UploadProof:
    """Put a mission on a vehicle and prove that it is there.

    Args:
        mission: what the vehicle is to hold. For ArduPilot item 0 is a placeholder for its home.
        peer: the vehicle.
        progress: stages `upload` and `read back`; raising `OperationCancelled` from it stops the transfer.

    Raises:
        RefusedError: the vehicle refused it, or holds something else after every attempt.
        LinkError: the link is gone; what the vehicle holds is unknown (`UnknownStateError` once all was sent).
        OperationCancelled: cancelled; what the vehicle holds is unknown.
    """
    _check_home_placeholder(mission.items, peer.autopilot)
    return await upload_list_and_prove(mission.items, MissionType.MISSION, peer, progress)


async def upload_list_and_prove(
    items: Sequence[MissionItem], mission_type: MissionType, peer: MissionPeer, progress: Progress | None = None
) -> UploadProof:
    """Replace one of a vehicle's lists (mission, fence, rally points) and prove that it is there.

    Args:
        items: what the list is to hold, numbered 0 to n - 1; not empty: a list is emptied by `MissionClear`.
        mission_type: which list.
        peer: the vehicle.
        progress: stages `upload` and `read back`; raising `OperationCancelled` from it stops the transfer.

    Raises:
        ListUnsupportedError: the vehicle has no such list.
        RefusedError: the vehicle refused it, or holds something else after every attempt.
        LinkError: the link is gone; what the vehicle holds is unknown (`UnknownStateError` once all was sent).
        OperationCancelled: cancelled; what the vehicle holds is unknown.
    """
    progress = progress if progress is not None else SilentProgress()
    differs = ""
    part: range | None = None
    transfer_s = proof_s = 0.0
    for attempt in range(1, _ATTEMPTS + 1):
        begun_s = peer.clock()
        try:
            outcome = await peer.run(_sending(peer, progress, mission_type, items, part))
        except RefusedError:
            if part is None:
                raise
            part = None  # it does not replace single items: once more as a whole
            continue
        sent_s = peer.clock()
        reading = _reading(peer, progress, mission_type, items)
        try:
            read = await peer.run(reading)
        except (LinkError, RefusedError) as error:
            raise UnknownStateError(
                f"the {mission_type.noun} was sent, but could not be read back ({error}); {UNKNOWN}"
            ) from error
        transfer_s, proof_s = transfer_s + sent_s - begun_s, proof_s + peer.clock() - sent_s
        comparison = compare(items, read, peer.autopilot, mission_type)
        if comparison.equal:
            how = _NAMED if reading.recognised else f"read back {len(read)} of {len(items)} items, {_ALL_EQUAL}"
            how += "" if outcome.acknowledged else f"; {outcome.note}"
            how += "" if attempt == 1 else f"; {attempt} attempts"
            return UploadProof(len(items), len(read), how, comparison.canonical_crc32, tuple(read), transfer_s, proof_s)
        if outcome.refusal is not None:
            raise outcome.refusal
        whole_before = part is None and peer.autopilot is Autopilot.ARDUPILOT and mission_type is MissionType.MISSION
        part = comparison.replaceable if whole_before else None
        differs = comparison.summary + (f" ({outcome.note})" if outcome.note else "")
    raise RefusedError(f"the vehicle holds something else than was sent, after {_ATTEMPTS} attempts: {differs}")


async def download(
    peer: MissionPeer, progress: Progress | None = None, mission_type: MissionType = MissionType.MISSION
) -> tuple[MissionItem, ...]:
    """Read what a vehicle holds in one of its lists; stage `read back` of the progress."""
    return await peer.run(_reading(peer, progress, mission_type))


def _sending(
    peer: MissionPeer,
    progress: Progress,
    mission_type: MissionType,
    items: Sequence[MissionItem],
    part: range | None,
) -> MissionUpload:
    return MissionUpload(
        items,
        peer.target_system,
        peer.target_component,
        peer.send,
        peer.clock,
        mission_type,
        own_system=peer.own_system,
        on_progress=_stage(progress, "upload"),
        timing=peer.timing,
        round_trip=peer.round_trip,
        part=part,
    )


def _reading(
    peer: MissionPeer,
    progress: Progress | None,
    mission_type: MissionType,
    known: Sequence[MissionItem] | None = None,
) -> MissionDownload:
    return MissionDownload(
        peer.target_system,
        peer.target_component,
        peer.send,
        peer.clock,
        mission_type,
        autopilot=peer.autopilot,
        known=known,
        own_system=peer.own_system,
        on_progress=_stage(progress, "read back") if progress is not None else None,
        timing=peer.timing,
        round_trip=peer.round_trip,
    )


async def compare_with_vehicle(
    mission: Mission, peer: MissionPeer, progress: Progress | None = None
) -> MissionComparison:
    """Read what a vehicle holds and compare it with a mission, in the vehicle's canonical form."""
    return compare(mission.items, await download(peer, progress), peer.autopilot)


def _stage(progress: Progress, stage: str) -> OnItems:
    def tell(done: int, total: int) -> None:
        progress.report(stage, done / max(total, 1))

    return tell


def _check_home_placeholder(items: Sequence[MissionItem], autopilot: Autopilot) -> None:
    if autopilot is not Autopilot.ARDUPILOT or not items:
        return
    if items[0].command != 16:
        raise RefusedError(
            "ArduPilot replaces item 0 by its home: begin the mission with a waypoint at home, else its first "
            f"item (command {items[0].command}) would be lost",
            field="mission",
        )
