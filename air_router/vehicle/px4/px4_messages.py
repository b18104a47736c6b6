"""The messages of one PX4: what goes to it, when its own came, which of them are old, its words."""

import asyncio
import json
import logging
import math
import struct
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from mavsdk.plugins.mavlink_direct.mavlink_direct import (
    MavlinkDirect,
    MavlinkDirectError,
    MavlinkDirectResult,
)

from air_router.vehicle import VehicleClock, loop_s
from air_router.vehicle.px4.boot_clock import BootClock
from air_router.vehicle.px4.limits import (
    BACKLOG_CAUGHT_UP,
    BACKLOG_JITTER_S,
    BACKLOG_LIVE,
    BACKLOG_S,
    LINK_GAP_S,
    LINK_PAUSE_S,
    TEXTS_KEPT,
)
from air_router.vehicle.px4.mavlink_values import AUTOPILOT, EVENT_WARNING, INT32, NO_SUCH_PARAMETER
from air_router.vehicle.px4.mavsdk_bridge import Received, call, message, subscribe
from air_router.vehicle.px4.px4_events import ArmingReports, Px4Event

_log = logging.getLogger(__name__)

Handler = Callable[[dict[str, Any]], None]
Watcher = Callable[[str, Mapping[str, Any]], None]
"""Takes name and fields of a message, after its handler."""

_REFUSALS: Final = ("navigator_mis_", "feasibility_mis_", "navigator_geofence_invalid_")


MODES: Final = frozenset({"HEARTBEAT", "CURRENT_MODE"})
"""The messages that carry the flight mode."""

_ONCE: Final = frozenset(
    {
        *(*MODES, "COMMAND_ACK", "EVENT", "STATUSTEXT", "PARAM_VALUE", "TIMESYNC"),
        *("MISSION_ITEM_REACHED", "AUTOPILOT_VERSION", "FLIGHT_INFORMATION", "HOME_POSITION"),
    }
)
"""What is taken in however old it is: it does not come again, or tells what a pilot chose."""


class Backlog:
    """Finds messages of before a gap: a socket keeps them while this program stands still.

    They tell of a vehicle that a pilot may have taken since. A gap is this program's if a message
    after it tells a time that has not gone on as ours has; a long one counts as that. All that
    follows is of before until one tells a time that has, they do not come all at once, or
    `BACKLOG_S` have passed. The last alone does not prove that a mode is of now.

    Attributes:
        proven: A message has come that was sent since the latest gap.
    """

    def __init__(self) -> None:
        self._gap_s = 0.0  # how long the latest gap was, on our clock; 0 once it was reported
        self.proven = True
        self._came_s: float | None = None  # when anything came last, monotonic
        self._boot_s = 0.0  # the latest time that the vehicle told
        self._boot_at_s: float | None = None  # when that came; None: it told none
        self._suspected_s = 0.0  # a gap of so long, that may be ours
        self._fresh_s = 0.0  # from this time of the vehicle on nothing is of before
        self._first: tuple[float, float] | None = None  # time told first after it, and when
        self._until_s = -math.inf  # monotonic; all that comes later is of now

    def holds(self, fields: Mapping[str, Any], arrived_s: float, rate: float) -> bool:
        """Whether a message is of before a gap.

        Args:
            fields: Of the message.
            arrived_s: When it came.
            rate: Of the vehicle's time against ours.
        """
        gap_s = 0.0 if self._came_s is None else arrived_s - self._came_s
        self._came_s = arrived_s
        if gap_s > LINK_GAP_S:
            since_s = 0.0 if self._boot_at_s is None else arrived_s - self._boot_at_s
            self._fresh_s = self._boot_s + (BACKLOG_CAUGHT_UP * since_s - BACKLOG_JITTER_S) * rate
            self._suspected_s, self._first = gap_s, None
        if gap_s > LINK_PAUSE_S:
            self._begin(arrived_s)
        if (boot_ms := fields.get("time_boot_ms")) is not None:
            boot_s, self._boot_at_s = boot_ms / 1e3, arrived_s
            self._boot_s = boot_s
            self._first = self._first or (boot_s, arrived_s)
            elapsed_s, took_s = boot_s - self._first[0], (arrived_s - self._first[1]) * rate
            if boot_s >= self._fresh_s or took_s >= BACKLOG_LIVE * elapsed_s > 0.0:
                self.is_read()
            elif self._suspected_s > 0.0:
                self._begin(arrived_s)
        return arrived_s < self._until_s

    def _begin(self, arrived_s: float) -> None:
        """What comes is of before the gap."""
        self._gap_s, self._suspected_s = self._suspected_s, 0.0
        self.proven, self._until_s = False, arrived_s + BACKLOG_S

    def new_gap_s(self) -> float:
        """How long a gap was, on our clock, that was not reported before; 0: there is none."""
        gap_s, self._gap_s = self._gap_s, 0.0
        return gap_s

    def is_read(self) -> None:
        """What comes from now on was sent after the gap."""
        self._suspected_s = 0.0
        self.proven, self._until_s = True, -math.inf


class Px4Messages:
    """Hands messages of the autopilot to their handlers, and wakes who waits for what they say.

    Args:
        clock: The vehicle's.

    Attributes:
        clock: The same, which any thread may read.
        system_id: The vehicle's, and ours; 0 until `listen`.
        reports: Its health and arming checks.
        refusals: Why it did not take a plan, in its words, since `forget_texts`.
        parameters: Those heard so far, by name.
        absent_parameters: Those of which the autopilot reports that it does not have them.
    """

    def __init__(self, clock: VehicleClock) -> None:
        self.clock = clock
        self.system_id = 0
        self.reports = ArmingReports()
        self.refusals: list[str] = []
        self.parameters: dict[str, float] = {}
        self.absent_parameters: set[str] = set()
        self._direct: MavlinkDirect  # from `listen` on
        self._arrival = asyncio.Event()  # set by every message, then replaced
        self._received_s = loop_s()  # when anything came last, loop's clock
        self._arrived_s: dict[str, float] = {}  # by message, monotonic
        self._watchers: list[Watcher] = []  # of all messages, in order
        self._backlog = Backlog()
        self._boot_clock = BootClock()
        self._texts: deque[str] = deque(maxlen=TEXTS_KEPT)  # newest STATUSTEXTs

    def listen(self, direct: MavlinkDirect, system_id: int) -> None:
        """Send through this, and take the words of the autopilot with this system id."""
        self._direct, self.system_id = direct, system_id
        self.take(
            {
                "STATUSTEXT": self._on_text,
                "EVENT": self._on_event,
                "PARAM_VALUE": self._on_parameter,
                "PARAM_ERROR": self._on_parameter_error,
            }
        )

    def take(self, handlers: Mapping[str, Handler]) -> None:
        """Hand messages of the autopilot, by name, to others as well; then waiters check again."""
        for name, handler in handlers.items():
            subscribe(self._direct, name, self._only_autopilot(name, handler))

    def watch(self, watcher: Watcher) -> None:
        """Hand all that is taken from the autopilot to this too, in the order of the link."""
        self._watchers.append(watcher)

    def send(self, name: str, fields: dict[str, Any], *, to_all: bool = False) -> str | None:
        """Send a message once, to the autopilot or to all; why it did not leave, if so."""
        target = {"target_system": self.system_id, "target_component": AUTOPILOT}
        try:
            self._direct.send_message(message(name, fields if to_all else target | fields))
        except MavlinkDirectError as error:
            return str(error.result.name)
        return None

    async def request_result(self, command: int, *params: float, limit_s: float) -> int | None:
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
        request = message("COMMAND_LONG", fields, self.system_id)
        try:
            result, reply = await call(self._direct.send_command_async, request, timeout_s=limit_s)
        except TimeoutError:
            return None
        if result != MavlinkDirectResult.SUCCESS:
            return None
        return int(json.loads(reply.fields_json)["result"])

    def silent_s(self) -> float:
        """Wall-clock seconds since anything was received."""
        return loop_s() - self._received_s

    def arrived_s(self, *names: str) -> float:
        """When the newest message of these names came, on the monotonic clock; long ago if none."""
        return max(self._arrived_s.get(name, -math.inf) for name in names)

    def texts(self) -> str:
        """The autopilot's last texts, to add to an error."""
        return f' (it says: "{"; ".join(self._texts)}")' if self._texts else ""

    def forget_texts(self) -> None:
        """A new request goes to the autopilot: earlier texts are not about it."""
        self._texts.clear()
        self.refusals.clear()

    def forget_parameters(self) -> None:
        """They are read anew."""
        self.parameters.clear()
        self.absent_parameters.clear()

    async def shows(self, condition: Callable[[], bool], limit_s: float) -> bool:
        """Whether `condition`, checked after every message, holds within so much wall time."""
        try:
            async with asyncio.timeout(limit_s):
                while not condition():
                    await self._arrival.wait()
        except TimeoutError:
            return False
        return True

    def _only_autopilot(self, name: str, handler: Handler) -> Callable[[Received], None]:
        def on_message(received: Received) -> None:
            if received.sender != (self.system_id, AUTOPILOT):
                return
            if (counted_ms := received.fields.get("time_boot_ms")) is not None:
                whole_ms = self._boot_clock.whole_ms(counted_ms)
                fields = {**received.fields, "time_boot_ms": whole_ms}
                received = received._replace(fields=fields)
            old = self._is_old(name, received)
            if old and name not in _ONCE:
                return
            self._received_s = loop_s()
            self._arrived_s[name] = received.arrived_s
            self._handed(name, received, handler, old=old)
            for watcher in self._watchers:
                watcher(name, received.fields)
            self._arrival.set()
            self._arrival = asyncio.Event()

        return on_message

    def _is_old(self, name: str, received: Received) -> bool:
        """Whether a message may be of before a gap: a socket kept it while this program stood."""
        if self.clock.most_ahead_s < math.inf:
            return False  # the vehicle's time stood still as well
        backlog = self._backlog
        old = backlog.holds(received.fields, received.arrived_s, self.clock.rate)
        if (silent_s := backlog.new_gap_s()) > 0.0:
            self._came_back(silent_s)
        return old or (name in MODES and not backlog.proven)

    def up_to_date(self) -> None:
        """What comes from now on was sent after the latest gap: an answer has shown it."""
        self._backlog.is_read()

    def _came_back(self, silent_s: float) -> None:
        """A message has come after so long."""

    def _handed(self, name: str, received: Received, handler: Handler, *, old: bool) -> None:
        """Hand a message on; an old one tells what was, and makes nothing younger."""
        del name, old
        handler(received.fields)

    def _on_text(self, fields: dict[str, Any]) -> None:
        text = str(fields["text"]).rstrip("\t\0 ")
        self._texts.append(text)
        _log.info("PX4: %s", text)

    def _on_event(self, fields: dict[str, Any]) -> None:
        event = Px4Event.of(fields)
        self.reports.take(event)
        if event.level > EVENT_WARNING or event.is_check:
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

    def _on_parameter_error(self, fields: dict[str, Any]) -> None:
        if fields["error"] == NO_SUCH_PARAMETER:
            self.absent_parameters.add(str(fields["param_id"]).rstrip("\0"))
