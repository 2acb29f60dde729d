"""Links over real sockets, with the real MAVLink side and nobody at the other end."""

import socket

import pytest

from gcs.core.errors import InputError, NotFoundError
from gcs.mavlink.station import MavlinkStation
from gcs.services.live_feed import LinkChanged, LiveFeed
from gcs.services.vehicle_service import VehicleService
from gcs.storage.database import Database


@pytest.fixture
def database(tmp_path):
    database = Database(tmp_path)
    yield database
    database.close()


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


async def test_links_are_opened_again_at_the_next_start_and_closed_for_good(database):
    url = f"udpin:127.0.0.1:{free_port()}"
    first = VehicleService(database, LiveFeed(), MavlinkStation())
    await first.open()
    link = (await first.open_link(url)).link
    assert [view.state for view in first.links()] == ["open"]
    assert (await first.open_link(url)).link == link
    await first.close()

    second = VehicleService(database, LiveFeed(), MavlinkStation())
    await second.open()
    assert [(view.link, view.state) for view in second.links()] == [(link, "open")]
    await second.close_link(link.id)
    with pytest.raises(NotFoundError):
        await second.close_link(link.id)
    await second.close()

    third = VehicleService(database, LiveFeed(), MavlinkStation())
    await third.open()
    assert third.links() == ()
    await third.close()


async def test_a_given_link_is_not_kept_and_kept_ones_can_be_left_closed(database):
    database.links.add(f"udpin:127.0.0.1:{free_port()}")
    service = VehicleService(database, LiveFeed(), MavlinkStation(), (f"udpin:127.0.0.1:{free_port()}",))
    await service.open(stored_links=False)
    assert [view.state for view in service.links()] == ["open"]
    assert len(database.links.all()) == 1
    await service.close()


async def test_a_link_of_an_earlier_run_that_fails_does_not_stop_the_station(database):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        database.links.add(f"udpin:127.0.0.1:{taken.getsockname()[1]}")
        feed, told = LiveFeed(), []
        feed.open(lambda event: told.append(event) or "")
        with feed.subscribe():
            service = VehicleService(database, feed, MavlinkStation())
            await service.open()
        (view,) = service.links()
        assert view.state == "failed"
        assert view.problem
        assert [e.link.state for e in told if isinstance(e, LinkChanged)] == ["failed"]
        await service.close()


async def test_a_url_that_is_none_is_bad_input(database):
    service = VehicleService(database, LiveFeed(), MavlinkStation())
    await service.open()
    with pytest.raises(InputError):
        await service.open_link("carrier:pigeon")
    assert database.links.all() == ()
    await service.close()
