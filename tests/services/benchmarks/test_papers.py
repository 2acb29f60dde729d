"""The papers' experiments: what the papers print, what a run is, and corridors through viewpoints."""

import numpy as np
import pytest

from gcs.services.benchmarks.paper_corridor import MISS_M, passing_corridors
from gcs.services.benchmarks.paper_runs import HALF_WIDTH_M, HOME_SPREAD_M, VARIANTS, prepare_run
from gcs.services.benchmarks.papers import PUBLISHED, run


@pytest.fixture(scope="module")
def crane():
    return prepare_run("crane", 0)


def test_the_papers_means_are_those_of_their_runs():
    yard, crane = PUBLISHED["yard"], PUBLISHED["crane"]
    assert np.mean(yard.before.length_m) == pytest.approx(1927.468, abs=1e-3)
    assert np.mean(yard.after.length_m) == pytest.approx(1872.565, abs=1e-3)
    assert np.mean(yard.before.mean_deviation_m) == pytest.approx(3.253, abs=1e-3)
    assert np.mean(yard.after.mean_deviation_m) == pytest.approx(1.109, abs=1e-3)
    assert np.mean(yard.after.length_m) / yard.path_m == pytest.approx(1.0205, abs=1e-4)
    assert np.mean(crane.before.mean_deviation_m) == pytest.approx(1.964, abs=1e-3)
    assert np.mean(crane.after.mean_deviation_m) == pytest.approx(0.366, abs=1e-3)
    assert np.mean(crane.before.max_deviation_m) == pytest.approx(9.586, abs=1e-3)
    assert np.mean(crane.after.max_deviation_m) == pytest.approx(1.842, abs=1e-3)
    assert np.mean(crane.before.length_m) == pytest.approx(204.88, abs=1e-2)
    assert np.mean(crane.after.length_m) == pytest.approx(172.98, abs=1e-2)


def test_every_variant_appears_beside_the_papers_figures():
    rows = {(row.case, row.figure): row for row in run(quick=True)}
    columns = ("mean_deviation_m", "max_deviation_m", "length_m", "length_ratio", "duration_s", "min_clearance_m")
    for case in ("yard", "crane"):
        for variant in VARIANTS:
            for way in (variant, f"{variant}_through"):
                assert all(np.isfinite(rows[case, f"{way}.{column}"].value) for column in columns)
        for way in ("corridor", "corridor_through"):
            assert rows[case, f"{way}.longest_duration_share"].value <= 1.0
            assert rows[case, f"{way}.mean_deviation_m"].value < rows[case, f"{way}.mean_deviation_m"].reference_value
            assert rows[case, f"{way}.min_clearance_m"].value >= 1.9 - 1e-9
        for axis in "xyz":
            row = rows[case, f"corridor.tracking_{axis}_m"]
            assert row.value <= row.reference_value / 2
        assert rows[case, "corridor.least_motor_thrust_n"].value > 0
        hover = rows[case, "corridor.most_motor_thrust_n"]
        assert hover.value > hover.reference_value
    assert rows["tower", "ours.energy"].value <= rows["tower", "genetic.energy"].value + 1e-9
    assert rows["tower", "genetic.energy"].value < rows["tower", "z_path.energy"].value
    assert rows["tower", "ours.gap"].value == pytest.approx(0.0, abs=1e-9)
    assert rows["tower", "ours.length_m"].value == pytest.approx(4 * 12 - 1)  # every cell's neighbour is 1 m away
    assert rows["crane", "corridor_through.run-1.mean_deviation_m"].reference_value == 0.39
    assert rows["crane", "corridor.yaw_error_rad"].value <= 5.1e-4 / 2


def test_a_run_is_repeated_to_the_last_digit_and_another_seed_is_another_flight(crane):
    again, other = prepare_run("crane", 0), prepare_run("crane", 1)
    np.testing.assert_array_equal(again.path_m, crane.path_m)
    assert crane.scenario.home_m == (-20.0, -20.0, 0.0)
    moved = np.subtract(other.scenario.home_m, crane.scenario.home_m)
    assert 0 < np.abs(moved).max() <= HOME_SPREAD_M
    assert moved[2] == 0.0
    assert len(crane.legs_m) == 7  # L3 to L8


@pytest.mark.parametrize("variant", VARIANTS)
def test_curves_pass_the_viewpoints_and_keep_the_limits(crane, variant):
    places = np.array([leg[-1] for leg in crane.legs_m[:-1]])
    for curve in (crane.stopping(variant), crane.through(variant)):
        trajectory = curve.built.trajectory
        points = trajectory.value(np.linspace(0, trajectory.duration_s, 40_001))
        away = np.linalg.norm(points[:, None] - places[None], axis=2).min(axis=0)
        assert away.max() <= MISS_M
        assert curve.figures.max_speed_m_s <= crane.limits.speed_m_s
        assert curve.figures.max_acceleration_m_s2 <= crane.limits.acceleration_m_s2
        assert curve.figures.largest_jump < 1e-4
        assert curve.figures.corridor_violation_m <= 1e-6


def test_corridors_go_on_where_the_path_does_and_stop_where_it_bends_back(crane):
    home, top = np.array(crane.scenario.home_m), crane.scene.space.take_off_m
    straight = [top - np.array([0.0, 3.0 * k, 0.0]) for k in range(1, 4)]
    legs = [np.array([home, top, straight[0]]), np.array(straight[:2]), np.array(straight[1:])]
    legs += [np.array([straight[2], top, home])]
    corridors = passing_corridors(legs, crane.limits, HALF_WIDTH_M, crane.scene.space)
    assert len(corridors) == 2
    np.testing.assert_allclose(corridors[0].joints_m[0], home)
    np.testing.assert_allclose(corridors[0].joints_m[-1], straight[2])
    np.testing.assert_allclose(corridors[1].joints_m[0], straight[2])
    np.testing.assert_allclose(corridors[1].joints_m[-1], home)
    for corridor in corridors:
        low, high = corridor.boxes_m[:, 0], corridor.boxes_m[:, 1]
        for ends in (corridor.joints_m[:-1], corridor.joints_m[1:]):
            assert (ends >= low - 1e-9).all()
            assert (ends <= high + 1e-9).all()
        for place in straight[:2]:
            at = np.flatnonzero(np.linalg.norm(corridor.joints_m[1:-1] - place, axis=1) < 1e-9)
            for k in at:
                shared_low, shared_high = np.maximum(low[k], low[k + 1]), np.minimum(high[k], high[k + 1])
                assert np.linalg.norm(np.maximum(place - shared_low, shared_high - place)) <= MISS_M
