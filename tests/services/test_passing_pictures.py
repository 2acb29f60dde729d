"""Pictures commanded in passing: the lag is learned from their own times, and what goes wrong is said."""

import asyncio
from types import SimpleNamespace

import pytest

from gcs.core.errors import LinkError
from gcs.services import passing_pictures
from gcs.services.passing_pictures import PassingPictures

VIEWPOINT = SimpleNamespace(name="V7")


class Rig:
    """A vehicle whose camera announces each picture at once, taken `lag_s` after its command."""

    def __init__(self, lag_s=0.3, announces=True, error=None):
        self.lag_s, self.announces, self.error = lag_s, announces, error
        self.collector = SimpleNamespace(count=0, taken_at_s=None, announced=asyncio.Event())
        self.said = []
        recorder = SimpleNamespace(log=lambda kind, text, **more: self.said.append(text))
        self.pictures = PassingPictures(self, self.collector, recorder)
        self.now_s = 100.0

    async def take_picture(self):
        sent_s = self.now_s
        await asyncio.sleep(0)
        if self.error is not None:
            raise self.error
        if self.announces:
            self.collector.count += 1
            self.collector.taken_at_s = None if self.lag_s is None else sent_s + self.lag_s
            self.collector.announced.set()

    async def pass_by(self, off_m=0.1):
        self.now_s += 5.0
        self.pictures.trigger(VIEWPOINT, self.now_s, lambda: off_m)
        await self.pictures.settle()


async def test_the_lag_is_what_the_latest_pictures_have_shown():
    rig = Rig()
    assert rig.pictures.lag_s == 0.0
    for rig.lag_s in (0.3, 0.2, 0.9, 0.2, 0.3, 0.3):
        await rig.pass_by()
    assert rig.pictures.lag_s == pytest.approx(0.3)
    assert rig.said == []


@pytest.mark.parametrize("lag_s", [None, -0.5, 4.0, 1.6e9])
async def test_times_that_cannot_be_those_of_the_command_teach_nothing(lag_s):
    rig = Rig(lag_s)
    await rig.pass_by()
    assert rig.pictures.lag_s == 0.0


async def test_a_command_that_was_taken_too_far_away_is_said():
    rig = Rig()
    await rig.pass_by(off_m=0.8)
    await rig.pass_by(off_m=None)
    assert rig.said == [
        "V7: photographed up to 0.8 m from its place",
        "V7: photographed an unknown distance from its place",
    ]


async def test_a_refused_command_and_a_picture_that_nobody_announces_are_said(monkeypatch):
    monkeypatch.setattr(passing_pictures, "ANNOUNCED_WITHIN_S", 0.01)
    rig = Rig(error=LinkError("the vehicle does not answer"))
    await rig.pass_by()
    silent = Rig(announces=False)
    await silent.pass_by()
    assert rig.said == ["V7: the vehicle does not answer"]
    assert silent.said == ["V7: the vehicle has not announced its picture yet"]


async def test_nothing_is_waited_for_any_more_once_it_is_cancelled():
    rig = Rig(announces=False)
    rig.pictures.trigger(VIEWPOINT, 100.0, lambda: 0.0)
    await asyncio.sleep(0.01)
    rig.pictures.cancel()
    with pytest.raises(asyncio.CancelledError):
        await rig.pictures.settle()
    assert rig.said == []
