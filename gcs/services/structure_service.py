"""Structures of the station: samples, and meshes that were brought in."""

from __future__ import annotations

import hashlib
import shutil
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal, get_args

from gcs.core.clock import new_id, utc_now
from gcs.core.errors import InputError, RefusedError
from gcs.core.structure_source import MeshSource, SampleName, StructureSource
from gcs.storage.atomic_files import new_directory, open_folder
from gcs.storage.records import StructureRecord

if TYPE_CHECKING:
    from gcs.core.structure import Structure
    from gcs.storage.database import Database

SAMPLES = get_args(SampleName)
SUFFIXES = (".stl", ".obj", ".ply", ".glb", ".gltf", ".off", ".dae")
MAX_UPLOAD_BYTES = 500_000_000
MAX_CACHED = 4
HOME_MARGIN_M = 15.0
CHUNK_BYTES = 1 << 20
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class StructureInfo:
    """One structure of the list.

    Attributes:
        id: for a sample its name.
        source: what goes into `structure` of a scenario.
    """

    id: str
    kind: Literal["sample", "mesh"]
    name: str
    created_at: str | None
    source: dict[str, Any]


@dataclass(frozen=True)
class LoadedStructure:
    """A structure of the list with its triangles."""

    info: StructureInfo
    structure: Structure


class StructureService:
    """Keeps meshes and loads them.

    Args:
        database: where they are listed.
        data_dir: the data directory; the files are in its folder `structures`.
    """

    def __init__(self, database: Database, data_dir: Path) -> None:
        self._database = database
        self.folder = data_dir / "structures"
        self._loaded: dict[str, LoadedStructure] = {}
        self._lock = threading.Lock()

    def open(self) -> None:
        """Make the folder, and remove what a killed station left half-written.

        Raises:
            StorageError: it cannot be made.
        """
        open_folder(self.folder)

    def list(self) -> list[StructureInfo]:
        """Samples first, then what was brought in, newest first."""
        return [_sample_info(name) for name in SAMPLES] + [_mesh_info(r) for r in self._database.structures.all()]

    def info(self, structure_id: str) -> StructureInfo:
        """One structure of the list.

        Raises:
            NotFoundError: there is none of this name.
        """
        if structure_id in SAMPLES:
            return _sample_info(structure_id)
        return _mesh_info(self._database.structures.get(structure_id))

    def get(self, structure_id: str) -> LoadedStructure:
        """One structure with its triangles.

        Raises:
            NotFoundError: there is none of this name.
            InputError: its file cannot be loaded any more.
        """
        from gcs.storage.mesh_files import load_structure

        info = self.info(structure_id)
        with self._lock:
            known = self._loaded.get(structure_id)
            if known is None:
                structure, _ = load_structure(StructureSource.model_validate(info.source), self.folder)
                known = LoadedStructure(info, structure)
                self._loaded[structure_id] = known
                while len(self._loaded) > MAX_CACHED:
                    del self._loaded[next(iter(self._loaded))]
            return known

    def mesh_ply(self, structure_id: str) -> bytes:
        """The placed triangles as a binary PLY with float32 vertices.

        Raises:
            NotFoundError: there is none of this name.
        """
        from gcs.storage.ply_files import ply_bytes

        structure = self.get(structure_id).structure
        return ply_bytes(structure.vertices_m, structure.faces, single=True)

    def add(
        self,
        file: IO[bytes],
        *,
        original_name: str,
        name: str | None = None,
        scale: float = 1.0,
        up: Literal["z", "y"] = "z",
        rotation_deg: float = 0.0,
        position_m: Vector = (0.0, 0.0, 0.0),
    ) -> LoadedStructure:
        """Bring in a mesh: it is kept only when it can be loaded.

        Args:
            file: its content.
            original_name: the name that the user knows it by; its ending tells the format.
            name: what to call it; the original name when left out.
            scale: file units to metres.
            up: the file's upward axis.
            rotation_deg: about the vertical, counter-clockwise.
            position_m: of the file's origin.

        Raises:
            InputError: it is not a mesh that can be used.
            StorageError: the disk did not take it.
        """
        from gcs.storage.mesh_files import load_structure

        shown = Path(original_name.replace("\\", "/")).name or "mesh"
        suffix = Path(shown).suffix.lower()
        if suffix not in SUFFIXES:
            raise InputError(f"{shown}: the file's ending must be one of {', '.join(SUFFIXES)}", field="file")
        structure_id = new_id("mesh")
        file_name = f"mesh{suffix}"
        source = MeshSource(
            file=f"{structure_id}/{file_name}", scale=scale, up=up, position_m=position_m, rotation_deg=rotation_deg
        )
        folder = self.folder / structure_id
        with new_directory(folder, lambda _: False) as partial:
            sha256 = _copy(file, partial / file_name)
            there = source.model_copy(update={"file": file_name})
            try:
                structure, _ = load_structure(StructureSource(meshes=(there,)), partial)
            except InputError as error:
                raise InputError(error.message.replace(str(partial / file_name), shown), field="file") from error
        low, high = structure.bounds_m
        record = StructureRecord(
            id=structure_id,
            name=(name or "").strip() or Path(shown).stem,
            created_at=utc_now(),
            file_name=file_name,
            original_name=shown,
            sha256=sha256,
            scale=scale,
            up=up,
            position_m=position_m,
            rotation_deg=rotation_deg,
            triangles=len(structure.faces),
            low_m=(float(low[0]), float(low[1]), float(low[2])),
            high_m=(float(high[0]), float(high[1]), float(high[2])),
            notes=structure.notes,
        )
        self._database.structures.add(record)
        return LoadedStructure(_mesh_info(record), structure)

    def starting_scenario(self, structure_id: str) -> dict[str, Any]:
        """A scenario to start from: the sample's own, or for a mesh one with common numbers to be looked at.

        Raises:
            NotFoundError: there is none of this name.
        """
        from gcs.storage.mesh_files import sample_scenario

        if structure_id in SAMPLES:
            return sample_scenario(structure_id)
        record = self._database.structures.get(structure_id)
        ground = record.low_m[2]
        home = (round(record.low_m[0] - HOME_MARGIN_M, 2), round(record.low_m[1] - HOME_MARGIN_M, 2), ground)
        return {
            "name": record.name,
            "structure": _mesh_info(record).source,
            "anchor": {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.0},
            "ground_m": ground,
            "camera": {
                "sensor_width_mm": 13.2,
                "sensor_height_mm": 8.8,
                "focal_length_mm": 8.8,
                "image_width_px": 5472,
                "image_height_px": 3648,
                "min_interval_s": 1.0,
                "gimbal": {"pitch_min_deg": -90, "pitch_max_deg": 30, "rate_deg_s": 60},
            },
            "inspection": {"surface": {"gsd_mm": 8, "overlap": 0.3}},
            "vehicle": {"radius_m": 0.5, "max_speed_m_s": 5.0, "max_acceleration_m_s2": 2.5},
            "home_m": list(home),
        }

    def delete(self, structure_id: str) -> None:
        """Remove a mesh; plans keep their own copy.

        Raises:
            NotFoundError: there is none of this name.
            RefusedError: it is a sample.
        """
        if structure_id in SAMPLES:
            raise RefusedError("samples come with the station and stay", field="structure_id")
        record = self._database.structures.get(structure_id)
        self._database.structures.delete(record.id)
        self._loaded.pop(record.id, None)
        shutil.rmtree(self.folder / record.id, ignore_errors=True)


def _sample_info(name: str) -> StructureInfo:
    return StructureInfo(name, "sample", name.replace("-", " "), None, {"sample": name})


def _mesh_info(record: StructureRecord) -> StructureInfo:
    mesh = {
        "file": f"{record.id}/{record.file_name}",
        "scale": record.scale,
        "up": record.up,
        "position_m": list(record.position_m),
        "rotation_deg": record.rotation_deg,
    }
    return StructureInfo(record.id, "mesh", record.name, record.created_at, {"meshes": [mesh]})


def _copy(file: IO[bytes], path: Path) -> str:
    """Copy; returns the SHA-256."""
    digest = hashlib.sha256()
    with path.open("xb") as out:
        while chunk := file.read(CHUNK_BYTES):
            digest.update(chunk)
            out.write(chunk)
    return digest.hexdigest()
