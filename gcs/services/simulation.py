"""Simulated vehicles as processes of their own: started, waited for, and ended with the program that started them."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import InputError, LinkError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from types import TracebackType

    from gcs.core.frames import GeoPoint

READY_TIMEOUT_S = 60.0
USAGE_STATUS = 2
"""What a process ends with that was given arguments it does not know."""


@dataclass(frozen=True)
class SimulatorOptions:
    """What to simulate; see `gcs simulate --help`.

    Attributes:
        home: where the vehicles stand; None for the default of the simulator.
        anchor: the scene's origin, for the pictures; None for the default.
        structure: file with the structure in the scene frame that the camera sees.
        uid: hardware id reported by the vehicle, so that it can be told from any other on the same port.
        obstacles: JSON file of what the lidar sees and no plan knows.
        companion: UDP port on this machine on which the first vehicle's companion listens.
        extra: further arguments of `python -m sitl_mocks`, as they are.
    """

    autopilot: str = "px4"
    count: int = 1
    speedup: float = 1.0
    port: int = 14550
    replan: bool = False
    home: GeoPoint | None = None
    anchor: GeoPoint | None = None
    structure: Path | None = None
    uid: str | None = None
    seed: int = 0
    obstacles: Path | None = None
    companion: int | None = None
    extra: Sequence[str] = ()

    def command(self) -> list[str]:
        """The command line of the process."""
        line = [sys.executable, "-m", "sitl_mocks", "--exit-with-parent"]
        line += ["--autopilot", self.autopilot, "--count", str(self.count), "--port", str(self.port)]
        line += ["--speedup", str(self.speedup), "--seed", str(self.seed)]
        if self.replan:
            line.append("--replan")
        for name, point in (("--home", self.home), ("--anchor", self.anchor)):
            if point is not None:
                line.append(f"{name}={point.latitude_deg:.9f},{point.longitude_deg:.9f},{point.altitude_m:.4f}")
        if self.structure is not None:
            line += ["--structure", str(self.structure)]
        if self.uid is not None:
            line += ["--uid", self.uid]
        if self.obstacles is not None:
            line += ["--obstacles", str(self.obstacles)]
        if self.companion is not None:
            line += ["--companion", str(self.companion)]
        return [*line, *self.extra]


class Simulator:
    """A running `sitl_mocks` process; a context manager that ends it."""

    def __init__(self, options: SimulatorOptions) -> None:
        self._options = options
        self._process: subprocess.Popen[str] | None = None
        self._lines: deque[str] = deque(maxlen=200)
        self._ready = False
        self._ready_or_ended = threading.Event()
        self._reader: threading.Thread | None = None

    def __enter__(self) -> Simulator:
        self._process = subprocess.Popen(
            self._options.command(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._ready_or_ended.wait(READY_TIMEOUT_S)
        if not self._ready or self._process.poll() is not None:
            self.__exit__(None, None, None)
            said = " / ".join(list(self._lines)[-3:]) or "it said nothing"
            raise LinkError(f"the simulated vehicle did not start: {said}", field="gcs simulate")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        process = self._process
        if process is None:
            return
        process.terminate()
        try:
            process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if self._reader is not None:
            self._reader.join(timeout=2)
        if process.stdout is not None:
            process.stdout.close()

    @property
    def output(self) -> list[str]:
        """The last lines the process printed."""
        return list(self._lines)

    def _read(self) -> None:
        process = self._process
        if process is None or process.stdout is None:
            return
        ready = 0
        for line in process.stdout:
            self._lines.append(line.rstrip())
            ready += " ready" in line
            if ready >= self._options.count:
                self._ready = True
                self._ready_or_ended.set()
        self._ready_or_ended.set()


def run_simulator(options: SimulatorOptions) -> None:
    """Run simulated vehicles in the foreground until interrupted.

    Raises:
        InputError: the simulator does not know one of the extra arguments.
        LinkError: the process ended by itself with an error.
    """
    process = subprocess.Popen(options.command())
    try:
        status = process.wait()
    except KeyboardInterrupt:
        process.terminate()
        process.wait()
        return
    if status == USAGE_STATUS:
        raise InputError("the simulator does not take these arguments: see what it says above", field="gcs simulate")
    if status != 0:
        raise LinkError(f"the simulated vehicle ended with status {status}", field="gcs simulate")
