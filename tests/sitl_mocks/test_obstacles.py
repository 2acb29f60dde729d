"""Obstacles: where they are, how near, and what a file may say about them."""

import json
import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from sitl_mocks.command_line import main
from sitl_mocks.obstacle_file import parse_obstacles, read_obstacles
from sitl_mocks.obstacles import Obstacle, Obstacles

TRUCK = {"kind": "vehicle", "path_m": [[4, 2]]}


def cylinder(**changes):
    return Obstacle(**{"name": "a", "path_m": ((0.0, 0.0),), "radius_m": 2.0, "base_m": 1.0, "height_m": 4.0} | changes)


def test_a_path_is_followed_with_stops_and_to_and_fro():
    path = ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0))
    once = Obstacles([cylinder(path_m=path, speed_m_s=2.0, start_s=10.0, pause_s=1.0)])
    expected = {
        0.0: (0, 0),
        10.0: (0, 0),
        11.0: (2, 0),
        12.5: (4, 0),
        13.0: (4, 0),
        14.0: (4, 2),
        14.5: (4, 3),
        99: (4, 3),
    }
    for time_s, place in expected.items():
        assert once.place_m(0, time_s) == pytest.approx(place), time_s
    forever = Obstacles([cylinder(path_m=path[:2], speed_m_s=2.0, start_s=10.0, repeats=True)])
    for time_s in (11.0, 13.0, 15.0, 111.0):
        assert forever.place_m(0, time_s) == pytest.approx((2, 0))


def test_distance_is_that_of_the_nearest_point_of_a_cylinder():
    obstacles = Obstacles([cylinder()])
    rng = np.random.default_rng(1)
    turns, heights = np.meshgrid(np.linspace(0, 2 * math.pi, 721), np.linspace(1.0, 5.0, 81))
    side = np.column_stack([2 * np.cos(turns.ravel()), 2 * np.sin(turns.ravel()), heights.ravel()])
    disc = rng.uniform(-2, 2, (60_000, 2))
    disc = disc[np.hypot(*disc.T) <= 2]
    caps = np.concatenate([np.column_stack([disc, np.full(len(disc), z)]) for z in (1.0, 5.0)])
    surface = np.concatenate([side, caps])
    for point in rng.uniform(-6, 9, (40, 3)):
        distance, which = obstacles.nearest(point, 0.0)
        inside = math.hypot(point[0], point[1]) < 2 and 1 < point[2] < 5
        assert which == 0
        assert (-distance if inside else distance) == pytest.approx(
            np.linalg.norm(surface - point, axis=1).min(), abs=0.06
        )
    assert Obstacles([]).nearest(np.zeros(3), 0.0) == (math.inf, -1)


def test_a_file_gives_names_and_usual_sizes(tmp_path):
    file = tmp_path / "yard.json"
    drone = {"kind": "drone", "path_m": [[0, 0], [5, 5]], "base_m": 7.5, "name": "other", "repeats": True}
    file.write_text(json.dumps({"obstacles": [TRUCK, drone]}))
    truck, other = read_obstacles(file)
    assert (truck.name, truck.base_m, truck.radius_m) == ("vehicle-1", 0.0, 2.0)
    assert (other.name, other.base_m, other.height_m, other.speed_m_s) == ("other", 7.5, 0.5, 4.0)


@pytest.mark.parametrize(
    ("entry", "field"),
    [
        ({**TRUCK, "kind": "whale"}, "kind"),
        ({**TRUCK, "radius_m": 0}, "radius_m"),
        ({**TRUCK, "radius_m": math.nan}, "radius_m"),
        ({**TRUCK, "colour": "red"}, "colour"),
        ({**TRUCK, "path_m": []}, "path_m"),
        ({**TRUCK, "path_m": [[1, 1], [1, 1]]}, "path_m"),
        ({**TRUCK, "path_m": [[1, math.inf]]}, "path_m"),
        ({**TRUCK, "repeats": True}, "repeats"),
        ({"kind": "drone", "path_m": [[0, 0]]}, "base_m"),
        ({**TRUCK, "name": "vehicle-1"}, "name"),
    ],
)
def test_a_wrong_entry_is_named(entry, field):
    with pytest.raises(InputError, match=rf"obstacles\.1.*{field}"):
        parse_obstacles({"obstacles": [TRUCK, entry]})


@pytest.mark.parametrize("text", [None, "{", "[]", '{"obstacles": 3}', '{"obstacles": [{"kind": "person"}]}'])
def test_a_bad_file_is_one_clear_line(text, tmp_path, capsys):
    file = tmp_path / "yard.json"
    if text is not None:
        file.write_text(text)
    assert main(["--port", "9", "--obstacles", str(file)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(file) in line
