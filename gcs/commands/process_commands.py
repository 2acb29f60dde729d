"""Commands that run until interrupted: the station, its demonstration, companions and simulated vehicles."""

from __future__ import annotations

from pathlib import Path

import click

from gcs.commands.shared_options import connect_option, data_option, run


@click.command()
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
        run(running)


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True)
@click.option("--port", type=click.IntRange(0, 65535), default=8080, show_default=True)
@data_option
def serve(host: str, port: int, data_dir: Path | None) -> None:
    """Run the ground station: REST, live stream and dashboard."""
    from gcs.api.server import serve as run_server

    run_server(host, port, data_dir)


@click.command()
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


@click.command()
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
