"""What PX4 says in EVENT messages, in plain words.

A companion computer gets no STATUSTEXT from PX4 (those go to ground stations only): why a mission
is refused or arming denied reaches it as EVENT (message 410) with a number and packed arguments.
The number is the FNV-1a hash of the event's name with the component in the top byte, so the table
of names in `px4_event_words` is all that is needed, also where the autopilot's own table of words
cannot be fetched. Every check of the health and arming report comes as an event of its own between
two summaries.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from air_router.vehicle.events.px4_event_words import ACTIONS, CAUSES, MODES, WORDS

ERROR: Final = 3
WARNING: Final = 4
PROTOCOL: Final = 7  # levels above INFO are for programs

_COMPONENT: Final = 1 << 24
_FNV_OFFSET, _FNV_PRIME = 0x811C9DC5, 0x01000193
_CHECK_HEAD: Final = struct.Struct("<IB")  # modes concerned, health component
_SUMMARY: Final = struct.Struct("<BIIII")  # chunk, errors, warnings, can arm, can run
_MISSION_MODE: Final = 1 << 3  # NAVIGATION_STATE_AUTO_MISSION


def event_id(name: str) -> int:
    """The number under which PX4 sends an event."""
    value = _FNV_OFFSET
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return _COMPONENT | value & 0xFFFFFF


ARMING_SUMMARY: Final = "commander_arming_check_summary"
HEALTH_SUMMARY: Final = "commander_health_summary"
_NAMES: Final = MappingProxyType(
    {event_id(name): name for name in (*WORDS, ARMING_SUMMARY, HEALTH_SUMMARY)}
)


@dataclass(frozen=True, slots=True)
class Px4Event:
    """One EVENT.

    Attributes:
        number: Its id on the wire.
        level: For people: 0 emergency to 6 information (7: for programs only).
        arguments: Packed, little endian, up to 40 bytes.
    """

    number: int
    level: int
    arguments: bytes = b""

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Px4Event:
        """From the fields of an EVENT message."""
        arguments = bytes(int(byte) & 0xFF for byte in fields.get("arguments") or ())
        return cls(int(fields["id"]), int(fields["log_levels"]) & 0x0F, arguments)

    @property
    def name(self) -> str | None:
        """PX4's name of it, None for one that we do not know."""
        return _NAMES.get(self.number)

    @property
    def is_check(self) -> bool:
        """Whether it is one finding of the health and arming report."""
        return (self.name or "").startswith("check_")

    @property
    def text(self) -> str:
        """What it means and, where there is something, what to do."""
        name = self.name
        if name is None or name not in WORDS:
            return f"event {self.number:#010x} of PX4, explained in the ground station"
        known = WORDS[name]
        words, layout = (known, "") if isinstance(known, str) else known
        skipped = _CHECK_HEAD.size if self.is_check else 0
        values = _unpacked(layout, self.arguments[skipped:])
        return words.format(*values) if values is not None else name.replace("_", " ")


_ENUMERATIONS: Final = MappingProxyType({"m": MODES, "a": ACTIONS, "c": CAUSES})


def _unpacked(layout: str, data: bytes) -> tuple[object, ...] | None:
    """Arguments as numbers and words; None where fewer came than belong to the event."""
    code = struct.Struct("<" + re.sub("[mac]", "B", layout))
    if len(data) < code.size:
        return None
    return tuple(
        _ENUMERATIONS[letter].get(value, "another") if letter in _ENUMERATIONS else value
        for letter, value in zip(layout, code.unpack_from(data), strict=True)
    )


@dataclass(frozen=True, slots=True)
class ArmingReport:
    """What PX4's health and arming checks find.

    Attributes:
        can_arm: Whether it would arm in Mission mode as things are.
        problems: What stands in the way, in words.
        warnings: What does not, but was found.
    """

    can_arm: bool
    problems: tuple[str, ...]
    warnings: tuple[str, ...]


class ArmingReports:
    """Puts reports together from the events between the two summaries."""

    def __init__(self) -> None:
        self._findings: list[Px4Event] | None = None  # of the report under way
        self._can_arm = 0  # bit for each mode group
        self.last: ArmingReport | None = None  # the newest complete one
        self.count = 0  # of complete reports

    def take(self, event: Px4Event) -> None:
        """Take the next event; `last` and `count` change when it completes a report."""
        if event.name == ARMING_SUMMARY and len(event.arguments) >= _SUMMARY.size:
            self._can_arm = _SUMMARY.unpack_from(event.arguments)[3]
            self._findings = []
        elif event.name == HEALTH_SUMMARY and self._findings is not None:
            self.last = self._report(self._findings)
            self.count += 1
            self._findings = None
        elif self._findings is not None and (event.is_check or event.name is None):
            self._findings.append(event)

    def _report(self, findings: list[Px4Event]) -> ArmingReport:
        ours = [event for event in findings if _concerns_us(event)]
        return ArmingReport(
            can_arm=bool(self._can_arm & _MISSION_MODE),
            problems=tuple(dict.fromkeys(e.text for e in ours if e.level <= ERROR)),
            warnings=tuple(dict.fromkeys(e.text for e in ours if e.level == WARNING)),
        )


def _concerns_us(event: Px4Event) -> bool:
    """Findings that only keep the vehicle from being flown by hand are no concern of a mission."""
    if not event.is_check or len(event.arguments) < _CHECK_HEAD.size:
        return True
    return bool(_CHECK_HEAD.unpack_from(event.arguments)[0] & _MISSION_MODE)
