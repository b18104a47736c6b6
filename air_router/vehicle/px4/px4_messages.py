"""The messages of one PX4: what goes to it, when its own came, and what it says in words.

A companion computer gets no STATUSTEXT from PX4 (those go to ground stations only): why a mission
is refused or arming denied reaches it as EVENT (message 410) with a number and packed arguments.
The number is the FNV-1a hash of the event's name with the component in the top byte, so the table
of names in `px4_event_words.toml` is all that is needed, also where the autopilot's own table of
words cannot be fetched. Every check of the health and arming report comes as an event of its own
between two summaries.
"""

import asyncio
import json
import logging
import math
import re
import struct
import tomllib
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from mavsdk.plugins.mavlink_direct.mavlink_direct import (
    MavlinkDirect,
    MavlinkDirectError,
    MavlinkDirectResult,
)

from air_router.vehicle.clock import loop_s
from air_router.vehicle.px4.mavsdk_bridge import Received, call, message, subscribe

_log = logging.getLogger(__name__)

Handler = Callable[[dict[str, Any]], None]

AUTOPILOT: Final = 1  # MAV_COMP_ID_AUTOPILOT1
INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE; PX4 has no others
_REFUSALS: Final = ("navigator_mis_", "feasibility_mis_", "navigator_geofence_invalid_")


ERROR: Final = 3
WARNING: Final = 4  # of the levels; those above INFO, 6, are for programs

ARMING_SUMMARY: Final = "commander_arming_check_summary"
HEALTH_SUMMARY: Final = "commander_health_summary"

_COMPONENT: Final = 1 << 24
_FNV_OFFSET, _FNV_PRIME = 0x811C9DC5, 0x01000193
_CHECK_HEAD: Final = struct.Struct("<IB")  # modes concerned, health component
_MISSION_MODE: Final = 1 << 3  # NAVIGATION_STATE_AUTO_MISSION

_TABLE: Final[dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_name("px4_event_words.toml").read_text(encoding="utf-8")
)
_ENUMERATIONS: Final = {"m": _TABLE["modes"], "a": _TABLE["actions"], "c": _TABLE["causes"]}
WORDS: Final[dict[str, str | tuple[str, str]]] = {
    name: row if isinstance(row, str) else tuple(row)
    for section in ("checks", "mission", "commander")
    for name, row in _TABLE[section].items()
}
"""By name: words, or words and the layout of the arguments."""


def event_id(name: str) -> int:
    """The number under which PX4 sends an event."""
    value = _FNV_OFFSET
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return _COMPONENT | value & 0xFFFFFF


_NAMES: Final = {event_id(name): name for name in (*WORDS, ARMING_SUMMARY, HEALTH_SUMMARY)}


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
    def of(cls, fields: dict[str, Any]) -> Self:
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
    def concerns_missions(self) -> bool:
        """Whether it is more than a finding that keeps the vehicle from being flown by hand."""
        if not self.is_check or len(self.arguments) < _CHECK_HEAD.size:
            return True
        return bool(_CHECK_HEAD.unpack_from(self.arguments)[0] & _MISSION_MODE)

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


def _unpacked(layout: str, data: bytes) -> tuple[object, ...] | None:
    """Arguments as numbers and words; None where fewer came than belong to the event."""
    code = struct.Struct("<" + re.sub("[mac]", "B", layout))
    if len(data) < code.size:
        return None
    return tuple(
        _ENUMERATIONS[letter].get(str(value), "another") if letter in _ENUMERATIONS else value
        for letter, value in zip(layout, code.unpack_from(data), strict=True)
    )


class ArmingReports:
    """Puts health and arming reports together from the events between two summaries.

    Attributes:
        problems: What stands in the way of arming, in words, by the newest complete report.
        warnings: What does not, but was found.
        count: Of complete reports.
    """

    def __init__(self) -> None:
        self.problems: tuple[str, ...] = ()
        self.warnings: tuple[str, ...] = ()
        self.count = 0
        self._findings: list[Px4Event] | None = None  # of the report under way

    @property
    def words(self) -> str:
        """What stands in the way of arming, to add to an error; empty: nothing that it reports."""
        return f" ({'; '.join(self.problems)})" if self.problems else ""

    def take(self, event: Px4Event) -> None:
        """Take the next event."""
        if event.name == ARMING_SUMMARY:
            self._findings = []
        elif self._findings is None:
            return
        elif event.name == HEALTH_SUMMARY:
            texts = [(e.level, e.text) for e in self._findings if e.concerns_missions]
            self.problems = tuple(dict.fromkeys(text for level, text in texts if level <= ERROR))
            self.warnings = tuple(dict.fromkeys(text for level, text in texts if level == WARNING))
            self.count += 1
            self._findings = None
        elif event.is_check or event.name is None:
            self._findings.append(event)


class Px4Messages:
    """Hands messages of the autopilot to their handlers, and wakes who waits for what they say.

    Attributes:
        system_id: The vehicle's, and ours; 0 until `listen`.
        reports: Its health and arming checks.
        refusals: Why it did not take a plan, in its words, since `forget_words`.
        parameters: Those heard so far, by name.
    """

    def __init__(self) -> None:
        self.system_id = 0
        self.reports = ArmingReports()
        self.refusals: list[str] = []
        self.parameters: dict[str, float] = {}
        self._direct: MavlinkDirect  # from `listen` on
        self._news = asyncio.Event()  # set by every message, then replaced
        self._heard_s = loop_s()  # when anything came last, loop's clock
        self._arrived_s: dict[str, float] = {}  # by message, monotonic
        self._texts: deque[str] = deque(maxlen=3)  # newest STATUSTEXTs

    def listen(self, direct: MavlinkDirect, system_id: int) -> None:
        """Send through this, and take the words of the autopilot with this system id."""
        self._direct, self.system_id = direct, system_id
        self.take(
            {
                "STATUSTEXT": self._on_text,
                "EVENT": self._on_event,
                "PARAM_VALUE": self._on_parameter,
            }
        )

    def take(self, handlers: Mapping[str, Handler]) -> None:
        """Hand messages of the autopilot, by name, to others as well; then waiters look again."""
        for name, handler in handlers.items():
            subscribe(self._direct, name, self._only_autopilot(name, handler))

    def send(self, name: str, fields: dict[str, Any], *, to_all: bool = False) -> str | None:
        """Send a message once, to the autopilot or to all; why it did not leave, if so."""
        target = {"target_system": self.system_id, "target_component": AUTOPILOT}
        try:
            self._direct.send_message(message(name, fields if to_all else target | fields))
        except MavlinkDirectError as error:
            return str(error.result.name)
        return None

    async def ask(self, command: int, *params: float, limit_s: float) -> int | None:
        """Send a COMMAND_LONG, which MAVSDK repeats until it is answered.

        Args:
            command: MAV_CMD.
            params: Its first parameters; the others are 0.
            limit_s: Wall-clock limit for the answer.

        Returns:
            The MAV_RESULT; None if there is none in time.
        """
        values = (*params, *(0.0,) * (7 - len(params)))
        fields = {
            "target_system": self.system_id,
            "target_component": AUTOPILOT,
            "command": command,
            "confirmation": 0,
            **{f"param{n}": value for n, value in enumerate(values, start=1)},
        }
        asked = message("COMMAND_LONG", fields, self.system_id)
        try:
            result, answer = await call(self._direct.send_command_async, asked, timeout_s=limit_s)
        except TimeoutError:
            return None
        if result != MavlinkDirectResult.SUCCESS:
            return None
        return int(json.loads(answer.fields_json)["result"])

    def silent_s(self) -> float:
        """Wall-clock seconds since anything was heard."""
        return loop_s() - self._heard_s

    def arrived_s(self, *names: str) -> float:
        """When the newest message of these names came, on the monotonic clock; long ago if none."""
        return max(self._arrived_s.get(name, -math.inf) for name in names)

    def said(self) -> str:
        """The autopilot's last words, to add to an error."""
        return f' (it says: "{"; ".join(self._texts)}")' if self._texts else ""

    def forget_words(self) -> None:
        """Something new is asked of the autopilot: what it said before is not about that."""
        self._texts.clear()
        self.refusals.clear()

    async def shows(self, condition: Callable[[], bool], limit_s: float) -> bool:
        """Whether `condition`, looked at after every message, holds within so much wall time."""
        try:
            async with asyncio.timeout(limit_s):
                while not condition():
                    await self._news.wait()
        except TimeoutError:
            return False
        return True

    def _only_autopilot(self, name: str, handler: Handler) -> Callable[[Received], None]:
        def on_message(received: Received) -> None:
            if received.sender != (self.system_id, AUTOPILOT):
                return
            self._heard_s = loop_s()
            self._arrived_s[name] = received.arrived_s
            self._handed(name, received, handler)
            self._news.set()
            self._news = asyncio.Event()

        return on_message

    def _handed(self, name: str, received: Received, handler: Handler) -> None:
        """Hand a message on."""
        del name
        handler(received.fields)

    def _on_text(self, fields: dict[str, Any]) -> None:
        text = str(fields["text"]).rstrip("\t\0 ")
        self._texts.append(text)
        _log.info("PX4: %s", text)

    def _on_event(self, fields: dict[str, Any]) -> None:
        event = Px4Event.of(fields)
        self.reports.take(event)
        if event.level > WARNING or event.is_check:
            return
        text = event.text
        _log.info("PX4: %s", text)
        self._texts.append(text)
        if (event.name or "").startswith(_REFUSALS):
            self.refusals.append(text)

    def _on_parameter(self, fields: dict[str, Any]) -> None:
        value = fields["param_value"]
        if value is None:
            return  # the bits of a negative whole number, which are no number as a float
        if fields["param_type"] == INT32:
            (value,) = struct.unpack("<i", struct.pack("<f", value))
        self.parameters[str(fields["param_id"]).rstrip("\0")] = float(value)
