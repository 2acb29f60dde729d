"""`gcs upload` and `gcs download` against simulated vehicles: proved, refused, or plainly told that nobody is there."""

from __future__ import annotations

import asyncio
import json
import socket

import pytest

from gcs.core.errors import InputError, LinkError, NotFoundError, RefusedError
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_protocol import MissionType
from gcs.services import transfer_commands
from gcs.services.mission_files import mission_of_plan
from gcs.services.opened_link import opened_link
from gcs.services.signing_commands import give_key
from gcs.services.simulation import Simulator, SimulatorOptions
from gcs.services.transfer_commands import clear_list, download_mission, set_current, upload_plan
from gcs.storage.plan_files import read_plan


@pytest.fixture
def vehicle():
    """Starts a simulated vehicle; the URL of its link."""
    running = []

    def start(kind, *extra):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", 0))
            port = sock.getsockname()[1]
        options = SimulatorOptions(autopilot=kind, speedup=4.0, port=port, extra=("--tcp-base", "none", *extra))
        running.append(Simulator(options))
        running[-1].__enter__()
        return f"udpin:127.0.0.1:{port}"

    yield start
    for simulator in running:
        simulator.__exit__(None, None, None)


@pytest.mark.system
@pytest.mark.parametrize(
    ("kind", "autopilot"),
    [("px4", Autopilot.PX4), ("ardupilot", Autopilot.ARDUPILOT)],
)
async def test_what_was_uploaded_is_there(vehicle, box_plan, kind, autopilot):
    url = vehicle(kind)
    told = []
    proof = await upload_plan(box_plan, url, told.append)
    plan = read_plan(box_plan)
    expected = mission_of_plan(plan, autopilot).items
    assert proof["proved"] is True
    assert proof["vehicle"] == f"{kind}-1"
    assert proof["items"] == proof["items_read"] == len(expected)
    json.dumps(proof)
    text, items = await download_mission(url)
    assert [item["command"] for item in items][1:] == [item.command for item in expected][1:]
    assert [(item["x"], item["y"]) for item in items][1:] == [(item.x, item.y) for item in expected][1:]
    lines = text.splitlines()
    assert lines[0] == "QGC WPL 110"
    assert len(lines) >= 1 + len(items)
    json.dumps(items, allow_nan=False)


@pytest.mark.system
async def test_a_plan_beyond_the_vehicles_limits_is_not_uploaded(vehicle, box_plan):
    url = vehicle("px4", "--param", "MPC_XY_VEL_MAX=1.0")
    with pytest.raises(RefusedError, match=r"px4-1: horizontal speed: .* limit is 1\.00 m/s"):
        await upload_plan(box_plan, url, lambda line: None)
    _, items = await download_mission(url)
    assert items == []


@pytest.mark.system
async def test_a_mission_that_would_leave_the_clearance_is_not_uploaded(vehicle, box_plan):
    url = vehicle("px4", "--param", "MPC_XY_VEL_P_ACC=0.2")
    with pytest.raises(RefusedError, match=r"px4-1: predicted flight: as a mission it comes .* m too near at"):
        await upload_plan(box_plan, url, lambda line: None)
    _, items = await download_mission(url)
    assert items == []


@pytest.mark.system
async def test_a_failsafe_that_is_off_is_said(vehicle, box_plan):
    url = vehicle("px4", "--param", "NAV_DLL_ACT=0")
    told = []
    assert (await upload_plan(box_plan, url, told.append))["proved"]
    assert any("NAV_DLL_ACT" in line for line in told)


@pytest.mark.system
@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_an_interrupted_upload_is_cancelled_on_the_vehicle_and_what_is_unknown_is_said(
    vehicle, box_plan, monkeypatch, kind
):
    """What Ctrl-C does."""
    url, told, sent = vehicle(kind, "--latency", "0.2"), [], []
    upload = transfer_commands.upload_fitted

    async def interrupted(of, *arguments):
        send = of._channel.send

        def seen(message):
            if not sent:
                asyncio.get_running_loop().call_later(0.5, command.cancel)
            sent.append(message)
            send(message)

        monkeypatch.setattr(of._channel, "send", seen)
        return await upload(of, *arguments)

    monkeypatch.setattr(transfer_commands, "upload_fitted", interrupted)
    command = asyncio.ensure_future(upload_plan(box_plan, url, told.append))
    with pytest.raises(asyncio.CancelledError):
        await command
    assert told[-1].startswith("the upload was cancelled; what the vehicle holds now is unknown")
    if kind == "px4":
        assert (sent[-1].get_type(), sent[-1].type) == ("MISSION_ACK", 15)


@pytest.fixture(scope="module")
def fenced_plan(tmp_path_factory, box_folder, box_scenario):
    """The box inside a fence, with a rally point."""
    import yaml

    from gcs.services.plan_service import plan_to_directory

    square = [[-40, -40], [40, -40], [40, 40], [-40, 40]]
    given = box_scenario | {"fence": {"include": [square], "max_height_m": 60}, "rally_m": [[-20, 5, 0]]}
    (box_folder / "fenced.yaml").write_text(yaml.safe_dump(given))
    out = tmp_path_factory.mktemp("plans") / "fenced"
    plan_to_directory(box_folder / "fenced.yaml", out)
    return out


@pytest.mark.system
@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_fence_and_rally_points_are_proved_and_never_taken_away(vehicle, box_plan, fenced_plan, kind):
    url = vehicle(kind, "--loss", "0.1")
    proof = await upload_plan(fenced_plan, url, lambda line: None)
    assert [(e["name"], e["proved"], e["items"]) for e in proof["lists"]] == [
        ("fence", True, 4),
        ("rally points", True, 1),
    ]
    json.dumps(proof)
    told = []
    assert (await upload_plan(box_plan, url, told.append))["lists"] == []
    assert any(line.startswith("needs acceptance: fence: the vehicle holds a fence of 4 items") for line in told)
    assert await held(url) == [4, 1], "what the plan did not bring is left as it is"
    with pytest.raises(NotFoundError, match=f"heard so far: {kind}-1"):
        await clear_list(url, "px4-7", MissionType.FENCE)
    assert await held(url) == [4, 1]
    await clear_list(url, f"{kind}-1", MissionType.FENCE)
    assert await held(url) == [0, 1]
    await clear_list(url, f"{kind}-1", MissionType.MISSION)
    _, items = await download_mission(url)
    assert items == []


async def held(url):
    async with opened_link(url, None, 30.0) as link:
        return [len(await link.vehicle.download_list(t)) for t in (MissionType.FENCE, MissionType.RALLY)]


@pytest.mark.system
async def test_a_link_with_a_key_is_signed_for_transfers_too(vehicle, box_plan, tmp_path, monkeypatch):
    monkeypatch.setenv("GCS_KEY", "correct horse")
    url = vehicle("px4")
    assert (await give_key(url, "px4-1", tmp_path, rejects_unsigned=True)).proved
    proof = await upload_plan(box_plan, url, lambda line: None, tmp_path)
    _, items = await download_mission(url, tmp_path)
    assert proof["proved"]
    assert len(items) == proof["items"]
    await clear_list(url, "px4-1", MissionType.MISSION, tmp_path)
    assert (await download_mission(url, tmp_path))[1] == []
    with pytest.raises(LinkError):  # a station without the key is not answered
        async with asyncio.timeout(60.0):
            await download_mission(url, tmp_path / "elsewhere")
    monkeypatch.delenv("GCS_KEY")
    with pytest.raises(InputError, match="GCS_KEY"):
        await download_mission(url, tmp_path)


@pytest.mark.system
async def test_lists_of_an_armed_vehicle_are_not_cleared_and_its_current_item_is_not_set(vehicle, box_plan):
    url = vehicle("px4")
    await upload_plan(box_plan, url, lambda line: None)
    async with opened_link(url, None, 30.0) as link:
        await link.vehicle.until(lambda: link.vehicle.telemetry.ready_to_arm is not None, 30.0, "its checks")
        await link.vehicle.arm()
        await link.vehicle.until(lambda: link.vehicle.telemetry.armed.value, 30.0, "it to arm")
    with pytest.raises(RefusedError, match="lists are cleared on a vehicle that is disarmed"):
        await clear_list(url, "px4-1", MissionType.MISSION)
    with pytest.raises(RefusedError, match="the current item is set on a vehicle that is disarmed"):
        await set_current(url, "px4-1", 2)


@pytest.mark.system
@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_the_current_item_is_set_and_told(vehicle, box_plan, kind):
    url = vehicle(kind, "--loss", "0.1")
    await upload_plan(box_plan, url, lambda line: None)
    await set_current(url, f"{kind}-1", 3)
    async with opened_link(url, None, 30.0) as link:
        await link.vehicle.until(lambda: link.vehicle.telemetry.mission is not None, 30.0, "its mission")
        assert link.vehicle.telemetry.mission.value.current == 3
    with pytest.raises(NotFoundError, match=f"heard so far: {kind}-1"):
        await set_current(url, "px4-7", 3)
    with pytest.raises(LinkError, match="item 500"):
        await set_current(url, f"{kind}-1", 500)


async def test_nobody_answers(box_plan, monkeypatch):
    monkeypatch.setattr(transfer_commands, "VEHICLE_TIMEOUT_S", 0.1)
    with pytest.raises(LinkError, match="no vehicle answers"):
        await upload_plan(box_plan, "udpin:127.0.0.1:0", print)
    with pytest.raises(LinkError, match="no vehicle answers"):
        await download_mission("udpin:127.0.0.1:0")


async def test_input_is_looked_at_before_the_link(tmp_path, box_plan):
    with pytest.raises(InputError, match="no such plan"):
        await upload_plan(tmp_path, "nonsense", print)
    with pytest.raises(InputError, match="not a link URL"):
        await upload_plan(box_plan, "nonsense", print)
