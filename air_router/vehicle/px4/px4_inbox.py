"""The messages of one PX4: to whom they go, when they came, and what it says in words."""

import asyncio
import logging
import math
import struct
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect

from air_router.vehicle.events.px4_events import WARNING, ArmingReports, Px4Event
from air_router.vehicle.loop_clock import loop_s
from air_router.vehicle.mavlink.mavsdk_bridge import Received, subscribe
from air_router.vehicle.px4.px4_order import AUTOPILOT

_log = logging.getLogger(__name__)

Handler = Callable[[dict[str, Any]], None]

INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE; PX4 has no others
_REFUSALS: Final = ("navigator_mis_", "feasibility_mis_", "navigator_geofence_invalid_")


class Px4Inbox:
    """Hands messages of the autopilot to their handlers, and wakes who waits for what they say."""

    def __init__(self) -> None:
        self._system_id = 0  # set by `listen`
        self._news = asyncio.Event()  # set by every message, then replaced
        self._heard_s = loop_s()  # when anything came last, loop's clock
        self._arrived_s: dict[str, float] = {}  # by message, monotonic
        self._texts: deque[str] = deque(maxlen=3)  # newest STATUSTEXTs
        self.reports = ArmingReports()
        self.refusals: list[str] = []  # why it did not arm, in its words
        self.parameters: dict[str, float] = {}  # heard so far

    def listen(self, direct: MavlinkDirect, system_id: int) -> None:
        """Take the words of the autopilot with this system id."""
        self._system_id = system_id
        words = {
            "STATUSTEXT": self._on_text,
            "EVENT": self._on_event,
            "PARAM_VALUE": self._on_parameter,
        }
        self.take(direct, words)

    def take(self, direct: MavlinkDirect, handlers: Mapping[str, Handler]) -> None:
        """Hand messages of the autopilot, by name, to others as well; then waiters look again."""
        for name, handler in handlers.items():
            subscribe(direct, name, self._only_autopilot(name, handler))

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

    async def wait_for(self, condition: Callable[[], bool]) -> None:
        """Return once `condition` holds, looked at after every message."""
        while not condition():
            await self._news.wait()

    async def shows(self, condition: Callable[[], bool], limit_s: float) -> bool:
        """Whether `condition` holds within so much wall-clock time."""
        try:
            async with asyncio.timeout(limit_s):
                await self.wait_for(condition)
        except TimeoutError:
            return False
        return True

    def _only_autopilot(self, name: str, handler: Handler) -> Callable[[Received], None]:
        def on_message(received: Received) -> None:
            if received.sender != (self._system_id, AUTOPILOT):
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
