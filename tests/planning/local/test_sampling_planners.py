"""RRT, RRT*, BI-RRT* and IB-RRT*: free ways, seeds, ways that only get shorter, and trees that add up."""

import itertools

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError, InputError, OperationCancelled
from gcs.planning.local.bidirectional_rrt_star import BidirectionalRrtStar
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.intelligent_bidirectional_rrt_star import IntelligentBidirectionalRrtStar
from gcs.planning.local.rrt import Rrt
from gcs.planning.local.rrt_star import RrtStar
from gcs.planning.local.sampling_planner import SamplingOptions, search_path
from gcs.planning.local.search_tree import straight_free

START, GOAL = (6.7, 29.6), (39.9, 29.6)
OPTIMUM = 34.9728440
STARS = [RrtStar, BidirectionalRrtStar, IntelligentBidirectionalRrtStar]
PLANNERS = [Rrt, *STARS]
ROOM_START, ROOM_GOAL = (-8.0, 3.0, 1.0), (8.0, -3.0, 2.0)


def length(way):
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def assert_free(way, area):
    """By many points, which shares nothing with the planners' walk through the cells."""
    for a, b in itertools.pairwise(way):
        for share in np.linspace(0.0, 1.0, 400):
            assert not area.is_blocked(a + share * (b - a))


@pytest.mark.parametrize("planner", PLANNERS)
def test_the_way_is_free_and_joins_start_and_goal_in_the_plane(planner, paper_map):
    way = search_path(planner(paper_map, START, GOAL))
    assert way.shape[1] == 2
    assert np.allclose(way[[0, -1]], [START, GOAL])
    assert_free(way, paper_map)
    assert length(way) >= OPTIMUM


@pytest.mark.parametrize("planner", PLANNERS)
def test_the_way_is_free_and_joins_start_and_goal_in_space(planner, room):
    way = search_path(planner(room, ROOM_START, ROOM_GOAL, SamplingOptions(iterations=2000)))
    assert way.shape[1] == 3
    assert np.allclose(way[[0, -1]], [ROOM_START, ROOM_GOAL])
    assert_free(way, room)
    assert way[:, 2].max() > 8.0


@pytest.mark.parametrize("planner", STARS)
def test_the_optimum_is_come_near_to(planner, paper_map):
    way = search_path(planner(paper_map, START, GOAL, SamplingOptions(iterations=4000)))
    assert length(way) <= 1.02 * OPTIMUM


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_seed_gives_one_way_and_another_seed_another(planner, paper_map):
    options = SamplingOptions(iterations=600, seed=3, goal_share=0.0)
    one = planner(paper_map, START, GOAL, options)
    search_path(one)
    again = planner(paper_map, START, GOAL, options)
    search_path(again)
    other = planner(paper_map, START, GOAL, SamplingOptions(iterations=600, seed=4, goal_share=0.0))
    search_path(other)
    assert (one.best() == again.best()).all()
    assert one.best().tolist() != other.best().tolist()


@pytest.mark.parametrize("planner", STARS)
def test_the_best_way_is_there_at_any_time_and_never_gets_longer(planner, paper_map):
    search = planner(paper_map, START, GOAL, SamplingOptions(iterations=1500))
    lengths = []
    while not search.finished:
        search.grow(50)
        way = search.best()
        assert way is not None or not lengths
        if way is not None:
            lengths.append(length(way))
    assert (np.diff(lengths) <= 1e-9).all()
    assert lengths[-1] < lengths[0]


@pytest.mark.parametrize("planner", STARS)
def test_the_costs_in_the_trees_are_the_lengths_of_their_ways(planner, paper_map):
    search = planner(paper_map, START, GOAL, SamplingOptions(iterations=700))
    search_path(search)
    trees = [search._tree] if planner is RrtStar else [search._from_start, search._from_goal]
    for tree in trees:
        count = int(tree.size[0])
        cost = np.zeros(count)
        reached = np.zeros(count, dtype=np.bool_)
        waiting = [0]
        while waiting:  # down the lists of children, which rewiring has to keep in order
            node = waiting.pop()
            assert not reached[node]
            reached[node] = True
            child = tree.first_child[node]
            while child >= 0:
                assert tree.parent[child] == node
                cost[child] = cost[node] + np.linalg.norm(tree.points[child] - tree.points[node])
                waiting.append(child)
                child = tree.next_sibling[child]
        assert reached.all()
        assert np.allclose(tree.cost[:count], cost)


def test_rrt_ends_with_its_first_way(paper_map):
    search = Rrt(paper_map, START, GOAL)
    search_path(search)
    assert search.iterations_done < 700
    before = search.best()
    search.grow(100)
    assert (search.best() == before).all()


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_wall_without_a_gap_is_said(planner):
    blocked = np.zeros((20, 20), dtype=np.bool_)
    blocked[10] = True
    with pytest.raises(InfeasibleError, match="in 300 samples"):
        search_path(planner(BinaryMap(blocked, np.zeros(2), 1.0), (1, 1), (19, 19), SamplingOptions(iterations=300)))


class Impatient:
    def __init__(self, reports):
        self.left = reports

    def report(self, stage, fraction):
        assert stage == "local path"
        self.left -= 1
        if self.left == 0:
            raise OperationCancelled("enough")


@pytest.mark.parametrize("planner", STARS)
def test_a_search_that_is_stopped_keeps_its_best_way(planner, paper_map):
    search = planner(paper_map, START, GOAL, SamplingOptions(iterations=50_000))
    with pytest.raises(OperationCancelled):
        search_path(search, Impatient(6))
    assert search.iterations_done == 500
    assert length(search.best()) < 1.5 * OPTIMUM


def test_bad_queries_and_options_are_refused(paper_map):
    with pytest.raises(InputError, match="an obstacle is on the vehicle"):
        RrtStar(paper_map, (22.0, 30.0), GOAL)
    with pytest.raises(InputError, match="goal"):
        RrtStar(paper_map, START, (22.0, 30.0))
    for field, bad in (("iterations", 0), ("step_m", -1.0), ("goal_share", 2.0)):
        with pytest.raises(InputError) as error:
            SamplingOptions(**{field: bad})
        assert error.value.field == field


def test_a_straight_through_cells_is_seen_as_by_many_points():
    rng = np.random.default_rng(5)
    blocked = rng.random((8, 7, 6)) < 0.08
    area = BinaryMap(blocked, np.zeros(3), 1.0)
    seen = 0
    for _ in range(300):
        a, b = rng.uniform(0, blocked.shape), rng.uniform(0, blocked.shape)
        points = a + np.linspace(0, 1, 2000)[:, None] * (b - a)
        free = not blocked[tuple(np.floor(points).astype(int).T)].any()
        if straight_free(a, b, blocked) != free:
            # Between two of the points a corner may be cut; never the other way round.
            assert free
            seen += 1
        assert not area.is_blocked(a) or not straight_free(a, b, blocked)
    assert seen <= 5
