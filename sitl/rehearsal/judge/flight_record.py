"""What is written down of a flight while it is flown, and handed to the judge at its end."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from sitl.rehearsal.judge.evidence import (
    Evidence,
    Line,
    Sample,
    SceneEvent,
    SceneEventKind,
    WireMessage,
)

_SEEN: Final = ("samples", "messages", "heard", "happenings", "lines")


@dataclass(slots=True)
class FlightRecord:
    """What has been seen so far, each in order of time; see `Evidence`."""

    samples: list[Sample] = field(default_factory=list)
    messages: list[WireMessage] = field(default_factory=list)
    heard: list[WireMessage] = field(default_factory=list)
    happenings: list[SceneEvent] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)

    def happened(self, time_s: float, what: SceneEventKind, value: Any = None) -> None:
        """The scene did something."""
        self.happenings.append(SceneEvent(time_s, what, value))

    def evidence(self, **more: Any) -> Evidence:
        """All of it, and what else there is to say of the flight."""
        seen: dict[str, Any] = {name: tuple(getattr(self, name)) for name in _SEEN}
        return Evidence(**seen, **more)
