"""The process as a user starts it, and MAVSDK as an independent client of it."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.system

ROOT = Path(__file__).resolve().parents[2]
CLIENT = Path(__file__).with_name("mavsdk_client.py")


class Process:
    def __init__(self, *arguments):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            s.bind(("127.0.0.1", 0))
            self.port = s.getsockname()[1]
        line = [sys.executable, "-m", "sitl_mocks", "--port", str(self.port), "--control-port", "0", *arguments]
        self.process = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        self.lines = []
        while not self.lines or not self.lines[-1].startswith("control:"):
            text = self.process.stdout.readline()
            assert text, "it ended before it was ready"
            self.lines.append(text.strip())
        self.control = int(self.lines[-1].rsplit(":", 1)[1])

    def ask(self, line):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            s.settimeout(120.0)
            s.sendto(line.encode(), ("127.0.0.1", self.control))
            return json.loads(s.recv(65535))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


def test_says_when_it_is_ready_and_ends_cleanly():
    with Process("--autopilot", "ardupilot", "--count", "2", "--first-system-id", "5", "--tcp-base", "0") as sim:
        assert sim.lines[0].startswith(f"vehicle 5 ardupilot ready: udp -> 127.0.0.1:{sim.port}, tcp 127.0.0.1:")
        assert sim.lines[1].startswith("vehicle 6 ardupilot ready:")
        assert sim.ask("6 state")["system_id"] == 6
        sim.process.send_signal(signal.SIGTERM)
        assert sim.process.wait(120.0) == 0


def test_ends_with_the_process_that_started_it():
    starter = (
        "import subprocess, sys\n"
        "p = subprocess.Popen([sys.executable, '-m', 'sitl_mocks', '--port', '9', '--exit-with-parent'],"
        " stdout=subprocess.PIPE, text=True)\n"
        "p.stdout.readline()\n"
        "print(p.pid, flush=True)\n"
    )
    ended = subprocess.run([sys.executable, "-c", starter], cwd=ROOT, capture_output=True, text=True, check=True)
    pid = int(ended.stdout)
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        try:
            stat = Path(f"/proc/{pid}/stat").read_text()
        except FileNotFoundError:
            return
        if stat.split()[2] == "Z":
            return
        time.sleep(0.1)
    os.kill(pid, signal.SIGKILL)
    raise AssertionError("it went on without its parent")


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_mavsdk_connects_and_reads_back_the_mission_it_wrote(kind):
    pytest.importorskip("mavsdk")
    with Process("--autopilot", kind, "--tcp-base", "none") as sim:
        ran = subprocess.run(
            [sys.executable, str(CLIENT), str(sim.port), kind], capture_output=True, text=True, timeout=120, check=False
        )
        assert ran.returncode == 0, ran.stderr[-2000:]
        result = json.loads(ran.stdout.strip().splitlines()[-1])
        assert result["back"] == result["sent"]
        assert sim.ask("state")["mission_items"] == len(result["sent"])
