"""From what the station holds (SI, radians, records) to what the API says (degrees, ages, schemas)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from gcs.api.schemas.base import Box, CableLine, Failure, GeoPosition, Reading
from gcs.api.schemas.flights import (
    FlightEvent,
    FlightInfo,
    ImageInfo,
    MissionItemInfo,
    OnVehicle,
    PreflightCheck,
    PreflightInfo,
    TrackSample,
)
from gcs.api.schemas.plans import JobInfo, PlanReport, PlanSummary
from gcs.api.schemas.predictions import PredictionInfo
from gcs.api.schemas.structures import NamedPointInfo, StructureDetail, StructureSummary
from gcs.api.schemas.vehicles import (
    Attitude,
    Battery,
    LinkInfo,
    MissionPosition,
    SigningInfo,
    VehicleInfo,
    VehicleMessage,
    WayInfo,
)
from gcs.core.frames import enu_from_geodetic
from gcs.core.mission import Frame
from gcs.services.flight_types import allowed_actions

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gcs.core.frames import GeoPoint
    from gcs.core.mission import MissionItem
    from gcs.core.structure_source import Cable
    from gcs.core.vehicle import Heard
    from gcs.mavlink.routing import WayInfo as Way
    from gcs.mavlink.signing import SigningStatus
    from gcs.services.flight_types import OnVehicleMission, PreflightReport
    from gcs.services.plan_service import PlanView
    from gcs.services.structure_service import LoadedStructure, StructureInfo
    from gcs.services.vehicle_service import LinkView, VehicleText, VehicleView
    from gcs.storage.records import Failure as FailureRecord
    from gcs.storage.records import (
        FlightEventRecord,
        FlightOverview,
        ImageRecord,
        JobRecord,
        TrackPoint,
    )

T = TypeVar("T")
U = TypeVar("U")

STALE_AFTER_S = {"home": 120.0, "mission": 10.0, "battery": 10.0, "ready_to_arm": 10.0}
"""Values that vehicles send seldom; all others are stale after `USUAL_STALE_AFTER_S`."""
USUAL_STALE_AFTER_S = 3.0


def point3(values: Iterable[float]) -> tuple[float, float, float]:
    """Three plain numbers of any sequence of three."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def cable_line(cable: Cable) -> CableLine:
    """A cable for drawing."""
    return CableLine(from_m=cable.from_m, to_m=cable.to_m, radius_m=cable.radius_m)


def geo_position(point: GeoPoint) -> GeoPosition:
    """A geodetic point."""
    return GeoPosition.model_validate(point)


def structure_summary(info: StructureInfo) -> StructureSummary:
    """One structure of the list."""
    return StructureSummary(id=info.id, kind=info.kind, name=info.name, created_at=info.created_at)


def structure_detail(loaded: LoadedStructure) -> StructureDetail:
    """A structure with what was found in it."""
    info, structure = loaded.info, loaded.structure
    low, high = structure.bounds_m
    return StructureDetail(
        id=info.id,
        kind=info.kind,
        name=info.name,
        created_at=info.created_at,
        source=info.source,
        triangles=len(structure.faces),
        bounds=Box(low_m=point3(low), high_m=point3(high)),
        cables=[cable_line(c) for c in structure.cables],
        named_points=[
            NamedPointInfo(name=p.name, position_m=p.position_m, normal=p.normal) for p in structure.named_points
        ],
        notes=list(structure.notes),
    )


def failure(record: FailureRecord | None) -> Failure | None:
    """Why something failed."""
    return None if record is None else Failure.model_validate(record)


def job_info(job: JobRecord) -> JobInfo:
    """How far a job is."""
    return JobInfo.model_validate(job)


def plan_summary(view: PlanView) -> PlanSummary:
    """State, figures and files of a plan."""
    plan = view.plan
    return PlanSummary(
        id=plan.id,
        name=plan.name,
        created_at=plan.created_at,
        state=plan.state,
        plan_hash=plan.plan_hash,
        report=None if plan.report is None else PlanReport.model_validate(plan.report),
        failure=failure(plan.failure),
        job=None if view.job is None else job_info(view.job),
        files=list(view.files),
    )


def link_info(view: LinkView) -> LinkInfo:
    """A link and whether it is open."""
    return LinkInfo(
        id=view.link.id,
        url=view.link.url,
        created_at=view.link.created_at,
        state=view.state,
        problem=view.problem,
        messages_per_s=view.messages_per_s,
        peers=list(view.peers),
        signing=None if view.signing is None else signing_info(view.signing),
    )


def signing_info(status: SigningStatus) -> SigningInfo:
    """How signing of a link goes."""
    counts = {verdict.name.lower(): count for verdict, count in status.counts.items()}
    return SigningInfo(
        rejects_unsigned=status.rejects_unsigned, problem=status.problem, rotated_at=status.rotated_at, **counts
    )


def way_info(way: Way) -> WayInfo:
    """A link on which a vehicle is heard."""
    signing = None if way.signing is None else signing_info(way.signing)
    return WayInfo.model_validate({**vars(way), "signing": signing})


def vehicle_info(view: VehicleView) -> VehicleInfo:
    """A vehicle with the age of every value."""
    t = view.telemetry

    def reading(name: str, heard: Heard[T] | None, convert: Callable[[T], U]) -> Reading[U] | None:
        if heard is None:
            return None
        age = max(heard.age_s(view.now_s), 0.0)
        limit = STALE_AFTER_S.get(name, USUAL_STALE_AFTER_S)
        return Reading(value=convert(heard.value), age_s=round(age, 3), stale=age > limit or not view.connected)

    return VehicleInfo(
        name=view.identity.name,
        system_id=view.identity.system_id,
        autopilot=view.identity.autopilot.value,
        vehicle_type=view.identity.vehicle_type,
        connected=view.connected,
        last_heard_age_s=None if view.last_heard_s is None else round(max(view.now_s - view.last_heard_s, 0.0), 3),
        link_quality=None if view.link_quality.loss is None else 1 - view.link_quality.loss,
        messages_per_s=round(view.link_quality.messages_per_s, 2),
        round_trip_s=None if view.link_quality.round_trip_s is None else round(view.link_quality.round_trip_s, 4),
        flight_id=view.flight_id,
        id_clash=view.id_clash,
        mavlink_version=view.mavlink_version,
        ways=[way_info(way) for way in view.ways],
        position_source=view.position_source,
        armed=reading("armed", t.armed, bool),
        mode=reading("mode", t.mode, lambda m: m.value),
        mode_name=reading("mode_name", t.mode_name, str),
        landed=reading("landed", t.landed, lambda s: s.name.lower()),
        position=reading("position", t.position, geo_position),
        local_position_m=reading("local_position_m", t.local_position_m, point3),
        velocity_m_s=reading("velocity_m_s", t.velocity_m_s, point3),
        yaw_deg=reading("yaw_deg", t.yaw_rad, math.degrees),
        attitude=reading("attitude", t.attitude_rad, _attitude),
        gimbal_pitch_deg=reading("gimbal_pitch_deg", t.gimbal_pitch_rad, math.degrees),
        battery=reading("battery", t.battery, Battery.model_validate),
        home=reading("home", t.home, geo_position),
        mission=reading(
            "mission",
            t.mission,
            lambda m: MissionPosition(current=m.current, total=m.total, state=m.state.name.lower()),
        ),
        gps_fix=reading("gps_fix", t.gps_fix, int),
        satellites=reading("satellites", t.satellites, int),
        ready_to_arm=reading("ready_to_arm", t.ready_to_arm, bool),
    )


def _attitude(angles_rad: tuple[float, float, float]) -> Attitude:
    """Roll, pitch and yaw (rad) of the body in degrees; yaw as a heading from 0 to 360."""
    roll, pitch, yaw = angles_rad
    return Attitude(
        roll_deg=math.degrees(roll), pitch_deg=math.degrees(pitch), heading_deg=math.degrees(yaw % (2 * math.pi))
    )


def vehicle_message(text: VehicleText) -> VehicleMessage:
    """A message of a vehicle for people."""
    return VehicleMessage.model_validate(text)


def flight_info(summary: FlightOverview) -> FlightInfo:
    """A flight with its counts and what may be asked of it."""
    flight = summary.flight
    return FlightInfo(
        id=flight.id,
        plan_id=flight.plan_id,
        plan_hash=flight.plan_hash,
        vehicle=flight.vehicle,
        system_id=flight.system_id,
        mode=flight.mode,
        state=flight.state,
        created_at=flight.created_at,
        updated_at=flight.updated_at,
        started_at=flight.started_at,
        ended_at=flight.ended_at,
        proved=flight.proved,
        viewpoints=flight.viewpoints,
        viewpoints_reached=summary.viewpoints_reached,
        images_expected=flight.viewpoints,
        images_received=summary.images_received,
        max_cross_track_m=flight.max_cross_track_m,
        plan_time_s=flight.plan_time_s,
        accepted_failsafes=list(flight.accepted_failsafes),
        observer=flight.observer,
        problems=list(flight.problems),
        actions=list(allowed_actions(flight.state, flight.mode)),
    )


def flight_event(record: FlightEventRecord) -> FlightEvent:
    """One line of a flight's log."""
    return FlightEvent.model_validate(record)


def track_sample(point: TrackPoint) -> TrackSample:
    """One point of a flown path."""
    return TrackSample.model_validate(point)


def image_info(record: ImageRecord) -> ImageInfo:
    """A picture."""
    return ImageInfo.model_validate(record)


def preflight_info(report: PreflightReport) -> PreflightInfo:
    """All checks before upload and arming."""
    checks = [PreflightCheck.model_validate(check) for check in report.checks]
    found = report.prediction
    prediction = None if found is None else PredictionInfo.model_validate(found.as_json())
    return PreflightInfo(flight_id=report.flight_id, at=report.at, ok=report.ok, checks=checks, prediction=prediction)


def on_vehicle_info(mission: OnVehicleMission, anchor: GeoPoint) -> OnVehicle:
    """What a vehicle holds, with scene positions of the items that have a place.

    Args:
        mission: as read back.
        anchor: of the plan's scene.
    """
    viewpoint_of = {sequence: viewpoint for viewpoint, sequence in mission.viewpoint_items.items()}
    return OnVehicle(
        flight_id=mission.flight_id,
        state=mission.state,
        read_at=mission.read_at,
        how=mission.how,
        equal=mission.equal,
        differences=list(mission.differences),
        canonical_crc32=mission.canonical_crc32,
        items=[_mission_item(item, anchor, viewpoint_of.get(item.sequence)) for item in mission.items],
        problem=mission.problem,
    )


def _mission_item(item: MissionItem, anchor: GeoPoint, viewpoint_id: int | None) -> MissionItemInfo:
    place = None
    if item.frame in {Frame.GLOBAL, Frame.GLOBAL_INT} and (item.x, item.y) != (0, 0):
        place = point3(enu_from_geodetic(item.x * 1e-7, item.y * 1e-7, item.z, anchor))
    return MissionItemInfo(
        sequence=item.sequence,
        frame=item.frame,
        command=item.command,
        params=[None if math.isnan(p) else p for p in item.params],
        x=item.x,
        y=item.y,
        z=item.z,
        position_m=place,
        viewpoint_id=viewpoint_id,
    )
