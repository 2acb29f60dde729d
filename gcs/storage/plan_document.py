"""The content of `plan.json`: its schema, and the way from a plan to it and back."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from gcs.core.camera import Camera
from gcs.core.plan import CellNote, Certificates, FaceCoverage, OwnWays, Plan, Sortie, Viewpoint
from gcs.core.scenario import Scenario
from gcs.core.structure_source import Cable
from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
from gcs.core.way_home import OwnAction
from gcs.storage.coverage_document import CoverageEntry, coverage_entry, coverage_of

Point = tuple[float, float, float]
Plane = tuple[float, float, float, float]
"""Of a convex set: outward unit normal, and the offset that `normal . p` does not exceed in it (m)."""

Coefficients = Annotated[list[Point], Field(min_length=8, max_length=8)]


class Document(BaseModel):
    """Base: nothing unknown, and numbers are finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ViewpointEntry(Document):
    """A place from which one picture is taken: at standstill for at least `hold_s`, or in flight."""

    id: int
    name: str
    position_m: Point
    direction: Point
    up: Point
    gsd_m: Annotated[float, Field(gt=0)]
    time_s: float
    yaw_rad: float
    gimbal_pitch_rad: float
    stops: bool = True
    hold_s: Annotated[float, Field(ge=0)] = 0.0


class TourEntry(Document):
    """The visiting order, as viewpoint ids, and how good it is."""

    order: list[int]
    cost: float
    lower_bound: float
    metric: str


class PathEntry(Document):
    """The polyline of straight legs, and which of its points are home, the viewpoints and home again."""

    points_m: list[Point]
    stops: list[int]


class BoxEntry(Document):
    """The box of one trajectory segment: where it had to stay, or without a corridor what holds its control points."""

    low_m: Point
    high_m: Point


class TrajectoryEntry(Document):
    """Degree-7 pieces: on segment s, p = sum_k coefficients_m[s][k] u^k with u = (t - t_s) / durations_s[s]."""

    degree: Literal[7] = 7
    durations_s: list[float]
    coefficients_m: list[Coefficients]


class AngleEntry(Document):
    """An angle over time: at rest at every knot, a smooth step 3 s^2 - 2 s^3 between knots."""

    times_s: list[float]
    angles_rad: list[float]


class CellEntry(Document):
    """A cell of a face and what is to be said about it."""

    cell: str
    reason: str


class FaceEntry(Document):
    """How many cells of a face are seen whole; which of them not from straight in front, and which not at all."""

    name: str
    cells: int
    covered: int
    moved: list[CellEntry]
    not_covered: list[CellEntry]


class OwnWaysEntry(Document):
    """What the vehicle can safely do by itself; intervals are (from, to) in seconds of the trajectory's time."""

    action: Literal["return", "land", "retrace", "continue"]
    return_altitude_m: float | None
    return_blocked_s: list[tuple[float, float]]
    landing_blocked_s: list[tuple[float, float]]
    hold_blocked_s: list[tuple[float, float]]
    retrace_accuracy_m: float
    retrace_points: int
    rally_blocked_s: list[tuple[float, float]] | None = None
    rally_altitude_m: float | None = None


class SortieEntry(Document):
    """One of several flights on one battery each: its viewpoints, and take-off and landing on the trajectory's time."""

    viewpoints: list[int]
    energy_wh: float
    duration_s: float
    start_s: float
    end_s: float


class EventEntry(Document):
    """Something that happens at a time of the trajectory."""

    time_s: float
    kind: Literal["take_off", "photo", "landed"]
    viewpoint: int | None = None


class CertificatesEntry(Document):
    """Figures computed from the finished plan, SI units."""

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
    max_blur_px: float | None = None
    max_skew_px: float | None = None
    viewpoints_lower_bound: float | None = None
    viewpoints_bound_solved: bool | None = None
    surface_m2: float | None = None
    coverage_samples: int | None = None
    not_covered_m2: dict[str, float] | None = None
    spots: dict[str, int] | None = None


class PlanDocument(Document):
    """The whole plan. Positions are scene ENU in metres about the scenario's anchor, times seconds, yaw from east."""

    format: Literal["gcs-plan"] = "gcs-plan"
    version: Literal[1] = 1
    scenario: Scenario
    camera: Camera
    cables: list[Cable]
    viewpoints: list[ViewpointEntry]
    tour: TourEntry
    path: PathEntry
    corridor: list[BoxEntry]
    corridor_planes: list[list[Plane]] = []
    trajectory: TrajectoryEntry
    yaw: AngleEntry
    gimbal_pitch: AngleEntry
    events: list[EventEntry]
    coverage: CoverageEntry | None
    faces: list[FaceEntry] = []
    sorties: list[SortieEntry] = []
    own_ways: OwnWaysEntry | None = None
    certificates: CertificatesEntry
    stages_s: dict[str, float]

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        pieces, ids = self.trajectory.durations_s, [v.id for v in self.viewpoints]
        stops = self.path.stops
        fits = {
            "trajectory": 0 < len(pieces) == len(self.trajectory.coefficients_m) and min(pieces) > 0,
            "corridor": len(self.corridor) == len(pieces),
            "corridor_planes": len(self.corridor_planes)
            == (0 if self.scenario.planner.corridor == "boxes" else len(pieces))
            and all(abs(math.hypot(*plane[:3]) - 1) < 1e-9 for planes in self.corridor_planes for plane in planes),
            "path": len(stops) == len(ids) + 2
            and stops[0] == 0
            and stops[-1] == len(self.path.points_m) - 1
            and _ascends(stops, strictly=False),
            "yaw": len(self.yaw.times_s) == len(self.yaw.angles_rad) >= 2 and _ascends(self.yaw.times_s),
            "gimbal_pitch": len(self.gimbal_pitch.times_s) == len(self.gimbal_pitch.angles_rad) >= 2
            and _ascends(self.gimbal_pitch.times_s),
            "camera": self.camera == self.scenario.camera,
            "tour": self.tour.order == ids,
            "events": [(e.viewpoint, e.time_s) for e in self.events if e.kind == "photo"]
            == [(v.id, v.time_s) for v in self.viewpoints],
            "sorties": not self.sorties or [v for s in self.sorties for v in s.viewpoints] == ids,
            "faces": all(f.covered == f.cells - len(f.not_covered) for f in self.faces),
        }
        wrong = [name for name, well in fits.items() if not well]
        if wrong:
            raise ValueError(f"does not fit the other parts: {', '.join(wrong)}")
        return self


def document_of(plan: Plan) -> PlanDocument:
    """The document of a plan."""
    certificates = plan.certificates
    return PlanDocument(
        scenario=plan.scenario,
        camera=plan.scenario.camera,
        cables=list(plan.cables),
        viewpoints=[
            ViewpointEntry(
                id=v.id,
                name=v.name,
                position_m=_point(v.position_m),
                direction=_point(v.direction),
                up=_point(v.up),
                gsd_m=float(v.gsd_m),
                time_s=float(v.time_s),
                yaw_rad=float(v.yaw_rad),
                gimbal_pitch_rad=float(v.gimbal_pitch_rad),
                stops=v.stops,
                hold_s=v.hold_s,
            )
            for v in plan.viewpoints
        ],
        tour=TourEntry(
            order=[v.id for v in plan.viewpoints],
            cost=certificates.tour_cost,
            lower_bound=certificates.tour_lower_bound,
            metric=certificates.tour_metric,
        ),
        path=PathEntry(points_m=_points(plan.path_m), stops=[int(k) for k in plan.path_stops]),
        corridor=[BoxEntry(low_m=_point(box[0]), high_m=_point(box[1])) for box in plan.corridor_m],
        corridor_planes=[[_plane(plane) for plane in planes] for planes in plan.corridor_planes],
        trajectory=TrajectoryEntry(
            durations_s=_numbers(plan.trajectory.durations_s),
            coefficients_m=[_points(segment) for segment in plan.trajectory.coefficients],
        ),
        yaw=AngleEntry(times_s=_numbers(plan.yaw.times_s), angles_rad=_numbers(plan.yaw.angles_rad)),
        gimbal_pitch=AngleEntry(
            times_s=_numbers(plan.gimbal_pitch.times_s), angles_rad=_numbers(plan.gimbal_pitch.angles_rad)
        ),
        events=sorted(_events(plan), key=lambda event: event.time_s),
        coverage=None if plan.coverage is None else coverage_entry(plan.coverage),
        faces=[face_entry(face) for face in plan.faces],
        sorties=[sortie_entry(sortie) for sortie in plan.sorties],
        own_ways=own_ways_entry(plan.own_ways),
        certificates=CertificatesEntry.model_validate(vars(certificates)),
        stages_s=plan.stages_s,
    )


def _events(plan: Plan) -> list[EventEntry]:
    flights = [(s.start_s, s.end_s) for s in plan.sorties] or [(0.0, plan.trajectory.duration_s)]
    return [
        *(EventEntry(time_s=start, kind="take_off") for start, _ in flights),
        *(EventEntry(time_s=float(v.time_s), kind="photo", viewpoint=v.id) for v in plan.viewpoints),
        *(EventEntry(time_s=end, kind="landed") for _, end in flights),
    ]


def sortie_entry(sortie: Sortie) -> SortieEntry:
    """The entry of a sortie."""
    return SortieEntry(
        viewpoints=list(sortie.viewpoints),
        energy_wh=sortie.energy_wh,
        duration_s=sortie.duration_s,
        start_s=sortie.start_s,
        end_s=sortie.end_s,
    )


def face_entry(face: FaceCoverage) -> FaceEntry:
    """The entry of a face."""
    return FaceEntry(
        name=face.name,
        cells=face.cells,
        covered=face.covered,
        moved=[CellEntry(cell=note.cell, reason=note.reason) for note in face.moved],
        not_covered=[CellEntry(cell=note.cell, reason=note.reason) for note in face.not_covered],
    )


def own_ways_entry(ways: OwnWays | None) -> OwnWaysEntry | None:
    """The entry of what the vehicle can do by itself."""
    return None if ways is None else OwnWaysEntry.model_validate({**vars(ways), "action": ways.action.value})


def _ascends(values: Sequence[float], *, strictly: bool = True) -> bool:
    return all(a < b or (a == b and not strictly) for a, b in itertools.pairwise(values))


def plan_of(document: PlanDocument) -> Plan:
    """The plan that a document holds."""
    return Plan(
        scenario=document.scenario,
        cables=tuple(document.cables),
        viewpoints=tuple(
            Viewpoint(
                id=v.id,
                name=v.name,
                position_m=np.array(v.position_m),
                direction=np.array(v.direction),
                up=np.array(v.up),
                gsd_m=v.gsd_m,
                time_s=v.time_s,
                yaw_rad=v.yaw_rad,
                gimbal_pitch_rad=v.gimbal_pitch_rad,
                stops=v.stops,
                hold_s=v.hold_s,
            )
            for v in document.viewpoints
        ),
        path_m=_array(document.path.points_m, (-1, 3)),
        path_stops=np.array(document.path.stops, dtype=np.int64),
        corridor_m=_array([[b.low_m, b.high_m] for b in document.corridor], (-1, 2, 3)),
        corridor_planes=tuple(_array(planes, (-1, 4)) for planes in document.corridor_planes),
        trajectory=PiecewisePolynomial(
            _array(document.trajectory.coefficients_m, (-1, 8, 3)), _array(document.trajectory.durations_s, (-1,))
        ),
        yaw=_angle(document.yaw),
        gimbal_pitch=_angle(document.gimbal_pitch),
        coverage=None if document.coverage is None else coverage_of(document.coverage),
        certificates=Certificates(**document.certificates.model_dump()),
        stages_s=document.stages_s,
        faces=tuple(
            FaceCoverage(face.name, face.cells, _notes(face.moved), _notes(face.not_covered)) for face in document.faces
        ),
        own_ways=_own_ways(document.own_ways),
        sorties=tuple(Sortie(tuple(s.viewpoints), s.start_s, s.end_s, s.energy_wh) for s in document.sorties),
    )


def _notes(entries: list[CellEntry]) -> tuple[CellNote, ...]:
    return tuple(CellNote(entry.cell, entry.reason) for entry in entries)


def _own_ways(entry: OwnWaysEntry | None) -> OwnWays | None:
    if entry is None:
        return None
    return OwnWays(
        action=OwnAction(entry.action),
        return_altitude_m=entry.return_altitude_m,
        return_blocked_s=tuple(entry.return_blocked_s),
        landing_blocked_s=tuple(entry.landing_blocked_s),
        hold_blocked_s=tuple(entry.hold_blocked_s),
        retrace_accuracy_m=entry.retrace_accuracy_m,
        retrace_points=entry.retrace_points,
        rally_blocked_s=None if entry.rally_blocked_s is None else tuple(entry.rally_blocked_s),
        rally_altitude_m=entry.rally_altitude_m,
    )


def _point(values: NDArray[np.float64]) -> Point:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _plane(values: NDArray[np.float64]) -> Plane:
    x, y, z, offset = (float(v) for v in values)
    return x, y, z, offset


def _points(values: NDArray[np.float64]) -> list[Point]:
    return [(x, y, z) for x, y, z in values.tolist()]


def _numbers(values: NDArray[np.float64]) -> list[float]:
    return [float(v) for v in values]


def _array(values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    return np.array(values, dtype=np.float64).reshape(shape)


def _angle(entry: AngleEntry) -> AngleProfile:
    return AngleProfile(_array(entry.times_s, (-1,)), _array(entry.angles_rad, (-1,)))
