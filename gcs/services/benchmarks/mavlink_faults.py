"""Case `faults`: every fault of a vehicle and its link against uploads and downloads, on fake time.

What the vehicle holds in the end is asked of the simulated vehicle, which shares no code with the station. An upload is
a false success when the vehicle did not hold the plan as its last words left it, and a false failure when it holds the
plan all the same, unless the station says that it does not know and the link is gone indeed. A download is a false
success when it is not what the vehicle holds, and a false failure when it ends in an error though the link is there.
"""

from __future__ import annotations

import random
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

from gcs.core.errors import GcsError, LinkError, OperationCancelled
from gcs.core.mission import Mission, MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_proof import MissionPeer, download, upload_and_prove
from gcs.services.benchmarks.lockstep_worlds import STATION, LockstepWorlds, Order, WorldLink
from gcs.services.benchmarks.mavlink_missions import random_mission, wire_items
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.mavlink.transaction import Transaction

CASE = "faults"
LOSSES = (0.0, 0.05, 0.2)
UPLOADS, DOWNLOADS = 100_000, 10_000
QUICK_SHARE = 300
PROCESSES = 2
ITEMS = 5
NO_FAULT = "none"
CANCELLED, KILLED = "cancelled", "killed"
"""Faults of the station's own: stopped at some step, cleanly or not, and tried again."""
FALSE_SUCCESS, FALSE_FAILURE = "false_success", "false_failure"


@dataclass(frozen=True)
class Cell:
    """One field of the matrix.

    Attributes:
        fault: its name.
        upload: whether missions go up, or come down.
        autopilot: px4 or ardupilot.
        loss: of packets, each way.
        runs: how many transfers.
        number: of the field, for its seeds.
    """

    fault: str
    upload: bool
    autopilot: Autopilot
    loss: float
    runs: int
    number: int


class _Killed(BaseException):
    """The station's process ends here."""


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: some hundred transfers instead of 110,000.
    """
    counts = Counter[tuple[bool, str, str]]()
    cells = matrix(QUICK_SHARE if quick else 1)
    shares = [cells[k::PROCESSES] for k in range(PROCESSES)]
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        for outcomes in pool.map(run_cells, shares):
            counts.update(outcomes)
    return list(_rows(counts))


def matrix(share: int = 1) -> list[Cell]:
    """All fields, with so many runs each that they make up the wanted totals, divided by `share`."""
    with LockstepWorlds() as worlds:
        (faults,) = worlds.answers([["faults"]])
    kinds = [
        (fault, upload, autopilot, loss)
        for fault in (NO_FAULT, *faults, CANCELLED, KILLED)
        for upload in (True, False)
        for autopilot in (Autopilot.PX4, Autopilot.ARDUPILOT)
        for loss in LOSSES
    ]
    each = len(kinds) // 2
    return [
        Cell(*kind, runs=-(-(UPLOADS if kind[1] else DOWNLOADS) // (each * share)), number=number)
        for number, kind in enumerate(kinds)
    ]


def run_cells(cells: list[Cell]) -> Counter[tuple[bool, str, str]]:
    """Outcomes of the transfers of some fields, counted by direction, fault and outcome."""
    numbers = [(cell, cell.number * 1_000_000 + k) for cell in cells for k in range(cell.runs)]
    with LockstepWorlds() as worlds:
        return Counter(worlds.run_all(_transfer(cell, number) for cell, number in numbers))


async def _transfer(cell: Cell, number: int) -> tuple[bool, str, str]:
    rng = random.Random(number)
    plan = random_mission(cell.autopilot, rng, ITEMS)
    other = random_mission(cell.autopilot, rng, rng.randrange(1, 8))
    spec = {
        "autopilot": cell.autopilot.value,
        "faults": [] if cell.fault in {NO_FAULT, CANCELLED, KILLED} else [cell.fault],
        "seed": number,
        "loss": cell.loss,
        "plan": wire_items(plan) if cell.upload else [],
        "held": wire_items(other if cell.upload else plan),
    }
    await Order("open", number, spec)
    link = WorldLink(number)
    if cell.fault in {CANCELLED, KILLED}:
        _interrupt(link, rng.randrange(1, 16), killed=cell.fault == KILLED)
    peer = MissionPeer(1, 1, cell.autopilot, link.send, link.clock, link.run, own_system=STATION[0])
    outcome = await (_upload(plan, peer, link) if cell.upload else _download(peer, link))
    return cell.upload, cell.fault, outcome


async def _upload(plan: Mission, peer: MissionPeer, link: WorldLink) -> str:
    error: GcsError | None = None
    for _ in range(2):
        try:
            await upload_and_prove(plan, peer)
            break
        except (OperationCancelled, _Killed):
            continue
        except GcsError as caught:
            error = caught
            break
    truth = await link.truth()
    if error is None:
        right = truth["held"] and (truth["holds"] or truth["meddled"])
        return "proved" if right else FALSE_SUCCESS
    unknown = isinstance(error, LinkError)
    if truth["holds"] and not (unknown and (truth["severed_upload"] or truth["severed_download"])):
        return FALSE_FAILURE
    return "unknown" if unknown else "refused"


async def _download(peer: MissionPeer, link: WorldLink) -> str:
    items: tuple[MissionItem, ...] | None = None
    for _ in range(2):
        try:
            items = await download(peer)
            break
        except (OperationCancelled, _Killed):
            continue
        except GcsError:
            break
    truth = await link.truth(None if items is None else wire_items(Mission(items)))
    if items is None:
        return "unknown" if truth["severed_download"] else FALSE_FAILURE
    return "read" if truth["read_right"] else FALSE_SUCCESS


def _interrupt(link: WorldLink, after: int, *, killed: bool) -> None:
    left = after

    def heard(transaction: Transaction[Any]) -> None:
        nonlocal left
        left -= 1
        if left == 0 and killed:
            raise _Killed
        if left == 0:
            transaction.cancel()

    link.on_heard = heard


def _rows(counts: Counter[tuple[bool, str, str]]) -> Iterator[Row]:
    uploads = sum(n for (upload, _, _), n in counts.items() if upload)
    yield Row(CASE, "uploads", float(uploads), "1")
    yield Row(CASE, "downloads", float(counts.total() - uploads), "1")
    for wanted in (FALSE_SUCCESS, FALSE_FAILURE):
        yield Row(CASE, wanted, float(sum(n for (_, _, outcome), n in counts.items() if outcome == wanted)), "1")
    for (upload, fault, outcome), n in sorted(counts.items()):
        yield Row(CASE, f"{'upload' if upload else 'download'}.{fault}.{outcome}", float(n), "1")
