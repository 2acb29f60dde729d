"""A companion that dies while it flies round something: the vehicle's own stop touches nothing that was seen."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from gcs.planning.trajectories.stream_loss import StreamLoss

OBSTACLES = [
    {"kind": "vehicle", "name": "on the way", "radius_m": 1.0, "height_m": 20.0, "path_m": [[6.0, 0.3]]},
    {"kind": "vehicle", "name": "beside it", "radius_m": 1.2, "height_m": 20.0, "path_m": [[6.3, -6.6]]},
]
DETOUR_S = 1.5
"""From the start of the plan until the vehicle is well on its way between the two."""


@pytest.mark.parametrize("after_s", [2.0, 2.5, 3.0, 4.0])
def test_dying_in_the_middle_of_a_detour_touches_nothing(make_world, after_s):
    """Without the rule the second and third of these end in the second obstacle: it flies on for 3 s."""
    world = make_world("ardupilot", obstacles=OBSTACLES)
    flyable = next(iter(world.plans.plans.values()))
    world.plans.plans = {flyable.plan_hash: replace(flyable, stream_loss=StreamLoss(3.0, 2.0))}
    world.take_off()
    world.order()
    assert world.run(10.0, lambda: world.core._flight._navigator is not None)
    world.run(DETOUR_S + after_s)
    assert world.core._flight._navigator.away
    world.core = SimpleNamespace(deadline=math.inf, handle=lambda message: None, on_time=lambda: None)
    world.run(10.0)
    truth = world.world.truth()
    assert truth["obstacles"]["touched"] == {}
    assert truth["obstacles"]["least_distance_m"] > 0.2, "the errors of place and map are left"
