"""Plans: asked for, listed, and in full for drawing."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from gcs.api.schemas.base import Box, CableLine, Failure, GeoPosition, Point3, Sent, Taken
from gcs.api.schemas.predictions import PredictionInfo
from gcs.storage.records import JobState, PlanState


class PlanRequest(Taken):
    """Ask for a plan."""

    scenario: dict[str, Any] = Field(
        description="A scenario as in a scenario file. Meshes are named by the `source` of a structure of this station."
    )


class JobInfo(Sent):
    """How far a planning job is."""

    id: str
    plan_id: str
    state: JobState
    stage: str
    fraction: float = Field(description="Share of the present stage that is done, 0 to 1.")
    created_at: str
    finished_at: str | None


class FaceCellNote(Sent):
    """A cell of a face, named as its viewpoint, and what is to be said about it."""

    cell: str
    reason: str


class FaceReport(Sent):
    """How the cells of a face are seen."""

    name: str
    cells: int
    covered: int = Field(description="Cells that one picture shows whole.")
    moved: list[FaceCellNote] = Field(description="Covered, but not from straight in front; what is in the way there.")
    not_covered: list[FaceCellNote] = Field(description="Cells that no place shows whole, and why.")


class SortieReport(Sent):
    """One of several flights on one battery each; the vehicle rests at home between them."""

    viewpoints: list[int] = Field(description="Ids, in visiting order.")
    energy_wh: float
    duration_s: float
    start_s: float = Field(description="Take-off, on the time of the whole plan.")
    end_s: float


class TrackingReport(Sent):
    """How closely a rigid body of the vehicle's mass could fly the curve in light gusts, and what its motors give."""

    axes_m: Point3 = Field(description="Largest position error east, north and up.")
    distance_m: float = Field(description="Largest distance from where it is to be at that moment.")
    deviation_m: float = Field(description="Largest distance from the curve.")
    mean_deviation_m: float
    yaw_rad: float = Field(description="Largest error of the heading.")
    thrust_n: tuple[float, float] = Field(description="Least and largest thrust of a motor.")
    most_thrust_n: float = Field(description="What one motor can give.")
    saturated_share: float = Field(description="Share of the time in which a motor gives all that it can.")
    mass_kg: float
    gusts_m_s: float


class PlanReport(Sent):
    """The figures of `report.json`."""

    length_m: float
    path_length_m: float
    duration_s: float
    mean_deviation_m: float
    max_deviation_m: float
    min_clearance_m: float
    max_speed_m_s: float
    max_acceleration_m_s2: float
    max_jerk_m_s3: float
    corridor_violation_m: float
    worst_viewpoint_miss_m: float
    viewpoints: int
    coverage: float | None
    coverable: float | None
    tour_cost: float
    tour_lower_bound: float
    tour_metric: str
    energy_wh: float
    open_sky: float
    max_blur_px: float | None = Field(None, description="None when the camera's exposure is not known.")
    max_skew_px: float | None = Field(None, description="None when the camera's readout is not known.")
    viewpoints_lower_bound: float | None = Field(
        None, description="No choice from the same candidates that covers as much has fewer viewpoints."
    )
    viewpoints_bound_solved: bool | None = Field(None, description="Whether it is the best of its kind to 0.2 %.")
    surface_m2: float | None = Field(None, description="Area that was asked for, both sides.")
    coverage_samples: int | None = None
    not_covered_m2: dict[str, float] | None = Field(None, description="Area that is not seen, by its verdict.")
    spots: dict[str, int] | None = Field(None, description="How many of the named spots have each verdict.")
    faces: list[FaceReport] = Field(default_factory=list)
    sorties: list[SortieReport] = Field(
        default_factory=list, description="The flights, when one battery is not enough for all; else empty."
    )
    mission_items: int | None = Field(description="None when the plan was written without mission files.")
    predictions: list[PredictionInfo] = Field(
        default_factory=list, description="Of vehicles with their autopilot's usual settings."
    )
    tracking: TrackingReport | None = Field(
        None, description="None for several sorties, which have their own, and in reports of earlier releases."
    )
    stages_s: dict[str, float]


class PlanSummary(Sent):
    """One plan of the list. Only a `ready` plan has a report, files and a drawing."""

    id: str
    name: str
    created_at: str
    state: PlanState
    plan_hash: str | None = Field(description="SHA-256 of the bytes of plan.json.")
    report: PlanReport | None
    failure: Failure | None
    job: JobInfo | None
    files: list[str]


class PlanAccepted(Sent):
    """A plan that is being made."""

    plan: PlanSummary
    job: JobInfo


class ViewpointInfo(Sent):
    """A place from which one picture is taken."""

    id: int
    name: str
    position_m: Point3
    direction: Point3
    up: Point3
    gsd_mm: float
    time_s: float
    yaw_deg: float = Field(description="From east, counter-clockwise.")
    gimbal_pitch_deg: float = Field(description="0 level, negative down.")


class TrajectorySamples(Sent):
    """The curve that is flown, sampled; columns of equal length."""

    t_s: list[float]
    position_m: list[Point3]
    speed_m_s: list[float]
    yaw_deg: list[float]
    gimbal_pitch_deg: list[float]


class CoverageSamples(Sent):
    """How the sampled sides of the surface are seen; columns of equal length."""

    points_m: list[Point3]
    normals: list[Point3]
    seen: list[bool]
    coverable: list[bool]
    verdicts: list[str] = Field(
        description="What becomes of each: `seen`, `left_out` (could be seen by more viewpoints), or why no picture "
        "shows it: `gimbal`, `incidence`, `too_far`, `not_sharp`, `fence`, `ground`, `not_reachable`, `too_close`, "
        "`occluded`."
    )
    samples: int = Field(description="How many the certificate used; the columns may hold a thinned-out part of them.")


class PlanDetail(Sent):
    """A ready plan for drawing. The structure's triangles are in files/structure.ply."""

    id: str
    name: str
    plan_hash: str
    anchor: GeoPosition
    home_m: Point3
    ground_m: float | None
    scenario: dict[str, Any]
    cables: list[CableLine]
    viewpoints: list[ViewpointInfo]
    path_m: list[Point3]
    trajectory: TrajectorySamples
    corridor: list[Box]
    coverage: CoverageSamples | None
    report: PlanReport
