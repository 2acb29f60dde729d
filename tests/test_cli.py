"""The command line, as a new user meets it and as a careless one does."""

from __future__ import annotations

import asyncio
import contextlib
import copy
import json
import os
import pty
import signal
import socket
import struct
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
import yaml

from gcs import cli
from gcs.core.errors import IncompleteError, LinkError, RefusedError
from gcs.services import fly_command, transfer_commands
from gcs.storage import atomic_files

HEAVY = ("numpy", "scipy", "fastapi", "pymavlink", "numba", "sqlalchemy", "pydantic", "trimesh", "distributed", "yaml")


@pytest.fixture
def gcs(monkeypatch, capsys):
    """Runs the command line in this process: its exit status, and what it said on both outputs."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["gcs", *map(str, arguments)])
        status = 0
        try:
            cli.main()
        except SystemExit as end:
            status = end.code
        said = capsys.readouterr()
        return SimpleNamespace(status=status, out=said.out, err=said.err)

    return run


@pytest.fixture
def plan_of(gcs, box_scenario, box_folder, tmp_path):
    """Plans a changed copy of the box's scenario; also tells what is left in the folder of the output."""

    def run(change):
        scenario = copy.deepcopy(box_scenario)
        change(scenario)
        file = tmp_path / "s.yaml"
        file.write_text(yaml.safe_dump(scenario))
        if not (tmp_path / "box.stl").exists():
            (tmp_path / "box.stl").write_bytes((box_folder / "box.stl").read_bytes())
        (tmp_path / "out").mkdir(exist_ok=True)
        said = gcs("plan", file, "-o", tmp_path / "out" / "plan")
        said.left = list((tmp_path / "out").iterdir())
        return said

    return run


def is_one_line(said, status, *words):
    """One clear line on standard error with all of these words, and nothing on standard output."""
    assert said.status == status, said.err
    assert said.out == ""
    assert said.err.startswith("gcs: ")
    assert said.err.endswith("\n")
    assert said.err.count("\n") == 1
    for word in words:
        assert word in said.err


def at(path, value):
    """A change of one field, named as in a message."""

    def change(scenario):
        *way, last = path.split(".")
        for name in way:
            scenario = scenario[int(name)] if name.isdigit() else scenario.setdefault(name, {})
        scenario[last] = value

    return change


def without(path):
    def change(scenario):
        *way, last = path.split(".")
        for name in way:
            scenario = scenario[name]
        del scenario[last]

    return change


def point(**changed):
    def change(scenario):
        named = {"name": "W", "position_m": [-2.0, 0.0, 6.0], "normal": [-1.0, 0.0, 0.0], **changed}
        scenario["inspection"] = {"points": [named]}

    return change


# ---- help ----


def test_help_and_version_are_light():
    probe = f"import sys, gcs.cli; print([name for name in {HEAVY!r} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_every_command_explains_itself(gcs):
    for name in cli.cli.commands:
        said = gcs(name, "--help")
        assert (said.status, said.err) == (0, "")
        assert said.out.startswith(f"Usage: gcs {name} ")
    assert "gantry" not in gcs("--help").out
    assert gcs("--version").out.startswith("gcs, version ")


def test_no_command_at_all_shows_the_help(gcs):
    said = gcs()
    assert said.status == 2
    assert "Usage: gcs" in said.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nonsense",), ("No such command 'nonsense'", "gcs --help")),
        (("plan",), ("SCENARIO", "gcs plan --help")),
        (("plan", "s.yaml"), ("--out",)),
        (("fly", "out"), ("--connect",)),
        (("fly", "out", "--connect", "udpin:127.0.0.1:0", "--mode", "sideways"), ("--mode", "sideways", "offboard")),
        (("simulate", "--count", "0"), ("--count",)),
        (("bench", "nonsense"), ("no benchmark 'nonsense'", "paths")),
        (("bench", "paths", "--mesh", "box.stl"), ("--mesh",)),
    ],
)
def test_wrong_arguments_are_one_line(gcs, arguments, words):
    is_one_line(gcs(*arguments), 2, *words)


# ---- plan ----


def test_a_scenario_becomes_a_verified_plan(gcs, box_folder, tmp_path):
    out = tmp_path / "plan"
    said = gcs("plan", box_folder / "box.yaml", "-o", out)
    assert (said.status, said.err) == (0, "")
    assert "of the coverable surface" in said.out
    assert f"written to {out}" in said.out
    assert sorted(file.name for file in out.iterdir()) == sorted(
        [
            *("plan.json", "viewpoints.csv", "path.csv", "structure.ply", "trajectory.csv"),
            *("mission.plan", "mission.waypoints", "report.json", "report.html"),
        ]
    )
    checked = gcs("verify", out)
    assert checked.status == 0
    assert "FAIL" not in checked.out


def test_what_was_left_out_of_a_mesh_is_said(plan_of, tmp_path):
    box = trimesh.creation.box(extents=(4, 4, 10))
    box.apply_translation([0, 0, 5])
    trimesh.Trimesh(box.vertices, np.vstack([box.faces, [0, 0, 1]]), process=False).export(tmp_path / "box.stl")
    said = plan_of(point())
    assert said.status == 0
    assert "note: box.stl: 1 triangle" in said.out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (at("camera.colour", "red"), ("camera.colour", "unknown field")),
        (without("anchor"), ("anchor", "missing")),
        (without("camera.focal_length_mm"), ("camera.focal_length_mm", "missing")),
        (without("inspection"), ("inspection",)),
        (at("vehicle.radius_m", -1), ("vehicle.radius_m", "greater than 0")),
        (at("camera.sensor_width_mm", -13.2), ("camera.sensor_width_mm", "greater than 0")),
        (at("vehicle.radius_m", float("nan")), ("vehicle.radius_m", "finite")),
        (at("home_m", [0, 0]), ("home_m",)),
        (at("structure.meshes.0.scale", 0), ("structure.meshes.0.scale",)),
        (at("structure.meshes.0.file", "none.stl"), ("none.stl", "no such file")),
        (at("structure", {"sample": "lighthouse"}), ("structure.sample", "gantry-crane")),
        (at("home_m", [0, 0, 5]), ("home_m", "inside the structure")),
        (at("home_m", [-12, -12, -5]), ("home_m", "below the ground")),
        (at("fence", {"include": [[[-5, -5], [5, -5], [5, 5], [-5, 5]]]}), ("home_m", "outside the fence")),
        (at("fence", {"max_height_m": 3}), ("home_m", "blocked")),
        (point(position_m=[0.0, 0.0, 5.0]), ("inspection.points.W", "lies 2.00 m from any surface")),
    ],
)
def test_bad_input_names_its_field(plan_of, change, words):
    said = plan_of(change)
    is_one_line(said, 2, *words)
    assert said.left == []


def stl(spoil=None):
    triangles = trimesh.creation.box(extents=(4, 4, 10)).triangles.astype("<f4")
    if spoil is not None:
        triangles[spoil] = np.nan
    body = b"".join(struct.pack("<3f", 0, 0, 0) + t.tobytes() + b"\0\0" for t in triangles)
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + body


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.stl", b"", "the file is empty"),
        ("words.stl", b"hello world", "not a surface mesh"),
        ("zeros.stl", bytes(84), "not a surface mesh"),
        ("cut.stl", stl()[:300], "damaged"),
        ("nan.stl", stl(spoil=3), "1 triangle has corners that are not finite"),
        ("bad.glb", b"glTF\x02\0\0\0" + b"\xff" * 20, "damaged"),
        ("bad.dae", b"<COLLADA><broken", "damaged"),
        ("bad.obj", b"v 1 2\nf 1 2 3\n", "damaged"),
        ("box.xyz", b"1 2 3", "STL, OBJ, PLY"),
    ],
)
def test_what_is_no_mesh_is_refused_by_name(plan_of, gcs, tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    said = plan_of(at("structure.meshes.0.file", name))
    is_one_line(said, 2, name, words)
    assert said.left == []
    if name != "nan.stl":
        is_one_line(gcs("inspect-mesh", tmp_path / name), 2, name, words)


def closed_in(scenario):
    """A point on the inner wall of a hollow box: no way leads there."""
    scenario["structure"]["meshes"][0]["file"] = "hollow.stl"
    scenario["home_m"] = [-30.0, -30.0, 0.0]
    point(position_m=[-9.0, 0.0, 10.0], normal=[1.0, 0.0, 0.0])(scenario)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (point(gsd_mm=0.3), ("inspection.points.W", "the best it can have is 0.68 mm")),
        (
            at("inspection", {"surface": {"gsd_mm": 0.3}}),
            ("inspection.surface.gsd_mm", "the best it can have is 0.70 mm"),
        ),
        (
            point(normal=[1.0, 0.0, 0.0]),
            ("inspection.points.W", "inside the structure"),
        ),
        (closed_in, ("inspection.points.W", "no way leads there from home")),
        (
            at("fence", {"include": [[[-20, -20], [-8, -20], [-8, 20], [-20, 20]]]}),
            ("inspection", "fence"),
        ),
        (at("vehicle.battery.capacity_wh", 1.0), ("viewpoint ", "0.8 Wh may be taken", "larger battery")),
    ],
)
def test_no_feasible_plan_says_why(plan_of, tmp_path, change, words):
    walls = [trimesh.creation.box(extents=(size, size, size)) for size in (20, 18)]
    hollow = trimesh.util.concatenate(walls)
    hollow.apply_translation([0, 0, 10])
    hollow.export(tmp_path / "hollow.stl")
    said = plan_of(change)
    is_one_line(said, 3, *words)
    assert said.left == []


@pytest.mark.parametrize(
    "ask", [lambda gsd: point(gsd_mm=gsd), lambda gsd: at("inspection", {"surface": {"gsd_mm": gsd}})]
)
def test_the_best_gsd_that_is_named_can_be_had(plan_of, ask):
    refused = plan_of(ask(0.3))
    best = float(refused.err.split("the best it can have is ")[1].split(" mm")[0])
    assert plan_of(ask(best)).status == 0


def test_a_folder_of_other_things_is_left_as_it_is(gcs, box_folder, tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    is_one_line(gcs("plan", box_folder / "box.yaml", "-o", tmp_path), 2, str(tmp_path), "other files")
    is_one_line(gcs("plan", box_folder / "box.yaml", "-o", tmp_path / "note.txt"), 2, "note.txt", "not a folder")
    is_one_line(gcs("plan", box_folder / "box.yaml", "-o", tmp_path / "note.txt" / "x"), 2, "note.txt", "written")
    assert [file.read_text() for file in tmp_path.iterdir()] == ["mine"]


def test_a_place_that_cannot_be_written_is_said_before_planning(gcs, box_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(atomic_files.os, "access", lambda place, mode: place != tmp_path)
    is_one_line(gcs("plan", box_folder / "box.yaml", "-o", tmp_path / "x"), 2, str(tmp_path), "written")


def test_an_earlier_plan_is_replaced(gcs, box_folder, tmp_path):
    for _ in range(2):
        assert gcs("plan", box_folder / "box.yaml", "-o", tmp_path / "plan").status == 0
    assert [file.name for file in tmp_path.iterdir()] == ["plan"]


@pytest.mark.system
def test_an_interrupted_plan_ends_and_leaves_nothing(box_scenario, box_folder, tmp_path):
    scenario = copy.deepcopy(box_scenario)
    scenario["inspection"] = {"surface": {"gsd_mm": 1.0, "overlap": 0.8}}
    (tmp_path / "box.stl").write_bytes((box_folder / "box.stl").read_bytes())
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(scenario))
    (tmp_path / "out").mkdir()
    screen, terminal = pty.openpty()
    line = [sys.executable, "-m", "gcs.cli", "plan", tmp_path / "s.yaml", "-o", tmp_path / "out" / "plan"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=terminal) as process:
        os.close(terminal)
        seen = b""
        while b"free_space" not in seen:  # its progress bar
            seen += os.read(screen, 4096)
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(OSError):  # reading fails when the process has ended
            while rest := os.read(screen, 4096):
                seen += rest
        assert process.wait(300) in (130, -signal.SIGINT)  # a shell shows 130 for both
        assert process.stdout.read() == b""
    os.close(screen)
    assert b"Traceback" not in seen
    assert list((tmp_path / "out").iterdir()) == []


# ---- verify, fly, upload, download ----


def test_a_folder_without_a_plan_is_no_plan(gcs, tmp_path):
    for command in (("verify",), ("fly", "--connect", "udpin:127.0.0.1:0", "--data", tmp_path / "data")):
        is_one_line(gcs(*command, tmp_path / "none"), 2, "no such plan", "none")
    is_one_line(gcs("upload", tmp_path / "none", "--connect", "udpin:127.0.0.1:0"), 2, "no such plan")


def test_verify_says_what_does_not_hold(gcs, small_plan, small_structure, tmp_path):
    from gcs.storage.plan_files import write_plan

    write_plan(small_plan, small_structure, tmp_path / "plan")
    said = gcs("verify", tmp_path / "plan")
    assert said.status == 1
    assert "FAIL  mission.plan" in said.out  # it was never written
    (tmp_path / "plan" / "structure.ply").write_bytes(b"ply\n")
    said = gcs("verify", tmp_path / "plan")
    assert said.status == 1
    assert "FAIL" in said.out
    assert "structure.ply" in said.out


def test_output_that_nobody_reads_to_the_end_is_no_fault(box_plan):
    line = f"{sys.executable} -m gcs.cli verify {box_plan} | true"
    assert subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=True).stderr == ""


@pytest.mark.parametrize("url", ["nonsense", "udpin:127.0.0.1:99999", "tcp:127.0.0.1", "http://127.0.0.1:1"])
def test_a_malformed_url_is_named(gcs, box_plan, tmp_path, url):
    is_one_line(gcs("fly", box_plan, "--connect", url, "--data", tmp_path), 2, url.split("//")[-1])
    is_one_line(gcs("upload", box_plan, "--connect", url), 2, url.split("//")[-1])
    is_one_line(gcs("download", "--connect", url), 2, url.split("//")[-1])


def test_nobody_answers(gcs, box_plan, tmp_path, monkeypatch):
    monkeypatch.setattr(fly_command, "VEHICLE_TIMEOUT_S", 0.2)
    monkeypatch.setattr(transfer_commands, "VEHICLE_TIMEOUT_S", 0.2)
    words = ("no vehicle answers within 0.2 s", "udpin:127.0.0.1:", "URL")
    is_one_line(gcs("fly", box_plan, "--connect", "udpin:127.0.0.1:0", "--data", tmp_path), 4, *words)
    is_one_line(gcs("upload", box_plan, "--connect", "udpin:127.0.0.1:0"), 4, *words)
    is_one_line(gcs("download", "--connect", "udpin:127.0.0.1:0"), 4, *words)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    is_one_line(gcs("download", "--connect", f"tcp:127.0.0.1:{port}"), 4, f"tcp:127.0.0.1:{port}", "nobody answers")


def test_a_link_port_that_is_taken(gcs):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        is_one_line(gcs("download", "--connect", f"udpin:127.0.0.1:{port}"), 4, f"udpin:127.0.0.1:{port}", "port")


def test_a_download_goes_nowhere_that_is_not_there(gcs, tmp_path):
    said = gcs("download", "--connect", "udpin:127.0.0.1:0", "-o", tmp_path / "none" / "m.waypoints")
    is_one_line(said, 2, str(tmp_path / "none"), "no such folder")


def test_a_download_is_shown_or_written(gcs, tmp_path, monkeypatch):
    async def held(url, data_dir):
        return "QGC WPL 110\n", [{"sequence": 0}]

    monkeypatch.setattr(transfer_commands, "download_mission", held)
    assert gcs("download", "--connect", "x").out == "QGC WPL 110\n"
    assert json.loads(gcs("download", "--connect", "x", "--json").out) == [{"sequence": 0}]
    assert "1 items" in gcs("download", "--connect", "x", "-o", tmp_path / "m.waypoints").out
    assert (tmp_path / "m.waypoints").read_text() == "QGC WPL 110\n"


@pytest.mark.parametrize(
    ("option", "noun"), [((), "mission"), (("--fence",), "fence"), (("--rally",), "list of rally")]
)
def test_a_list_is_cleared_on_the_vehicle_that_is_named(gcs, monkeypatch, tmp_path, option, noun):
    cleared = []

    async def clear(*arguments):
        cleared.append(arguments)

    monkeypatch.setattr(transfer_commands, "clear_list", clear)
    said = gcs("clear", "--connect", "x", "--vehicle", "px4-1", "--data", tmp_path, *option)
    assert said.out.startswith(f"px4-1 holds no {noun}")
    [(url, vehicle, mission_type, data)] = cleared
    assert (url, vehicle, mission_type.noun[: len(noun)], data) == ("x", "px4-1", noun, tmp_path)
    is_one_line(gcs("clear", "--connect", "x"), 2, "--vehicle")


def test_the_current_item_is_set_on_the_vehicle_that_is_named(gcs, monkeypatch, tmp_path):
    given = []

    async def set_current(*arguments):
        given.append(arguments)

    monkeypatch.setattr(transfer_commands, "set_current", set_current)
    said = gcs("set-current", "--connect", "x", "--vehicle", "px4-1", "--data", tmp_path, "3")
    assert said.out == "px4-1 has item 3 as its current one\n"
    assert given == [("x", "px4-1", 3, tmp_path)]
    is_one_line(gcs("set-current", "--connect", "x", "--vehicle", "px4-1", "--", "-1"), 2, "-1")


def outcome(**changed):
    made = {"ok": True, "flight": "flight-1", "proved": True, "reached": 2, "viewpoints": 2, "images_expected": 2}
    made |= {"images_received": 2, "max_cross_track_m": 0.1, "duration_s": 60.0, "problems": (), "failure": None}
    return fly_command.FlightOutcome(**{**made, **changed})


@pytest.mark.parametrize(
    ("flown", "status"),
    [
        (outcome(), 0),
        (outcome(ok=False, failure=LinkError("gone", field="px4-1"), problems=("px4-1: gone",)), 4),
        (outcome(ok=False, failure=RefusedError("no", field="px4-1"), problems=("px4-1: no",)), 5),
        (outcome(ok=False, failure=IncompleteError("half"), problems=("half",)), 6),
        (outcome(ok=False, reached=1, problems=("1 of 2 viewpoints not reached",)), 6),
    ],
)
def test_a_flights_summary_is_the_last_line_whatever_came_of_it(gcs, monkeypatch, flown, status):
    async def fly(out, url, *, mode, confirm, accept, data_dir, say, sortie, rest, observer):
        assert (mode, accept, await confirm("px4-1")) == ("offboard", ("NAV_DLL_ACT",), "px4-1")
        say("flying")
        return flown

    monkeypatch.setattr(fly_command, "fly_plan", fly)
    arguments = ("--connect", "x", "--mode", "offboard", "--yes", "px4-1", "--accept", "NAV_DLL_ACT", "--json")
    said = gcs("fly", "plan", *arguments)
    assert said.status == status
    summary = json.loads(said.out)
    keys = "ok proved reached viewpoints images_expected images_received max_cross_track_m duration_s problems"
    assert set(summary) >= set(keys.split())
    assert summary["ok"] is (status == 0)
    assert said.err.startswith("flying\n")
    assert said.err.count("\n") == (1 if status == 0 else 2)


@pytest.mark.parametrize(("typed", "status"), [(b"px4-1\n", 0), (b"", 5)])
def test_the_confirmation_is_typed_while_the_link_stays_alive(gcs, monkeypatch, typed, status):
    beats = 0

    async def fly(out, url, *, confirm, **more):
        async def beat():
            nonlocal beats
            while True:
                beats += 1
                if beats == 3:  # the operator answers only after some heartbeats
                    os.write(writing, typed)
                    os.close(writing)
                await asyncio.sleep(0.01)

        beating = asyncio.create_task(beat())
        try:
            assert await confirm("px4-1") == "px4-1"
        finally:
            beating.cancel()
        return outcome()

    monkeypatch.setattr(fly_command, "fly_plan", fly)
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        said = gcs("fly", "plan", "--connect", "x")
    assert said.status == status
    assert "Type the vehicle's name to arm and start it (px4-1): " in said.out
    assert beats >= 3
    if status:
        assert "--yes" in said.err


def test_a_confirmation_from_a_plain_file(gcs, monkeypatch, tmp_path):
    async def fly(out, url, *, confirm, **more):
        assert await confirm("px4-1") == "px4-1"
        return outcome()

    monkeypatch.setattr(fly_command, "fly_plan", fly)
    (tmp_path / "answers").write_text("px4-1\n")
    with (tmp_path / "answers").open() as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert gcs("fly", "plan", "--connect", "x").status == 0


# ---- the rest ----


def test_a_dashboard_port_that_is_taken(gcs, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for command in ("serve", "demo"):
            is_one_line(gcs(command, "--port", port, "--data", tmp_path), 2, "--port", str(port), "taken")


def test_pictures_of_a_flight_that_is_not_there(gcs, tmp_path):
    is_one_line(gcs("images", "import", "none", tmp_path, "--data", tmp_path / "data"), 2, "none")
    is_one_line(gcs("images", "import", "none", tmp_path / "x", "--data", tmp_path / "data"), 2, "no such folder")


def test_inspect_mesh(gcs, box_folder):
    said = gcs("inspect-mesh", box_folder / "box.stl")
    assert said.status == 0
    assert "12 triangles" in said.out


def test_a_simulator_needs_a_plan_that_is_there(gcs, tmp_path):
    is_one_line(gcs("simulate", "--scene", tmp_path / "none"), 2, "no such plan")


@pytest.mark.system
def test_a_fault_ends_with_its_status_and_no_traceback(tmp_path):
    line = [sys.executable, "-m", "gcs.cli", "plan", tmp_path / "none.yaml", "-o", tmp_path / "out"]
    ended = subprocess.run(line, check=False, capture_output=True, text=True)
    assert ended.returncode == 2
    assert ended.stderr == f"gcs: {tmp_path / 'none.yaml'}: there is no such file\n"
    assert ended.stdout == ""
    assert not (tmp_path / "out").exists()
