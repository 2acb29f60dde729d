"""The progress bar: one line on a terminal, nothing anywhere else."""

import io
import sys

import pytest

from gcs.services.terminal import WIDTH, TerminalProgress


class Screen(io.StringIO):
    def isatty(self):
        return True


def test_a_bar_that_is_rewritten_and_cleared(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Screen())
    with TerminalProgress() as progress:
        progress.report("tour", 0.5)
        progress.report("tour", 1.0)
        drawn = sys.stderr.getvalue()
    assert drawn.split("\r\033[K")[1:] == [
        f"tour           [{'#' * (WIDTH // 2)}{'.' * (WIDTH // 2)}]  50%",
        f"tour           [{'#' * WIDTH}] 100%",
    ]
    assert sys.stderr.getvalue().endswith("\r\033[K")
    assert "\n" not in sys.stderr.getvalue()


def test_the_bar_is_cleared_for_the_message_of_a_fault(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Screen())
    with pytest.raises(ValueError), TerminalProgress() as progress:
        progress.report("tour", 0.2)
        raise ValueError
    assert sys.stderr.getvalue().endswith("\r\033[K")


@pytest.mark.parametrize("fraction", [-0.1, 1.2])
def test_the_bar_keeps_its_width(monkeypatch, fraction):
    monkeypatch.setattr(sys, "stderr", Screen())
    with TerminalProgress() as progress:
        progress.report("tour", fraction)
        assert len(sys.stderr.getvalue().split("[", 2)[2].split("]")[0]) == WIDTH


def test_nothing_is_drawn_into_a_file(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with TerminalProgress() as progress:
        progress.report("tour", 0.5)
    assert sys.stderr.getvalue() == ""
