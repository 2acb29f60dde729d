"""Commands that fly, and bring what a flight was for."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs.commands.shared_options import connect_option, data_option, json_option, run
from gcs.core.errors import IncompleteError, RefusedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.services.fly_command import FlightOutcome


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@connect_option
@click.option(
    "--mode",
    type=click.Choice(["mission", "offboard", "companion"]),
    help="[default: what the prediction of both says]",
)
@click.option("--yes", "vehicle_name", metavar="VEHICLE", help="Confirm for the vehicle of this name, without asking.")
@click.option(
    "--accept",
    multiple=True,
    metavar="NAME",
    help="Accept what a check names: a failsafe that is off, a fence, ...; NAME=VALUE sets a failsafe (repeatable).",
)
@click.option("--sortie", type=click.IntRange(min=1), help="Of a plan of several. [default: the first not done yet]")
@click.option("--rest", is_flag=True, help="Only viewpoints without a picture from earlier flights.")
@click.option("--observer", metavar="NAME", help="Vehicle whose sightings stand in for a lost position fix.")
@data_option
@json_option
def fly(
    out: Path,
    url: str,
    mode: str | None,
    vehicle_name: str | None,
    accept: tuple[str, ...],
    sortie: int | None,
    rest: bool,
    observer: str | None,
    data_dir: Path | None,
    as_json: bool,
) -> None:
    """Fly the plan in OUT: upload with proof, confirm, arm, fly, watch, land, bring the images."""
    from gcs.services.fly_command import fly_plan

    async def confirm(name: str) -> str:
        if vehicle_name is not None:
            return vehicle_name
        click.echo(f"Type the vehicle's name to arm and start it ({name}): ", nl=False, err=as_json)
        return await _typed_line()

    say: Callable[[str], None] = lambda line: click.echo(line, err=as_json)  # noqa: E731
    outcome: FlightOutcome = run(
        fly_plan(
            out,
            url,
            mode=mode,
            confirm=confirm,
            accept=accept,
            data_dir=data_dir,
            say=say,
            sortie=sortie,
            rest=rest,
            observer=observer,
        )
    )
    if as_json:
        click.echo(json.dumps(outcome.as_json()))
    if outcome.failure is not None:
        raise outcome.failure
    if not outcome.ok:
        raise IncompleteError("; ".join(outcome.problems) or "not all of the plan was flown")


@click.group()
def images() -> None:
    """The pictures of a flight."""


@images.command(name="import")
@click.argument("flight")
@click.argument("folder", type=click.Path(path_type=Path))
@data_option
def import_images(flight: str, folder: Path, data_dir: Path | None) -> None:
    """Bring pictures from a card in FOLDER to FLIGHT."""
    from gcs.services.image_import import import_folder

    result = import_folder(flight, folder, data_dir)
    for line in result.lines():
        click.echo(line)
    if result.missing:
        raise IncompleteError(f"{len(result.missing)} expected pictures are not there: {', '.join(result.missing[:8])}")


async def _typed_line() -> str:
    """A line from standard input; the event loop goes on meanwhile, so that no vehicle misses our heartbeats.

    Raises:
        RefusedError: there is nobody who could type.
    """
    import asyncio

    loop, readable = asyncio.get_running_loop(), asyncio.Event()
    try:
        loop.add_reader(sys.stdin, readable.set)
    except (OSError, ValueError):  # a plain file, or none at all: nothing to wait for
        readable.set()
    else:
        try:
            await readable.wait()
        finally:
            loop.remove_reader(sys.stdin)
    line = sys.stdin.readline()
    if not line:
        raise RefusedError("nobody confirmed it: type the vehicle's name, or give --yes VEHICLE", field="confirm")
    return line.strip()
