"""Corridors and times that cannot be flown: one clear error each, with leg and segment."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError, InputError
from gcs.core.progress import SilentProgress
from gcs.planning.numerics.chain_qp import ChainSolver
from gcs.planning.numerics.qp_solver import PiqpSolver, default_solvers
from gcs.planning.trajectories.convex_set import outside_m
from gcs.planning.trajectories.corridor_checks import check_corridor
from gcs.planning.trajectories.minimum_snap import minimum_snap
from gcs.planning.trajectories.safe_corridor import LegCorridor, build_corridor
from gcs.planning.trajectories.time_allocation import FlightLimits, time_legs

LEG = np.array([[0.0, 0, 5], [6, 0, 5], [6, 6, 5]])


@pytest.fixture
def corridor():
    return build_corridor(LEG, 0.5, 2.0)


def changed(corridor, segment, low=None, high=None):
    boxes = corridor.boxes_m.copy()
    boxes[segment, 0] += 0 if low is None else np.array(low)
    boxes[segment, 1] += 0 if high is None else np.array(high)
    return replace(corridor, boxes_m=boxes)


def refused(leg, error, message):
    good = build_corridor(LEG, 0.5, 2.0)
    with pytest.raises(error, match=f"leg 1: {message}"):
        time_legs([good, leg], FlightLimits(5.0, 2.5), default_solvers(), SilentProgress())
    with pytest.raises(error, match=f"leg 1: {message}"):
        minimum_snap([good, leg], [np.ones(len(c.boxes_m)) for c in (good, leg)], default_solvers())


def test_boxes_that_do_not_meet_are_named(corridor):
    refused(changed(corridor, 3, low=[0, 0, 3], high=[0, 0, 3]), InfeasibleError, "segments 2 and 3 .* do not meet")


def test_boxes_that_meet_in_less_than_the_tolerance_are_named(corridor):
    # Boxes 1 and 2 share from -0.5 to 0.5 in y.
    leg = changed(corridor, 2, low=[0, 1 - 2e-6, 0], high=[0, 1, 0])
    refused(leg, InfeasibleError, "segments 1 and 2 .* share only 2e-06 m")


def test_a_box_narrower_than_the_tolerance_is_named(corridor):
    middle = corridor.joints_m[3:5].mean(axis=0)
    boxes = corridor.boxes_m.copy()
    boxes[3, :, 2] = middle[2] - 1e-6, middle[2] + 1e-6
    refused(replace(corridor, boxes_m=boxes), InfeasibleError, "segment 3 .* 2e-06 m wide")


def test_an_empty_box_is_named(corridor):
    refused(changed(corridor, 4, low=[0, 9, 0]), InfeasibleError, "segment 4 .* wide")


def test_a_stop_outside_its_box_is_named(corridor):
    refused(changed(corridor, 0, low=[0.5 + 0.25, 0, 0]), InfeasibleError, "segment 0 .* 0.25 m outside")
    refused(changed(corridor, -1, high=[0, -0.75, 0]), InfeasibleError, "segment 5 .* 0.25 m outside")


@pytest.fixture
def tubes():
    return build_corridor(LEG, 0.5, 2.0, kind="tubes")


def cut(leg, segment, normal, offset):
    """One more plane for a segment's set."""
    planes = list(leg.planes)
    planes[segment] = np.vstack([planes[segment], [*normal, offset]])
    return replace(leg, planes=tuple(planes))


def test_sets_that_do_not_meet_are_named(tubes):
    # Tubes 2 and 3 share the corner at (6, 0); tube 3 from y = 0.75 on is free of tube 2, which ends at 0.5.
    refused(cut(tubes, 3, [0, -1, 0], -0.75), InfeasibleError, "segments 2 and 3 .* they do not meet")


def test_sets_that_meet_in_less_than_the_tolerance_are_named(tubes):
    refused(cut(tubes, 3, [0, -1, 0], -0.5 + 6e-6), InfeasibleError, "segments 2 and 3 .* share only 6e-06 m")


def test_sets_that_meet_away_from_their_joint_are_connected(tubes):
    leg = cut(tubes, 3, [0, -1, 0], -0.4)
    check_corridor(leg)
    times = np.ones(len(leg.planes))
    for solver in (ChainSolver(), PiqpSolver()):
        (control,) = minimum_snap([leg], [times], [solver])
        assert outside_m(control, leg.planes) == 0.0


def test_a_set_narrower_than_the_tolerance_and_an_empty_one_are_named(tubes):
    slim = cut(cut(tubes, 4, [0, 0, 1], 5 + 1e-6), 4, [0, 0, -1], -5 + 1e-6)
    refused(slim, InfeasibleError, "segment 4 .* 2e-06 m wide")
    refused(cut(tubes, 1, [1, 0, 0], 0.0), InfeasibleError, "segment 1 .* wide")


def test_a_stop_outside_its_set_is_named(tubes):
    refused(cut(tubes, 0, [-1, 0, 0], -0.25), InfeasibleError, "segment 0 .* 0.25 m outside its set")
    refused(cut(tubes, -1, [0, 1, 0], 5.25), InfeasibleError, "segment 5 .* 0.75 m outside its set")


def test_planes_that_are_not_finite_are_named(tubes):
    refused(cut(tubes, 2, [np.nan, 0, 0], 1.0), InputError, "segment 2 .* not finite")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_named(corridor, bad):
    joints = corridor.joints_m.copy()
    joints[3, 1] = bad
    refused(replace(corridor, joints_m=joints), InputError, "segment 2 .* not finite")
    boxes = corridor.boxes_m.copy()
    boxes[4, 1, 0] = bad
    refused(replace(corridor, boxes_m=boxes), InputError, "segment 4 .* not finite")


def test_repeated_points_are_named(corridor):
    joints = np.insert(corridor.joints_m, 2, corridor.joints_m[2], axis=0)
    boxes = np.insert(corridor.boxes_m, 2, corridor.boxes_m[2], axis=0)
    refused(LegCorridor(joints, boxes), InputError, "segment 2 .* no length")


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_times_that_are_not_positive_are_named(corridor, bad):
    times = np.ones(len(corridor.boxes_m))
    times[4] = bad
    with pytest.raises(InputError, match="leg 0: segment 4 lasts"):
        minimum_snap([corridor], [times], default_solvers())
    with pytest.raises(InputError, match="leg 0: 6 segments need as many times"):
        minimum_snap([corridor], [times[:3]], default_solvers())


def test_a_corridor_just_wide_enough_is_flown():
    """A bend through boxes that share a cube of 20 micrometres."""
    joints = np.array([[0.0, 0, 5], [3, 0, 5], [3, 3, 5]])
    low, high = np.minimum(joints[:-1], joints[1:]) - 1e-5, np.maximum(joints[:-1], joints[1:]) + 1e-5
    leg = LegCorridor(joints, np.stack([low, high], axis=1))
    check_corridor(leg)
    (timed,) = time_legs([leg], FlightLimits(5.0, 2.5), default_solvers(), SilentProgress())
    assert (timed.control >= leg.boxes_m[:, :1] - 1e-9).all()
    assert (timed.control <= leg.boxes_m[:, 1:] + 1e-9).all()
