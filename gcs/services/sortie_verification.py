"""The sorties of a written plan: reserve, rest at home between them, and folders that agree with the whole."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.certificates import Check
from gcs.planning.dynamics.energy import energy_wh, usable_wh
from gcs.storage.plan_files import part_directories, read_plan

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from gcs.core.plan import Plan, Sortie

ENERGY_TOLERANCE = 0.01
SAME_M = 1e-3
"""How far a sortie's own trajectory may be from that part of the whole one."""

LOOK_S = 0.5


def verify_sorties(plan: Plan, directory: Path, verify: Callable[[Path], list[Check]]) -> list[Check]:
    """Check the sorties of a plan, and the complete plans in their folders.

    Args:
        plan: as read.
        directory: its folder.
        verify: checks a written plan.
    """
    folders = part_directories(directory)
    expected = [f"sortie-{number + 1}" for number in range(len(plan.sorties))]
    if [folder.name for folder in folders] != expected:
        found = ", ".join(folder.name for folder in folders) or "none"
        return [Check("sorties", False, len(folders), len(expected), f"folders of sorties: {found}")]
    checks = [_rest_between(plan)] if plan.sorties else []
    for sortie, folder in zip(plan.sorties, folders, strict=True):
        checks.append(_reserve(plan, sortie, folder.name))
        checks.append(_same(plan, sortie, folder))
        checks.extend(replace(check, name=f"{folder.name}: {check.name}") for check in verify(folder))
    return checks


def _rest_between(plan: Plan) -> Check:
    """Between sorties, before the first and after the last the vehicle stands at home; pictures are taken in flight."""
    trajectory, home = plan.trajectory, np.asarray(plan.scenario.home_m)
    ends = [0.0, *(t for s in plan.sorties for t in (s.start_s, s.end_s)), trajectory.duration_s]
    rests = [np.arange(a, b, LOOK_S) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    times = np.concatenate([*rests, ends])
    away = float(np.linalg.norm(trajectory.value(times) - home, axis=1).max())
    exposures = {v.id: v.time_s for v in plan.viewpoints}
    timely = all(s.start_s < exposures[v] < s.end_s for s in plan.sorties for v in s.viewpoints)
    ok = away <= SAME_M and timely and ends == sorted(ends)
    return Check("sorties", ok, away, SAME_M, f"{len(plan.sorties)} sorties, from home while resting {away:.4f} m")


def _reserve(plan: Plan, sortie: Sortie, name: str) -> Check:
    needed = energy_wh(plan.trajectory, plan.scenario.vehicle, sortie.start_s, sortie.end_s)
    battery = plan.scenario.vehicle.battery
    usable = math.inf if battery is None else usable_wh(battery)
    ok = needed <= usable and abs(needed - sortie.energy_wh) <= ENERGY_TOLERANCE * max(sortie.energy_wh, 1.0)
    message = f"{needed:.1f} Wh, reported {sortie.energy_wh:.1f} Wh, usable {usable:.1f} Wh"
    return Check(f"{name}: reserve", ok, needed, usable, message)


def _same(plan: Plan, sortie: Sortie, folder: Path) -> Check:
    name = f"{folder.name}: part of the whole"
    try:
        part = read_plan(folder)
    except InputError as error:
        return Check(name, False, 0.0, 1.0, error.message)
    if tuple(v.id for v in part.viewpoints) != sortie.viewpoints:
        return Check(name, False, 0.0, 1.0, "visits other viewpoints than the whole plan in this sortie")
    times = np.append(np.arange(0.0, sortie.duration_s, LOOK_S), sortie.duration_s)
    apart = part.trajectory.value(times) - plan.trajectory.value(times + sortie.start_s)
    off = float(np.linalg.norm(apart, axis=1).max())
    off = max(off, abs(part.trajectory.duration_s - sortie.duration_s))
    return Check(name, off <= SAME_M, off, SAME_M, f"differs from the whole plan's by {off:.4f} m or s at most")
