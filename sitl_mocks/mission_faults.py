"""All faults that can be switched on, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from random import Random

from gcs.core.errors import InputError
from sitl_mocks.link_faults import LINK_FAULTS
from sitl_mocks.mission_fault import MissionFault
from sitl_mocks.mission_server import ACCEPTED, ERROR, MissionServer
from sitl_mocks.reading_faults import DeafToList, DeafToRequest, ErrorInsteadOfItem, MisnumberedItem
from sitl_mocks.store_faults import DriftingHome, HomeInItem0, Mixed, ReplacedByOther, Rounded, Truncated
from sitl_mocks.stray_faults import Deaf, Impostor, Reboot, SecondStation, StaleAcknowledgement, StaleOfOtherList
from sitl_mocks.writing_faults import (
    AsksForAnother,
    DeafToCount,
    EndsInstead,
    FinalAcknowledgement,
    FullAfter,
    NeverAsks,
    OddWordsBeforeRequests,
    RequestStorm,
)

MISSION_FAULTS: dict[str, Callable[[MissionServer, Random], MissionFault]] = {
    # QGroundControl's MockLink, on reading
    "read-list-silent": partial(DeafToList, once=False),
    "read-list-silent-once": partial(DeafToList, once=True),
    "read-0-silent": partial(DeafToRequest, sequence=0, once=False),
    "read-1-silent": partial(DeafToRequest, sequence=1, once=False),
    "read-1-silent-once": partial(DeafToRequest, sequence=1, once=True),
    "read-0-misnumbered": partial(MisnumberedItem, sequence=0),
    "read-1-misnumbered": partial(MisnumberedItem, sequence=1),
    "read-0-error": partial(ErrorInsteadOfItem, sequence=0),
    "read-1-error": partial(ErrorInsteadOfItem, sequence=1),
    # and on writing
    "write-count-silent": partial(DeafToCount, once=False),
    "write-count-silent-once": partial(DeafToCount, once=True),
    "write-1-silent": partial(NeverAsks, sequence=1),
    "write-0-misnumbered": partial(AsksForAnother, sequence=0),
    "write-1-misnumbered": partial(AsksForAnother, sequence=1),
    "write-0-error": partial(EndsInstead, sequence=0, result=ERROR),
    "write-1-error": partial(EndsInstead, sequence=1, result=ERROR),
    "ack-missing": FinalAcknowledgement,
    "ack-error": partial(FinalAcknowledgement, result=ERROR),
    "ack-early": partial(EndsInstead, sequence=1, result=ACCEPTED),
    # what real links and vehicles add
    "ack-lost-once": partial(FinalAcknowledgement, once=True),
    "stale-other-list": StaleOfOtherList,
    "stale-ack": StaleAcknowledgement,
    "other-component": Impostor,
    "other-system": partial(Impostor, system_id=77),
    "invalid-sequence": partial(OddWordsBeforeRequests, out_of_range=False),
    "request-out-of-range": partial(OddWordsBeforeRequests, out_of_range=True),
    "request-storm": RequestStorm,
    "reboot": Reboot,
    "second-station": SecondStation,
    "changed": partial(ReplacedByOther, clears=False),
    "cleared": partial(ReplacedByOther, clears=True),
    "truncated": Truncated,
    "mixed": Mixed,
    "no-space-later": FullAfter,
    "signed-only": Deaf,
    "rounded": Rounded,
    "home-in-item-0": HomeInItem0,
    "home-drifts": DriftingHome,
}

FAULTS = (*MISSION_FAULTS, *LINK_FAULTS)
"""The names of all."""


def make_faults(names: Iterable[str], server: MissionServer, rng: Random) -> list[MissionFault]:
    """Those of some faults that are of missions, standing before a server."""
    return [MISSION_FAULTS[name](server, rng) for name in names if name in MISSION_FAULTS]


def check_fault(name: str) -> str:
    """The name, if there is such a fault.

    Raises:
        InputError: there is none.
    """
    if name not in FAULTS:
        raise InputError(f"there is no fault {name!r}; there are {', '.join(FAULTS)}", field="--fault")
    return name
