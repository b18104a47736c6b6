"""What a session wants done after something came in."""

from __future__ import annotations

from dataclasses import dataclass, field

from mocha_link.links.metrics import LinkEvent


@dataclass(slots=True)
class Step:
    """Frames and datagrams to send, events to tell, refusals to count."""

    frames: list[bytes] = field(default_factory=list)
    events: list[LinkEvent] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    packets: list[bytes] = field(default_factory=list)
