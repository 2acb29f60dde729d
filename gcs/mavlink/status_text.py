"""STATUSTEXT: long texts go in chunks, some of which may be lost."""

from __future__ import annotations

from gcs.core.vehicle import StatusText
from gcs.mavlink.dialect import Message, mavlink

CHUNK = 50
MAX_CHUNKS = 20
MAX_OPEN = 8


def status_text_messages(text: str, severity: int, number: int) -> list[Message]:
    """STATUSTEXT messages of a text.

    Args:
        text: for people; letters beyond ASCII are replaced.
        severity: 0 emergency to 7 debug.
        number: of the text; not used again soon.
    """
    letters = text.encode("ascii", "replace")[: CHUNK * MAX_CHUNKS - 1]
    parts = [letters[at : at + CHUNK] for at in range(0, len(letters) + 1, CHUNK)]
    text_id = 0 if len(parts) == 1 else number % 65535 + 1
    return [mavlink.MAVLink_statustext_message(severity, part, text_id, i) for i, part in enumerate(parts)]


class StatusTextAssembler:
    """Puts chunks together by the text's id; a text whose chunks were lost is told without them."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int], tuple[int, dict[int, str]]] = {}

    def take(self, message: Message) -> list[StatusText]:
        """The texts that are complete, or given up, with this STATUSTEXT."""
        severity = min(int(message.severity), 7)
        if message.id == 0:
            return [StatusText(severity, _clean(message.text))]
        key = (message.get_srcComponent(), message.id)
        given_up = [self._finish(other) for other in list(self._open) if other != key and len(self._open) >= MAX_OPEN]
        _, chunks = self._open.setdefault(key, (severity, {}))
        if message.chunk_seq < MAX_CHUNKS:
            chunks[message.chunk_seq] = message.text
        if len(message.text) < CHUNK or message.chunk_seq >= MAX_CHUNKS - 1:
            return [*given_up, self._finish(key)]
        return given_up

    def _finish(self, key: tuple[int, int]) -> StatusText:
        severity, chunks = self._open.pop(key)
        last = max(chunks, default=-1)
        return StatusText(severity, _clean("".join(chunks.get(i, " ... ") for i in range(last + 1))))


def _clean(text: str) -> str:
    """A text for people: printable, on one line."""
    return "".join(letter if letter.isprintable() else " " for letter in text).strip()
