"""Safety rule 7 under stays: what the vehicle does by itself comes home without touching, or is not flown at all."""

import asyncio
import time

import numpy as np
import pytest
import yaml

from gcs.core.frames import geodetic_from_enu
from gcs.core.way_home import ReturnFlight
from gcs.planning.flights.ways_home import return_is_clear
from gcs.planning.scene.point_distance import SceneDistance
from gcs.services.plan_service import plan_to_directory
from gcs.storage.plan_files import read_plan, read_structure

pytestmark = pytest.mark.system

SCENARIO = {
    "name": "under the stays",
    "structure": {"sample": "bridge-tower"},
    "anchor": {"latitude_deg": 34.32, "longitude_deg": 108.72, "altitude_m": 385.0},
    "ground_m": 0.0,
    "camera": {
        "sensor_width_mm": 13.2,
        "sensor_height_mm": 8.8,
        "focal_length_mm": 8.8,
        "image_width_px": 5472,
        "image_height_px": 3648,
        "gimbal": {"pitch_min_deg": -90, "pitch_max_deg": 30, "rate_deg_s": 60},
    },
    "inspection": {
        "points": [
            {"name": "south", "position_m": [-13.9, -1.5, 30], "normal": [0, -1, 0]},
            {"name": "inside", "position_m": [-13.5, 0, 35], "normal": [1, 0, 0]},
            {"name": "north", "position_m": [-13.9, 1.5, 30], "normal": [0, 1, 0]},
            {"name": "top", "position_m": [-15.5, -1.5, 80], "normal": [0, -1, 0]},
        ]
    },
    "home_m": [-40, -25, 0],
}
HULL_M = 0.5
GOES_BACK = (
    *("--param", "FS_OPTIONS=0", "--param", "FS_GCS_ENABLE=4", "--param", "FS_GCS_TIMEOUT=4"),
    *("--param", "FS_THR_ENABLE=5", "--param", "BATT_FS_LOW_ACT=4", "--param", "BATT_FS_CRT_ACT=4"),
    *("--param", "SRTL_ACCURACY=0.3"),
)
GOES_ON_ARDUPILOT = (*GOES_BACK, "--param", "FS_OPTIONS=18")
GOES_ON_PX4 = (
    *("--param", "COM_DLL_EXCEPT=3", "--param", "COM_RCL_EXCEPT=3"),
    *("--param", "COM_DL_LOSS_T=4", "--param", "COM_FAIL_ACT_T=0.5"),
)
ACCEPTED = {"ardupilot": ["ways home"], "px4": ["ways home", "COM_LOW_BAT_ACT"]}


@pytest.fixture(scope="module")
def tower(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tower")
    (folder / "tower.yaml").write_text(yaml.safe_dump(SCENARIO))
    plan_to_directory(folder / "tower.yaml", folder / "plan")
    return folder / "plan"


@pytest.fixture
def at_the_tower(vehicle, tower):
    """Makes vehicles that stand at home of the tower's scene."""
    scenario = read_plan(tower).scenario
    latitude, longitude, altitude = geodetic_from_enu(scenario.home_m, scenario.anchor.point)
    anchor = scenario.anchor
    place = (
        f"--anchor={anchor.latitude_deg},{anchor.longitude_deg},{anchor.altitude_m}",
        f"--home={float(latitude):.9f},{float(longitude):.9f},{float(altitude):.4f}",
    )
    return lambda kind, *extra, speedup=2.0: vehicle(kind, *place, *extra, plan=tower, speedup=speedup)


class Watch:
    """The true track of a vehicle, and how near to the scene it came."""

    def __init__(self, vehicle, plan):
        self._vehicle = vehicle
        self.plan = read_plan(plan)
        self.scene = SceneDistance(read_structure(plan), self.plan.scenario.ground_m)
        self.track, self.modes = [], []

    def look(self):
        truth = self._vehicle.truth
        self.track.append(truth["position_m"])
        if truth["mode"] not in self.modes:
            self.modes.append(truth["mode"])
        return truth

    async def until(self, holds, timeout_s=300.0):
        end = time.monotonic() + timeout_s
        while not holds(truth := self.look()):
            assert time.monotonic() < end, truth
            await asyncio.sleep(0.02)
        return truth

    def nearest_m(self):
        """Least distance of the hull's surface from the structure, between two looks along the chord."""
        track = np.array(self.track)
        share = np.linspace(0, 1, 5)[None, :, None]
        chords = (track[:-1, None] * (1 - share) + track[1:, None] * share).reshape(-1, 3)
        return self.scene.distance(chords, ground=False).min() - HULL_M

    def near(self, name, within_m):
        place = next(v.position_m for v in self.plan.viewpoints if v.name == name)
        return lambda truth: np.linalg.norm(np.subtract(truth["position_m"], place)) < within_m

    def would_hit(self, position_m):
        """Whether a return at any of several heights would."""
        return all(
            not return_is_clear(self.plan, self.scene, ReturnFlight(height), position_m, np.zeros(3))
            for height in (30.0, 60.0, 100.0)
        )


async def flying(base, flown, mode):
    flight = await base.prepared(flown, mode)
    accept = ACCEPTED[flown.name.split("-")[0]]
    if mode == "mission":
        await base.post(f"/flights/{flight}/upload", expect=202, accept=accept)
        await base.until(flight, lambda f: f["state"] == "uploaded")
    await base.post(f"/flights/{flight}/start", confirm=flown.name, accept=accept)
    return flight


@pytest.mark.parametrize(
    ("kind", "mode", "setting", "way"),
    [
        ("ardupilot", "mission", GOES_BACK, "SMART_RTL"),
        ("ardupilot", "offboard", GOES_BACK, "SMART_RTL"),
        ("ardupilot", "mission", GOES_ON_ARDUPILOT, "AUTO"),
        ("px4", "mission", GOES_ON_PX4, "AUTO.MISSION"),
    ],
)
async def test_the_link_is_cut_under_the_stays(kind, mode, setting, way, at_the_tower, station, tower):
    flown = at_the_tower(kind, *setting)
    watch = Watch(flown, tower)
    base = await station(tower)
    await flying(base, flown, mode)
    cut_at = await watch.until(watch.near("inside", 0.8))
    flown.ask("kill-link")
    if way == "SMART_RTL" and mode == "mission":
        flown.ask("mode BRAKE")  # a pilot stops it there, and can do no more
    assert watch.would_hit(cut_at["position_m"])
    down = await watch.until(lambda t: t["station_lost"] and not t["armed"])
    assert watch.nearest_m() > 0.0
    assert np.linalg.norm(np.subtract(down["position_m"], SCENARIO["home_m"])) < 1.0
    assert watch.modes[-1] == way
    assert "RTL" not in watch.modes and "AUTO.RTL" not in watch.modes


async def test_return_is_commanded_under_the_stays(at_the_tower, station, tower):
    flown = at_the_tower("ardupilot", *GOES_BACK)
    watch = Watch(flown, tower)
    base = await station(tower)
    flight = await flying(base, flown, "mission")
    await watch.until(watch.near("inside", 0.8))
    returning = await base.post(f"/flights/{flight}/return")
    assert returning["state"] == "returning"
    await watch.until(lambda t: not t["armed"])
    assert watch.modes[-1] == "SMART_RTL"
    assert watch.nearest_m() > 0.0


async def test_px4_is_not_sent_home_from_under_the_stays(at_the_tower, station, tower):
    flown = at_the_tower("px4", *GOES_ON_PX4)
    watch = Watch(flown, tower)
    base = await station(tower)
    flight = await flying(base, flown, "mission")
    await watch.until(watch.near("inside", 0.8))
    await base.post(f"/flights/{flight}/pause")
    refused = await base.post(f"/flights/{flight}/return", expect=403)
    assert "would hit the structure" in refused["detail"]
    assert (await watch.until(lambda t: True))["mode"] == "AUTO.LOITER"
    await base.post(f"/flights/{flight}/resume", confirm=flown.name)
    await watch.until(watch.near("top", 1.0))
    await base.post(f"/flights/{flight}/return")
    await watch.until(lambda t: not t["armed"])
    assert watch.modes[-1] == "AUTO.RTL"
    assert watch.nearest_m() > 0.0


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("px4", ("NAV_DLL_ACT", "NAV_RCL_ACT", "COM_LOW_BAT_ACT", "ways home")),
        ("ardupilot", ("FS_THR_ENABLE", "BATT_FS_LOW_ACT", "ways home")),
    ],
)
async def test_failsafes_that_would_hit_are_refused_with_what_to_set(kind, names, at_the_tower, station, tower):
    flown = at_the_tower(kind)
    base = await station(tower)
    flight = await base.prepared(flown, "mission")
    report = await asyncio.to_thread(base.get, f"/flights/{flight}/preflight")
    bad = {c["name"]: c for c in report["checks"] if c["state"] != "ok"}
    assert set(bad) == set(names)
    assert all("COM_DLL_EXCEPT 3" in bad[n]["detail"] for n in ("NAV_DLL_ACT",) if n in bad)
    assert all("FS_THR_ENABLE 5 with SRTL_ACCURACY" in bad[n]["detail"] for n in ("FS_THR_ENABLE",) if n in bad)
    await base.post(f"/flights/{flight}/upload", expect=403, accept=list(names))
    assert flown.truth["mission_items"] == 0
