"""Why sides cannot be seen: scenes in which one limit alone stands in the way, and names that fit their order."""

import numpy as np
import pytest
import trimesh

from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.core.structure import Structure
from gcs.core.surface_coverage import WORDS, SurfaceCoverage, Verdict
from gcs.planning.scene.fence import fence_volume
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.views import coverage_places
from gcs.planning.views.coverage import certify_coverage, judge_targets
from gcs.planning.views.coverage_reasons import RANKS
from gcs.planning.views.viewpoint_pose import pose_towards


def boxes(*parts):
    """Boxes by their middles and sizes."""
    meshes = []
    for middle, size in parts:
        mesh = trimesh.creation.box(size)
        mesh.apply_translation(middle)
        meshes.append(mesh)
    whole = trimesh.util.concatenate(meshes)
    return Structure(np.asarray(whole.vertices), np.asarray(whole.faces))


CUBE = boxes(((0, 0, 40), (10, 10, 10)))


def scenario(gsd_mm=8.0, ground_m=0.0, pitch_max_deg=30, fence=None, camera=None, incidence_deg=60.0):
    """The clearance of the centre is 2.4 m; at 8 mm pictures may be taken from 29 m."""
    return parse_scenario(
        {
            "structure": {"meshes": [{"file": "cube.stl"}]},
            "anchor": {"latitude_deg": 31.0, "longitude_deg": 121.0, "altitude_m": 4.0},
            "ground_m": ground_m,
            "camera": {
                "sensor_width_mm": 13.2,
                "sensor_height_mm": 8.8,
                "focal_length_mm": 8.8,
                "image_width_px": 5472,
                "image_height_px": 3648,
                "gimbal": {"pitch_min_deg": -90, "pitch_max_deg": pitch_max_deg},
                **(camera or {}),
            },
            "fence": fence,
            "inspection": {"surface": {"gsd_mm": gsd_mm, "max_incidence_deg": incidence_deg}},
        }
    )


def judge(asked, structure, points, normal, views=(), lift_m=0.002):
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    fence = fence_volume(asked.fence, asked.vehicle, asked.safety)
    found = judge_targets(
        asked,
        structure,
        views,
        points,
        np.tile(np.asarray(normal, dtype=np.float64), (len(points), 1)),
        fence,
        SceneDistance(structure, asked.ground_m),
        SilentProgress(),
        rng=np.random.default_rng(1),
        lift_m=lift_m,
    )
    return [Verdict(v) for v in found]


def patch(x, y, z, count=200, seed=0):
    """Random points in a box of ranges; a number for a range is a plane."""
    rng = np.random.default_rng(seed)
    return np.column_stack([np.full(count, v) if np.isscalar(v) else rng.uniform(*v, count) for v in (x, y, z)])


def most(verdicts, expected, share=0.9):
    assert np.mean([v is expected for v in verdicts]) >= share, {v.name: verdicts.count(v) for v in set(verdicts)}


SIDE = patch(5.0, (-4, 4), (36, 44))


def test_seen_and_left_out():
    pose = pose_towards("S", (17, 0, 40), (-1, 0, 0), 0.003)
    most(judge(scenario(), CUBE, SIDE, (1, 0, 0), [pose]), Verdict.SEEN, 1.0)
    most(judge(scenario(), CUBE, SIDE, (1, 0, 0)), Verdict.LEFT_OUT, 1.0)


def test_gimbal():
    below = patch((-4, 4), (-4, 4), 35.0)
    most(judge(scenario(pitch_max_deg=20), CUBE, below, (0, 0, -1)), Verdict.GIMBAL)
    most(judge(scenario(pitch_max_deg=90), CUBE, below, (0, 0, -1)), Verdict.LEFT_OUT)


def test_incidence():
    # 4 m in front of the face stands a plate that leaves only views past its edge, at 68 degrees from the middle
    plate = boxes(((0, 0, 40), (10, 10, 10)), ((9.1, 0, 40), (0.2, 20, 20)))
    middle = patch(5.0, (-0.5, 0.5), (39.5, 40.5))
    most(judge(scenario(), plate, middle, (1, 0, 0)), Verdict.INCIDENCE)
    most(judge(scenario(incidence_deg=75.0), plate, middle, (1, 0, 0)), Verdict.LEFT_OUT, 0.6)


def test_too_far():
    most(judge(scenario(gsd_mm=0.6), CUBE, SIDE, (1, 0, 0)), Verdict.TOO_FAR)
    most(judge(scenario(gsd_mm=0.8), CUBE, SIDE, (1, 0, 0)), Verdict.LEFT_OUT)


def test_not_sharp():
    # the fence ends before the nearest distance that is sharp
    blurred = {"f_number": 2.8, "nearest_focus_m": 25.0, "blur_circle_px": 0.01}
    around = {"include": [[[-14, -14], [14, -14], [14, 14], [-14, 14]]], "max_height_m": 60}
    most(judge(scenario(camera=blurred, fence=around), CUBE, SIDE, (1, 0, 0)), Verdict.NOT_SHARP, 0.7)
    most(judge(scenario(fence=around), CUBE, SIDE, (1, 0, 0)), Verdict.LEFT_OUT)
    most(judge(scenario(camera=blurred), CUBE, SIDE, (1, 0, 0)), Verdict.LEFT_OUT)


def test_fence():
    low = {"include": [[[-90, -90], [90, -90], [90, 90], [-90, 90]]], "max_height_m": 44}
    most(judge(scenario(fence=low), CUBE, patch((-4, 4), (-4, 4), 45.0), (0, 0, 1)), Verdict.FENCE)
    most(judge(scenario(), CUBE, patch((-4, 4), (-4, 4), 45.0), (0, 0, 1)), Verdict.LEFT_OUT)


def test_ground():
    # under a roof of 4 m there is room for the vehicle, but not above the ground
    roof = boxes(((0, 0, 4.1), (60, 60, 0.2)))
    under = patch((-5, 5), (-5, 5), 4.0)
    most(judge(scenario(pitch_max_deg=90), roof, under, (0, 0, -1)), Verdict.GROUND)
    high = boxes(((0, 0, 14.1), (60, 60, 0.2)))
    most(judge(scenario(pitch_max_deg=90), high, under + np.array([0, 0, 10]), (0, 0, -1)), Verdict.LEFT_OUT)


def tunnel(*, barred):
    """60 m long, 8 m wide and high inside; bars at its ends leave gaps of 1.8 m."""
    walls = [((0, s * 4.5, 40), (60, 1, 10)) for s in (-1, 1)] + [((0, 0, 40 + s * 4.5), (60, 8, 1)) for s in (-1, 1)]
    bars = [((s * 29.9, y, 40), (0.2, 0.2, 8)) for s in (-1, 1) for y in (-3, -1, 1, 3)] if barred else []
    return boxes(*walls, *bars)


def test_not_reachable():
    inside = patch((-8, 8), 4.0, (38, 42))
    most(judge(scenario(gsd_mm=2.0), tunnel(barred=True), inside, (0, -1, 0)), Verdict.NOT_REACHABLE, 0.7)
    most(judge(scenario(gsd_mm=2.0), tunnel(barred=False), inside, (0, -1, 0)), Verdict.LEFT_OUT)


def test_too_close():
    walls = boxes(((-1.5, 0, 40), (1, 30, 30)), ((1.5, 0, 40), (1, 30, 30)))
    slit = judge(scenario(), walls, patch(-1.0, (-3, 3), (37, 43)), (1, 0, 0))
    assert set(slit) <= {Verdict.TOO_CLOSE, Verdict.OCCLUDED}
    most(slit, Verdict.TOO_CLOSE, 0.5)  # walks may end before they are out of it
    wide = boxes(((-4.5, 0, 40), (1, 30, 30)), ((4.5, 0, 40), (1, 30, 30)))
    most(judge(scenario(), wide, patch(-4.0, (-8, 8), (32, 48)), (1, 0, 0)), Verdict.LEFT_OUT)


def test_occluded():
    most(judge(scenario(), CUBE, SIDE, (-1, 0, 0)), Verdict.OCCLUDED, 1.0)
    hall = boxes(((0, 0, 40), (30, 30, 30)))
    most(judge(scenario(), hall, patch(15.0, (-4, 4), (36, 44)), (-1, 0, 0)), Verdict.OCCLUDED, 1.0)


def test_points_that_lie_on_the_surface_only_roughly_are_looked_at_from_a_little_above():
    sunk = patch(4.995, (-4, 4), (36, 44))
    most(judge(scenario(), CUBE, sunk, (1, 0, 0)), Verdict.OCCLUDED, 1.0)
    most(judge(scenario(), CUBE, sunk, (1, 0, 0), lift_m=0.02), Verdict.LEFT_OUT, 1.0)


def test_the_bits_are_in_the_order_of_the_verdicts():
    for verdict in list(Verdict)[Verdict.GIMBAL : Verdict.OCCLUDED]:
        bit = getattr(coverage_places, verdict.name)
        assert RANKS[bit] == 16 + verdict - Verdict.GIMBAL
        assert RANKS[bit | coverage_places.TOO_CLOSE] >= RANKS[bit]
    assert RANKS[0] == 0
    assert max(RANKS) < 255


def test_every_verdict_has_words():
    assert set(WORDS) == set(Verdict)
    assert len(set(WORDS.values())) == len(Verdict)


def test_areas_of_what_is_not_seen_add_up():
    coverage = certify_coverage(
        scenario(), CUBE, [], fence_volume(None, scenario().vehicle, scenario().safety), SceneDistance(CUBE, 0.0),
        SilentProgress(), samples=5000,
    )  # fmt: skip
    assert isinstance(coverage, SurfaceCoverage)
    assert coverage.area_m2 == pytest.approx(1200.0)
    areas = coverage.not_covered_m2()
    assert sum(areas.values()) == pytest.approx(1200.0)
    assert areas["gimbal"] == pytest.approx(100.0, rel=0.1)
    assert areas["left_out"] == pytest.approx(500.0, rel=0.1)
    assert areas["occluded"] == pytest.approx(600.0, rel=0.01)
