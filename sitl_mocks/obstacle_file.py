"""Obstacles from a file: `{"obstacles": [{"kind": "vehicle", "path_m": [[4, 2], [9, 2]], "speed_m_s": 2}, ...]}`.

`kind` (vehicle, person or drone) gives what is left out. A path of one corner is something that stands. Places are
scene ENU in metres; vehicles and people stand on the ground that the flying vehicle starts from (`base_m` 0) unless
told otherwise, a drone's `base_m` must be given.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from gcs.core.errors import InputError
from sitl_mocks.obstacles import Obstacle

Length = Annotated[float, Field(gt=0.0, le=1000.0)]
Coordinate = Annotated[FiniteFloat, Field(ge=-1e5, le=1e5)]

USUAL_SIZES_M: dict[str, tuple[float, float]] = {"vehicle": (2.0, 4.0), "person": (0.3, 1.8), "drone": (0.5, 0.5)}
"""Radius and height of each kind."""
USUAL_SPEEDS_M_S = {"vehicle": 3.0, "person": 1.3, "drone": 4.0}


class _ObstacleEntry(BaseModel):
    model_config = ConfigDict(extra="forbid")

    kind: Literal["vehicle", "person", "drone"]
    name: str | None = None
    path_m: Annotated[list[tuple[Coordinate, Coordinate]], Field(min_length=1, max_length=1000)]
    radius_m: Length | None = None
    base_m: Coordinate | None = None
    height_m: Length | None = None
    speed_m_s: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    start_s: Annotated[FiniteFloat, Field(ge=0.0)] = 0.0
    pause_s: Annotated[FiniteFloat, Field(ge=0.0)] = 0.0
    repeats: bool = False


class _ObstacleFile(BaseModel):
    model_config = ConfigDict(extra="forbid")

    obstacles: Annotated[list[_ObstacleEntry], Field(max_length=1000)]


def read_obstacles(file: Path) -> tuple[Obstacle, ...]:
    """The obstacles in a file.

    Raises:
        InputError: in one line, naming the file and the first thing that is wrong in it.
    """
    try:
        return parse_obstacles(json.loads(file.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", field=str(file)) from None
    except ValueError:
        raise InputError("this is no JSON text", field=str(file)) from None
    except InputError as error:
        raise InputError(str(error), field=str(file)) from None


def parse_obstacles(data: object) -> tuple[Obstacle, ...]:
    """The obstacles in what a JSON parser gave.

    Raises:
        InputError: in one line, naming the first field that is wrong.
    """
    try:
        entries = _ObstacleFile.model_validate(data).obstacles
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(first["msg"], field=".".join(map(str, first["loc"])) or None) from None
    obstacles = tuple(_obstacle(entry, number) for number, entry in enumerate(entries))
    names = [obstacle.name for obstacle in obstacles]
    for number, name in enumerate(names):
        if name in names[:number]:
            raise InputError(f"there is another obstacle named {name}", field=f"obstacles.{number}.name")
    return obstacles


def _obstacle(entry: _ObstacleEntry, number: int) -> Obstacle:
    field = f"obstacles.{number}"
    if entry.kind == "drone" and entry.base_m is None:
        raise InputError("a drone flies: give the height of its lower side", field=f"{field}.base_m")
    if any(a == b for a, b in zip(entry.path_m, entry.path_m[1:], strict=False)):
        raise InputError("two corners that follow each other are at the same place", field=f"{field}.path_m")
    if entry.repeats and len(entry.path_m) < 2:
        raise InputError("what goes to and fro needs a path of two corners or more", field=f"{field}.repeats")
    radius_m, height_m = USUAL_SIZES_M[entry.kind]
    return Obstacle(
        name=entry.name or f"{entry.kind}-{number + 1}",
        path_m=tuple(entry.path_m),
        radius_m=entry.radius_m or radius_m,
        base_m=entry.base_m or 0.0,
        height_m=entry.height_m or height_m,
        speed_m_s=entry.speed_m_s or USUAL_SPEEDS_M_S[entry.kind],
        start_s=entry.start_s,
        pause_s=entry.pause_s,
        repeats=entry.repeats,
    )
