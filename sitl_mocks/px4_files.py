"""The files of the PX4-like autopilot: what it says of itself, and what a station leaves there.

The form is that of component metadata: a general file names the others with their checksums, all of them compressed.
"""

from __future__ import annotations

import json
import lzma
from typing import Any

from sitl_mocks.file_server import file_crc32
from sitl_mocks.file_tree import FileTree
from sitl_mocks.parameters import REAL32, ParameterServer

_EXTRAS = "etc/extras"
_READ_ONLY = "/etc/"
_MOST_FILES = 16
_PARAMETERS = 1
"""COMP_METADATA_TYPE."""


class Px4Files(FileTree):
    """See `WritableFolder`.

    Args:
        parameters: of the vehicle.
    """

    def __init__(self, parameters: ParameterServer) -> None:
        super().__init__(folders=("/fs",))
        entries = [
            {"name": name, "type": "Float" if kind == REAL32 else "Int32", "default": default}
            for name, (_, kind, default) in parameters.table().items()
        ]
        packed = _packed({"version": 1, "parameters": entries})
        about = {
            "type": _PARAMETERS,
            "uri": f"mftp://{_EXTRAS}/parameters.json.xz",
            "fileCrc": file_crc32(packed),
        }
        general = _packed({"version": 1, "metadataTypes": [about]})
        self.files = {
            f"/{_EXTRAS}/component_general.json.xz": general,
            f"/{_EXTRAS}/parameters.json.xz": packed,
        }

    def takes(self, path: str) -> bool:
        """Whether a file can be written."""
        return not path.startswith(_READ_ONLY) and (path in self.files or len(self.files) < _MOST_FILES)

    def written(self, path: str, data: bytes) -> bool:
        """Keep a file."""
        self.files[path] = data
        return True


def _packed(content: dict[str, Any]) -> bytes:
    return lzma.compress(json.dumps(content).encode(), check=lzma.CHECK_CRC32, preset=0)
