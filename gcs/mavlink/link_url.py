"""Link URLs: `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT`, `serial:DEVICE:BAUD`, and MAVSDK's spelling."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from gcs.core.errors import InputError

FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD"


class LinkKind(Enum):
    """How a link is made."""

    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    TCP = "tcp"
    SERIAL = "serial"


_KINDS = {
    "udpin": LinkKind.UDP_IN,
    "udp": LinkKind.UDP_IN,
    "udpout": LinkKind.UDP_OUT,
    "tcp": LinkKind.TCP,
    "tcpout": LinkKind.TCP,
    "serial": LinkKind.SERIAL,
}


@dataclass(frozen=True)
class LinkAddress:
    """A link URL, taken apart.

    Attributes:
        place: host name or address, or the serial device.
        number: port, or baud rate.
    """

    kind: LinkKind
    place: str
    number: int

    @property
    def url(self) -> str:
        """The one spelling under which a link is kept."""
        return f"{self.kind.value}:{self.place}:{self.number}"


def parse_link_url(url: str) -> LinkAddress:
    """Take a link URL apart.

    Raises:
        InputError: it is none of the forms.
    """
    scheme, colon, rest = url.strip().partition(":")
    kind = _KINDS.get(scheme.lower())
    if kind is None or not colon:
        raise InputError(f"not a link URL; write {FORMS}", field=url or "URL")
    if rest.startswith("//"):
        rest = rest[2:]
    place, colon, number_text = rest.rpartition(":")
    if kind is not LinkKind.SERIAL and place.startswith("[") and place.endswith("]"):
        place = place[1:-1]
    if kind is LinkKind.UDP_IN and colon and not place:
        place = "0.0.0.0"  # an empty host in MAVSDK's spelling asks for every interface
    what = "baud rate" if kind is LinkKind.SERIAL else "port"
    if not place or not number_text.isascii() or not number_text.isdigit():
        raise InputError(f"its {what} is missing or not a number; write {FORMS}", field=url)
    number = int(number_text)
    lowest = 0 if kind is LinkKind.UDP_IN else 1
    if not lowest <= number <= (4_000_000 if kind is LinkKind.SERIAL else 65535):
        raise InputError(f"{number} is not a {what}", field=url)
    return LinkAddress(kind, place, number)
