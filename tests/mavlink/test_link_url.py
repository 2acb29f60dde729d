import pytest

from gcs.core.errors import InputError
from gcs.mavlink.link_url import LinkKind, parse_link_url


@pytest.mark.parametrize(
    ("url", "kind", "place", "number"),
    [
        ("udpin:127.0.0.1:14550", LinkKind.UDP_IN, "127.0.0.1", 14550),
        ("udpin://127.0.0.1:14550", LinkKind.UDP_IN, "127.0.0.1", 14550),
        ("udpin://:14550", LinkKind.UDP_IN, "0.0.0.0", 14550),
        ("udpout:localhost:14540", LinkKind.UDP_OUT, "localhost", 14540),
        ("udpout://10.0.0.1:14540", LinkKind.UDP_OUT, "10.0.0.1", 14540),
        ("tcp:127.0.0.1:5760", LinkKind.TCP, "127.0.0.1", 5760),
        ("tcpout://127.0.0.1:5760", LinkKind.TCP, "127.0.0.1", 5760),
        ("tcp:[::1]:5760", LinkKind.TCP, "::1", 5760),
        ("serial:/dev/ttyUSB0:57600", LinkKind.SERIAL, "/dev/ttyUSB0", 57600),
        ("serial:///dev/ttyACM0:921600", LinkKind.SERIAL, "/dev/ttyACM0", 921600),
    ],
)
def test_forms(url, kind, place, number):
    address = parse_link_url(url)
    assert (address.kind, address.place, address.number) == (kind, place, number)


def test_both_spellings_are_one_link():
    assert parse_link_url("tcpout://127.0.0.1:5760").url == parse_link_url("tcp:127.0.0.1:5760").url


@pytest.mark.parametrize(
    "url",
    [
        "",
        "14550",
        "http://127.0.0.1:14550",
        "udpin",
        "udpin:",
        "udpin:127.0.0.1",
        "udpin:127.0.0.1:x",
        "udpin:127.0.0.1:70000",
        "udpin:127.0.0.1:-1",
        "udpin:127.0.0.1:1²",
        "tcp:127.0.0.1:0",
        "tcp::5760",
        "serial:/dev/ttyUSB0",
    ],
)
def test_bad_urls_are_named(url):
    with pytest.raises(InputError) as caught:
        parse_link_url(url)
    assert caught.value.field == (url or "URL")
