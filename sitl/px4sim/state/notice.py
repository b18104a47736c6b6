"""What the autopilot says: MAVLink messages, and words as a STATUSTEXT, an EVENT, or both.

PX4 writes most of its texts twice: as a STATUSTEXT, which only ground stations are sent, and as
an EVENT with a numeric id, which every link gets. A text that has an event twin ends in a tab, so
that a ground station that shows events can leave it out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final


@dataclass(frozen=True, slots=True)
class Outgoing:
    """Name and fields of one message, as in the MAVLink definitions."""

    name: str
    fields: Mapping[str, Any]


_FNV_OFFSET: Final = 0x811C9DC5
_FNV_PRIME: Final = 0x01000193
_AUTOPILOT_COMPONENT: Final = 1


class Severity(IntEnum):
    """MAV_SEVERITY, and the log levels of events."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


@dataclass(frozen=True, slots=True)
class Notice:
    """One thing said.

    Attributes:
        severity: Of the text.
        text: The STATUSTEXT's words; empty if there is only an event.
        event: PX4's name of the event, such as `commander_armed_by`; empty if there is none.
        event_severity: The event's own level, mostly that of the text; 8 is for programs only.
        arguments: The event's arguments, as on the wire.
    """

    severity: Severity
    text: str = ""
    event: str = ""
    event_severity: int | None = None
    arguments: bytes = b""

    @property
    def status_text(self) -> str:
        """The text as PX4 sends it."""
        return f"{self.text}\t" if self.text and self.event else self.text

    @property
    def event_id(self) -> int:
        """The EVENT's id: component in the top byte, FNV-1a hash of the name below."""
        return _AUTOPILOT_COMPONENT << 24 | _fnv1a(self.event) & 0xFFFFFF

    @property
    def log_levels(self) -> int:
        """EVENT.log_levels: internal level in the upper half byte, external in the lower."""
        level = self.severity if self.event_severity is None else self.event_severity
        return level << 4 | level


def _fnv1a(name: str) -> int:
    value = _FNV_OFFSET
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return value
