"""Commands that move missions, fences and rally points alone."""

from __future__ import annotations

import json
from pathlib import Path

import click

from gcs.commands.shared_options import connect_option, data_option, json_option, run, vehicle_option
from gcs.core.errors import InputError


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@connect_option
@data_option
@json_option
def upload(out: Path, url: str, data_dir: Path | None, as_json: bool) -> None:
    """Put the mission of the plan in OUT, its fence and rally points on the vehicle, and prove that they are there."""
    from gcs.services.transfer_commands import upload_plan

    proof = run(upload_plan(out, url, lambda line: click.echo(line, err=True), data_dir))
    if as_json:
        click.echo(json.dumps(proof))
    else:
        click.echo(f"proved: {proof['vehicle']} holds {proof['items']} items, {proof['how']}")
        for entry in proof["lists"]:
            click.echo(f"{'proved' if entry['proved'] else 'not sent'}: {entry['name']}: {entry['how']}")


@click.command()
@connect_option
@click.option("-o", "--out", type=click.Path(path_type=Path, dir_okay=False), help="Write a .waypoints file.")
@data_option
@json_option
def download(url: str, out: Path | None, data_dir: Path | None, as_json: bool) -> None:
    """Read the mission that the vehicle holds."""
    from gcs.services.transfer_commands import download_mission
    from gcs.storage.atomic_files import write_file

    if out is not None and not out.absolute().parent.is_dir():
        raise InputError("there is no such folder", field=str(out.parent))
    text, items = run(download_mission(url, data_dir))
    if out is not None:
        write_file(out, text.encode())
        click.echo(f"{len(items)} items written to {out}")
    elif as_json:
        click.echo(json.dumps(items))
    else:
        click.echo(text, nl=False)


@click.command()
@connect_option
@vehicle_option
@click.option("--fence", "what", flag_value="fence", help="Its fence, instead of its mission.")
@click.option("--rally", "what", flag_value="rally", help="Its rally points, instead of its mission.")
@data_option
def clear(url: str, vehicle: str, what: str | None, data_dir: Path | None) -> None:
    """Have a disarmed vehicle forget its mission, and read that nothing is left of it."""
    from gcs.mavlink.mission_protocol import MissionType
    from gcs.services.transfer_commands import clear_list

    mission_type = MissionType[(what or "mission").upper()]
    run(clear_list(url, vehicle, mission_type, data_dir))
    click.echo(f"{vehicle} holds no {mission_type.noun} any more")


@click.command("set-current")
@connect_option
@vehicle_option
@click.argument("item", type=click.IntRange(0, 65534))
@data_option
def set_current(url: str, vehicle: str, item: int, data_dir: Path | None) -> None:
    """Make ITEM (from 0) the current one of a disarmed vehicle's mission; `gcs fly` starts at the first anyhow."""
    from gcs.services.transfer_commands import set_current

    run(set_current(url, vehicle, item, data_dir))
    click.echo(f"{vehicle} has item {item} as its current one")
