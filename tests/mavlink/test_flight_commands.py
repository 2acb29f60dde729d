"""The current item of a mission, set on fake time."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import LinkError, RefusedError
from gcs.mavlink.flight_commands import ATTEMPTS, RESEND_S, CurrentItem


class Setting:
    """MISSION_SET_CURRENT of item 3 under way; the vehicle's answers are the test's."""

    def __init__(self, shown=(3,)):
        self.now, self.sent, self.refusal = 100.0, [], None
        channel = SimpleNamespace(send=self.sent.append, clock=lambda: self.now, target=(1, 1))
        self.transaction = CurrentItem(3, frozenset(shown), channel, self._permit)
        self.transaction.start()

    def _permit(self):
        if self.refusal is not None:
            raise self.refusal

    def show(self, sequence, source=(1, 1)):
        message = mavlink.MAVLink_mission_current_message(sequence)
        message._header.srcSystem, message._header.srcComponent = source
        self.transaction.handle(message)

    def wait(self):
        self.now = self.transaction.deadline
        self.transaction.on_time()


def test_it_is_sent_again_until_the_vehicle_shows_it():
    setting = Setting()
    setting.wait()
    setting.wait()
    assert [(m.get_type(), m.seq) for m in setting.sent] == [("MISSION_SET_CURRENT", 3)] * 3
    assert setting.now == pytest.approx(100.0 + 2 * RESEND_S)
    setting.show(3)
    assert setting.transaction.result() is None


def test_another_item_or_another_vehicles_does_not_count():
    setting = Setting()
    setting.show(2)
    setting.show(3, source=(2, 1))
    setting.show(3, source=(1, 191))
    assert not setting.transaction.finished
    setting.show(3)
    assert setting.transaction.finished


def test_each_of_the_items_that_count_will_do():
    setting = Setting(shown=(0, 1))
    setting.show(1)
    assert setting.transaction.finished


def test_a_vehicle_that_never_shows_it_is_given_up():
    setting = Setting()
    while not setting.transaction.finished:
        setting.wait()
    assert len(setting.sent) == ATTEMPTS
    with pytest.raises(LinkError, match="item 3"):
        setting.transaction.result()


def test_it_is_not_sent_again_once_somebody_else_commands_the_vehicle():
    setting = Setting()
    setting.refusal = RefusedError("the pilot has it")
    setting.wait()
    assert len(setting.sent) == 1
    with pytest.raises(RefusedError, match="the pilot has it"):
        setting.transaction.result()
