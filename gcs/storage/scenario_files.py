"""Scenario files: YAML or JSON on disk to a checked scenario, with every complaint about the file in one line."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import yaml

from gcs.core.errors import InputError
from gcs.core.scenario import Scenario, parse_scenario

if TYPE_CHECKING:
    from pathlib import Path


def read_scenario_file(path: Path) -> Scenario:
    """Read and check a scenario file; JSON if its name ends so, else YAML.

    Raises:
        InputError: naming the file or the field. A field that is given twice is an error too: YAML and JSON would
            silently drop the first one, and it may have been a clearance.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError("there is no such file", field=str(path)) from None
    except UnicodeDecodeError:
        raise InputError("this is not a text file: a scenario is YAML or JSON", field=str(path)) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", field=str(path)) from None
    try:
        if path.suffix.lower() == ".json":
            data = json.loads(text, object_pairs_hook=_unique)
        else:
            data = yaml.load(text, _UniqueKeyLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        where = " ".join(str(error).split())
        raise InputError(f"not well-formed YAML or JSON: {where}", field=str(path)) from None
    _read_spots(data, path.parent)
    return parse_scenario(data)


def _read_spots(data: object, folder: Path) -> None:
    """Put the points of a table in the place of its name in `inspection.surface.spots`."""
    inner = data
    for key in ("inspection", "surface"):
        inner = inner.get(key) if isinstance(inner, dict) else None
    if not isinstance(inner, dict) or not isinstance(inner.get("spots"), str):
        return
    from gcs.storage.point_table import read_point_table

    names, places, normals = read_point_table(folder / inner["spots"])
    inner["spots"] = [
        {"name": name, "position_m": place, "normal": normal}
        for name, place, normal in zip(names, places.tolist(), normals.tolist(), strict=True)
    ]


class _UniqueKeyLoader(yaml.SafeLoader):
    """Plain data only, and no key twice in a mapping."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(None, None, f"{key.value} is given twice", key.start_mark)
                seen.add(key.value)
        return super().construct_mapping(node, deep)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    seen: dict[str, Any] = {}
    for key, value in pairs:
        if key in seen:
            raise ValueError(f"{key} is given twice")
        seen[key] = value
    return seen
