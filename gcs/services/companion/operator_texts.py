"""Short texts for people, as STATUSTEXT; what is said again and again is sent seldom."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from gcs.mavlink.status_text import status_text_messages

if TYPE_CHECKING:
    from gcs.mavlink.transaction import Clock, Send

WARNING = 4
AGAIN_S = 10.0
NUMBER = re.compile(r"\d+(\.\d+)?")


class OperatorTexts:
    """Sends texts.

    Args:
        send: puts a message on the link.
        clock: monotonic seconds.
    """

    def __init__(self, send: Send, clock: Clock) -> None:
        self._send = send
        self._clock = clock
        self._said: dict[str, float] = {}
        self._texts = 0

    def say(self, text: str) -> None:
        """Say something, once in ten seconds."""
        self._say(text, text)

    def say_measured(self, text: str) -> None:
        """The same for a text with a measurement in it: with another number it is still the same text."""
        self._say(text, NUMBER.sub("#", text))

    def _say(self, text: str, kind: str) -> None:
        now = self._clock()
        if now - self._said.get(kind, float("-inf")) < AGAIN_S:
            return
        self._said[kind] = now
        self._texts += 1
        for message in status_text_messages(text, WARNING, self._texts):
            self._send(message)
