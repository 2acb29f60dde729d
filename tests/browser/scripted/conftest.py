"""What a scripted station tells: one plan of a small portal, one vehicle, one flight."""

from __future__ import annotations

import io
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw

from gcs.api.schemas import base, flights, leases, live, plans, replans, vehicles

NOW = "2026-11-22T10:00:00Z"
VEHICLE = "px4-1"
HASH = "ab" * 32
ANCHOR = base.GeoPosition(latitude_deg=31.3622, longitude_deg=121.6155, altitude_m=4.0)
STOPS = [(-7.0, -4.0, 8.0), (-7.0, 4.0, 20.0), (7.0, 4.0, 20.0), (7.0, -4.0, 8.0)]
HOME = (-20.0, -20.0, 0.0)
HOME_PLACE = {"latitude_deg": 31.3620197, "longitude_deg": 121.6152898, "altitude_m": 4.0}

PROVED = {"state": "uploaded", "proved": True, "actions": ["upload", "start"]}
FLYING = {"state": "flying", "proved": True, "started_at": NOW, "actions": ["pause", "return", "land"]}
NOT_READ: dict[str, Any] = {"state": "none", "read_at": None, "how": "", "equal": None, "items": []}


def reading(value: Any, age_s: float = 0.1, *, stale: bool = False) -> dict[str, Any]:
    return {"value": value, "age_s": age_s, "stale": stale}


def vehicle(**changes: Any) -> vehicles.VehicleInfo:
    values: dict[str, Any] = {
        "name": VEHICLE, "system_id": 1, "autopilot": "px4", "vehicle_type": 2, "connected": True,
        "last_heard_age_s": 0.1, "link_quality": 0.98, "messages_per_s": 87.0, "round_trip_s": 0.042, "flight_id": None,
        "armed": reading(False), "mode": reading("hold"), "mode_name": reading("AUTO.LOITER"),
        "landed": reading("on_ground"), "position": reading(HOME_PLACE), "local_position_m": None,
        "velocity_m_s": reading((0.0, 0.0, 0.0)), "yaw_deg": reading(45.0), "gimbal_pitch_deg": reading(-20.0),
        "attitude": reading({"roll_deg": 0.0, "pitch_deg": 0.0, "heading_deg": 45.0}), "home": reading(HOME_PLACE),
        "battery": reading({"remaining": 0.83, "voltage_v": 15.6, "current_a": 1.2}), "mission": None,
        "gps_fix": reading(3), "satellites": reading(14), "ready_to_arm": reading(True),
    }  # fmt: skip
    return vehicles.VehicleInfo.model_validate({**values, **changes})


def report() -> plans.PlanReport:
    values: dict[str, Any] = {
        "length_m": 168.2, "path_length_m": 166.9, "duration_s": 95.0, "mean_deviation_m": 0.04,
        "max_deviation_m": 0.31, "min_clearance_m": 2.04, "max_speed_m_s": 4.81, "max_acceleration_m_s2": 2.44,
        "max_jerk_m_s3": 7.0, "corridor_violation_m": 0.0, "worst_viewpoint_miss_m": 0.001, "viewpoints": len(STOPS),
        "coverage": 0.982, "coverable": 0.91, "tour_cost": 95.0, "tour_lower_bound": 91.3, "tour_metric": "time",
        "energy_wh": 21.4, "open_sky": 1.0, "mission_items": 18,
        "stages_s": {"distance field": 1.2, "views": 3.1, "trajectory": 0.7},
    }  # fmt: skip
    return plans.PlanReport.model_validate(values)


def plan_summary(**changes: Any) -> plans.PlanSummary:
    values: dict[str, Any] = {
        "id": "plan-1", "name": "test portal", "created_at": NOW, "state": "ready", "plan_hash": HASH,
        "report": report(), "failure": None, "job": None, "files": ["plan.json", "structure.ply", "report.html"],
    }  # fmt: skip
    return plans.PlanSummary.model_validate({**values, **changes})


def portal() -> trimesh.Trimesh:
    """Two legs and a beam."""
    parts = [((1.5, 1.5, 24), (-3, 0, 12)), ((1.5, 1.5, 24), (3, 0, 12)), ((10, 2, 2), (0, 0, 25))]
    boxes = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(place)) for size, place in parts]
    return trimesh.util.concatenate(boxes)


def viewpoint(number: int) -> plans.ViewpointInfo:
    stop = STOPS[number]
    yaw = math.atan2(-stop[1], -stop[0])
    values: dict[str, Any] = {
        "id": number, "name": f"V{number + 1}", "position_m": stop, "direction": (math.cos(yaw), math.sin(yaw), 0.0),
        "up": (0.0, 0.0, 1.0), "gsd_mm": 2.0, "time_s": 20.0 * (number + 1), "yaw_deg": math.degrees(yaw),
        "gimbal_pitch_deg": 0.0,
    }  # fmt: skip
    return plans.ViewpointInfo.model_validate(values)


def plan_detail(**changes: Any) -> plans.PlanDetail:
    mesh = portal()
    samples, faces = trimesh.sample.sample_surface(mesh, 3000, seed=1)
    path = [HOME, (-20.0, -20.0, 10.0), *STOPS, (-20.0, -20.0, 10.0), HOME]
    t = np.linspace(0, 1, 400)
    curve = np.stack([np.interp(t, np.linspace(0, 1, len(path)), [p[axis] for p in path]) for axis in range(3)], axis=1)
    values: dict[str, Any] = {
        "id": "plan-1", "name": "test portal", "plan_hash": HASH, "anchor": ANCHOR, "home_m": HOME, "ground_m": 0.0,
        "scenario": {
            "safety": {"clearance_m": 1.0, "tracking_m": 0.5, "position_m": 0.3, "model_m": 0.1},
            "vehicle": {
                "max_speed_m_s": 5.0, "max_acceleration_m_s2": 2.5, "battery": {"capacity_wh": 130, "reserve": 0.25},
            },
            "camera": {"sensor_width_mm": 13.2, "sensor_height_mm": 8.8, "focal_length_mm": 8.8},
        },
        "cables": [{"from_m": (0, 0, 26), "to_m": (10, 0, 0), "radius_m": 0.1}],
        "viewpoints": [viewpoint(i) for i in range(len(STOPS))], "path_m": path, "corridor": [], "report": report(),
        "trajectory": {
            "t_s": list(95 * t), "position_m": curve.tolist(), "speed_m_s": [2.0] * 400, "yaw_deg": [0.0] * 400,
            "gimbal_pitch_deg": [0.0] * 400,
        },
        "coverage": {
            "points_m": samples.tolist(), "normals": mesh.face_normals[faces].tolist(), "samples": len(samples),
            "seen": (samples[:, 2] > 4).tolist(), "coverable": (samples[:, 2] > 1.5).tolist(),
            "verdicts": ["seen" if z > 4 else "left_out" if z > 1.5 else "too_close" for z in samples[:, 2]],
        },
    }  # fmt: skip
    return plans.PlanDetail.model_validate({**values, **changes})


def flight(**changes: Any) -> flights.FlightInfo:
    values: dict[str, Any] = {
        "id": "flight-1", "plan_id": "plan-1", "plan_hash": HASH, "vehicle": VEHICLE, "system_id": 1,
        "mode": "mission", "state": "created", "created_at": NOW, "updated_at": NOW, "started_at": None,
        "ended_at": None, "proved": False, "viewpoints": len(STOPS), "viewpoints_reached": 0,
        "images_expected": len(STOPS), "images_received": 0, "max_cross_track_m": None, "plan_time_s": None,
        "accepted_failsafes": [], "observer": None, "problems": [], "actions": ["upload"],
    }  # fmt: skip
    return flights.FlightInfo.model_validate({**values, **changes})


def mission_item(number: int) -> dict[str, Any]:
    return {
        "sequence": number, "frame": 5, "command": 16, "params": [0.0, 0.0, 0.0, None], "x": 0, "y": 0, "z": 0.0,
        "position_m": STOPS[number], "viewpoint_id": number,
    }  # fmt: skip


def on_vehicle(**changes: Any) -> flights.OnVehicle:
    values: dict[str, Any] = {
        "flight_id": "flight-1", "state": "proved", "read_at": "2026-11-22T10:01:00Z", "how": "mission protocol",
        "equal": True, "differences": [], "canonical_crc32": 1234, "problem": None,
        "items": [mission_item(i) for i in range(len(STOPS))],
    }  # fmt: skip
    return flights.OnVehicle.model_validate({**values, **changes})


def picture(text: str) -> bytes:
    image = Image.new("RGB", (320, 213), (84, 104, 122))
    ImageDraw.Draw(image).text((140, 100), text)
    data = io.BytesIO()
    image.save(data, "JPEG")
    return data.getvalue()


def image(number: int, state: str = "stored") -> flights.ImageInfo:
    values: dict[str, Any] = {
        "id": f"image-{number}", "flight_id": "flight-1", "index": number, "viewpoint_id": number,
        "viewpoint_name": f"V{number + 1}", "state": state, "source": "link",
        "announced_at": f"2026-11-22T10:0{number}:00Z", "stored_at": NOW if state == "stored" else None,
        "vehicle_path": f"/DCIM/{number:04}.jpg", "position_m": STOPS[number], "size_bytes": 20480, "crc32": 0xBEEF,
        "problem": None,
    }  # fmt: skip
    return flights.ImageInfo.model_validate(values)


def lease(**changes: Any) -> leases.LeaseInfo:
    values: dict[str, Any] = {
        "flight_id": "flight-1", "lease": "00c0ffee", "state": "leading", "text": "leads, lease 00c0ffee", "away": None,
        "plan_time_s": 31.0, "reports_pending": 0, "lidar_age_s": 0.1, "odometry_quality": 92, "age_s": 0.1,
    }  # fmt: skip
    return leases.LeaseInfo.model_validate({**values, **changes})


def replan(**changes: Any) -> replans.ReplanInfo:
    values: dict[str, Any] = {
        "id": 1, "flight_id": "flight-1", "boot_id": 7, "number": 1, "received_at": NOW, "reason": "bird",
        "mission_item": 3, "left_at_s": 10.0, "rejoined_at_s": 14.5, "plan_hash": HASH, "plan_hash_after": "cd" * 32,
        "path_m": [(-7, -2.4, 10.4), (-10, -1, 12.5), (-10, 1, 15), (-7, 2.4, 17.6)], "chain": "known",
        "left_out": {
            "from_s": 30.0, "to_s": 33.5, "length_m": 8.7, "duration_s": 3.5,
            "path_m": [(-7, -2.4, 10.4), (-7, 2.4, 17.6)],
        },
        "flown_length_m": 11.7, "flown_duration_s": 4.5,
        "obstacle": {"position_m": (-7, 0, 14), "radius_m": 0.8, "velocity_m_s": (0.6, 0.8)},
        "viewpoints": [{"viewpoint_id": 1, "name": "V2", "fate": "skipped", "position_m": None}],
    }  # fmt: skip
    return replans.ReplanInfo.model_validate({**values, **changes})


def offer(**changes: Any) -> replans.PlanOfferInfo:
    values: dict[str, Any] = {
        "id": "offer-1", "flight_id": "flight-1", "state": "offered", "created_at": NOW, "viewpoints": [1],
        "names": ["V2"], "length_m": 84.0, "duration_s": 61.0, "decided_at": None, "plan_id": None, "failure": None,
    }  # fmt: skip
    return replans.PlanOfferInfo.model_validate({**values, **changes})


def checks(*states: tuple[str, str, str | None]) -> flights.PreflightInfo:
    """Preflight checks as (name, state, name to accept)."""
    listed = [
        {"name": name, "state": state, "detail": f"what {name} says", "accept": accept}
        for name, state, accept in states
    ]
    ok = all(state == "ok" for _, state, _ in states)
    return flights.PreflightInfo.model_validate(
        {"flight_id": "flight-1", "at": NOW, "ok": ok, "checks": listed, "prediction": None}
    )


@pytest.fixture
def told() -> SimpleNamespace:
    """Builders of what the station tells."""
    return SimpleNamespace(
        reading=reading, vehicle=vehicle, plan_summary=plan_summary, plan_detail=plan_detail, flight=flight,
        on_vehicle=on_vehicle, image=image, lease=lease, replan=replan, offer=offer, checks=checks, PROVED=PROVED,
        FLYING=FLYING, NOW=NOW, VEHICLE=VEHICLE,
    )  # fmt: skip


@pytest.fixture
def script(station: Any) -> Any:
    """A station with one ready plan and one vehicle on the ground."""
    station.snapshot = live.SnapshotMessage(
        at=NOW,
        reason="start",
        links=[],
        vehicles=[vehicle()],
        plans=[plan_summary()],
        flights=[],
        leases=[],
        messages=[],
    )
    station.replies |= {
        "GET /plans/plan-1/detail": plan_detail(),
        "GET /plans/plan-1/files/structure.ply": portal().export(file_type="ply"),
        "GET /flights/flight-1/track": flights.Track(flight_id="flight-1", points=[]),
        "GET /flights/flight-1/events": [],
        "GET /flights/flight-1/images": [],
        "GET /flights/flight-1/replans": [],
        "GET /flights/flight-1/offers": [],
        "GET /flights/flight-1/on-vehicle": on_vehicle(**NOT_READ),
        "GET /flights/flight-1/preflight": checks(("datum", "ok", None)),
        "POST /flights": flight(),
    }
    for number in range(len(STOPS)):
        station.replies[f"GET /images/image-{number}/file"] = picture(f"V{number + 1}")
    return station
