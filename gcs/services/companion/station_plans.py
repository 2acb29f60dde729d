"""Plans that a companion flies: from its own disk, or from the station by their hash.

They are made ready in a process of its own: that takes seconds, in which the companion must go on.
"""

from __future__ import annotations

import os
from contextlib import suppress
from http.client import HTTPException
from multiprocessing import get_context
from typing import TYPE_CHECKING
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

from gcs.core.errors import GcsError, InputError, LinkError, NotFoundError, RefusedError
from gcs.services.companion.flyable_plan import flyable_plan
from gcs.storage.kept_plans import PLAN, STRUCTURE
from gcs.storage.plan_files import plan_hash, read_plan, read_structure

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from pathlib import Path

    from gcs.services.companion.flyable_plan import FlyablePlan
    from gcs.storage.kept_plans import KeptPlans

NICENESS = 10
"""Preparing a plan can wait for whatever else the computer does."""

TIMEOUT_S = 20.0
MOST_BYTES = 500_000_000
NO_STATION = "no station to ask for it: give --station, or the plan's folder with --plan"


def station_address(url: str) -> str:
    """The URL of a station, such as `http://127.0.0.1:8080`, without a slash at its end.

    Raises:
        InputError: not such a URL.
    """
    try:
        parts = urlsplit(url)
        fits = parts.scheme in {"http", "https"} and parts.hostname and (parts.port or True) and not parts.query
    except ValueError:
        fits = False
    if not fits:
        raise InputError("give the station as http://HOST:PORT", field="--station")
    return url.rstrip("/")


class StationFiles:
    """Gets a plan's files from a station.

    Args:
        url: as `station_address` returns it.
        token: opens the station's API.
    """

    def __init__(self, url: str, token: str) -> None:
        self._url = url
        self._token = token

    def get(self, wanted: str, name: str) -> bytes:
        """A file of the plan with a hash.

        Raises:
            NotFoundError: the station knows no plan of this hash.
            RefusedError: it does not take the token.
            LinkError: it does not answer.
        """
        url = f"{self._url}/api/plans/by-hash/{wanted}/{name}"
        request = Request(url, headers={"Authorization": f"Bearer {self._token}"})
        try:
            with urlopen(request, timeout=TIMEOUT_S) as answer:
                content = bytes(answer.read(MOST_BYTES))
                if answer.length:
                    raise LinkError("the station's answer broke off", field=self._url)
                return content
        except HTTPError as error:
            if error.code == 404:
                raise NotFoundError("the station knows no plan of this hash", field=wanted[:12]) from None
            if error.code in (401, 403):
                raise RefusedError("the station does not take the token", field="--token-file") from None
            raise LinkError(f"the station answered {error.code}", field=self._url) from None
        except (URLError, OSError, HTTPException) as error:
            reason = getattr(error, "reason", error)
            raise LinkError(f"the station does not answer: {reason}", field=self._url) from None


class StationPlans:
    """Implements `gcs.services.companion.doors.PlanSource`.

    Args:
        kept: plans on disk.
        station: asked for others; None to fly what is kept alone.
    """

    def __init__(self, kept: KeptPlans, station: StationFiles | None) -> None:
        self._kept = kept
        self._station = station
        self._making: dict[tuple[str, float], Connection[None, FlyablePlan | GcsError]] = {}
        self._made: dict[tuple[str, float], FlyablePlan] = {}

    def get(self, plan_hash: str, offboard_timeout_s: float) -> FlyablePlan | None:
        """See PlanSource; what failed is tried anew with the next call after the failure was told."""
        key = (plan_hash, offboard_timeout_s)
        if key in self._made:
            return self._made[key]
        if key not in self._making:
            if not all(answer.poll() for answer in self._making.values()):
                return None  # one at a time, whatever is announced: the computer has a vehicle to fly
            self._making[key] = self._begin(*key)
        if not self._making[key].poll():
            return None
        with self._making.pop(key) as answer:
            try:
                made = answer.recv()
            except EOFError:
                raise GcsError("the plan could not be made ready: its process ended") from None
        if isinstance(made, GcsError):
            raise made
        self._made[key] = made
        return made

    def _begin(self, wanted: str, offboard_timeout_s: float) -> Connection[None, FlyablePlan | GcsError]:
        spawning = get_context("spawn")
        answer, given = spawning.Pipe(duplex=False)
        work = (given, self._kept, self._station, wanted, offboard_timeout_s)
        spawning.Process(target=_make_ready, args=work, name="prepare plan", daemon=True).start()
        given.close()
        return answer


def _make_ready(
    given: Connection[FlyablePlan | GcsError, None],
    kept: KeptPlans,
    station: StationFiles | None,
    wanted: str,
    offboard_timeout_s: float,
) -> None:
    """Send the plan, or why there is none; the process then ends by itself, whatever became of the companion."""
    os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    with suppress(BrokenPipeError), given:
        try:
            given.send(prepared_plan(kept, station, wanted, offboard_timeout_s))
        except GcsError as error:
            given.send(error)


def prepared_plan(kept: KeptPlans, station: StationFiles | None, wanted: str, offboard_timeout_s: float) -> FlyablePlan:
    """A plan by its hash, from the disk where it is whole there, else from the station; takes seconds.

    Raises:
        NotFoundError: it is neither here nor at the station.
        InputError: what the station gave is not this plan.
        GcsError: the station does not give it, the disk does not take it, or it cannot be flown.
    """
    folder = kept.find(wanted)
    if folder is None:
        if station is None:
            raise NotFoundError(NO_STATION, field=wanted[:12])
        folder = kept.keep(wanted, station.get(wanted, PLAN), station.get(wanted, STRUCTURE))
    try:
        plan, structure = read_plan(folder), read_structure(folder)
    except GcsError:
        kept.forget(wanted)  # or it would never be got again
        raise
    return flyable_plan(plan, wanted, structure, offboard_timeout_s)


def keep_folder(kept: KeptPlans, folder: Path) -> str:
    """Keep the plan of a folder that `gcs plan` wrote; returns its hash.

    Raises:
        InputError: it holds no plan.
    """
    read_plan(folder)
    wanted = plan_hash(folder)
    try:
        structure = (folder / STRUCTURE).read_bytes()
        plan = (folder / PLAN).read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", field=str(folder)) from None
    kept.keep(wanted, plan, structure)
    return wanted
