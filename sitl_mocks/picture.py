"""What the camera sees, as a small JPEG: ray-cast, shaded by normal and range, with a checker of the place.

A picture taken in the wrong direction shows something else; the chequers are half a metre wide and fixed to the scene,
so that two pictures can be told apart even on a plain wall.
"""

from __future__ import annotations

import io
import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.core.frames import GeoPoint

Array = NDArray[np.float64]

WIDTH_PX, HEIGHT_PX = 320, 213
SENSOR_WIDTH_MM, SENSOR_HEIGHT_MM, FOCAL_LENGTH_MM = 13.2, 8.8, 8.8
_CHECKER_M = 0.5
_SUN = np.array([0.4, -0.5, 0.77])


@dataclass(frozen=True)
class Exposure:
    """Where and when a picture was taken.

    Attributes:
        index: the camera's own running number, from 0.
        sequence: number that the command gave it; 0 for none.
        position_m: of the camera, scene ENU.
        place: the same on the earth, as the vehicle's estimator knows it.
        home_altitude_m: altitude of home, for the height above it.
        yaw_rad: of the view, from east counter-clockwise.
        pitch_rad: of the view, negative looks down.
        roll_rad: of the vehicle (the gimbal takes it out of the picture).
        boot_s: the vehicle's clock.
        unix_s: the same as UTC.
    """

    index: int
    sequence: int
    position_m: Array
    place: GeoPoint
    home_altitude_m: float
    yaw_rad: float
    pitch_rad: float
    roll_rad: float
    boot_s: float
    unix_s: float


class Scene:
    """What there is to be seen.

    Args:
        vertices_m: scene ENU, shape (V, 3).
        faces: shape (F, 3).
        ground_m: height of the flat ground.
    """

    def __init__(self, vertices_m: Array | None, faces: NDArray[np.int64] | None, ground_m: float) -> None:
        self._ground_m = ground_m
        self._caster = None
        if vertices_m is not None and faces is not None and len(faces) > 0:
            from embreex import rtcore_scene
            from embreex.mesh_construction import TriangleMesh

            triangles = np.asarray(vertices_m, dtype=np.float64)[faces]
            self._caster = rtcore_scene.EmbreeScene()
            TriangleMesh(self._caster, triangles.astype(np.float32))
            normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            size = np.linalg.norm(normals, axis=1, keepdims=True)
            self._normals = normals / np.where(size > 0.0, size, 1.0)

    def first_hits(self, origin: Array, directions: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Distance to what is seen, its normal, and whether it is the structure.

        Args:
            origin: shape (3,).
            directions: unit vectors, shape (N, 3).

        Returns:
            Distances (N,), infinite for the sky; normals (N, 3); whether it is the structure (N,).
        """
        distance = np.full(len(directions), np.inf)
        normal = np.zeros((len(directions), 3))
        down = directions[:, 2] < -1e-9
        distance[down] = (origin[2] - self._ground_m) / -directions[down, 2]
        normal[down] = (0.0, 0.0, 1.0)
        solid = np.zeros(len(directions), dtype=bool)
        if self._caster is not None:
            origins = np.repeat(origin[None].astype(np.float32), len(directions), axis=0)
            result = self._caster.run(origins, directions.astype(np.float32), output=1)
            hit = result["primID"] >= 0
            nearer = hit & (result["tfar"] < distance)
            distance[nearer] = result["tfar"][nearer]
            normal[nearer] = self._normals[result["primID"][nearer]]
            solid = nearer
        return distance, normal, solid


def load_scene(file: Path | None, ground_m: float) -> Scene:
    """A scene with the structure of a mesh file in scene coordinates, or with ground and sky alone."""
    if file is None:
        return Scene(None, None, ground_m)
    import trimesh

    mesh = trimesh.load(file, force="mesh", process=False)
    return Scene(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64), ground_m)


def render(scene: Scene, exposure: Exposure) -> NDArray[np.uint8]:
    """The picture as RGB, shape (213, 320, 3)."""
    forward = np.array(
        [
            math.cos(exposure.pitch_rad) * math.cos(exposure.yaw_rad),
            math.cos(exposure.pitch_rad) * math.sin(exposure.yaw_rad),
            math.sin(exposure.pitch_rad),
        ]
    )
    right = np.array([math.sin(exposure.yaw_rad), -math.cos(exposure.yaw_rad), 0.0])
    up = np.cross(right, forward)
    u = ((np.arange(WIDTH_PX) + 0.5) / WIDTH_PX - 0.5) * SENSOR_WIDTH_MM / FOCAL_LENGTH_MM
    v = (0.5 - (np.arange(HEIGHT_PX) + 0.5) / HEIGHT_PX) * SENSOR_HEIGHT_MM / FOCAL_LENGTH_MM
    rays = (forward + u[None, :, None] * right + v[:, None, None] * up).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distance, normal, solid = scene.first_hits(exposure.position_m, rays)

    seen = np.isfinite(distance)
    points = exposure.position_m + rays * np.where(seen, distance, 0.0)[:, None]
    # Just below a surface, so that rounding does not flicker between two chequers.
    cells = np.floor((points - 0.01 * normal) / np.where(solid, _CHECKER_M, 4 * _CHECKER_M)[:, None])
    checker = np.where(np.mod(cells.sum(axis=1), 2.0) < 1.0, 1.0, 0.78)
    light = 0.45 + 0.55 * np.abs(normal @ _SUN)
    haze = np.exp(-np.where(seen, distance, 0.0) / 150.0)[:, None]
    sky = np.array([120.0, 170.0, 225.0]) * (1.0 - 0.35 * np.clip(rays[:, 2:3], 0.0, 1.0))
    paint = np.where(solid[:, None], [235.0, 150.0, 50.0], [125.0, 135.0, 105.0])
    colour = paint * (light * checker)[:, None] * haze + (1.0 - haze) * np.array([190.0, 200.0, 210.0])
    pixels = np.where(seen[:, None], colour, sky)
    picture: NDArray[np.uint8] = np.clip(pixels, 0.0, 255.0).astype(np.uint8).reshape(HEIGHT_PX, WIDTH_PX, 3)
    return picture


def jpeg(pixels: NDArray[np.uint8], exposure: Exposure) -> bytes:
    """The picture as a JPEG file with its place, direction and time in EXIF."""
    from PIL import Image

    image = Image.fromarray(pixels)
    exif = image.getexif()
    taken = datetime.fromtimestamp(exposure.unix_s, UTC)
    heading = math.degrees((math.pi / 2 - exposure.yaw_rad) % (2 * math.pi))
    place = exposure.place
    exif[0x010F] = "gcs"  # Make
    exif[0x0110] = "sitl_mocks camera"  # Model
    details = exif.get_ifd(0x8769)
    details[0x9003] = taken.strftime("%Y:%m:%d %H:%M:%S")  # DateTimeOriginal
    details[0x9291] = f"{taken.microsecond // 1000:03d}"  # SubSecTimeOriginal
    details[0x9011] = "+00:00"  # OffsetTimeOriginal
    details[0x920A] = FOCAL_LENGTH_MM  # FocalLength
    comment = {
        "index": exposure.index,
        "sequence": exposure.sequence,
        "yaw_rad": round(exposure.yaw_rad, 6),
        "pitch_rad": round(exposure.pitch_rad, 6),
        "position_m": [round(float(c), 4) for c in exposure.position_m],
        "boot_s": round(exposure.boot_s, 3),
    }
    details[0x9286] = b"ASCII\0\0\0" + json.dumps(comment).encode()  # UserComment
    gps = exif.get_ifd(0x8825)
    gps[1] = "N" if place.latitude_deg >= 0 else "S"
    gps[2] = _degrees_minutes_seconds(place.latitude_deg)
    gps[3] = "E" if place.longitude_deg >= 0 else "W"
    gps[4] = _degrees_minutes_seconds(place.longitude_deg)
    gps[5] = b"\x00" if place.altitude_m >= 0 else b"\x01"
    gps[6] = round(abs(place.altitude_m), 3)
    gps[7] = (float(taken.hour), float(taken.minute), taken.second + taken.microsecond / 1e6)
    gps[16] = "T"
    gps[17] = round(heading, 3)
    gps[29] = taken.strftime("%Y:%m:%d")
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=80, exif=exif)
    return buffer.getvalue()


def _degrees_minutes_seconds(degrees: float) -> tuple[float, float, object]:
    from PIL.TiffImagePlugin import IFDRational

    rest = abs(degrees)
    whole = math.floor(rest)
    minutes = math.floor((rest - whole) * 60)
    seconds = (rest - whole - minutes / 60) * 3600
    return float(whole), float(minutes), IFDRational(round(seconds * 1_000_000), 1_000_000)
