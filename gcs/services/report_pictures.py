"""Pictures of a plan as inline SVG: the scene from three sides, what is not seen of it, and speed over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from gcs.core.plan import Plan
    from gcs.core.structure import Structure
    from gcs.core.surface_coverage import SurfaceCoverage, Verdict

WIDTH_PX = 480
HEIGHT_PX = 420
CHART_WIDTH_PX = 980
CHART_HEIGHT_PX = 200
MARGIN_PX = 28
MAX_EDGES, MAX_FAINT_EDGES = 5000, 2500
MAX_SAMPLES = 1500
MAX_DOTS = 2500


class Drawn(NamedTuple):
    """A line to be drawn over a scene.

    Attributes:
        style: class of the line.
        points_m: scene ENU, shape (N, 3).
    """

    style: str
    points_m: NDArray[np.float64]


def scene_view(plan: Plan, structure: Structure, axes: tuple[int, int], over: Sequence[Drawn] = ()) -> str:
    """The scene in parallel projection.

    Args:
        plan: a finished plan.
        structure: what is inspected.
        axes: which coordinates go right and up.
        over: drawn over it.
    """
    columns = list(axes)
    t = np.linspace(0.0, plan.trajectory.duration_s, MAX_SAMPLES)
    curve = plan.trajectory.value(t)[:, columns]
    path = plan.path_m[:, columns]
    views = np.array([v.position_m for v in plan.viewpoints]).reshape(-1, 3)[:, columns]
    edges = _edges(structure)[:, :, columns]
    lines_over = [(line.style, line.points_m[:, columns]) for line in over]
    everything = np.concatenate(
        [curve, path, edges.reshape(-1, 2), structure.bounds_m[:, columns], *(points for _, points in lines_over)]
    )
    on_screen = _Frame(everything)
    home = on_screen(np.array(plan.scenario.home_m)[columns])
    lines = "".join(f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}" for a, b in on_screen(edges))
    cables = "".join(
        f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}" for a, b in on_screen(structure.cable_ends_m[:, :, columns])
    )
    drawn = "".join(
        f'<polyline class="{style}" points="{point_pairs(on_screen(points))}"/>' for style, points in lines_over
    )
    dots = "".join(f'<circle class="v" cx="{x:.1f}" cy="{y:.1f}" r="2.5"/>' for x, y in on_screen(views))
    return (
        f'<svg width="{WIDTH_PX}" height="{HEIGHT_PX}" role="img">'
        f'<path class="s" d="{lines}"/><path class="c" d="{cables}"/>'
        f'<polyline class="p" points="{point_pairs(on_screen(path))}"/>'
        f'<polyline class="t" points="{point_pairs(on_screen(curve))}"/>{drawn}{dots}'
        f'<circle class="h" cx="{home[0]:.1f}" cy="{home[1]:.1f}" r="4"/>'
        f"{on_screen.ruler}</svg>"
    )


def coverage_view(
    coverage: SurfaceCoverage, structure: Structure, axes: tuple[int, int], verdicts: Collection[Verdict]
) -> str:
    """The sides that are not seen, in parallel projection, as dots: a path of the class `k3` for verdict 3.

    Args:
        coverage: what becomes of each side.
        structure: what is inspected.
        axes: which coordinates go right and up.
        verdicts: which sides are drawn.
    """
    columns = list(axes)
    edges = _edges(structure, MAX_FAINT_EDGES)[:, :, columns]
    on_screen = _Frame(structure.bounds_m[:, columns])
    lines = "".join(f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}" for a, b in on_screen(edges))
    drawn = np.flatnonzero(np.isin(coverage.verdicts, [int(v) for v in verdicts]))
    if len(drawn) > MAX_DOTS:
        drawn = drawn[np.linspace(0, len(drawn) - 1, MAX_DOTS).astype(np.int64)]
    places, found = on_screen(coverage.points_m[drawn][:, columns]), coverage.verdicts[drawn]
    dots = "".join(
        f'<path class="k{v}" d="{"".join(f"M{x:.1f} {y:.1f}h0" for x, y in places[found == v])}"/>'
        for v in np.unique(found)
    )
    return (
        f'<svg width="{WIDTH_PX}" height="{HEIGHT_PX}" role="img"><path class="s" d="{lines}"/>{dots}'
        f"{on_screen.ruler}</svg>"
    )


class _Frame:
    """Scene metres to picture pixels, so that some points (N, 2) fill the picture."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        self._low, high = points.min(axis=0), points.max(axis=0)
        frame = np.array([WIDTH_PX, HEIGHT_PX])
        self._scale = float(((frame - 2 * MARGIN_PX) / np.maximum(high - self._low, 1.0)).min())
        self._corner = (frame - (high - self._low) * self._scale) / 2
        self._ruler = _round_length(float(high[0] - self._low[0]) / 4)

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        x = self._corner[0] + (points[..., 0] - self._low[0]) * self._scale
        y = HEIGHT_PX - self._corner[1] - (points[..., 1] - self._low[1]) * self._scale
        return np.stack([x, y], axis=-1)

    @property
    def ruler(self) -> str:
        """A line of a round length, and its length."""
        return (
            f'<path class="a" d="M{MARGIN_PX} {HEIGHT_PX - 10}h{self._ruler * self._scale:.1f}"/>'
            f'<text x="{MARGIN_PX}" y="{HEIGHT_PX - 14}">{self._ruler:g} m</text>'
        )


def speed_chart(plan: Plan) -> str:
    """Speed over time with the limit and the times of the pictures."""
    duration = plan.trajectory.duration_s
    t = np.linspace(0.0, duration, MAX_SAMPLES)
    speed = np.linalg.norm(plan.trajectory.value(t, 1), axis=1)
    limit = plan.scenario.vehicle.max_speed_m_s
    top = max(limit, float(speed.max())) * 1.1
    bottom = CHART_HEIGHT_PX - MARGIN_PX

    def x(time_s: NDArray[np.float64] | float) -> NDArray[np.float64]:
        return np.asarray(MARGIN_PX + np.asarray(time_s) / duration * (CHART_WIDTH_PX - 2 * MARGIN_PX))

    def y(value: NDArray[np.float64] | float) -> NDArray[np.float64]:
        return np.asarray(bottom - np.asarray(value) / top * (bottom - MARGIN_PX / 2))

    marks = "".join(f'<circle class="v" cx="{float(x(v.time_s)):.1f}" cy="{bottom}" r="2"/>' for v in plan.viewpoints)
    limit_y = float(y(limit))
    return (
        f'<svg width="{CHART_WIDTH_PX}" height="{CHART_HEIGHT_PX}" role="img">'
        f'<line class="a" x1="{MARGIN_PX}" x2="{CHART_WIDTH_PX - MARGIN_PX}" y1="{bottom}" y2="{bottom}"/>'
        f'<line class="p" x1="{MARGIN_PX}" x2="{CHART_WIDTH_PX - MARGIN_PX}" y1="{limit_y:.1f}" y2="{limit_y:.1f}"/>'
        f'<text x="{MARGIN_PX}" y="{limit_y - 3:.1f}">limit {limit:g} m/s</text>'
        f'<polyline class="t" points="{point_pairs(np.stack([x(t), y(speed)], axis=-1))}"/>{marks}'
        f'<text x="{MARGIN_PX}" y="{CHART_HEIGHT_PX - 8}">0 s</text>'
        f'<text x="{CHART_WIDTH_PX - MARGIN_PX - 30}" y="{CHART_HEIGHT_PX - 8}">{duration:.0f} s</text></svg>'
    )


def _edges(structure: Structure, most: int = MAX_EDGES) -> NDArray[np.float64]:
    """Edges of the triangles, shape (E, 2, 3); of large meshes an even selection."""
    pairs = np.sort(structure.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs = np.unique(pairs, axis=0)
    if len(pairs) > most:
        pairs = pairs[np.linspace(0, len(pairs) - 1, most).astype(np.int64)]
    return structure.vertices_m[pairs]


def point_pairs(points: NDArray[np.float64]) -> str:
    """Points of shape (N, 2) as a polyline has them."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _round_length(length_m: float) -> float:
    """The largest of 1, 2, 5, 10, ... that is not longer."""
    power = 10.0 ** np.floor(np.log10(max(length_m, 1e-3)))
    return float(max(m for m in (1, 2, 5) if m * power <= max(length_m, 1e-3)) * power)
