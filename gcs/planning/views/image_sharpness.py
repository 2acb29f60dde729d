"""How sharp the pictures of a trajectory are: focus, motion blur and rolling-shutter skew at each exposure.

The camera is taken to focus on what its viewpoint is for. Speed counts whole as if it were across the view, and the
vehicle's drift while it holds its position comes on top of what the trajectory says. Turning is not counted: gimbal and
yaw are at rest at each exposure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.camera import Camera
    from gcs.core.plan import Viewpoint
    from gcs.core.scenario import Scenario
    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.views.viewpoint_pose import ViewpointPose

SLOWEST_PASS_M_S = 0.05
"""Viewpoints that would have to be passed slower than this are stopped at."""


class WorstView(NamedTuple):
    """The worst figure of any viewpoint, and that viewpoint's name."""

    value: float
    viewpoint: str


@dataclass(frozen=True)
class ImageSharpness:
    """What limits the sharpness of the pictures; None where the camera does not state it.

    Attributes:
        focus: least room (m) between what a viewpoint is for and the nearest depth that can be sharp there; negative
            when it cannot be focused on.
        blur: pixels moved during the exposure.
        skew: pixels moved between the first row and the last.
        unjudged: pictures in flight whose blur or skew cannot be told, because the camera does not state it.
    """

    focus: WorstView | None
    blur: WorstView | None
    skew: WorstView | None
    unjudged: int = 0

    @property
    def max_blur_px(self) -> float | None:
        """Largest blur (pixels)."""
        return None if self.blur is None else self.blur.value

    @property
    def max_skew_px(self) -> float | None:
        """Largest skew (pixels)."""
        return None if self.skew is None else self.skew.value


def passing_speeds_m_s(views: Sequence[ViewpointPose | Viewpoint], scenario: Scenario) -> NDArray[np.float64]:
    """How fast each picture may be taken in flight (m/s), shape (V,): 0 where the vehicle is to stop for it.

    It stops everywhere unless `planner.viewpoints` says otherwise, where a hold is asked for, and when the camera does
    not state what blur or skew come from.
    """
    camera = scenario.camera
    if scenario.planner.viewpoints == "stop" or not _tells_blur(camera):
        return np.zeros(len(views))
    sharp = np.array([camera.fastest_m_s(camera.distance_for_gsd(view.gsd_m)) for view in views]).reshape(-1)
    speeds = sharp - scenario.vehicle.hover_speed_m_s
    asked_to_hold = np.array([view.hold_s > 0 for view in views], dtype=np.bool_)
    return np.where(asked_to_hold | (speeds < SLOWEST_PASS_M_S), 0.0, speeds)


def _tells_blur(camera: Camera) -> bool:
    """Whether blur and skew of a moving camera can be told."""
    return camera.exposure_s is not None and (camera.shutter == "global" or camera.readout_s is not None)


def measure_sharpness(
    trajectory: PiecewisePolynomial, viewpoints: Sequence[Viewpoint], scenario: Scenario
) -> ImageSharpness:
    """Focus, blur and skew of every picture.

    Args:
        trajectory: what is flown; its speed at a viewpoint's time is that of the exposure.
        viewpoints: their GSD gives the depth of what they are for, and their time that of the exposure.
        scenario: its camera, and the drift of its vehicle.
    """
    camera = scenario.camera
    speeds = np.linalg.norm(trajectory.value([v.time_s for v in viewpoints], 1), axis=-1)
    focus: list[WorstView] = []
    blur: list[WorstView] = []
    skew: list[WorstView] = []
    for view, speed in zip(viewpoints, speeds.tolist(), strict=True):
        depth = camera.distance_for_gsd(view.gsd_m)
        moving = speed + scenario.vehicle.hover_speed_m_s
        if camera.f_number is not None:
            focus.append(WorstView(depth - camera.sharp_between_m(depth)[0], view.name))
        blurred, skewed = camera.blur_px(moving, depth), camera.skew_px(moving, depth)
        if blurred is not None:
            blur.append(WorstView(blurred, view.name))
        if skewed is not None:
            skew.append(WorstView(skewed, view.name))
    unjudged = 0 if _tells_blur(camera) else sum(not view.stops for view in viewpoints)
    return ImageSharpness(min(focus, default=None), max(blur, default=None), max(skew, default=None), unjudged)
