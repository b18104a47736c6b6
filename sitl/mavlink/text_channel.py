"""STATUSTEXT on one link: only to a ground station that is there, and never old news."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from sitl.px4sim.state.notice import Notice
from sitl.px4sim.state.outgoing import Outgoing

_WINDOW_S: Final = 2.5
_AGE_S: Final = 5.0
_CHUNK: Final = 50
_MOST: Final = 50


class TextChannel:
    """Keeps texts for up to 5 s until a ground station's heartbeat was heard on the link.

    Args:
        time_scale: Simulated seconds per wall-clock second, in which heartbeats come.
    """

    def __init__(self, time_scale: float) -> None:
        self._window_s = _WINDOW_S * time_scale
        self._texts: deque[tuple[float, Notice]] = deque(maxlen=_MOST)
        self._heard_s = -math.inf
        self._identifier = 0

    def heard_ground_station(self, now_s: float) -> None:
        """A heartbeat of a ground station came in on the link."""
        self._heard_s = now_s

    def add(self, notice: Notice, now_s: float) -> None:
        """Something was said."""
        if notice.text:
            self._texts.append((now_s, notice))

    def take(self, now_s: float) -> list[Outgoing]:
        """The messages to be sent now."""
        if not self._texts or now_s - self._heard_s > self._window_s:
            return []
        messages: list[Outgoing] = []
        for said_s, notice in self._texts:
            if now_s - said_s <= _AGE_S:
                messages.extend(self._chunks(notice))
        self._texts.clear()
        return messages

    def _chunks(self, notice: Notice) -> list[Outgoing]:
        data = notice.status_text.encode("ascii", "replace")
        chunks = [data[start : start + _CHUNK] for start in range(0, len(data), _CHUNK)]
        if len(data) % _CHUNK == 0:
            chunks.append(b"")  # a text ends with the first chunk that is not full
        identifier = self._identifier
        self._identifier = (identifier + 1) & 0xFFFF
        return [
            Outgoing(
                "STATUSTEXT",
                {
                    "severity": notice.severity,
                    "text": chunk,
                    "id": identifier,
                    "chunk_seq": number,
                },
            )
            for number, chunk in enumerate(chunks)
        ]
