"""The one typed door to numba: functions compiled once and kept in numba's cache on disk."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar, cast

from numba import njit

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

F = TypeVar("F", bound="Callable[..., Any]")


def compiled(function: F) -> F:
    """Compile a kernel of numbers and arrays; it runs without the interpreter lock.

    No fast-math: infinities and NaN keep their meaning.
    """
    return cast("F", njit(cache=True, nogil=True)(function))


def compiled_ieee(function: F) -> F:
    """`compiled`, but a division by zero gives infinity or NaN as in NumPy; loops are quicker without the check."""
    return cast("F", njit(cache=True, nogil=True, error_model="numpy")(function))
