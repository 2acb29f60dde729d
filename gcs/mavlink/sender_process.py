"""A process of its own that puts packets on a link, each when it is due (`sender_program`), as the station holds it."""

from __future__ import annotations

import contextlib
import marshal
import os
import select
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from gcs.core.errors import GcsError
from gcs.mavlink import sender_program
from gcs.mavlink.link_base import Outlet

HALT_S = 0.25
"""For so long it may take to end by itself."""


class SenderProcess:
    """Starts the process; safe to use from several threads.

    Args:
        patience_s: it ends when it finds that it stood still for longer.

    Raises:
        GcsError: the system does not start it.
    """

    def __init__(self, patience_s: float) -> None:
        self._talk, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._talk.setblocking(False)
        program = Path(__file__).with_name("sender_program.py")
        command = [sys.executable, "-I", "-S", str(program), str(theirs.fileno()), str(patience_s)]
        try:
            with theirs:
                # In a session of its own: what the terminal does to the station's group is the station's to judge.
                self._process = subprocess.Popen(
                    command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, start_new_session=True
                )
        except OSError as error:
            self._talk.close()
            raise GcsError(f"the process that sends setpoints cannot be started ({error})") from error
        self._closing = threading.Lock()
        self.ready = False
        """Whether it has come up."""
        self.ended = False
        """Whether it has gone."""

    @property
    def stood_still(self) -> bool:
        """Whether it ended because it found that it stood still."""
        return self.ended and self._process.wait() == sender_program.STOOD_STILL

    def use(self, outlet: Outlet | None) -> None:
        """Have it write there from now on; None while there is no link."""
        where = None if outlet is None else outlet.where
        try:
            descriptor = None if outlet is None else outlet.duplicate()
        except OSError:  # it has been closed meanwhile
            descriptor = None
        try:
            self._say([] if descriptor is None else [descriptor], sender_program.OUTLET, where)
        finally:
            if descriptor is not None:
                os.close(descriptor)

    def queue(self, packets: list[tuple[float, bytes]], *, replaces: bool) -> None:
        """Have it write packets when they are due (monotonic s), in order.

        Args:
            packets: due times and packets.
            replaces: in place of all that it has not written yet.
        """
        self._say([], sender_program.QUEUE, replaces, packets)

    def written(self, timeout_s: float = 0.0) -> bytes | None:
        """The next packet that it has written; None when there was none in time, or it has come up or gone."""
        if timeout_s > 0.0:
            select.select([self._talk], [], [], timeout_s)
        try:
            with self._closing:
                said = self._talk.recv(sender_program.LARGEST)
        except BlockingIOError:
            return None
        except OSError:  # it died, or was let go of
            said = b""
        if said == sender_program.READY:
            self.ready = True
            return None
        self.ended = not said
        return said or None

    def halt(self) -> None:
        """End it; after the return it writes nothing."""
        with contextlib.suppress(OSError):
            self._talk.shutdown(socket.SHUT_WR)
        try:
            self._process.wait(HALT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def close(self) -> None:
        """Halt it, and let go of all that it used; for the one who waits for what is written."""
        self.halt()
        with self._closing:
            self._talk.close()

    def _say(self, descriptors: list[int], *said: Any) -> None:
        try:
            socket.send_fds(self._talk, [marshal.dumps(said)], descriptors)
        except BlockingIOError:
            # So much that it has not read, it was not able to for seconds.
            self._process.kill()
        except OSError:
            pass  # it was halted, or has ended, which `written` tells
