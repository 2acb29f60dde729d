"""From rows of a table to frozen records and back: fields of one name, tuples for lists, enums for their words."""

from __future__ import annotations

from dataclasses import asdict, fields
from enum import Enum
from typing import Any, TypeVar, get_type_hints

from gcs.storage.tables import Base

R = TypeVar("R")


_known: dict[type[Any], dict[str, type[Enum]]] = {}


def _enum_fields(kind: type[Any]) -> dict[str, type[Enum]]:
    if kind not in _known:
        hints = get_type_hints(kind)
        _known[kind] = {name: h for name, h in hints.items() if isinstance(h, type) and issubclass(h, Enum)}
    return _known[kind]


def frozen(value: Any) -> Any:
    """A value as a record has it: tuples for lists."""
    return tuple(frozen(v) for v in value) if isinstance(value, list) else value


def record_of(kind: type[R], row: Base) -> R:
    """The record that a row holds; its fields are columns of the same name."""
    enums = _enum_fields(kind)
    values: dict[str, Any] = {}
    for field in fields(kind):  # type: ignore[arg-type]  # records are dataclasses
        value = getattr(row, field.name)
        values[field.name] = enums[field.name](value) if field.name in enums else frozen(value)
    return kind(**values)


def columns_of(record: Any) -> dict[str, Any]:
    """The column values of a record."""
    return {name: plain(value) for name, value in asdict(record).items()}


def plain(value: Any) -> Any:
    """A value as a column takes it: lists for tuples, words for enums."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, tuple):
        return [plain(v) for v in value]
    return value
