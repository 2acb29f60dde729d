"""Simulated vehicles as processes: their command line, their start and their end."""

import subprocess
import sys
import time
from dataclasses import dataclass

import pytest

from gcs.core.errors import InputError, LinkError
from gcs.core.frames import GeoPoint
from gcs.services import simulation
from gcs.services.simulation import Simulator, SimulatorOptions, run_simulator


@dataclass(frozen=True)
class Scripted(SimulatorOptions):
    """A process that runs a few lines of Python instead."""

    script: str = ""

    def command(self):
        return [sys.executable, "-u", "-c", self.script]


WAIT = "import time; time.sleep(60)"


def test_the_command_line_says_all_that_was_asked(tmp_path):
    place = GeoPoint(31.3622, 121.6155, 4.0)
    line = SimulatorOptions(
        autopilot="ardupilot",
        count=3,
        speedup=4.0,
        port=14999,
        replan=True,
        home=place,
        anchor=place,
        structure=tmp_path / "s.ply",
        uid="0011",
        seed=7,
        extra=("--tcp-base", "none"),
    ).command()
    assert line[1:3] == ["-m", "sitl_mocks"]
    words = " ".join(line)
    for part in (
        *("--autopilot ardupilot", "--count 3", "--speedup 4.0", "--port 14999", "--replan", "--seed 7", "--uid 0011"),
        *("--home=31.362200000,121.615500000,4.0000", "--anchor=31.3", f"--structure {tmp_path}/s.ply"),
    ):
        assert part in words
    assert line[-2:] == ["--tcp-base", "none"]


def test_a_minus_sign_of_a_place_is_no_option():
    line = SimulatorOptions(home=GeoPoint(-33.0, -70.0, 500.0)).command()
    assert "--home=-33.000000000,-70.000000000,500.0000" in line


def test_it_waits_until_all_vehicles_are_ready_and_ends_them():
    script = f"print('vehicle 1 ready'); print('vehicle 2 ready'); {WAIT}"
    simulator = Simulator(Scripted(count=2, script=script))
    with simulator:
        assert simulator.output == ["vehicle 1 ready", "vehicle 2 ready"]
        process = simulator._process
        assert process.poll() is None
    assert process.poll() is not None


def test_one_of_two_vehicles_is_not_enough(monkeypatch):
    monkeypatch.setattr(simulation, "READY_TIMEOUT_S", 0.5)
    simulator = Simulator(Scripted(count=2, script=f"print('vehicle 1 ready'); {WAIT}"))
    with pytest.raises(LinkError, match="did not start: vehicle 1 ready"), simulator:
        pass
    assert simulator._process.poll() is not None


def test_a_simulator_that_ends_at_once_says_why():
    with (
        pytest.raises(LinkError, match=r"did not start: .*port 5760 is taken"),
        Simulator(Scripted(script="import sys; sys.exit('port 5760 is taken')")),
    ):
        pass


def test_one_that_ignores_the_end_is_killed(monkeypatch):
    waited = subprocess.Popen.wait
    monkeypatch.setattr(
        subprocess.Popen, "wait", lambda self, timeout=None: waited(self, None if timeout is None else 0.3)
    )
    script = f"import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('vehicle 1 ready'); {WAIT}"
    started = time.monotonic()
    with Simulator(Scripted(script=script)) as simulator:
        pass
    assert simulator._process.returncode == -9
    assert time.monotonic() - started < 30


def test_in_the_foreground_until_it_ends():
    run_simulator(Scripted(script="pass"))
    with pytest.raises(LinkError, match="status 3"):
        run_simulator(Scripted(script="import sys; sys.exit(3)"))
    with pytest.raises(InputError, match="arguments"):
        run_simulator(Scripted(script="import sys; sys.exit(2)"))


def test_an_interrupt_ends_it_without_a_fault(monkeypatch):
    waits = iter([KeyboardInterrupt])
    waited = subprocess.Popen.wait

    def wait(self, timeout=None):
        for interrupt in waits:
            raise interrupt
        return waited(self, timeout)

    monkeypatch.setattr(subprocess.Popen, "wait", wait)
    run_simulator(Scripted(script=WAIT))


@pytest.mark.system
def test_arguments_that_the_simulator_does_not_know(capfd):
    with pytest.raises(InputError, match="does not take these arguments"):
        run_simulator(SimulatorOptions(extra=("--nonsense",)))
    assert "--nonsense" in capfd.readouterr().err
