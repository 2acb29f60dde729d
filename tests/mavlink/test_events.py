import asyncio

from gcs.core.vehicle import StatusText, Telemetry
from gcs.mavlink.events import MAX_WAITING, EventStream, StatusTextEvent, TelemetryEvent, newer_telemetry


async def take(stream, count):
    return [await asyncio.wait_for(anext(stream), 30.0) for _ in range(count)]


async def test_every_reader_hears_everything_in_order():
    stream = EventStream()
    async with stream.read() as one, stream.read() as two:
        for i in range(3):
            stream.publish(i)
        assert await take(one, 3) == await take(two, 3) == [0, 1, 2]


async def test_a_waiting_reader_is_woken():
    stream = EventStream()
    async with stream.read() as reader:
        waiting = asyncio.ensure_future(take(reader, 1))
        await asyncio.sleep(0)
        stream.publish("x")
        assert await waiting == ["x"]


async def test_a_slow_reader_gets_the_newest_telemetry_and_all_else():
    stream = EventStream(newer_telemetry)
    text = StatusTextEvent(StatusText(6, "hello"))
    telemetry = [TelemetryEvent(Telemetry()) for _ in range(6)]
    async with stream.read() as reader:
        for event in (*telemetry[:3], text, *telemetry[3:]):
            stream.publish(event)
        heard = await take(reader, 3)
    assert heard[0] is telemetry[2]
    assert heard[1] is text
    assert heard[2] is telemetry[5]


async def test_a_flood_drops_the_oldest():
    stream = EventStream()
    async with stream.read() as reader:
        for i in range(MAX_WAITING + 5):
            stream.publish(i)
        assert await take(reader, 1) == [5]


async def test_nothing_is_kept_for_readers_that_left():
    stream = EventStream()
    async with stream.read():
        pass
    stream.publish(1)
    async with stream.read() as reader:
        stream.publish(2)
        assert await take(reader, 1) == [2]
