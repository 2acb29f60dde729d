"""Case `image-5`: a picture of 5 MB by MAVLink FTP, with and without losses, on fake time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.errors import IncompleteError
from gcs.mavlink.ftp_fetch import FetchFile
from gcs.services.benchmarks.lockstep_worlds import STATION, LockstepWorlds, Order, WorldLink
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Iterator

CASE = "image-5"
BYTES, QUICK_BYTES = 5_000_000, 300_000
LOSS = 0.05
ROUND_TRIP_S = 0.05
CAMERA = (1, 100)
PATH = "/DCIM/IMG_0001.JPG"


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: a picture of 0.3 MB.
    """
    return list(_rows(QUICK_BYTES if quick else BYTES))


def _rows(size: int) -> Iterator[Row]:
    with LockstepWorlds() as worlds:
        times = dict(worlds.run_all(_fetch(number, size, loss) for number, loss in enumerate((0.0, LOSS))))
    yield Row(CASE, "seconds", times[LOSS], "s", "the same link without losses", times[0.0])
    yield Row(CASE, "rate_ratio", times[0.0] / times[LOSS], "1")


async def _fetch(number: int, size: int, loss: float) -> tuple[float, float]:
    """The loss, and how long the picture took (s of the link's time).

    Raises:
        IncompleteError: what came is not the picture.
    """
    await Order("open-picture", number, {"size": size, "loss": loss, "round_trip_s": ROUND_TRIP_S, "seed": 1})
    link = WorldLink(number)
    file = await link.run(FetchFile(PATH, *CAMERA, link.send, link.clock, own_system=STATION[0]))
    if not (await Order("truth", number, file.crc32))["whole"]:
        raise IncompleteError(f"what came at a loss of {loss:g} is not the picture")
    return loss, link.clock()
