"""The link of a URL."""

from __future__ import annotations

from gcs.mavlink.link_base import Link, OnMessage
from gcs.mavlink.link_url import LinkAddress, LinkKind
from gcs.mavlink.stream_link import SerialLink, TcpLink
from gcs.mavlink.transaction import Clock
from gcs.mavlink.udp_link import UdpLink


def make_link(address: LinkAddress, own: tuple[int, int], on_message: OnMessage, clock: Clock) -> Link:
    """The link of an address, not yet open."""
    kinds: dict[LinkKind, type[Link]] = {
        LinkKind.UDP_IN: UdpLink,
        LinkKind.UDP_OUT: UdpLink,
        LinkKind.TCP: TcpLink,
        LinkKind.SERIAL: SerialLink,
    }
    return kinds[address.kind](address, own, on_message, clock)
