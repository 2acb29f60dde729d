"""The command line. Heavy imports happen inside the commands, so that `gcs --help` answers at once."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gcs import __version__
from gcs.core.errors import GcsError, IncompleteError, InputError, RefusedError

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from gcs.mavlink.signing_setup import SigningProof
    from gcs.services.fly_command import FlightOutcome

T = TypeVar("T")

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}

connect_option = click.option(
    "--connect",
    "url",
    required=True,
    metavar="URL",
    help="udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD.",
)
data_option = click.option(
    "--data",
    "data_dir",
    type=click.Path(path_type=Path, file_okay=False),
    envvar="GCS_DATA",
    help="Where flights, plans and images are kept. [default: ~/.local/share/gcs]",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object last.")


@click.group(context_settings=CONTEXT)
@click.version_option(__version__, prog_name="gcs")
def cli() -> None:
    """Plan, prove, fly and account for structure inspections by drone."""


@cli.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path), help="Folder to write the plan into.")
def plan(scenario: Path, out: Path) -> None:
    """Plan the inspection that SCENARIO (YAML or JSON) asks for."""
    from gcs.services.plan_service import plan_to_directory
    from gcs.services.terminal import TerminalProgress

    with TerminalProgress() as progress:
        result = plan_to_directory(scenario, out, progress)
    from gcs.services.plan_writing import WrittenPlan  # there by now

    for note in result.notes:
        click.echo(f"note: {note}")
    if not isinstance(result, WrittenPlan):
        for line in result.document.lines():
            click.echo(line)
        click.echo(f"written to {out}")
        return
    c = result.plan.certificates
    seen = "" if c.coverage is None else f", {c.coverage:.1%} of the coverable surface"
    least = f" (no choice has fewer than {c.viewpoints_lower_bound:.1f})" if c.viewpoints_lower_bound else ""
    click.echo(f"{c.viewpoints} viewpoints{least}{seen}")
    for face in result.plan.faces:
        click.echo(f"face {face.name}: {face.covered} of {face.cells} cells, {len(face.moved)} of them from aside")
    click.echo(
        f"{c.length_m:.1f} m in {c.duration_s:.0f} s, {c.energy_wh:.0f} Wh, hull clearance {c.min_clearance_m:.2f} m"
    )
    for prediction in result.report["predictions"]:
        click.echo(f"on {prediction['autopilot']}: {prediction['why']}")
    for number, sortie in enumerate(result.plan.sorties, start=1):
        views, seconds, energy = len(sortie.viewpoints), sortie.duration_s, sortie.energy_wh
        click.echo(f"sortie {number}: {views} viewpoints in {seconds:.0f} s, {energy:.0f} Wh")
    click.echo(f"written to {out}")


@cli.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--points",
    type=click.Path(path_type=Path),
    help="Also say which points of this CSV (x_m,y_m,z_m,normal_x,normal_y,normal_z) are seen, and why not the others.",
)
def verify(out: Path, points: Path | None) -> None:
    """Check the written plan in OUT again, from its files and meshes alone."""
    from gcs.services.plan_verification import verify_plan

    checks = verify_plan(out)
    for check in checks:
        click.echo(f"{'ok  ' if check.ok else 'FAIL'}  {check.name}: {check.message}")
    if points is not None:
        from gcs.services.point_verdicts import judge_points

        for point in judge_points(out, points):
            click.echo(f"{point.name}: {point.verdict.words}")
    if not all(check.ok for check in checks):
        sys.exit(1)


@cli.command()
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
    outcome: FlightOutcome = _run(
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


@cli.command()
@click.argument("out", type=click.Path(path_type=Path))
@connect_option
@data_option
@json_option
def upload(out: Path, url: str, data_dir: Path | None, as_json: bool) -> None:
    """Put the mission of the plan in OUT, its fence and rally points on the vehicle, and prove that they are there."""
    from gcs.services.transfer_commands import upload_plan

    proof = _run(upload_plan(out, url, lambda line: click.echo(line, err=True), data_dir))
    if as_json:
        click.echo(json.dumps(proof))
    else:
        click.echo(f"proved: {proof['vehicle']} holds {proof['items']} items, {proof['how']}")
        for entry in proof["lists"]:
            click.echo(f"{'proved' if entry['proved'] else 'not sent'}: {entry['name']}: {entry['how']}")


@cli.command()
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
    text, items = _run(download_mission(url, data_dir))
    if out is not None:
        write_file(out, text.encode())
        click.echo(f"{len(items)} items written to {out}")
    elif as_json:
        click.echo(json.dumps(items))
    else:
        click.echo(text, nl=False)


vehicle_option = click.option("--vehicle", required=True, metavar="NAME", help="The vehicle's name, such as px4-1.")


@cli.command()
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
    _run(clear_list(url, vehicle, mission_type, data_dir))
    click.echo(f"{vehicle} holds no {mission_type.noun} any more")


@cli.command("set-current")
@connect_option
@vehicle_option
@click.argument("item", type=click.IntRange(0, 65534))
@data_option
def set_current(url: str, vehicle: str, item: int, data_dir: Path | None) -> None:
    """Make ITEM (from 0) the current one of a disarmed vehicle's mission; `gcs fly` starts at the first anyhow."""
    from gcs.services.transfer_commands import set_current

    _run(set_current(url, vehicle, item, data_dir))
    click.echo(f"{vehicle} has item {item} as its current one")


@cli.group()
def signing() -> None:
    """Sign links (MAVLink 2); keys are kept encrypted with the passphrase in GCS_KEY."""


@signing.command("set-up")
@connect_option
@vehicle_option
@click.option("--accept-unsigned", is_flag=True, help="Let unsigned packets in as well.")
@data_option
def set_up_signing(url: str, vehicle: str, accept_unsigned: bool, data_dir: Path | None) -> None:
    """Give a disarmed vehicle a new key, in place of an old one, and prove that it took it.

    The key goes over the link unencrypted: use a link that nobody else can hear, such as a cable.
    """
    from gcs.services.signing_commands import give_key

    _tell_proof(_run(give_key(url, vehicle, data_dir, rejects_unsigned=not accept_unsigned)), vehicle)


@signing.command("prove")
@connect_option
@vehicle_option
@data_option
def prove_signing(url: str, vehicle: str, data_dir: Path | None) -> None:
    """See whether a disarmed vehicle goes by the key of a link, such as one that got it by `gcs signing share`."""
    from gcs.services.signing_commands import prove_key

    _tell_proof(_run(prove_key(url, vehicle, data_dir)), vehicle)


def _tell_proof(proof: SigningProof, vehicle: str) -> None:
    click.echo(proof.words)
    if not proof.proved:
        raise IncompleteError("signing is not enforced by the vehicle", field=vehicle)


@signing.command("remove")
@connect_option
@vehicle_option
@data_option
def remove_signing(url: str, vehicle: str, data_dir: Path | None) -> None:
    """Have a disarmed vehicle forget its key."""
    from gcs.services.signing_commands import take_key_back

    _run(take_key_back(url, vehicle, data_dir))
    click.echo(f"{vehicle} has no key any more, and takes unsigned packets")


@signing.command("share")
@connect_option
@click.option("--with", "other_url", required=True, metavar="URL", help="The second link to the same vehicle.")
@data_option
def share_signing(url: str, other_url: str, data_dir: Path | None) -> None:
    """Sign a second link with the key of one: a vehicle's key holds for all its links."""
    from gcs.services.signing_commands import share_key

    share_key(url, other_url, data_dir)
    click.echo(f"{other_url} is signed with the key of {url} when it is opened next")


@signing.command("export")
@connect_option
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@data_option
def export_signing(url: str, file: Path, data_dir: Path | None) -> None:
    """Write a link's key to FILE, unencrypted, for another computer at the vehicle (`gcs companion --key-file`)."""
    from gcs.services.signing_commands import export_key

    export_key(url, file, data_dir)
    click.echo(f"{file} holds the key of {url}: bring it over a way that nobody else can read, then delete it here")


@signing.command("list")
@data_option
def list_signing(data_dir: Path | None) -> None:
    """List the links that are signed."""
    from gcs.services.link_signing import key_store

    for url in key_store(data_dir).urls():
        click.echo(url)


@cli.command()
@click.option("--autopilot", type=click.Choice(["px4", "ardupilot"]), default="px4", show_default=True)
@click.option("--count", type=click.IntRange(1, 250), default=1, show_default=True)
@click.option("--speedup", type=click.FloatRange(0.1, 50), default=1.0, show_default=True)
@click.option("--port", type=click.IntRange(1, 65535), default=14550, show_default=True, help="UDP port sent to.")
@click.option("--replan", is_flag=True, help="Leave the path once and report the detour.")
@click.option("--scene", type=click.Path(path_type=Path), help="Plan folder: stand at its home, see its structure.")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--obstacles", type=click.Path(path_type=Path), help="JSON file of obstacles that no plan knows.")
@click.option("--companion", type=int, metavar="PORT", help="UDP port of the first vehicle's companion; + 1 each.")
@click.argument("extra", nargs=-1, type=click.UNPROCESSED)
def simulate(
    autopilot: str,
    count: int,
    speedup: float,
    port: int,
    replan: bool,
    scene: Path | None,
    seed: int,
    obstacles: Path | None,
    companion: int | None,
    extra: tuple[str, ...],
) -> None:
    """Start simulated vehicles; runs until interrupted. Arguments after `--` go to the simulator as they are."""
    from gcs.services.simulation import SimulatorOptions, run_simulator
    from gcs.services.simulation_scene import scene_options

    options = SimulatorOptions(
        autopilot=autopilot,
        count=count,
        speedup=speedup,
        port=port,
        replan=replan,
        seed=seed,
        obstacles=obstacles,
        companion=companion,
        extra=extra,
    )
    with scene_options(options, scene) as placed:
        run_simulator(placed)


@cli.group()
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


@cli.command(name="inspect-mesh")
@click.argument("file", type=click.Path(path_type=Path))
def inspect_mesh(file: Path) -> None:
    """Say what the mesh in FILE is like."""
    from gcs.services.mesh_report import inspect_mesh as report

    for line in report(file).lines():
        click.echo(line)


@cli.command()
@connect_option
@click.option("--station", metavar="URL", help="Of the station that has the plans, such as http://127.0.0.1:8080.")
@click.option(
    "--token-file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Holds the station's session token. [default: that of this machine's data directory]",
)
@click.option(
    "--keep",
    type=click.Path(path_type=Path, file_okay=False),
    help="Where plans and undelivered reports are kept. [default: `companion` in the data directory]",
)
@click.option(
    "--plan", "plans", multiple=True, type=click.Path(path_type=Path), help="A plan's folder, to be kept (repeatable)."
)
@click.option(
    "--key-file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Holds the key that signs the link (`gcs signing export`). [default: that of the data directory, if any]",
)
@data_option
@click.option("--rate", type=click.FloatRange(20, 50), default=50.0, show_default=True, help="Setpoints per second.")
@click.option("--slab", type=click.FloatRange(0.1, 5), default=0.5, show_default=True, help="Lidar's half height, m.")
@click.option("--no-lidar", is_flag=True, help="Fly without scans: nothing is evaded.")
def companion(
    url: str,
    station: str | None,
    token_file: Path | None,
    keep: Path | None,
    plans: tuple[Path, ...],
    key_file: Path | None,
    data_dir: Path | None,
    rate: float,
    slab: float,
    no_lidar: bool,
) -> None:
    """Run beside an autopilot: fly plans by lease, evade what is not in them, and report; until interrupted."""
    from contextlib import suppress

    from gcs.services.companion.companion_options import CompanionOptions
    from gcs.services.companion.process import run_companion

    running = run_companion(
        url,
        station=station,
        token_file=token_file,
        keep=keep,
        plans=plans,
        options=CompanionOptions(stream_hz=rate, needs_lidar=not no_lidar, slab_half_m=slab),
        say=click.echo,
        data_dir=data_dir,
        key_file=key_file,
    )
    with suppress(KeyboardInterrupt):
        _run(running)


@cli.command()
@click.option("--host", default="127.0.0.1", show_default=True)
@click.option("--port", type=click.IntRange(0, 65535), default=8080, show_default=True)
@data_option
def serve(host: str, port: int, data_dir: Path | None) -> None:
    """Run the ground station: REST, live stream and dashboard."""
    from gcs.api.server import serve as run_server

    run_server(host, port, data_dir)


@cli.command()
@click.option("--stay", is_flag=True, help="Keep serving the dashboard afterwards.")
@click.option("--speedup", type=click.FloatRange(1, 50), default=12.0, show_default=True)
@click.option("--autopilot", type=click.Choice(["px4", "ardupilot"]), default="px4", show_default=True)
@click.option("--port", type=click.IntRange(0, 65535), help="Of the dashboard. [default: 8080 with --stay, else any]")
@data_option
def demo(stay: bool, speedup: float, autopilot: str, port: int | None, data_dir: Path | None) -> None:
    """Run the main job from nothing, on the sample crane and a simulated vehicle of its own."""
    from gcs.api.demo import run_demo

    if port is None:
        port = 8080 if stay else 0
    run_demo(stay=stay, speedup=speedup, autopilot=autopilot, port=port, data_dir=data_dir, say=click.echo)


@cli.command()
@click.argument("name", required=False)
@click.option("--quick", is_flag=True, help="A small version of the same, in seconds.")
@click.option("--mesh", type=click.Path(path_type=Path), help="A mesh of your own (coverage).")
@click.option("--records", type=click.Path(path_type=Path), help="A folder of recorded flights (predictions).")
@json_option
def bench(name: str | None, quick: bool, mesh: Path | None, records: Path | None, as_json: bool) -> None:
    """List the benchmarks, or run the one called NAME."""
    from gcs.services.benchmarks.registry import list_benchmarks, run_benchmark

    if name is None:
        for known, about in list_benchmarks().items():
            click.echo(f"{known:14s} {about}")
        return
    result: dict[str, Any] = run_benchmark(name, quick=quick, mesh=mesh, records=records)
    if not as_json:
        for row in result["rows"]:
            reference = "" if row["reference_value"] is None else f"   {row['reference']} {row['reference_value']:.6g}"
            click.echo(f"{row['case']:28s} {row['figure']:16s} {row['value']:.6g} {row['unit']}{reference}")
    click.echo(json.dumps(result) if as_json else "")


def _run(job: Coroutine[Any, Any, T]) -> T:
    import asyncio

    return asyncio.run(job)


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


def main() -> None:
    """Run the command line; whatever a user can mend becomes one line on standard error and its exit status."""
    try:
        cli.main(prog_name="gcs", standalone_mode=False)
        sys.stdout.flush()
    except GcsError as error:
        click.echo(f"gcs: {error}", err=True)
        sys.exit(error.exit_status)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(InputError.exit_status)
    except click.UsageError as error:
        command = "gcs" if error.ctx is None else error.ctx.command_path
        what = " ".join(error.format_message().split())
        click.echo(f"gcs: {what} See `{command} --help`.", err=True)
        sys.exit(InputError.exit_status)
    except BrokenPipeError:  # whoever read our output, such as `head`, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)


if __name__ == "__main__":
    main()
