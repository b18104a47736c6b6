"""What the companion heard and said, for the judge: streams and their limits, news, spans."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from sitl.rehearsal.judge.evidence import Evidence, WireMessage

_MOVES_CM_S: Final = 100
_STATUS: Final = re.compile(r"^[A-Z]+ *\|")


class Input(NamedTuple):
    """A stream that a flight rests on.

    Attributes:
        name: For the verdict.
        messages: Any of these is news of it.
        words: A line that announces its loss matches this.
        told_s: It has to be announced.
        stands_s: The vehicle has to stand, and no leg may begin; infinite: never.
        home_s: The mission has to end; infinite: never.
    """

    name: str
    messages: frozenset[str]
    words: str
    told_s: float
    stands_s: float = math.inf
    home_s: float = math.inf


INPUTS: Final = (
    Input("position", frozenset({"GLOBAL_POSITION_INT"}), "position", 2.0, 2.0),
    Input("mode", frozenset({"HEARTBEAT", "CURRENT_MODE"}), "mode|heartbeat", 5.0),
    Input("heartbeat", frozenset({"HEARTBEAT"}), "heartbeat", 5.0, math.inf, 30.0),
    Input("satellites", frozenset({"GPS_RAW_INT"}), "GPS", 5.0, 10.0, 30.0),
    Input("battery", frozenset({"SYS_STATUS"}), "battery", 5.0, math.inf, 30.0),
    Input("item", frozenset({"MISSION_CURRENT"}), "item", 5.0, math.inf, 60.0),
    Input("landed state", frozenset({"EXTENDED_SYS_STATE"}), "landed", 5.0, math.inf, 60.0),
)


def announcements(evidence: Evidence) -> list[tuple[float, str]]:
    """What was announced, and when: all lines but those that show the state every few seconds."""
    return [(line.time_s, line.text) for line in evidence.lines if not _STATUS.match(line.text)]


def news(heard: Sequence[WireMessage], numbers: Sequence[int]) -> Iterator[int]:
    """Those that are news: their clock goes on, and what reports a velocity has moved."""
    last: Mapping[str, Any] = {}
    for at in numbers:
        fields = heard[at].fields
        clock = next((c for c in ("time_boot_ms", "time_usec") if c in fields), None)
        if clock is not None and clock in last and fields[clock] == last[clock]:
            continue
        before, last = last, fields
        if before and "vx" in fields:
            moves = math.hypot(fields["vx"], fields["vy"]) >= _MOVES_CM_S
            if moves and (fields["lat"], fields["lon"]) == (before["lat"], before["lon"]):
                continue
        yield at


def spans(
    messages: Sequence[WireMessage], holds: Iterable[Any], pause_s: float = 0.0
) -> Iterator[tuple[float, float]]:
    """From when to when something held in every message, but for pauses that are no longer."""
    begun: tuple[float, float] | None = None
    for message, held in zip(messages, holds, strict=True):
        if held:
            begun = (message.time_s if begun is None else begun[0], message.time_s)
        elif begun is not None and message.time_s - begun[1] > pause_s:
            yield begun
            begun = None
    if begun is not None:
        yield begun
