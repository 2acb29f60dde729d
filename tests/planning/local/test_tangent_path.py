"""The planner that flies, against closed forms and against visibility graphs made by another method."""

import math
import re

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.cell_sight import convex_corners
from gcs.planning.local.convex_obstacles import ConvexObstacles
from gcs.planning.local.search_budget import MOST_WORK, SearchBudget
from gcs.planning.local.tangent_path import shortest_path
from gcs.services.benchmarks.local_fields import Field, collides, exact_length, random_field

START, GOAL = (6.7, 29.6), (39.9, 29.6)
OPTIMUM = 2 * math.hypot(19.8 - 6.7, 29.6 - 24.7) + 7.0
BOX = [(19.8, 24.7), (26.8, 24.7), (26.8, 34.9), (19.8, 34.9)]


def rectangle(i, j, width, height):
    return np.array([(i, j), (i + width, j), (i + width, j + height), (i, j + height)], dtype=np.float64)


def test_the_papers_query_is_solved_exactly_on_the_map_and_among_polygons(paper_map):
    assert shortest_path(START, GOAL, area=paper_map).length_m == pytest.approx(OPTIMUM, abs=1e-9)
    among = shortest_path(START, GOAL, ConvexObstacles.of([BOX]))
    assert among.length_m == pytest.approx(OPTIMUM, abs=1e-9)
    assert among.points_m[1:-1].tolist() == [[19.8, 24.7], [26.8, 24.7]]


def test_nothing_in_the_way_is_a_straight():
    path = shortest_path((0, 0), (3, 4))
    assert path.length_m == 5.0
    assert path.work < 100


@pytest.mark.parametrize("seed", range(30))
def test_random_fields_give_the_visibility_graphs_length(seed):
    field = random_field(np.random.default_rng(seed))
    path = shortest_path(field.start_m, field.goal_m, ConvexObstacles.of(field.polygons_m))
    assert path.length_m == pytest.approx(exact_length(field), rel=1e-12)
    assert not collides(path.points_m, field.polygons_m)


def cells_and_dominoes(blocked):
    """Blocked cells, and each two neighbours as one, so that nothing passes between them; in cells."""
    shapes = [rectangle(i, j, 1, 1) for i, j in np.argwhere(blocked)]
    shapes += [rectangle(i, j, 2, 1) for i, j in np.argwhere(blocked[:-1] & blocked[1:])]
    return shapes + [rectangle(i, j, 1, 2) for i, j in np.argwhere(blocked[:, :-1] & blocked[:, 1:])]


def without_touching_corners(blocked):
    while True:
        southwest, southeast, northwest, northeast = (
            blocked[:-1, :-1],
            blocked[1:, :-1],
            blocked[:-1, 1:],
            blocked[1:, 1:],
        )
        falling = southeast & northwest & ~southwest & ~northeast
        rising = southwest & northeast & ~southeast & ~northwest
        if not (falling | rising).any():
            return blocked
        blocked = blocked.copy()
        blocked[:-1, :-1] |= falling
        blocked[1:, :-1] |= rising


@pytest.mark.parametrize("seed", range(30))
def test_random_maps_give_the_visibility_graphs_length(seed):
    rng = np.random.default_rng(seed)
    blocked = np.zeros((14, 11), dtype=np.bool_)
    blocked[2:-2, 1:-1] = rng.random((10, 9)) < rng.uniform(0.1, 0.6)
    blocked = without_touching_corners(blocked)
    origin, cell = np.array([-3.0, 7.0]), 0.4
    area = BinaryMap(blocked, origin, cell)
    start, goal = rng.uniform((0, 0), (2, 11)), rng.uniform((12, 0), (14, 11))
    exact = cell * exact_length(Field(start, goal, cells_and_dominoes(blocked)))
    if math.isinf(exact):
        with pytest.raises(InfeasibleError, match="no way round"):
            shortest_path(area.points_m(start), area.points_m(goal), area=area)
    else:
        path = shortest_path(area.points_m(start), area.points_m(goal), area=area)
        assert path.length_m == pytest.approx(exact, rel=1e-9)
        assert not collides(area.cells(path.points_m), cells_and_dominoes(blocked))


def test_two_cells_that_touch_let_nothing_through():
    blocked = np.zeros((4, 4), dtype=np.bool_)
    blocked[1, :2] = blocked[2, 2:] = True
    with pytest.raises(InfeasibleError):
        shortest_path((0.5, 0.5), (3.5, 0.5), area=BinaryMap(blocked, np.zeros(2), 1.0))


def test_polygons_and_map_count_together(paper_map):
    below = ConvexObstacles.of([[(15, 0), (30, 0), (30, 25), (15, 25)]])
    path = shortest_path(START, GOAL, below, paper_map)
    over = 2 * math.hypot(19.8 - 6.7, 34.9 - 29.6) + 7.0
    assert path.length_m == pytest.approx(over, abs=1e-9)


def test_the_way_stays_on_the_map():
    blocked = np.zeros((10, 10), dtype=np.bool_)
    blocked[5, :] = True
    with pytest.raises(InfeasibleError):
        shortest_path((1, 5), (9, 5), area=BinaryMap(blocked, np.zeros(2), 1.0))


def test_the_work_is_bounded():
    field = random_field(np.random.default_rng(1))
    obstacles = ConvexObstacles.of(field.polygons_m)
    needed = shortest_path(field.start_m, field.goal_m, obstacles).work
    budget = SearchBudget(work=needed)
    assert shortest_path(field.start_m, field.goal_m, obstacles, budget=budget).work == needed
    assert budget.work == 0
    with pytest.raises(InfeasibleError, match="within"):
        shortest_path(field.start_m, field.goal_m, obstacles, budget=SearchBudget(work=needed - 1))


def noise(side, share):
    """Blocked cells at random, and the goal walled in: no way can be found, however long it is looked for."""
    blocked = np.random.default_rng(1).random((side, side)) < share
    blocked[:3, :3] = blocked[-3:, -3:] = False
    blocked[-5:, -5] = blocked[-5, -5:] = True
    return BinaryMap(blocked, np.zeros(2), 0.2)


def test_looks_for_tangents_are_counted_and_not_only_tests_of_sight():
    area, budget = noise(100, 0.01), SearchBudget()
    with pytest.raises(InfeasibleError, match="no way round"):
        shortest_path((0.3, 0.3), (19.7, 19.7), area=area, budget=budget)
    # Every corner but those of the goal's own walls was settled, and each of them looked at all of them.
    assert MOST_WORK - budget.work > 0.9 * len(convex_corners(area.blocked)) ** 2


@pytest.mark.parametrize(("side", "share"), [(160, 0.02), (160, 0.1), (250, 0.01), (250, 0.2)])
def test_on_a_map_of_noise_the_work_ends_at_the_bound(side, share):
    area = noise(side, share)
    with pytest.raises(InfeasibleError, match="within") as error:
        shortest_path((0.3, 0.3), 2 * (0.2 * side - 0.3,), area=area)
    work = int(re.search(r"\d+", str(error.value)).group())
    assert 0.99 * MOST_WORK < work < MOST_WORK + 10 * len(convex_corners(area.blocked))


def test_searches_share_a_budget():
    area, budget = noise(160, 0.1), SearchBudget()
    for _ in range(3):
        with pytest.raises(InfeasibleError, match="within"):
            shortest_path((0.3, 0.3), (31.7, 31.7), area=area, budget=budget)
    assert budget.work == 0


@pytest.mark.parametrize(
    ("start", "goal", "field", "words"),
    [
        ((22.0, 30.0), GOAL, "start", "an obstacle is on the vehicle"),
        (START, (22.0, 30.0), "goal", "inside an obstacle"),
        (START, (math.nan, 0.0), "goal", "2 finite coordinates"),
        ((1.0, 2.0, 3.0), GOAL, "start", "2 finite coordinates"),
    ],
)
def test_a_query_without_an_answer_is_one_clear_error(paper_map, start, goal, field, words):
    for scene in ({"area": paper_map}, {"obstacles": ConvexObstacles.of([BOX])}):
        with pytest.raises(InputError, match=words) as error:
            shortest_path(start, goal, **scene)
        assert error.value.field == field


def test_a_goal_off_the_map_and_a_map_of_space_are_refused(paper_map, room):
    with pytest.raises(InputError, match="off the map"):
        shortest_path(START, (50.0, 10.0), area=paper_map)
    with pytest.raises(InputError, match="map of the plane"):
        shortest_path(START, GOAL, area=room)
