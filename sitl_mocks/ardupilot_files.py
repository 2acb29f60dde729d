"""Files that ArduPilot makes up: `@PARAM/param.pck`, missions, fences and rally points as `@MISSION/*.dat`, and `@SYS`.

Formats: AP_Filesystem_Param and AP_Filesystem_Mission. Sizes are told before anything is made up, and so are no sizes;
the checksum of the parameters is over another layout than what is read.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping

from sitl_mocks.ardupilot_mission_server import ArduPilotMissionServer
from sitl_mocks.file_server import DATA_SIZE
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.parameters import INT8, INT16, INT32, REAL32, ParameterServer

_LISTS = {"@MISSION/mission.dat": 0, "@MISSION/fence.dat": 1, "@MISSION/rally.dat": 2}
_PARAMETERS = "@PARAM/param.pck"
_SYSTEM = "@SYS"
_ABOUT_ITSELF = {f"{_SYSTEM}/{name}.txt": f"{name}V1\n".encode() for name in ("threads", "memory", "uarts", "timers")}
_ANNOUNCED_TEXT = 100_000
_MISSION_MAGIC, _NO_CLEAR = 0x763D, 1
_HEADER = struct.Struct("<HHHHH")
_ITEM = struct.Struct("<ffffiifHHBBBBBB")
_PARAMETER_MAGIC = {False: 0x671B, True: 0x671C}
_CODES = {INT8: (1, "<b"), INT16: (2, "<h"), INT32: (3, "<i"), REAL32: (4, "<f")}
_CHECKSUM_BLOCK = 2048
_ANNOUNCED = 1 << 20


class ArduPilotFiles:
    """See `VirtualFolder`.

    Args:
        parameters: of the vehicle.
        servers: its mission servers by MAV_MISSION_TYPE.
    """

    def __init__(
        self, parameters: Callable[[], ParameterServer], servers: Mapping[int, ArduPilotMissionServer]
    ) -> None:
        self._parameters = parameters
        self._servers = servers

    def content(self, path: str) -> bytes | None:
        """A file; None when there is none."""
        name, _, query = path.partition("?")
        if name == _PARAMETERS:
            return self._packed(query, DATA_SIZE)
        return self._list_file(_LISTS[name]) if name in _LISTS else _ABOUT_ITSELF.get(path)

    def entries(self, path: str) -> list[str] | None:
        """Nothing but the files about itself is listed, as on the real one."""
        if path != _SYSTEM:
            return None
        return [f"F{name.removeprefix(f'{_SYSTEM}/')}\t{_ANNOUNCED_TEXT}" for name in _ABOUT_ITSELF]

    def takes(self, path: str) -> bool:
        """Whether a file can be written."""
        return path in _LISTS

    def announced_size(self, path: str) -> int:
        """A guess."""
        if path.startswith(_PARAMETERS):
            return 12 * len(self._parameters().table())
        return _ANNOUNCED_TEXT if path.startswith(_SYSTEM) else _ANNOUNCED

    def checksummed(self, path: str) -> bytes | None:
        """The same as it is when it is read in larger pieces."""
        name, _, query = path.partition("?")
        return self._packed(query, _CHECKSUM_BLOCK) if name == _PARAMETERS else self.content(path)

    def written(self, path: str, data: bytes) -> bool:
        """Take a list; one that holds an item which is of no use leaves those before it."""
        if len(data) < _HEADER.size:
            return False
        magic, _, options, start, count = _HEADER.unpack_from(data)
        body = data[_HEADER.size :]
        blank = any(not any(body[i : i + _ITEM.size]) for i in range(0, len(body), _ITEM.size))
        if magic != _MISSION_MAGIC or len(body) // _ITEM.size != count or blank or options & _NO_CLEAR or start:
            return False
        items = [_stored_item(values) for values in _ITEM.iter_unpack(body[: count * _ITEM.size])]
        return self._servers[_LISTS[path]].replace_by(items)

    def _list_file(self, mission_type: int) -> bytes:
        items = self._servers[mission_type].stored()
        parts = [_HEADER.pack(_MISSION_MAGIC, mission_type, 0, 0, len(items))]
        for sequence, i in enumerate(items):
            kind = (sequence, i.command, 0, 0, i.frame, 0, int(mission_type == 0), mission_type)
            parts.append(_ITEM.pack(*i.params, i.x, i.y, i.z, *kind))
        return b"".join(parts)

    def _packed(self, query: str, block: int) -> bytes:
        """The parameters, padded so that no value crosses a boundary of blocks."""
        with_defaults = "withdefaults=1" in query.split("&")
        table = self._parameters().table()
        out = struct.pack("<HHH", _PARAMETER_MAGIC[with_defaults], len(table), len(table))
        before = b""
        for text, (value, kind, default) in table.items():
            name = text.encode()
            shared = next((k for k, (a, b) in enumerate(zip(name, before, strict=False)) if a != b), len(before))
            shared = min(shared, len(name) - 1, 15)
            code, form = _CODES[kind]
            packed = struct.pack(form, value if kind == REAL32 else int(value))
            differs = with_defaults and value != default
            default_bytes = struct.pack(form, default if kind == REAL32 else int(default)) if differs else b""
            own = name[shared:]
            entry = bytes([code | (16 if differs else 0), shared | (len(own) - 1) << 4]) + own + packed + default_bytes
            over = (len(out) + len(entry)) % block
            if 0 < over < len(packed):
                out += bytes(len(packed) - over)
            out += entry
            before = name
        return out


def _stored_item(values: tuple[float, ...]) -> StoredItem:
    p1, p2, p3, p4, x, y, z, _, command, _, _, frame, current, autocontinue, _ = values
    return StoredItem(int(frame), int(command), (p1, p2, p3, p4), int(x), int(y), z, int(current), int(autocontinue))
