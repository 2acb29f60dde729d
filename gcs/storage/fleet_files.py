"""The folder of a fleet: a complete plan for each vehicle, and how they fly together."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from gcs.core.errors import InputError
from gcs.storage.atomic_files import check_replaceable, new_directory
from gcs.storage.plan_document import Document, Point
from gcs.storage.plan_files import is_plan_directory, part_directories, write_contents

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

FLEET_FILE = "fleet.json"


class FleetVehicle(Document):
    """One vehicle: its folder, where it stands, and when it flies on the fleet's clock."""

    directory: str
    home_m: Point
    viewpoints: list[str]
    start_s: Annotated[float, Field(ge=0)]
    end_s: float
    energy_wh: float
    plan_hash: str


class FleetDocument(Document):
    """Content of `fleet.json`: vehicles that fly at the same time, and how near they come to each other.

    `separation_m` is what was asked, `apart_m` that and the errors of two vehicles, `min_separation_m` what was proved.
    """

    format: Literal["gcs-fleet"] = "gcs-fleet"
    version: Literal[1] = 1
    name: str
    vehicles: Annotated[list[FleetVehicle], Field(min_length=2)]
    viewpoints: int
    duration_s: float
    duration_lower_bound_s: float
    length_m: float
    energy_wh: float
    coverage: float | None
    coverable: float | None
    separation_m: float
    apart_m: float
    min_separation_m: float
    nearest_at_s: float
    nearest: tuple[int, int]
    """Numbers, from 1, of the two that come nearest to each other."""

    @model_validator(mode="after")
    def _vehicles_in_their_folders(self) -> Self:
        expected = [f"vehicle-{number + 1}" for number in range(len(self.vehicles))]
        if [vehicle.directory for vehicle in self.vehicles] != expected:
            raise ValueError("the vehicles' folders are vehicle-1, vehicle-2, ... in order")
        return self


def check_fleet_output(directory: Path) -> None:
    """Tell before planning whether a fleet's plans may be written to a folder.

    Raises:
        InputError: something else is there.
    """
    check_replaceable(directory.absolute(), is_ours)


def is_ours(directory: Path) -> bool:
    """Whether a folder holds a fleet's plans or a plan, and nothing else."""
    return is_plan_directory(directory) or is_fleet_directory(directory)


def is_fleet_directory(directory: Path) -> bool:
    """Whether a folder holds the plans of a fleet and nothing else."""
    parts = part_directories(directory)
    names = {entry.name for entry in directory.iterdir()} - {part.name for part in parts}
    return names == {FLEET_FILE} and all(part.is_dir() and is_plan_directory(part) for part in parts)


def write_fleet(document: FleetDocument, plans: Mapping[str, Mapping[str, bytes]], directory: Path) -> None:
    """Write the plans of a fleet; the folder appears whole, or stays as it was.

    Args:
        document: how they fly together.
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
        (folder / FLEET_FILE).write_text(document.model_dump_json(indent=2) + "\n")


def read_fleet(directory: Path) -> FleetDocument:
    """Read how a fleet flies together.

    Raises:
        InputError: there is no such file, or it is damaged.
    """
    path = directory / FLEET_FILE
    try:
        return FleetDocument.model_validate(json.loads(path.read_text()))
    except OSError:
        raise InputError(
            "there are no plans of a fleet: give a folder that `gcs plan` wrote", field=str(path)
        ) from None
    except (ValueError, ValidationError) as error:
        what = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        raise InputError(f"damaged, or not of this version ({what}): plan again", field=str(path)) from None
