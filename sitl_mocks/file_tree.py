"""Files in memory, in folders."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class FileTree:
    """Files by path, such as `/DCIM/IMG_0001.JPG`.

    Attributes:
        files: their contents.
        folders: those that are there even when they are empty.
    """

    files: dict[str, bytes] = field(default_factory=dict)
    folders: tuple[str, ...] = ()

    def content(self, path: str) -> bytes | None:
        """A file; None when there is none."""
        return self.files.get(path)

    def entries(self, path: str) -> list[str] | None:
        """What is in a folder, as a listing has it; None when there is no such folder."""
        inside = f"{path}/"
        found: dict[str, str] = {}
        for full in (*(f"{folder}/" for folder in self.folders), *sorted(self.files)):
            name, is_folder, _ = full.removeprefix(inside).partition("/")
            if full.startswith(inside) and name:
                found[name] = f"D{name}" if is_folder else f"F{name}\t{len(self.files[full])}"
        return list(found.values()) if found or path in {"", *self.folders} else None
