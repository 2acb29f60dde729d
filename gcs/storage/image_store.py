"""Pictures on the disk: names of our own, whole files only, checked by size and CRC32."""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import IncompleteError, NotFoundError
from gcs.storage.atomic_files import write_file
from gcs.storage.errors import storage_error
from gcs.storage.image_parts import SUFFIX, ImagePart

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from gcs.storage.records import ImageRecord

_OUR_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,120}")


@dataclass(frozen=True)
class StoredImage:
    """What lies on the disk."""

    file_name: str
    size_bytes: int
    crc32: int


class ImageStore:
    """The folder `images/<flight id>/` of a data directory.

    Args:
        directory: the data directory.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory / "images"

    def save(
        self, image: ImageRecord, data: bytes, *, size_bytes: int | None = None, crc32: int | None = None
    ) -> StoredImage:
        """Keep a picture.

        Args:
            image: which one; its name on the disk is made from its own id.
            data: the file.
            size_bytes: what the sender says of its size, when it does.
            crc32: what the sender says of its CRC-32 (zlib), when it does.

        Raises:
            IncompleteError: the data is not what the sender says; nothing is kept.
            StorageError: the disk did not take it; nothing is kept.
        """
        found = zlib.crc32(data)
        if not data or (size_bytes is not None and size_bytes != len(data)):
            raise IncompleteError(f"{len(data)} bytes arrived of {size_bytes or 'an empty file'}", field=image.id)
        if crc32 is not None and crc32 != found:
            raise IncompleteError(f"the CRC-32 is {found:08x}, not {crc32:08x} as announced", field=image.id)
        name = f"{image.id}{_suffix(data)}"
        path = self._folder(image.flight_id) / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise storage_error(error, path) from error
        write_file(path, data)
        return StoredImage(name, len(data), found)

    def path(self, image: ImageRecord) -> Path:
        """Where a stored picture lies.

        Raises:
            NotFoundError: it is not stored, or its file is gone.
        """
        if image.file_name is None:
            raise NotFoundError("this picture is not stored", field=image.id)
        path = self._folder(image.flight_id) / checked_name(image.file_name)
        if not path.is_file():
            raise NotFoundError("the file of this picture is gone", field=str(path))
        return path

    def part(self, image: ImageRecord) -> ImagePart:
        """Where the pieces of a picture are kept until it is whole."""
        return ImagePart(self._folder(image.flight_id) / checked_name(image.id + SUFFIX))

    def remove_parts(self, but_of: Collection[str]) -> None:
        """Remove what was kept of pictures that are not whole, except those of some flights."""
        for path in self._directory.glob(f"*/*{SUFFIX}"):
            if path.parent.name not in but_of:
                ImagePart(path).remove()

    def is_whole(self, image: ImageRecord) -> bool:
        """Whether the file on the disk has the size and CRC-32 of the record."""
        try:
            data = self.path(image).read_bytes()
        except (NotFoundError, OSError):
            return False
        return len(data) == image.size_bytes and zlib.crc32(data) == image.crc32

    def _folder(self, flight_id: str) -> Path:
        return self._directory / checked_name(flight_id)


def checked_name(name: str) -> str:
    """The name, if it is one that the station made; it is then safe as part of a path.

    Raises:
        NotFoundError: it is not.
    """
    if not _OUR_NAME.fullmatch(name) or ".." in name:
        raise NotFoundError("this is not a name that the station made", field=name)
    return name


def _suffix(data: bytes) -> str:
    """By content, since the vehicle's own name is not trusted."""
    if data.startswith(b"\xff\xd8\xff"):
        return ".jpg"
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return ".png"
    return ".bin"
