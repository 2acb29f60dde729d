"""The lidar's odometry beside the estimator: drift is borne, disagreement and failure are said."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.mavlink.dialect import mavlink
from gcs.services.companion.odometry_check import OdometryCheck

START_YAW = 0.7


def odometry(way_m, turned_rad, variance=0.0, quality=90, frame=mavlink.MAV_FRAME_LOCAL_FRD):
    """As a lidar sends it whose frame looked along START_YAW when it was started."""
    east, north, up = way_m
    c, s = math.cos(START_YAW), math.sin(START_YAW)
    covariance = [0.0] * 21
    covariance[0] = covariance[6] = covariance[11] = variance
    return SimpleNamespace(
        x=east * c + north * s,
        y=east * s - north * c,
        z=-up,
        q=[math.cos(-turned_rad / 2), 0.0, 0.0, math.sin(-turned_rad / 2)],
        frame_id=frame,
        pose_covariance=covariance,
        quality=quality,
    )


def feed(check, error_m_s=(0.0, 0.0, 0.0), seconds=6.0, **message):
    """Along a bend; the odometry's place runs away at some velocity."""
    for t in np.arange(0.0, seconds, 0.1):
        yaw = START_YAW + 0.3 * t
        way = np.array([2.0 * t, math.sin(t), 0.2 * t])
        place = np.array([10.0, -4.0, 3.0]) + way
        check.take(odometry(way + t * np.array(error_m_s), 0.3 * t, **message), t, place, yaw)
    return check.problem(seconds)


def test_its_own_origin_and_heading_do_not_matter():
    assert feed(OdometryCheck()) is None


def test_slow_drift_is_borne_and_disagreement_is_not():
    assert feed(OdometryCheck(), (0.1, 0.0, 0.0)) is None
    assert "off the estimator" in feed(OdometryCheck(), (0.6, 0.0, 0.0))


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ({"quality": -1}, "failed"),
        ({"quality": 3}, "failed"),
        ({"variance": math.inf}, "failed"),
        ({"frame": 99}, "failed"),
    ],
)
def test_failure_is_said(message, words):
    assert words in feed(OdometryCheck(), **message)


def test_silence_is_said_only_of_what_was_heard():
    check = OdometryCheck()
    assert check.problem(100.0) is None
    feed(check)
    assert check.problem(6.5) is None
    assert "silent" in check.problem(9.0)
