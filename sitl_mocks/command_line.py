"""The command line of the simulated vehicles."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError, InputError
from gcs.core.frames import GeoPoint

if TYPE_CHECKING:
    from sitl_mocks.positioning import Box


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sitl_mocks", description="Simulated vehicles that speak MAVLink.")
    add = parser.add_argument
    add("--autopilot", choices=("px4", "ardupilot"), default="px4", help="whose behaviour to show (px4)")
    add("--count", type=int, default=1, help="number of vehicles (1)")
    add("--first-system-id", type=int, default=1, help="system id of the first vehicle (1)")
    add("--speedup", type=float, default=1.0, help="how much faster than the wall the vehicles' clocks run (1)")
    add("--host", default="127.0.0.1", help="where to send to, and where TCP listens (127.0.0.1)")
    add("--port", type=int, default=14550, help="UDP port to send to (14550)")
    add(
        "--tcp-base",
        default="5760",
        help="ardupilot: vehicle i listens on this TCP port + 10 (i - 1); 0 for any free ones, none for no TCP (5760)",
    )
    add("--replan", action="store_true", help="leave the path once, 2 m upward, and report it")
    add("--home", metavar="LAT,LON,ALT", help="where the first vehicle stands (20 m west and south of the anchor)")
    add("--anchor", metavar="LAT,LON,ALT", default="31.3622,121.6155,4.0", help="origin of the scene (%(default)s)")
    add("--structure", type=Path, metavar="FILE", help="mesh (PLY, STL) in scene coordinates that the camera sees")
    add("--images-dir", type=Path, metavar="DIR", help="write the pictures here too, as a card would hold them")
    add("--loss", type=float, default=0.0, help="packet loss each way, 0 to 1 (0)")
    add("--duplicate", type=float, default=0.0, help="share of packets that come twice (0)")
    add("--delay", type=float, default=0.0, help="packets are late by up to this many seconds, at random (0)")
    add("--latency", type=float, default=0.0, help="packets take at least this many seconds (0)")
    add(
        "--fault",
        action="append",
        default=[],
        metavar="NAME",
        help="switch a fault on (repeatable; a wrong name lists them)",
    )
    add("--seed", type=int, default=0, help="of sensor noise, gusts and link faults (0)")
    add("--param", action="append", default=[], metavar="NAME=VALUE", help="set a parameter (repeatable)")
    add("--parameter-count", type=int, default=0, help="how many parameters at least, most of them without a meaning")
    add("--mission-items", type=int, default=0, help="how many items a mission may have (px4 10000, ardupilot 650)")
    add("--real-start", action="store_true", help="start as slowly as the real ones did (px4 5 s, ardupilot 41 s)")
    add("--uid", default="", metavar="HEX", help="hardware id for AUTOPILOT_VERSION.uid2, at most 18 bytes")
    add("--battery-wh", type=float, default=130.0, help="capacity of the battery (130)")
    add("--wind", default="0,0", metavar="EAST,NORTH[,UP]", help="velocity of the air in m/s (0,0)")
    add("--gusts", type=float, default=0.0, metavar="M_S", help="standard deviation of the wind in m/s, by --seed (0)")
    add("--body", choices=("usual", "sih"), default="usual", help="sih: as much drag as PX4's own simulation (usual)")
    add("--no-picture-files", action="store_true", help="the camera serves no files: it sends pictures when asked")
    add("--obstacles", type=Path, metavar="FILE", help="JSON file of obstacles that the lidar sees and no plan knows")
    add("--companion", type=int, metavar="PORT", help="vehicle i's companion listens on this UDP port + i - 1 here")
    add(
        "--hidden",
        action="append",
        default=[],
        metavar="E,N,U,E,N,U",
        help="box without satellites, low and high corner in the scene in m (repeatable)",
    )
    add("--sights", metavar="OBSERVER,SEEN", help="system ids: the first vehicle tells where it sees the second")
    add("--lidar-3d", action="store_true", help="the lidar sends OBSTACLE_DISTANCE_3D too")
    add("--control-port", type=int, metavar="PORT", help="UDP port on loopback for tests; 0 for any free port")
    add("--exit-with-parent", action="store_true", help="end when the process that started this one has ended")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run simulated vehicles, or `replay` a recorded log; returns the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == ["replay"]:
        from sitl_mocks.replay import main as replay

        return replay(arguments[1:])
    given = _parser().parse_args(arguments)
    try:
        return _run(given)
    except GcsError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return error.exit_status


def _run(given: argparse.Namespace) -> int:
    from sitl_mocks.channel import LinkFaults
    from sitl_mocks.mission_faults import check_fault
    from sitl_mocks.obstacle_file import read_obstacles
    from sitl_mocks.simulator import Simulator, SimulatorOptions

    if not 0.0 < given.speedup <= 100.0:
        raise InputError("must be above 0 and at most 100", field="--speedup")
    if given.count < 1 or given.first_system_id < 1 or given.first_system_id + given.count - 1 > 250:
        raise InputError("system ids must lie in 1 to 250", field="--count")
    for name in ("loss", "duplicate"):
        if not 0.0 <= getattr(given, name) <= 1.0:
            raise InputError("must be between 0 and 1", field=f"--{name}")
    if given.structure is not None and not given.structure.is_file():
        raise InputError(f"there is no file {given.structure}", field="--structure")
    if not 0.0 <= given.gusts <= 30.0:
        raise InputError("must be between 0 and 30", field="--gusts")
    if given.companion is not None and not 1 <= given.companion <= 65536 - given.count:
        raise InputError("must leave every vehicle a port in 1 to 65535", field="--companion")
    wind = _numbers(given.wind, "--wind", {2, 3})
    options = SimulatorOptions(
        autopilot=given.autopilot,
        count=given.count,
        first_system_id=given.first_system_id,
        speedup=given.speedup,
        host=given.host,
        port=given.port,
        tcp_base=_tcp_base(given.tcp_base),
        replan=given.replan,
        home=None if given.home is None else GeoPoint(*_numbers(given.home, "--home", {3})),
        anchor=GeoPoint(*_numbers(given.anchor, "--anchor", {3})),
        structure=given.structure,
        faults=LinkFaults(given.loss, given.duplicate, given.delay, latency_s=given.latency),
        named_faults=tuple(check_fault(name) for name in given.fault),
        seed=given.seed,
        parameters=tuple(_parameter(text) for text in given.param),
        parameter_count=_count(given.parameter_count, "--parameter-count"),
        mission_items=_count(given.mission_items, "--mission-items"),
        real_start=given.real_start,
        uid=_uid(given.uid),
        images_dir=given.images_dir,
        battery_wh=given.battery_wh,
        wind_m_s=(wind[0], wind[1], wind[2] if len(wind) > 2 else 0.0),
        gust_m_s=given.gusts,
        body=given.body,
        serves_pictures=not given.no_picture_files,
        control_port=given.control_port,
        exit_with_parent=given.exit_with_parent,
        obstacles=() if given.obstacles is None else read_obstacles(given.obstacles),
        companion_port=given.companion,
        lidar_3d=given.lidar_3d,
        hidden=tuple(_box(text) for text in given.hidden),
        sights=None if given.sights is None else _sights(given.sights, given.first_system_id, given.count),
    )
    simulator = Simulator(options)
    try:
        for line in simulator.open():
            print(line, flush=True)
        simulator.run()
    finally:
        simulator.close()
    return 0


def _numbers(text: str, field: str, sizes: set[int]) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in sizes:
        raise InputError(f"{text!r} is not {' or '.join(map(str, sorted(sizes)))} numbers with commas", field=field)
    return numbers


def _box(text: str) -> Box:
    east, north, up, to_east, to_north, to_up = _numbers(text, "--hidden", {6})
    return (east, north, up), (to_east, to_north, to_up)


def _sights(text: str, first: int, count: int) -> tuple[int, int]:
    observer, seen = (int(number) for number in _numbers(text, "--sights", {2}))
    if observer == seen or not all(first <= system_id < first + count for system_id in (observer, seen)):
        raise InputError("must be the system ids of two of these vehicles", field="--sights")
    return observer, seen


def _count(number: int, field: str) -> int:
    if not 0 <= number < 2**15:
        raise InputError("must be between 0 and 32767", field=field)
    return number


def _tcp_base(text: str) -> int | None:
    if text == "none":
        return None
    if not text.isdigit() or int(text) > 65000:
        raise InputError(f"{text!r} is neither a port nor `none`", field="--tcp-base")
    return int(text)


def _parameter(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise InputError(f"{text!r} is not NAME=VALUE with a number", field="--param") from None


def _uid(text: str) -> bytes:
    try:
        uid = bytes.fromhex(text)
    except ValueError:
        uid = bytes(19)
    if len(uid) > 18:
        raise InputError(f"{text!r} is not at most 18 bytes in hexadecimal digits", field="--uid")
    return uid
