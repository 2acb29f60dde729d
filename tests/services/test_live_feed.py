import asyncio

import pytest

from gcs.core.clock import utc_now
from gcs.services.live_feed import JobChanged, LiveFeed, PlanDeleted, QueueOverflowError
from gcs.storage.records import JobRecord, JobState


def job(fraction, job_id="job-1"):
    return JobChanged(JobRecord(job_id, "plan-1", JobState.RUNNING, "tour", fraction, utc_now()))


def render(event):
    return event.plan_id if isinstance(event, PlanDeleted) else f"{event.job.id} {event.job.fraction}"


async def drain(client):
    texts = []
    while (text := await client.next(0.01)) is not None:
        texts.append(text)
    return texts


async def test_every_client_hears_everything_in_order():
    feed = LiveFeed()
    feed.open(render)
    with feed.subscribe() as a, feed.subscribe() as b:
        for k in range(5):
            feed.publish(PlanDeleted(f"plan-{k}"))
        assert await drain(a) == await drain(b) == [f"plan-{k}" for k in range(5)]
    assert feed.clients == 0


async def test_of_a_state_the_latest_wins_and_events_are_all_kept():
    feed = LiveFeed()
    feed.open(render)
    with feed.subscribe() as client:
        for k in range(100):
            feed.publish(job(k / 100))
            feed.publish(job(k / 100, "job-2"))
        feed.publish(PlanDeleted("plan-1"))
        assert await drain(client) == ["job-1 0.99", "job-2 0.99", "plan-1"]


async def test_a_slow_client_is_told_to_catch_up_and_holds_nobody_up():
    feed = LiveFeed(limit=10)
    feed.open(render)
    with feed.subscribe() as slow, feed.subscribe() as quick:
        heard = []
        for k in range(50):
            feed.publish(PlanDeleted(f"plan-{k}"))
            heard += await drain(quick)
        assert len(heard) == 50
        with pytest.raises(QueueOverflowError):
            await slow.next(0.01)
        feed.publish(PlanDeleted("after"))
        assert await drain(slow) == ["after"]


async def test_other_threads_may_publish():
    feed = LiveFeed()
    feed.open(render)
    with feed.subscribe() as client:
        await asyncio.to_thread(feed.publish, PlanDeleted("from a thread"))
        assert await client.next(1) == "from a thread"


async def test_a_message_is_rendered_once_for_all_and_not_at_all_for_nobody():
    rendered = []
    feed = LiveFeed()
    feed.open(lambda event: rendered.append(event) or "text")
    feed.publish(PlanDeleted("nobody listens"))
    with feed.subscribe(), feed.subscribe(), feed.subscribe():
        feed.publish(PlanDeleted("plan-1"))
    assert len(rendered) == 1
