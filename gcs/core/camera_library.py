"""The camera library: what `camera: {model: NAME}` of a scenario stands for.

The data is `camera_library.yaml` beside this file; it is read when the first model is asked for. A scenario's own
fields come on top of the library's, so that another lens or a smaller aperture needs one line.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from gcs.core.camera import Camera
from gcs.core.errors import InputError
from gcs.core.fields import NonNegative, Positive, Strict

DATA_FILE = "camera_library.yaml"

NEAR_MATCHES = 4
"""How many names are offered when one is not known."""

Shutter = Literal["global", "leaf", "focal-plane", "rolling"]


class StatedView(Strict):
    """What the maker says of the view, at the short end of a zoom."""

    equivalent_mm: Positive | None = None
    diagonal_deg: Annotated[float, Field(gt=0, lt=180)] | None = None


class LibraryCamera(Strict):
    """One entry of the library.

    Attributes:
        name: the maker's name, with the lens where lenses change.
        aliases: other names for the same camera.
        source: the data sheet, by name.
        shutter: `global` and `leaf` expose all rows at once; the curtains of `focal-plane` are a fast `rolling` one.
        stated: the maker's own words about the view, to hold the rest against.
        estimated: fields of `camera` that no data sheet gives.
        note: what else one has to know.
        nearest_focus_zoomed_m: nearest focus of a zoom away from its short end.
        camera: fields of `gcs.core.camera.Camera`.
    """

    name: str
    aliases: tuple[str, ...] = ()
    source: str
    shutter: Shutter
    stated: StatedView = StatedView()
    estimated: tuple[str, ...] = ()
    note: str = ""
    nearest_focus_zoomed_m: NonNegative | None = None
    camera: dict[str, Any]

    def fields(self) -> dict[str, Any]:
        """Fields of the camera, a zoom at its short end."""
        fields = {
            "model": self.name,
            "shutter": "global" if self.shutter in ("global", "leaf") else "rolling",
            **self.camera,
        }
        if "focal_range_mm" in fields:
            fields.setdefault("focal_length_mm", fields["focal_range_mm"][0])
        return fields


@cache
def library() -> tuple[LibraryCamera, ...]:
    """All cameras, in the file's order."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    text = files("gcs.core").joinpath(DATA_FILE).read_text(encoding="utf-8")
    return TypeAdapter(tuple[LibraryCamera, ...]).validate_python(yaml.load(text, loader)["cameras"])


def find_camera(name: str) -> LibraryCamera:
    """The camera of a name; case, spaces and punctuation do not matter, nor does leaving out the maker.

    Raises:
        InputError: there is none; names near to it are told.
    """
    found = _by_key().get(_key(name))
    if found is None:
        raise InputError(_unknown(name), field="camera.model")
    return found


def library_camera(name: str, **overrides: Any) -> Camera:
    """A camera of the library, with some of its fields changed.

    Raises:
        InputError: there is no such camera.
        pydantic.ValidationError: an override does not fit.
    """
    find_camera(name)
    return Camera.model_validate(resolve_camera({"model": name, **overrides}))


def resolve_camera(data: object) -> object:
    """Replace `model` of a scenario's `camera` by the library's figures; the scenario's own fields stay on top.

    Args:
        data: what the scenario says; anything without a model is given back as it is.

    Raises:
        ValidationError: naming `model` or `f_number`, for the model that holds the camera.
    """
    if not isinstance(data, Mapping) or data.get("model") is None:
        return data
    name = data["model"]
    entry = _by_key().get(_key(name)) if isinstance(name, str) else None
    if entry is None:
        raise _wrong("model", name, _unknown(name))
    fields = entry.fields()
    gimbal, own_gimbal = fields.get("gimbal"), data.get("gimbal")
    zoomed = data.get("focal_length_mm") not in (None, fields["focal_length_mm"])
    if zoomed and entry.nearest_focus_zoomed_m is not None:
        fields["nearest_focus_m"] = entry.nearest_focus_zoomed_m
    if data.get("shutter") == "global":
        fields.pop("readout_s", None)
    widest, asked = fields.get("f_number"), data.get("f_number")
    if isinstance(asked, int | float) and widest is not None and 0 < asked < widest:
        raise _wrong("f_number", asked, f"{asked:g} is wider than the lens of {entry.name} opens ({widest:g})")
    fields |= {key: value for key, value in data.items() if key != "model"}
    if isinstance(gimbal, Mapping) and isinstance(own_gimbal, Mapping):
        fields["gimbal"] = {**gimbal, **own_gimbal}
    return fields


@cache
def _by_key() -> dict[str, LibraryCamera]:
    """Entries by every spelling; a shortened name that two of them would share belongs to neither."""
    keys: dict[str, LibraryCamera | None] = {}
    for entry in library():
        for name in (entry.name, *entry.aliases):
            for key in {_key(name), _key(name.partition(" ")[2])} - {""}:
                keys[key] = entry if keys.get(key, entry) is entry else None
    for entry in library():
        for name in (entry.name, *entry.aliases):
            keys[_key(name)] = entry
    return {key: entry for key, entry in keys.items() if entry is not None}


def _key(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum())


def _unknown(name: object) -> str:
    if not isinstance(name, str):
        return "the name of a camera of the library is a text"
    key, names = _key(name), {_key(entry.name): entry.name for entry in library()}
    near = [names[k] for k in names if key and key in k]
    similar = difflib.get_close_matches(key, list(_by_key()), n=3 * NEAR_MATCHES, cutoff=0.5)
    near += [_by_key()[k].name for k in similar]
    offered = list(dict.fromkeys(near))[:NEAR_MATCHES]
    hint = f"did you mean {', '.join(offered)}?" if offered else "docs/cameras.md lists the names; or give the numbers"
    return f"no camera of the library is called {name!r}: {hint}"


def _wrong(field: str, value: object, message: str) -> ValidationError:
    error = PydanticCustomError("camera_library", "{message}", {"message": message})
    return ValidationError.from_exception_data("camera", [InitErrorDetails(type=error, loc=(field,), input=value)])
