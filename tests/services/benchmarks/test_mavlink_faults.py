"""The fault matrix: no false answer of ours, and it does find those of a station that lies."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from gcs.core.errors import RefusedError
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_proof import download, upload_and_prove
from gcs.services.benchmarks import mavlink_faults as benchmark
from gcs.services.benchmarks.mavlink_faults import FALSE_FAILURE, FALSE_SUCCESS, LOSSES, matrix, run_cells
from gcs.services.benchmarks.mavlink_missions import random_mission, wire_items

FALSE = {FALSE_SUCCESS, FALSE_FAILURE}


@pytest.fixture(scope="module")
def cells():
    return matrix()


def few(cells, faults, runs=2):
    return [replace(cell, runs=runs) for cell in cells if cell.fault in faults]


def test_the_full_matrix_is_large_enough_and_has_every_field(cells):
    assert sum(cell.runs for cell in cells if cell.upload) >= 100_000
    kinds = {(cell.fault, cell.upload, cell.autopilot, cell.loss) for cell in cells}
    faults = {cell.fault for cell in cells}
    assert len(kinds) == len(cells) == len(faults) * 2 * 2 * len(LOSSES)
    assert len(faults) >= 1 + 19 + 22


def test_no_false_answers(cells):
    outcomes = run_cells(few(cells, {cell.fault for cell in cells}, runs=1))
    assert sum(outcomes.values()) == len(cells)
    assert not {key for key in outcomes if key[2] in FALSE}


@pytest.mark.parametrize(
    ("fault", "outcome"), [("none", "proved"), ("truncated", "refused"), ("signed-only", "unknown")]
)
def test_what_comes_of_a_fault(cells, fault, outcome):
    assert {key[2] for key in run_cells(few(cells, {fault})) if key[0] == "upload"} == {outcome}


def test_a_station_that_believes_everything_is_found_out(cells, monkeypatch):
    async def believe(mission, peer):
        try:
            await upload_and_prove(mission, peer)
        except RefusedError:
            return

    monkeypatch.setattr(benchmark, "upload_and_prove", believe)
    outcomes = run_cells(few(cells, {"truncated", "no-space-later"}))
    assert {key[2] for key in outcomes if key[0] == "upload"} == {FALSE_SUCCESS}


def test_a_station_that_gives_up_too_early_is_found_out(cells, monkeypatch):
    async def despair(mission, peer):
        await upload_and_prove(mission, peer)
        raise RefusedError("no")

    monkeypatch.setattr(benchmark, "upload_and_prove", despair)
    outcomes = run_cells(few(cells, {"none", "ack-missing", "doubled"}))
    assert {key[2] for key in outcomes if key[0] == "upload"} == {FALSE_FAILURE}


def test_a_station_that_misreads_is_found_out(cells, monkeypatch):
    async def misread(peer, mission_type):
        return (await download(peer, mission_type=mission_type))[:-1]

    monkeypatch.setattr(benchmark, "download", misread)
    outcomes = run_cells(few(cells, {"none"}))
    assert {key[2] for key in outcomes if key[0] == "download"} == {FALSE_SUCCESS}


def test_fences_rally_points_and_missions_as_files_stand_beside_the_matrix():
    cells = benchmark.beside()
    assert 1_500 <= sum(cell.runs for cell in cells) <= 2_500
    assert {cell.what for cell in cells} == {"file.upload", "fence.upload", "rally.upload"}
    some = [
        replace(cell, runs=1) for cell in cells if cell.fault in {"none", "reboot", "changed", "corrupt", "ack-early"}
    ]
    outcomes = run_cells(some)
    assert not {key for key in outcomes if key[2] in FALSE}
    assert all(outcomes[what, "none", "proved"] > 0 for what in ("file.upload", "fence.upload", "rally.upload"))


def test_a_mission_goes_as_a_file_without_the_mission_protocol(monkeypatch):
    async def nothing(mission, peer):
        raise AssertionError("item by item")

    monkeypatch.setattr(benchmark, "upload_and_prove", nothing)
    cells = [replace(cell, runs=1) for cell in benchmark.beside() if cell.fault == "none" and cell.as_file]
    assert set(run_cells(cells)) == {("file.upload", "none", "proved")}


@pytest.mark.parametrize("autopilot", [Autopilot.PX4, Autopilot.ARDUPILOT])
def test_missions_are_random_but_repeatable(autopilot):
    a, b, c = (random_mission(autopilot, random.Random(seed), 5) for seed in (1, 1, 2))
    assert a == b != c
    assert [item.sequence for item in a.items] == list(range(5))
    assert all(len(row) == 10 for row in wire_items(a))
