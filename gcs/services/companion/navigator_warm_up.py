"""Loads the navigator's compiled kernels before a flight needs them: the first use of each takes a while."""

from __future__ import annotations

import math

import numpy as np

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.lidar_scan import LidarScan
from gcs.planning.local.navigator import LocalNavigator
from gcs.planning.local.navigator_options import NavigatorOptions
from gcs.planning.local.stream_loss_pace import StreamLossRule
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.stream_loss import StreamLoss

LENGTH_M, DURATION_S = 20.0, 10.0
SECTORS, REACH_M = 72, 30.0
ROUNDS = 15


def warm_navigator() -> None:
    """Have it evade something that stands on a straight way."""
    leg = np.zeros((1, 8, 3))
    leg[0, 4:, 0] = LENGTH_M * np.array([35.0, -84.0, 70.0, -20.0])
    way = PiecewisePolynomial(leg, np.array([DURATION_S]))
    options = NavigatorOptions(stream_loss=StreamLossRule(StreamLoss(3.0, 2.0), keep_m=0.6))
    navigator = LocalNavigator(way, (), FlightLimits(5.0, 2.5), options)
    for now_s in 0.1 * np.arange(ROUNDS):
        place = navigator.motion(float(now_s))[0]
        ranges = np.full(SECTORS, np.inf)
        ranges[0] = LENGTH_M / 2 - place[0]
        scan = LidarScan(ranges, 0.0, -2 * math.pi / SECTORS, REACH_M)
        navigator.see(scan, place, 0.0, float(now_s))
        navigator.decide(float(now_s))
