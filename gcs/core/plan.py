"""The plan: what was asked, what will be flown, and what is certified about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gcs.core.scenario import Scenario
    from gcs.core.structure_source import Cable
    from gcs.core.surface_coverage import SurfaceCoverage
    from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
    from gcs.core.way_home import OwnAction


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A place from which one picture is taken.

    Attributes:
        id: 0-based number in visiting order.
        name: the named point's name, or `S0001`, ... for surface viewpoints.
        position_m: vehicle centre, scene ENU, shape (3,).
        direction: unit view direction, shape (3,).
        up: unit upward direction of the image, square to `direction`, shape (3,).
        gsd_m: ground sampling distance (m a pixel) at the target along the axis.
        time_s: when the picture is taken on the trajectory.
        yaw_rad: vehicle yaw from east, counter-clockwise.
        gimbal_pitch_rad: camera pitch, 0 level, negative down.
        stops: whether the vehicle stands still there; otherwise the picture is taken in flight.
        hold_s: how long it stands there and looks at least, when that was asked for; 0 when not.
    """

    id: int
    name: str
    position_m: NDArray[np.float64]
    direction: NDArray[np.float64]
    up: NDArray[np.float64]
    gsd_m: float
    time_s: float
    yaw_rad: float
    gimbal_pitch_rad: float
    stops: bool = True
    hold_s: float = 0.0


@dataclass(frozen=True)
class Certificates:
    """Figures that were computed from the finished plan; the keys of `report.json` in SI units."""

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
    """Share of the flight time from which a straight climb above the scene keeps the clearance (safety rule 7)."""
    max_blur_px: float | None = None
    """Largest motion blur of a picture at its focus; None when the camera's exposure is not known."""
    max_skew_px: float | None = None
    """Largest rolling-shutter skew of a picture at its focus; None when the camera's readout is not known."""
    viewpoints_lower_bound: float | None = None
    """No choice from the same candidates that covers as much has fewer; None when no surface was asked for."""
    viewpoints_bound_solved: bool | None = None
    """Whether that is the best bound of its kind to 0.2 %; otherwise a longer search might raise it."""
    surface_m2: float | None = None
    """Area of the surface that was asked for, both sides."""
    coverage_samples: int | None = None
    """Sides that the shares of coverage are taken from."""
    not_covered_m2: dict[str, float] | None = None
    """Area of the sides that are not seen, by what is in the way (`gcs.core.surface_coverage.Verdict`)."""
    spots: dict[str, int] | None = None
    """How many spots there are of each verdict; None when no spots are named."""


@dataclass(frozen=True)
class OwnWays:
    """What the vehicle can safely do by itself along a plan (safety rule 7). Intervals are of plan time (from, to).

    Attributes:
        action: what is safe from everywhere: return, else landing, else flying back the way it came, else only going
            on with the mission.
        return_altitude_m: height above home at which its own return is clear from wherever it can be; None when home
            itself is under something.
        return_blocked_s: from when to when a return at that altitude would come too near to something.
        landing_blocked_s: the same for landing on the spot.
        hold_blocked_s: the same for braking to a hold.
        retrace_accuracy_m: the least accurate memory of the flown path with which flying back along it is clear; 0
            when none is accurate enough.
        retrace_points: points that such a memory needs.
        rally_blocked_s: from when to when a return at `rally_altitude_m` would hit if the vehicle knew the scenario's
            rally points and returned to the nearest of them and home; None without rally points.
        rally_altitude_m: like `return_altitude_m`.
    """

    action: OwnAction
    return_altitude_m: float | None
    return_blocked_s: tuple[tuple[float, float], ...]
    landing_blocked_s: tuple[tuple[float, float], ...]
    hold_blocked_s: tuple[tuple[float, float], ...]
    retrace_accuracy_m: float
    retrace_points: int
    rally_blocked_s: tuple[tuple[float, float], ...] | None = None
    rally_altitude_m: float | None = None


@dataclass(frozen=True)
class Sortie:
    """One of several flights on one battery each; between them the vehicle stands at home.

    Attributes:
        viewpoints: ids of its viewpoints, in visiting order.
        start_s: take-off on the time of the whole plan.
        end_s: landing.
        energy_wh: what it takes from its battery.
    """

    viewpoints: tuple[int, ...]
    start_s: float
    end_s: float
    energy_wh: float

    @property
    def duration_s(self) -> float:
        """From take-off to landing (s)."""
        return self.end_s - self.start_s


@dataclass(frozen=True, eq=False)
class Plan:
    """A finished plan; every certificate in it holds.

    Attributes:
        scenario: what was asked; meshes carry their SHA-256.
        cables: all cables, the sample scene's too.
        viewpoints: in visiting order.
        path_m: collision-free polyline of straight legs from home through the viewpoints to home, shape (N, 3).
        path_stops: index into `path_m` of home, every viewpoint and home again, shape (len(viewpoints) + 2,).
        corridor_m: low and high corner of each trajectory segment's box, shape (S, 2, 3); where it had to stay, or
            without a corridor (`planner.trajectory`) what holds its control points.
        corridor_planes: of each segment's convex set, outward unit normals and offsets, `normal . p <= offset`, shape
            (m, 4) each; where the curve had to stay, within the boxes. Empty where the boxes are the corridor.
        trajectory: the curve that is flown, at rest at both ends and at every viewpoint that it stops at.
        yaw: vehicle yaw over time (from east, counter-clockwise).
        gimbal_pitch: camera pitch over time (0 level, negative down).
        coverage: how the sampled surface is seen, when a surface was asked for.
        certificates: what was proved.
        stages_s: seconds each stage of planning took.
        faces: how the cells of the faces are seen, in the scenario's order.
        own_ways: what the vehicle can safely do by itself; None when that was not looked at.
        sorties: the flights, when one battery is not enough for all; empty when it is one flight.
        parts: each sortie as a complete plan of its own, on its own time; empty in a plan that was read, whose folder
            has them.
    """

    scenario: Scenario
    cables: tuple[Cable, ...]
    viewpoints: tuple[Viewpoint, ...]
    path_m: NDArray[np.float64]
    path_stops: NDArray[np.int64]
    corridor_m: NDArray[np.float64]
    trajectory: PiecewisePolynomial
    yaw: AngleProfile
    gimbal_pitch: AngleProfile
    coverage: SurfaceCoverage | None
    certificates: Certificates
    stages_s: dict[str, float]
    faces: tuple[FaceCoverage, ...] = ()
    own_ways: OwnWays | None = None
    sorties: tuple[Sortie, ...] = ()
    parts: tuple[Plan, ...] = ()
    corridor_planes: tuple[NDArray[np.float64], ...] = ()


@dataclass(frozen=True)
class CellNote:
    """What is to be said about one cell of a face."""

    cell: str
    """Its name, and that of its viewpoint."""
    reason: str


@dataclass(frozen=True)
class FaceCoverage:
    """How the cells of a face are seen.

    Attributes:
        name: the face's.
        cells: how many it has.
        moved: cells that are seen whole, but not from straight in front at the wanted distance: what is in the way
            there.
        not_covered: cells that no place shows whole, and why.
    """

    name: str
    cells: int
    moved: tuple[CellNote, ...]
    not_covered: tuple[CellNote, ...]

    @property
    def covered(self) -> int:
        """How many cells are seen whole."""
        return self.cells - len(self.not_covered)
