"""Text of mesh files put into the form that the readers take without loss."""

from __future__ import annotations

import re

_PLY_HEAD = re.compile(rb"\A\s*ply\s*?\r?\nformat\s+ascii\b.*?end_header", re.DOTALL | re.IGNORECASE)
_PLY_SINGLE = re.compile(rb"^(\s*property\s+)(float32|float)(\s+[xyz]\b)", re.MULTILINE)
_OBJ_RELATIVE = re.compile(rb"^\s*f\s[^\n]*-", re.MULTILINE)


def ply_in_double(data: bytes) -> bytes:
    """A text PLY whose coordinates are read with all their digits, whatever type its header gives them."""
    head = _PLY_HEAD.match(data)
    if head is None:
        return data
    return _PLY_SINGLE.sub(rb"\1double\3", head[0]) + data[head.end() :]


def has_single_precision(data: bytes) -> bool:
    """Whether a PLY file holds coordinates as binary single precision."""
    head = data[: data.find(b"end_header")]
    return b"ascii" not in head and _PLY_SINGLE.search(head) is not None


def obj_with_absolute_indices(data: bytes) -> bytes:
    """An OBJ file whose faces name their corners from the file's beginning.

    Negative numbers count back from the line they are in, which is not the file's end in a file of several objects.
    """
    if _OBJ_RELATIVE.search(data) is None:
        return data
    before = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = data.splitlines()
    for number, line in enumerate(lines):
        words = line.split()
        if not words:
            continue
        if words[0] in before:
            before[words[0]] += 1
        elif words[0] == b"f":
            lines[number] = b" ".join([b"f", *(_absolute(word, before) for word in words[1:])])
    return b"\n".join(lines) + b"\n"


def _absolute(corner: bytes, before: dict[bytes, int]) -> bytes:
    numbers = corner.split(b"/")
    counts = (before[b"v"], before[b"vt"], before[b"vn"])
    return b"/".join(
        str(count + int(n) + 1).encode() if n.startswith(b"-") else n for n, count in zip(numbers, counts, strict=False)
    )
