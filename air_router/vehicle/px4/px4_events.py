"""Translates PX4's EVENT messages to plain text.

PX4 sends STATUSTEXT to ground stations only. A companion computer receives the reason for a refused
mission or a denied arming as an EVENT (message 410) with a number and packed arguments. The number
is the FNV-1a hash of the event's name with the component in the top byte. So the table of names in
`px4_event_words.toml` suffices if PX4's own table cannot be fetched. Each finding of the health and
arming report is an event between two summaries.
"""

import re
import struct
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from air_router.vehicle.px4.mavlink_values import (
    EVENT_AUTOPILOT,
    EVENT_ERROR,
    EVENT_WARNING,
    FNV_OFFSET,
    FNV_PRIME,
    MISSION_MODE_BIT,
)

ARMING_SUMMARY: Final = "commander_arming_check_summary"
HEALTH_SUMMARY: Final = "commander_health_summary"

_CHECK_HEAD: Final = struct.Struct("<IB")  # modes concerned, health component
_SUMMARY: Final = struct.Struct("<B4I")  # chunk; components: errors, warnings; modes: can arm, run

_TABLE: Final[dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_name("px4_event_words.toml").read_text(encoding="utf-8")
)
_ENUMERATIONS: Final = {"m": _TABLE["modes"], "a": _TABLE["actions"], "c": _TABLE["causes"]}
WORDS: Final[dict[str, str | tuple[str, str]]] = {
    name: row if isinstance(row, str) else tuple(row)
    for section in ("checks", "mission", "commander")
    for name, row in _TABLE[section].items()
}
"""By name: the text, or the text with the layout of the arguments."""


def event_id(name: str) -> int:
    """The number of an event."""
    value = FNV_OFFSET
    for byte in name.encode():
        value = (value ^ byte) * FNV_PRIME & 0xFFFFFFFF
    return EVENT_AUTOPILOT | value & 0xFFFFFF


_NAMES: Final = {event_id(name): name for name in (*WORDS, ARMING_SUMMARY, HEALTH_SUMMARY)}


@dataclass(frozen=True, slots=True)
class Px4Event:
    """One EVENT message.

    Attributes:
        number: Its id on the wire.
        level: For people: 0 emergency to 6 information (7: for programs only).
        arguments: Packed, little endian, up to 40 bytes.
    """

    number: int
    level: int
    arguments: bytes = b""

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Self:
        """From the fields of an EVENT message."""
        arguments = bytes(int(byte) & 0xFF for byte in fields.get("arguments") or ())
        return cls(int(fields["id"]), int(fields["log_levels"]) & 0x0F, arguments)

    @property
    def name(self) -> str | None:
        """PX4's name of the event; None: unknown."""
        return _NAMES.get(self.number)

    @property
    def is_check(self) -> bool:
        """Whether it is a finding of the health and arming report."""
        return (self.name or "").startswith("check_")

    @property
    def concerns_missions(self) -> bool:
        """Whether the finding concerns missions, not only flight by hand."""
        if not self.is_check or len(self.arguments) < _CHECK_HEAD.size:
            return True
        return bool(_CHECK_HEAD.unpack_from(self.arguments)[0] & MISSION_MODE_BIT)

    @property
    def text(self) -> str:
        """The event's meaning, with a remedy if there is one."""
        name = self.name
        if name is None or name not in WORDS:
            return f"event {self.number:#010x} of PX4, explained in the ground station"
        known = WORDS[name]
        words, layout = (known, "") if isinstance(known, str) else known
        skipped = _CHECK_HEAD.size if self.is_check else 0
        values = _unpacked(layout, self.arguments[skipped:])
        return words.format(*values) if values is not None else name.replace("_", " ")


def _unpacked(layout: str, data: bytes) -> tuple[object, ...] | None:
    """The arguments as numbers and texts; None if some are missing."""
    code = struct.Struct("<" + re.sub("[mac]", "B", layout))
    if len(data) < code.size:
        return None
    return tuple(
        _ENUMERATIONS[letter].get(str(value), "another") if letter in _ENUMERATIONS else value
        for letter, value in zip(layout, code.unpack_from(data), strict=True)
    )


class ArmingReports:
    """Assembles health and arming reports from the events between two summaries.

    Attributes:
        problems: Findings of the newest complete report that prevent arming, as text.
        warnings: Its other findings.
        mission_can_run: Whether Mission mode can run, by the newest complete report; this requires
            a feasible mission on board. None: no report, or it does not include this.
        count: Number of complete reports.
    """

    def __init__(self) -> None:
        self.problems: tuple[str, ...] = ()
        self.warnings: tuple[str, ...] = ()
        self.mission_can_run: bool | None = None
        self.count = 0
        self._findings: list[Px4Event] | None = None  # of the current report
        self._can_run: bool | None = None  # by the first summary

    @property
    def words(self) -> str:
        """The findings that prevent arming, to append to an error; empty: none."""
        return f" ({'; '.join(self.problems)})" if self.problems else ""

    def take(self, event: Px4Event) -> None:
        """Handle the next event."""
        if event.name == ARMING_SUMMARY:
            self._findings = []
            self._can_run = _mission_can_run(event.arguments)
        elif self._findings is None:
            return
        elif event.name == HEALTH_SUMMARY:
            texts = [(e.level, e.text) for e in self._findings if e.concerns_missions]
            errors = (text for level, text in texts if level <= EVENT_ERROR)
            warnings = (text for level, text in texts if level == EVENT_WARNING)
            self.problems = tuple(dict.fromkeys(errors))
            self.warnings = tuple(dict.fromkeys(warnings))
            self.mission_can_run = self._can_run
            self.count += 1
            self._findings = None
        elif event.is_check or event.name is None:
            self._findings.append(event)


def _mission_can_run(arguments: bytes) -> bool | None:
    """Whether Mission mode can run, by the first summary of a report."""
    if len(arguments) < _SUMMARY.size:
        return None
    *_, can_run = _SUMMARY.unpack_from(arguments)
    return bool(can_run & MISSION_MODE_BIT)
