"""The program that puts packets on a link, each when it is due; `sender_process` starts it and talks to it.

It shares no interpreter with the station, so that nothing that keeps the station busy makes a packet late, and imports
the standard library alone, so that it starts at once. The station's messages on the socket between them, marshalled:

- `(OUTLET, where)`, with the descriptor of a link attached: write there from now on, to an address if one is given.
  Without a descriptor the link is gone: what is due is dropped.
- `(QUEUE, replaces, [(due, packet), ...])`: packets and when they are due (monotonic seconds), in order; in place of
  all that is still queued when it `replaces`.

It answers with `READY`, and then with each packet that it has written. Of several packets that are due it writes the
newest only. It ends, whatever is queued, when the station closes its end, which is also what happens when the station
dies; and when it finds that it stood still for longer than its patience, as what is queued then is from another time.
"""

import contextlib
import marshal
import os
import select
import socket
import sys
import time
from collections import deque

OUTLET, QUEUE = 0, 1
READY = b"ready"
LARGEST = 1 << 16
STOOD_STILL = 3
"""Exit status when it stood still."""


def main(talk: socket.socket, patience_s: float) -> int:
    """Write packets until the station closes its end; returns the exit status."""
    with contextlib.suppress(OSError):  # where the system allows it, busy programs do not delay this one either
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    outlet: Outlet | None = None
    queue: deque[tuple[float, bytes]] = deque()
    newest_due = 0.0
    talk.send(READY)
    while True:
        wait_s = max(0.0, queue[0][0] - time.monotonic()) if queue else None
        if select.select([talk], [], [], wait_s)[0]:  # what the station says comes before what is due
            data, descriptors, _, _ = socket.recv_fds(talk, LARGEST, 1)
            if not data:
                return 0
            kind, *said = marshal.loads(data)
            if kind == OUTLET:
                if outlet is not None:
                    outlet.close()
                outlet = Outlet(descriptors[0], *said) if descriptors else None
            else:
                replaces, packets = said
                if replaces:
                    queue.clear()
                queue.extend((due, packet) for due, packet in packets if due > newest_due)
            continue
        now = time.monotonic()
        if now - queue[0][0] > patience_s:
            return STOOD_STILL
        packet = b""
        while queue and queue[0][0] <= now:
            newest_due, packet = queue.popleft()
        if packet and outlet is not None and outlet.write(packet):
            talk.send(packet)


class Outlet:
    """A link, by a descriptor that is this program's own.

    Args:
        descriptor: of a socket or a device.
        where: address to send to; None when there is only one.
    """

    def __init__(self, descriptor: int, where: tuple[object, ...] | None) -> None:
        self._descriptor = descriptor
        self._datagrams = None if where is None else (socket.socket(fileno=descriptor), where)

    def write(self, packet: bytes) -> bool:
        """Whether it took a packet; one that a full buffer does not take is lost, like others on a link."""
        try:
            if self._datagrams is None:
                written = os.write(self._descriptor, packet)
            else:
                sock, where = self._datagrams
                written = sock.sendto(packet, where)
        except OSError:
            return False
        return written == len(packet)

    def close(self) -> None:
        """Let go of it."""
        if self._datagrams is None:
            os.close(self._descriptor)
        else:
            self._datagrams[0].close()


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as station:
        sys.exit(main(station, float(sys.argv[2])))
