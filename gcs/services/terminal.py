"""Progress on a terminal: one line that is rewritten; nothing at all when the output is not a terminal."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import TracebackType

WIDTH = 30


class TerminalProgress:
    """A `Progress` that draws a bar on standard error; a context manager that clears it."""

    def __init__(self) -> None:
        self._on = sys.stderr.isatty()

    def __enter__(self) -> TerminalProgress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._on:
            sys.stderr.write("\r\033[K")
            sys.stderr.flush()

    def report(self, stage: str, fraction: float) -> None:
        """Draw the bar of a stage at a fraction of 0 to 1."""
        if self._on:
            done = round(WIDTH * min(max(fraction, 0.0), 1.0))
            sys.stderr.write(f"\r\033[K{stage:14s} [{'#' * done}{'.' * (WIDTH - done)}] {fraction:4.0%}")
            sys.stderr.flush()
