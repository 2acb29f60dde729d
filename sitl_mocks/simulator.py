"""The process: vehicles, their sockets and the clock that drives them."""

from __future__ import annotations

import math
import os
import selectors
import signal
import socket
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from gcs.core.frames import GeoPoint
from sitl_mocks.airframe import Airframe, FlightLimits, FlightSetpoint
from sitl_mocks.ardupilot import ArduPilotVehicle
from sitl_mocks.channel import LinkFaults
from sitl_mocks.control_port import ControlPort
from sitl_mocks.lidar import LIDAR_STATES, ODOMETRY_STATES, LidarOptions
from sitl_mocks.link_faults import ChangingLink, link_changes
from sitl_mocks.links import TcpClient, UdpLink, listen, watch
from sitl_mocks.obstacles import Obstacle
from sitl_mocks.picture import Exposure, Scene, jpeg, load_scene, render
from sitl_mocks.positioning import Box
from sitl_mocks.px4 import Px4Vehicle
from sitl_mocks.scene_frame import SceneFrame
from sitl_mocks.sighting_sensor import SensorErrors, SightingSensor
from sitl_mocks.truth import truth
from sitl_mocks.vehicle import LOGIC_S, SimulatedVehicle
from sitl_mocks.vehicle_options import VehicleOptions

KINDS: dict[str, type[SimulatedVehicle]] = {"px4": Px4Vehicle, "ardupilot": ArduPilotVehicle}
_TICK_RANGE_S = (0.003, LOGIC_S)
_MOST_CATCH_UP_S = 0.25
_PARENT_CHECK_S = 0.5
_SPACING_M = 3.0


@dataclass(frozen=True)
class SimulatorOptions:
    """What to simulate; see the command line's help."""

    autopilot: str = "px4"
    count: int = 1
    first_system_id: int = 1
    speedup: float = 1.0
    host: str = "127.0.0.1"
    port: int = 14550
    tcp_base: int | None = 5760
    replan: bool = False
    home: GeoPoint | None = None
    anchor: GeoPoint = field(default_factory=lambda: GeoPoint(31.3622, 121.6155, 4.0))
    structure: Path | None = None
    faults: LinkFaults = field(default_factory=LinkFaults)
    seed: int = 0
    parameters: tuple[tuple[str, float], ...] = ()
    parameter_count: int = 0
    mission_items: int = 0
    real_start: bool = False
    uid: bytes = b""
    images_dir: Path | None = None
    battery_wh: float = 130.0
    wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust_m_s: float = 0.0
    body: str = "usual"
    serves_pictures: bool = True
    control_port: int | None = None
    exit_with_parent: bool = False
    named_faults: tuple[str, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    companion_port: int | None = None
    lidar_3d: bool = False
    hidden: tuple[Box, ...] = ()
    sights: tuple[int, int] | None = None
    sensor_errors: SensorErrors = field(default_factory=SensorErrors)


class Member:
    """One vehicle with its links.

    Args:
        vehicle: it.
        faults: of its links.
        changes: of these faults.
    """

    def __init__(self, vehicle: SimulatedVehicle, faults: LinkFaults, changes: ChangingLink) -> None:
        self.vehicle = vehicle
        self.faults = faults
        self.changes = changes
        self.links: list[UdpLink | TcpClient] = []
        self.gone = False


class Simulator:
    """Runs vehicles until told to stop.

    Args:
        options: what to simulate.
        clock: the wall's monotonic clock.
    """

    def __init__(self, options: SimulatorOptions, clock: Callable[[], float] = time.monotonic) -> None:
        self._options = options
        self._clock = clock
        self._selector = selectors.DefaultSelector()
        self._servers: list[socket.socket] = []
        self._members: dict[int, Member] = {}
        self._control: ControlPort | None = None
        self._sensor: SightingSensor | None = None
        self._stopping = False
        self._last_s = clock()
        self._arrivals: list[tuple[float, UdpLink, bytes]] = []
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="camera")
        self._parent = os.getppid()

    def open(self) -> list[str]:
        """Make the vehicles and open their sockets.

        Returns:
            A line for each vehicle, and one for the control port.

        Raises:
            GcsError: a port is taken, a file or a parameter is wrong.
        """
        o = self._options
        home = o.home or SceneFrame(o.anchor, o.anchor).geo(np.array([-20.0, -20.0, 0.0]))
        home_m = SceneFrame(o.anchor, home).origin_m
        scene = load_scene(o.structure, float(home_m[2]))
        _warm_up(scene)
        lines = []
        for i in range(o.count):
            system_id = o.first_system_id + i
            place = home_m + np.array([0.0, -_SPACING_M * i, 0.0])

            def draw(exposure: Exposure, system_id: int = system_id) -> Future[bytes]:
                return self._pool.submit(self._draw, scene, exposure, system_id)

            options = VehicleOptions(
                system_id=system_id,
                anchor=o.anchor,
                home=SceneFrame(o.anchor, home).geo(place) if i else home,
                draw=draw,
                seed=o.seed + i,
                parameters=o.parameters,
                parameter_count=o.parameter_count,
                mission_items=o.mission_items,
                real_start=o.real_start,
                uid=o.uid,
                battery_wh=o.battery_wh,
                wind_m_s=o.wind_m_s,
                gust_m_s=o.gust_m_s,
                body=o.body,
                serves_pictures=o.serves_pictures,
                replan=o.replan,
                faults=o.named_faults,
                unix_start_s=time.time(),
                hidden=o.hidden,
                obstacles=o.obstacles,
                lidar=LidarOptions(tells_3d=o.lidar_3d, seed=o.seed + i),
            )
            faults = replace(o.faults)
            changes = ChangingLink(faults, link_changes(o.named_faults, Random(o.seed + i)), self._clock())
            member = Member(KINDS[o.autopilot](options), faults, changes)
            self._members[system_id] = member
            lines.append(self._open_links(member, i))
        if o.sights is not None:
            observer, seen = (self._members[system_id] for system_id in o.sights)
            self._sensor = SightingSensor(observer.vehicle, lambda: seen.vehicle, o.sensor_errors, o.seed)
        if o.control_port is not None:
            self._control = ControlPort(o.control_port, self.command)
            watch(self._selector, self._control.socket, self._control.read)
            lines.append(f"control: udp 127.0.0.1:{self._control.port}")
        return lines

    def run(self) -> None:
        """Let time pass until a signal comes, or the parent has ended."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._stop)
        o = self._options
        tick_s = min(max(LOGIC_S / o.speedup, _TICK_RANGE_S[0]), _TICK_RANGE_S[1])
        self._last_s = self._clock()
        next_tick = self._last_s + tick_s
        next_parent_check = self._last_s
        while not self._stopping:
            self._read(max(0.0, min(next_tick, self._next_release_s()) - self._clock()))
            now = self._clock()
            self._read(0.0)  # no time may pass before what had come in by then is known
            self._deliver()
            self._release(now)
            if now < next_tick:
                continue
            next_tick = max(next_tick + tick_s, now)
            self._advance(now)
            if o.exit_with_parent and now >= next_parent_check:
                next_parent_check = now + _PARENT_CHECK_S
                self._stopping = self._stopping or os.getppid() != self._parent

    def _next_release_s(self) -> float:
        return min((link.next_s for member in self._members.values() for link in member.links), default=math.inf)

    def _release(self, wall_s: float) -> None:
        for member in self._members.values():
            for link in member.links:
                link.release(wall_s)

    def _read(self, timeout_s: float) -> None:
        for key, _ in self._selector.select(timeout_s):
            key.data()

    def _deliver(self) -> None:
        """Let the vehicles hear what has come in, each packet at the time at which it came."""
        arrivals, self._arrivals = sorted(self._arrivals, key=lambda a: a[0]), []
        for wall_s, link, data in arrivals:
            self._advance(wall_s)
            link.deliver(data, max(wall_s, self._last_s))

    def _advance(self, wall_s: float) -> None:
        """Let time pass until a wall time; after a long stall the vehicles' clocks slip rather than race."""
        elapsed = wall_s - self._last_s
        if elapsed > 0.0:
            self._last_s = wall_s
            self.step(min(elapsed, _MOST_CATCH_UP_S) * self._options.speedup, wall_s)

    def step(self, dt_s: float, wall_s: float) -> None:
        """Let time pass for all vehicles."""
        for member in self._members.values():
            if member.gone:
                continue
            member.changes.step(wall_s)
            member.vehicle.step(dt_s, wall_s)
            for link in list(member.links):
                link.release(wall_s)
                if isinstance(link, TcpClient) and link.closed:
                    self._drop(member, link)
        if self._sensor is not None:
            self._sensor.step()

    def close(self) -> None:
        """Close all sockets."""
        for member in self._members.values():
            for link in member.links:
                link.close()
        for server in self._servers:
            server.close()
        if self._control is not None:
            self._control.close()
        self._selector.close()
        self._pool.shutdown(cancel_futures=True)

    # Links -----------------------------------------------------------------------------------------------------------

    def _open_links(self, member: Member, index: int) -> str:
        o = self._options
        vehicle = member.vehicle
        self._open_udp(member, (o.host, o.port), member.faults, o.seed * 1000 + vehicle.system_id * 10)
        line = f"vehicle {vehicle.system_id} {vehicle.kind} ready: udp -> {o.host}:{o.port}"
        if o.autopilot == "ardupilot" and o.tcp_base is not None:
            server = listen(o.host, 0 if o.tcp_base == 0 else o.tcp_base + 10 * index)
            self._servers.append(server)
            watch(self._selector, server, lambda: self._accept(member, server))
            line += f", tcp {o.host}:{server.getsockname()[1]}"
        if o.companion_port is not None:
            port = o.companion_port + index
            cable = self._open_udp(member, ("127.0.0.1", port), LinkFaults(), 0)
            cable.channel.leads_to_companion = True
            line += f", companion udp -> 127.0.0.1:{port}"
        return line

    def _open_udp(self, member: Member, address: tuple[str, int], faults: LinkFaults, seed: int) -> UdpLink:
        link = UdpLink(
            member.vehicle.system_id,
            address,
            faults,
            seed,
            lambda message, channel: self._take(member, message, channel),
            self._clock,
        )
        member.links.append(link)
        member.vehicle.add_channel(link.channel)
        watch(self._selector, link.socket, lambda: self._arrivals.extend((t, link, data) for t, data in link.read()))
        return link

    def _accept(self, member: Member, server: socket.socket) -> None:
        try:
            connection, _ = server.accept()
        except OSError:
            return
        client = TcpClient(
            member.vehicle.system_id,
            connection,
            member.faults,
            self._options.seed * 1000 + len(member.links),
            lambda message, channel: self._take(member, message, channel),
            self._clock,
        )
        member.links.append(client)
        member.vehicle.add_channel(client.channel)
        watch(self._selector, connection, client.read)

    def _drop(self, member: Member, link: TcpClient) -> None:
        self._selector.unregister(link.socket)
        link.close()
        member.links.remove(link)
        member.vehicle.remove_channel(link.channel)

    @staticmethod
    def _take(member: Member, message: Any, channel: Any) -> None:
        if not member.gone:
            member.vehicle.handle(message, channel)

    # Camera ----------------------------------------------------------------------------------------------------------

    def _draw(self, scene: Scene, exposure: Exposure, system_id: int) -> bytes:
        picture = jpeg(render(scene, exposure), exposure)
        if self._options.images_dir is not None:
            folder = self._options.images_dir / f"vehicle-{system_id}"
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"IMG_{exposure.index + 1:04d}.JPG").write_bytes(picture)
        return picture

    # Control ---------------------------------------------------------------------------------------------------------

    def command(self, system_id: int | None, name: str, arguments: list[str]) -> dict[str, Any]:
        """Carry out a command of the control port.

        Raises:
            ValueError: it is not understood.
        """
        member = self._members.get(self._options.first_system_id if system_id is None else system_id)
        if member is None:
            raise ValueError(f"there is no vehicle {system_id}")
        vehicle = member.vehicle
        if name == "state":
            return {**truth(vehicle), "gone": member.gone}
        if name == "mode":
            if not vehicle.set_mode_by_name(arguments[0]):
                raise ValueError(f"mode {arguments[0]} was refused")
        elif name in {"loss", "duplicate"}:
            setattr(member.faults, name, float(arguments[0]))
        elif name == "delay":
            member.faults.delay_s = float(arguments[0])
        elif name in {"kill-link", "restore-link"}:
            member.faults.cut = name == "kill-link"
        elif name == "vanish":
            member.gone = True
        elif name == "reboot":
            self._reboot(member)
        elif name == "clear-mission":
            vehicle.missions.clear()
        elif name == "battery":
            vehicle.airframe.battery.used_wh = (1.0 - float(arguments[0])) * vehicle.airframe.battery.capacity_wh
        elif name == "param":
            vehicle.parameters.override(arguments[0], float(arguments[1]))
        elif name == "lidar":
            vehicle.lidar.state = _one_of(arguments[0], LIDAR_STATES)
        elif name == "odometry":
            vehicle.lidar.odometry_state = _one_of(arguments[0], ODOMETRY_STATES)
        else:
            raise ValueError(f"unknown command {name}")
        return {}

    def _reboot(self, member: Member) -> None:
        old = member.vehicle
        place = old.airframe.position_m
        place[2] = old.airframe.ground_m
        options = replace(old.options, home=old.frame.geo(place), unix_start_s=old.unix_s, replan=False)
        fresh = type(old)(options)
        fresh.parameters = old.parameters
        fresh.missions.keep_from(old.missions)
        fresh.folder.files.update(old.folder.files)
        fresh.signing_key = old.signing_key
        fresh.airframe.battery.used_wh = old.airframe.battery.used_wh
        for link in member.links:
            link.channel.streams.clear()
            fresh.add_channel(link.channel)
        member.vehicle = fresh

    def _stop(self, number: int, frame: object) -> None:
        del number, frame
        self._stopping = True


def _one_of(word: str, words: tuple[str, ...]) -> str:
    if word not in words:
        raise ValueError(f"{word} is none of {', '.join(words)}")
    return word


def _warm_up(scene: Scene) -> None:
    """Compile, or load from caches, what is needed in flight, before the clock starts to run."""
    exposure = Exposure(0, 0, np.array([0.0, 0.0, 9.0]), GeoPoint(0.0, 0.0, 9.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    jpeg(render(scene, exposure), exposure)
    airframe = Airframe(np.zeros(3), FlightLimits(5.0, 5.0, 5.0, 3.0, 3.0, 8.0))
    airframe.go_to(np.array([0.0, 0.0, 1.0]))
    airframe.step(2)
    airframe.follow(FlightSetpoint(np.zeros(3), np.zeros(3), np.zeros(3)))
    airframe.step(2)
