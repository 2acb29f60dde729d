"""Jobs on real worker processes, which import the functions of this module by pickle."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from gcs.core.errors import GcsError, InfeasibleError, OperationCancelled
from gcs.jobs.planning_jobs import NICENESS, PlanningJobs

pytestmark = pytest.mark.system

WAIT_S = 60.0
LONG_BEFORE_S = 15.0
"""A second is asked for, which a busy machine may take longer for; without the cancel a job goes on for a minute."""
LOOKS_AWAY_S = 8.0


def add(progress, a, b):
    progress.report("adding", 0.5)
    progress.report("adding", 1.0)
    return a + b, os.getpid()


def priorities(progress):
    with ThreadPoolExecutor(1) as pool:
        return [os.getpriority(os.PRIO_PROCESS, 0), pool.submit(os.getpriority, os.PRIO_PROCESS, 0).result()]


def refuse(progress):
    raise InfeasibleError("nothing fits", field="safety.clearance_m")


def fault(progress):
    return 1 / 0


def die(progress):
    os.kill(os.getpid(), signal.SIGKILL)


def work_for_long(progress):
    end = time.monotonic() + WAIT_S
    while time.monotonic() < end:
        progress.report("working", (end - time.monotonic()) / WAIT_S)
        time.sleep(0.05)
    return "ran to its end"


def look_away(progress):
    progress.report("looking away", 0.0)
    time.sleep(LOOKS_AWAY_S)
    progress.report("looking again", 0.0)
    return "ran to its end"


@pytest.fixture
async def jobs():
    jobs = PlanningJobs(workers=1)
    yield jobs
    await jobs.close()


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


async def ended(pid):
    for _ in range(100):
        if not alive(pid):
            return True
        await asyncio.sleep(0.1)
    return False


async def test_jobs_run_in_a_process_of_their_own_tell_how_far_they_are_and_end_with_the_station(jobs):
    told = []
    result, pid = await jobs.run("job-1", add, 2, 3, tell=lambda *report: told.append(report))
    assert result == 5
    assert pid != os.getpid()
    assert ("adding", 1.0) in told

    with pytest.raises(InfeasibleError, match="nothing fits") as caught:
        await jobs.run("job-2", refuse, tell=lambda *_: None)
    assert caught.value.field == "safety.clearance_m"
    assert caught.value.exit_status == 3

    with pytest.raises(ZeroDivisionError):
        await jobs.run("job-3", fault, tell=lambda *_: None)

    await jobs.close()
    assert await ended(pid)


async def test_a_cancel_is_obeyed_at_once_also_by_a_job_that_waits(jobs):
    begun = asyncio.Event()
    running = asyncio.create_task(
        jobs.run("long", work_for_long, tell=lambda stage, _: begun.set() if stage == "working" else None)
    )
    waiting = asyncio.create_task(jobs.run("queued", work_for_long, tell=lambda *_: None))
    await asyncio.wait_for(begun.wait(), WAIT_S)

    asked = time.monotonic()
    await jobs.cancel("queued")
    with pytest.raises(OperationCancelled):
        await waiting
    assert time.monotonic() - asked < LONG_BEFORE_S

    asked = time.monotonic()
    await jobs.cancel("long")
    with pytest.raises(OperationCancelled):
        await running
    assert time.monotonic() - asked < LONG_BEFORE_S

    # Also by one that does not look at its progress for longer; it stops as soon as it does.
    begun.clear()
    blind = asyncio.create_task(jobs.run("blind", look_away, tell=lambda *_: begun.set()))
    await asyncio.wait_for(begun.wait(), WAIT_S)
    asked = time.monotonic()
    await jobs.cancel("blind")
    with pytest.raises(OperationCancelled):
        await blind
    assert time.monotonic() - asked < LOOKS_AWAY_S

    # The worker is free again.
    assert (await jobs.run("after", add, 1, 1, tell=lambda *_: None))[0] == 2


async def test_a_job_that_is_cancelled_before_its_cluster_is_up_never_runs(jobs):
    told = []
    task = asyncio.create_task(jobs.run("early", work_for_long, tell=lambda *r: told.append(r)))
    await asyncio.sleep(0.1)
    asked = time.monotonic()
    await jobs.cancel("early")
    with pytest.raises(OperationCancelled):
        await task
    assert time.monotonic() - asked < LONG_BEFORE_S
    assert told == []


async def test_a_station_that_ends_while_its_cluster_starts_leaves_no_process():
    jobs = PlanningJobs(workers=1)
    task = asyncio.create_task(jobs.run("job", add, 1, 2, tell=lambda *_: None))
    await asyncio.sleep(0.05)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await jobs.close()
    me = psutil.Process()
    left = [p.pid for p in me.children(recursive=True) if "spawn_main" in " ".join(p.cmdline())]
    assert [pid for pid in left if not await ended(pid)] == []


async def test_a_worker_that_dies_is_a_failed_job_and_the_next_one_runs(jobs):
    with pytest.raises(GcsError, match="process died"):
        await jobs.run("dying", die, tell=lambda *_: None)
    assert (await jobs.run("next", add, 1, 2, tell=lambda *_: None))[0] == 3


async def test_planning_gives_way_to_whatever_else_the_station_does_also_in_a_worker_that_was_replaced(jobs):
    low = min(os.getpriority(os.PRIO_PROCESS, 0) + NICENESS, 19)
    assert await jobs.run("first", priorities, tell=lambda *_: None) == [low, low]
    with pytest.raises(GcsError, match="process died"):
        await jobs.run("dying", die, tell=lambda *_: None)
    assert await jobs.run("next", priorities, tell=lambda *_: None) == [low, low]


def test_no_process_outlives_a_killed_station(tmp_path):
    script = """
import asyncio, sys
sys.path.insert(0, sys.argv[1])
from test_planning_jobs import add
from gcs.jobs.planning_jobs import PlanningJobs
async def main():
    jobs = PlanningJobs(workers=1)
    _, pid = await jobs.run("job", add, 1, 2, tell=lambda *_: None)
    print(pid, flush=True)
    await asyncio.sleep(60)
if __name__ == "__main__":
    asyncio.run(main())
"""
    root = Path(__file__).resolve().parents[2]
    (tmp_path / "station.py").write_text(script)
    station = subprocess.Popen(
        [sys.executable, str(tmp_path / "station.py"), str(Path(__file__).parent)],
        cwd=root,
        env={**os.environ, "PYTHONPATH": f"{root}{os.pathsep}{Path(__file__).parent}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert station.stdout is not None
    with station.stdout:
        worker = int(station.stdout.readline())
        assert alive(worker)
        station.kill()
        station.wait()
    assert asyncio.run(ended(worker))
