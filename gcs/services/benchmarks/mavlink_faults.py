"""Case `faults`: every fault of a vehicle and its link against uploads and downloads, on fake time.

What the vehicle holds in the end is asked of the simulated vehicle, which shares no code with the station. An upload is
a false success when the vehicle did not hold the plan as its last words left it, and a false failure when it holds the
plan all the same, unless the station says that it does not know and the link is gone indeed. A download is a false
success when it is not what the vehicle holds, and a false failure when it ends in an error though the link is there.

The matrix is of missions that go item by item. Beside it stands a smaller one, of what else is transferred: fences and
rally points, and ArduPilot's missions as files, which real ones of some length are.
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
from gcs.mavlink.mission_ftp import upload_as_file
from gcs.mavlink.mission_proof import MissionPeer, download, upload_and_prove, upload_list_and_prove
from gcs.mavlink.mission_protocol import MissionType
from gcs.services.benchmarks.lockstep_worlds import STATION, LockstepWorlds, Order, WorldFiles, WorldLink
from gcs.services.benchmarks.mavlink_missions import random_list, random_mission, wire_items
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.mavlink.transaction import Transaction

CASE = "faults"
LOSSES = (0.0, 0.05, 0.2)
UPLOADS, DOWNLOADS = 100_000, 10_000
OTHER_LOSSES = (0.0, 0.2)
OTHER_RUNS = 4
QUICK_SHARE, QUICK_OTHERS = 300, 8
"""The quick run has one run in so many of the matrix, and one field in so many beside it."""
PROCESSES = 2
ITEMS, FILE_ITEMS = 5, 8
NO_FAULT = "none"
CANCELLED, KILLED = "cancelled", "killed"
"""Faults of the station's own: stopped at some step, cleanly or not, and tried again."""
FALSE_SUCCESS, FALSE_FAILURE = "false_success", "false_failure"


Outcomes = Counter[tuple[str, str, str]]
"""How often, by what was done, the fault, and what came of it."""


@dataclass(frozen=True)
class Cell:
    """One field of the matrix.

    Attributes:
        fault: its name.
        upload: whether lists go up, or come down.
        autopilot: px4 or ardupilot.
        loss: of packets, each way.
        runs: how many transfers.
        number: of the field, for its seeds.
        mission_type: which list.
        as_file: whether it goes as a file, and item by item only if that does not work.
    """

    fault: str
    upload: bool
    autopilot: Autopilot
    loss: float
    runs: int
    number: int
    mission_type: MissionType = MissionType.MISSION
    as_file: bool = False

    @property
    def what(self) -> str:
        """What is done, such as `upload` or `fence.upload`."""
        of = (
            "file."
            if self.as_file
            else ""
            if self.mission_type is MissionType.MISSION
            else f"{self.mission_type.name.lower()}."
        )
        return of + ("upload" if self.upload else "download")


class _Killed(BaseException):
    """The station's process ends here."""


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: some hundred transfers instead of 110,000.
    """
    counts = Outcomes()
    cells = [*matrix(QUICK_SHARE), *beside()[::QUICK_OTHERS]] if quick else [*matrix(), *beside()]
    shares = [cells[k::PROCESSES] for k in range(PROCESSES)]
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        for outcomes in pool.map(run_cells, shares):
            counts.update(outcomes)
    return list(_rows(counts))


def matrix(share: int = 1) -> list[Cell]:
    """All fields, with so many runs each that they make up the wanted totals, divided by `share`."""
    kinds = [
        (fault, upload, autopilot, loss)
        for fault in _faults()
        for upload in (True, False)
        for autopilot in (Autopilot.PX4, Autopilot.ARDUPILOT)
        for loss in LOSSES
    ]
    each = len(kinds) // 2
    return [
        Cell(*kind, runs=-(-(UPLOADS if kind[1] else DOWNLOADS) // (each * share)), number=number)
        for number, kind in enumerate(kinds)
    ]


def beside() -> list[Cell]:
    """The fields beside the matrix: uploads of the other lists, and of missions as files."""
    kinds = [(Autopilot.ARDUPILOT, MissionType.MISSION)]
    kinds += [(a, t) for a in (Autopilot.PX4, Autopilot.ARDUPILOT) for t in (MissionType.FENCE, MissionType.RALLY)]
    every = [(fault, *kind, loss) for fault in _faults() for kind in kinds for loss in OTHER_LOSSES]
    return [
        Cell(fault, True, autopilot, loss, OTHER_RUNS, 10_000 + k, of, as_file=of is MissionType.MISSION)
        for k, (fault, autopilot, of, loss) in enumerate(every)
    ]


def _faults() -> list[str]:
    with LockstepWorlds() as worlds:
        (faults,) = worlds.answers([["faults"]])
    return [NO_FAULT, *faults, CANCELLED, KILLED]


def run_cells(cells: list[Cell]) -> Outcomes:
    """Outcomes of the transfers of some fields."""
    numbers = [(cell, cell.number * 1_000_000 + k) for cell in cells for k in range(cell.runs)]
    with LockstepWorlds() as worlds:
        return Counter(worlds.run_all(_transfer(cell, number) for cell, number in numbers))


async def _transfer(cell: Cell, number: int) -> tuple[str, str, str]:
    rng = random.Random(number)
    plan = _random_list(cell, rng, FILE_ITEMS if cell.as_file else ITEMS)
    other = _random_list(cell, rng, rng.randrange(1, 8))
    spec = {
        "autopilot": cell.autopilot.value,
        "faults": [] if cell.fault in {NO_FAULT, CANCELLED, KILLED} else [cell.fault],
        "seed": number,
        "loss": cell.loss,
        "plan": wire_items(plan) if cell.upload else [],
        "held": wire_items(other if cell.upload else plan),
        "mission_type": int(cell.mission_type),
        "serves_files": cell.as_file,
    }
    await Order("open", number, spec)
    link = WorldLink(number)
    if cell.fault in {CANCELLED, KILLED}:
        _interrupt(link, rng.randrange(1, 16), killed=cell.fault == KILLED)
    peer = MissionPeer(1, 1, cell.autopilot, link.send, link.clock, link.run, own_system=STATION[0])
    outcome = await (_upload(plan, cell, peer, link) if cell.upload else _download(cell, peer, link))
    return cell.what, cell.fault, outcome


def _random_list(cell: Cell, rng: random.Random, count: int) -> Mission:
    if cell.mission_type is MissionType.MISSION:
        return random_mission(cell.autopilot, rng, count)
    return random_list(cell.mission_type, rng, max(count, 3))  # a polygon has three corners


async def _put(plan: Mission, cell: Cell, peer: MissionPeer, link: WorldLink) -> None:
    """Upload as a vehicle's object does."""
    if cell.as_file and await _went_as_file(plan, peer, link):
        return
    if cell.mission_type is MissionType.MISSION:
        await upload_and_prove(plan, peer)
    else:
        await upload_list_and_prove(plan.items, cell.mission_type, peer)


async def _went_as_file(plan: Mission, peer: MissionPeer, link: WorldLink) -> bool:
    files = WorldFiles(link)
    try:
        await upload_as_file(plan.items, MissionType.MISSION, files, files.target, peer.autopilot, peer.clock)
    except OperationCancelled:
        raise
    except GcsError:
        return False  # which is no verdict
    return True


async def _upload(plan: Mission, cell: Cell, peer: MissionPeer, link: WorldLink) -> str:
    error: GcsError | None = None
    for _ in range(2):
        try:
            await _put(plan, cell, peer, link)
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


async def _download(cell: Cell, peer: MissionPeer, link: WorldLink) -> str:
    items: tuple[MissionItem, ...] | None = None
    for _ in range(2):
        try:
            items = await download(peer, mission_type=cell.mission_type)
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


def _rows(counts: Outcomes) -> Iterator[Row]:
    for what in sorted({what for what, _, _ in counts}, key=lambda what: ("." in what, what != "upload", what)):
        yield Row(CASE, f"{what}s", float(sum(n for (done, _, _), n in counts.items() if done == what)), "1")
    for wanted in (FALSE_SUCCESS, FALSE_FAILURE):
        yield Row(CASE, wanted, float(sum(n for (_, _, outcome), n in counts.items() if outcome == wanted)), "1")
    for (what, fault, outcome), n in sorted(counts.items()):
        yield Row(CASE, f"{what}.{fault}.{outcome}", float(n), "1")
