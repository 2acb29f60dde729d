"""The report's section on tracking: position and yaw errors and motor thrusts over time, as inline SVG."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.services.report_pictures import CHART_WIDTH_PX, MARGIN_PX, point_pairs
from gcs.services.tracking_forecast import GUSTS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.services.tracking_forecast import TrackingForecast

HEIGHT_PX = 110
MOST_POINTS = 600
STYLES = ("t", "p", "c")


def tracking_section(found: TrackingForecast) -> str:
    """Figures and charts of a predicted flight."""
    history, f = found.history, found.figures
    charts = (
        ("position error east (blue), north (orange), up (violet), m", list(history.axes_m.T)),
        ("yaw error, degrees", [np.degrees(history.yaw_rad)]),
        ("least and largest motor thrust, N", [history.thrust_n[:, 0], history.thrust_n[:, 1]]),
    )
    pictures = "".join(f"<p>{about}</p>{_chart(history.time_s, lines)}" for about, lines in charts)
    east, north, up = f.axes_m
    return (
        "<h2>Tracking</h2>"
        f"<p>A rigid body of {found.mass_kg:g} kg under a geometric controller, in gusts of {GUSTS.deviation_m_s:g} "
        f"m/s: at most {f.deviation_m:.2f} m beside the curve, {f.mean_deviation_m:.2f} m in the mean; {east:.2f} m "
        f"east, {north:.2f} m north and {up:.2f} m up of where it is to be; yaw within "
        f"{math.degrees(f.yaw_rad):.1f}°; motors {f.thrust_n[0]:.1f} N to {f.thrust_n[1]:.1f} N of "
        f"{found.most_thrust_n:.1f} N, all of it during {f.saturated_share:.0%} of the time.</p>{pictures}\n"
    )


def _chart(time_s: NDArray[np.float64], lines: list[NDArray[np.float64]]) -> str:
    """Lines over time, from zero to their largest value; of long flights the largest of several seconds."""
    share = math.ceil(len(time_s) / MOST_POINTS)
    starts = np.arange(0, len(time_s), share)
    top = max(float(line.max()) for line in lines) or 1.0
    bottom = HEIGHT_PX - MARGIN_PX / 2
    x = MARGIN_PX + time_s[starts] / time_s[-1] * (CHART_WIDTH_PX - 2 * MARGIN_PX)
    up = (bottom - MARGIN_PX / 2) / top
    heights = [bottom - up * np.maximum.reduceat(line, starts) for line in lines]
    drawn = "".join(
        f'<polyline class="{style}" points="{point_pairs(np.stack([x, y], axis=-1))}"/>'
        for style, y in zip(STYLES, heights, strict=False)
    )
    return (
        f'<svg width="{CHART_WIDTH_PX}" height="{HEIGHT_PX}" role="img">'
        f'<line class="a" x1="{MARGIN_PX}" x2="{CHART_WIDTH_PX - MARGIN_PX}" y1="{bottom}" y2="{bottom}"/>'
        f'<text x="{MARGIN_PX}" y="12">{top:.3g}</text>{drawn}'
        f'<text x="{CHART_WIDTH_PX - MARGIN_PX - 30}" y="{HEIGHT_PX - 2}">{time_s[-1]:.0f} s</text></svg>'
    )
