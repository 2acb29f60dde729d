"""The folder of several flights of one inspection: a complete plan for each, and how they are flown together.

A fleet's flights are in `vehicle-1`, `vehicle-2`, ..., and `fleet.json` says how they fly at the same time. Sorties of
which some start from rally points are in `sortie-1`, ..., and `sorties.json` says how they follow each other.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, ValidationError, model_validator

from gcs.core.errors import InputError
from gcs.storage.atomic_files import new_directory
from gcs.storage.plan_document import Document, Point
from gcs.storage.plan_files import FLEET_FILE, SORTIES_FILE, is_ours, write_contents

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path


class GroupFlight(Document):
    """One flight: its folder, where it takes off and lands, and when on the clock of all."""

    directory: str
    home_m: Point
    viewpoints: list[str]
    start_s: Annotated[float, Field(ge=0)]
    end_s: float
    energy_wh: float
    plan_hash: str

    @property
    def more(self) -> str:
        """What a line about it ends with."""
        return f" from t = {self.start_s:.0f} s on"


class SortieFlight(GroupFlight):
    """One sortie; `rally` says at which of the scenario's rally points it takes off and lands, null means at home."""

    rally: Annotated[int, Field(ge=1)] | None

    @property
    def where(self) -> str:
        """Where it takes off and lands, in words."""
        place = "home" if self.rally is None else f"rally point {self.rally}"
        return f"from {place} at ({', '.join(f'{c:.1f}' for c in self.home_m)}) m"

    @property
    def more(self) -> str:  # noqa: D102
        return f", {self.energy_wh:.0f} Wh, {self.where}"


class PlanGroupDocument(Document, ABC):
    """What is said of all flights together. `coverage` and `coverable` are shares of a surface that was asked for."""

    FILE: ClassVar[str]
    KIND: ClassVar[str]
    """Begins the names of the flights' folders."""

    format: str
    version: Literal[1] = 1
    name: str
    viewpoints: int
    duration_s: float
    length_m: float
    energy_wh: float
    coverage: float | None
    coverable: float | None

    @property
    @abstractmethod
    def flights(self) -> Sequence[GroupFlight]:
        """The flights in order."""

    def lines(self) -> list[str]:
        """What there is, for people."""
        seen = "" if self.coverage is None else f", {self.coverage:.1%} of the coverable surface"
        return [
            *(
                f"{f.directory}: {len(f.viewpoints)} viewpoints in {f.end_s - f.start_s:.0f} s{f.more}"
                for f in self.flights
            ),
            f"{self.viewpoints} viewpoints{seen}, all down after {self.duration_s:.0f} s",
        ]

    @model_validator(mode="after")
    def _flights_in_their_folders(self) -> Self:
        expected = [f"{self.KIND}-{number + 1}" for number in range(len(self.flights))]
        if [flight.directory for flight in self.flights] != expected:
            raise ValueError(f"the flights' folders are {self.KIND}-1, {self.KIND}-2, ... in order")
        return self


class FleetDocument(PlanGroupDocument):
    """Content of `fleet.json`: vehicles that fly at the same time, and how near they come to each other.

    `separation_m` is what was asked, `apart_m` that and the errors of two vehicles, `min_separation_m` what was proved.
    """

    FILE: ClassVar[str] = FLEET_FILE
    KIND: ClassVar[str] = "vehicle"

    format: Literal["gcs-fleet"] = "gcs-fleet"
    vehicles: Annotated[list[GroupFlight], Field(min_length=2)]
    duration_lower_bound_s: float
    separation_m: float
    apart_m: float
    min_separation_m: float
    nearest_at_s: float
    nearest: tuple[int, int]
    """Numbers, from 1, of the two that come nearest to each other."""

    @property
    def flights(self) -> Sequence[GroupFlight]:  # noqa: D102
        return self.vehicles

    def lines(self) -> list[str]:  # noqa: D102
        apart = f"at least {self.min_separation_m:.2f} m between vehicles, {self.apart_m:.2f} m asked"
        return [*super().lines(), apart]


class SortiesDocument(PlanGroupDocument):
    """Content of `sorties.json`: flights one after the other, a fresh battery for each; and the cost of their tours."""

    FILE: ClassVar[str] = SORTIES_FILE
    KIND: ClassVar[str] = "sortie"

    format: Literal["gcs-sorties"] = "gcs-sorties"
    sorties: Annotated[list[SortieFlight], Field(min_length=1)]
    tour_cost: float
    tour_lower_bound: float
    tour_metric: str

    @property
    def flights(self) -> Sequence[GroupFlight]:  # noqa: D102
        return self.sorties


DOCUMENTS: tuple[type[FleetDocument], type[SortiesDocument]] = (FleetDocument, SortiesDocument)


def has_group(directory: Path) -> bool:
    """Whether a folder is that of a group of plans."""
    return any((directory / document.FILE).is_file() for document in DOCUMENTS)


def write_group(
    document: FleetDocument | SortiesDocument, plans: Mapping[str, Mapping[str, bytes]], directory: Path
) -> None:
    """Write a group of plans; the folder appears whole, or stays as it was.

    Args:
        document: how they are flown together.
        plans: folder -> files of the plan in it.
        directory: the folder; one that holds earlier plans is replaced.

    Raises:
        InputError: the folder holds something else.
        StorageError: the disk did not take it.
    """
    with new_directory(directory, is_ours) as folder:
        for name, files in plans.items():
            (folder / name).mkdir()
            write_contents(folder / name, files)
        (folder / document.FILE).write_text(document.model_dump_json(indent=2) + "\n")


def read_group(directory: Path) -> FleetDocument | SortiesDocument:
    """Read how a group of plans is flown.

    Raises:
        InputError: there is no such file, or it is damaged.
    """
    kind = next((document for document in DOCUMENTS if (directory / document.FILE).is_file()), None)
    if kind is None:
        raise InputError("there is no group of plans: give a folder that `gcs plan` wrote", field=str(directory))
    path = directory / kind.FILE
    try:
        return kind.model_validate(json.loads(path.read_text()))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", field=str(path)) from None
    except (ValueError, ValidationError) as error:
        what = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        raise InputError(f"damaged, or not of this version ({what}): plan again", field=str(path)) from None
