"""The messages of one PX4: sending, times of reception, detection of old ones, and its texts."""

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
"""Called with name and fields of a message, after its handler."""

_REFUSALS: Final = ("navigator_mis_", "feasibility_mis_", "navigator_geofence_invalid_")


MODES: Final = frozenset({"HEARTBEAT", "CURRENT_MODE"})
"""The messages that carry the flight mode."""

_ONCE: Final = frozenset(
    {
        *(*MODES, "COMMAND_ACK", "EVENT", "STATUSTEXT", "PARAM_VALUE", "TIMESYNC"),
        *("MISSION_ITEM_REACHED", "AUTOPILOT_VERSION", "FLIGHT_INFORMATION", "HOME_POSITION"),
    }
)
"""Messages handled however old they are: not repeated, or showing a pilot's choice."""


class Backlog:
    """Detects messages sent before a gap: a socket keeps them while this program stalls.

    A pilot may have taken over since. A gap is a stall of this program if the next message's time
    has not advanced as ours has; a long gap always counts as one. The messages after it are old
    until one has a current time, they no longer arrive in one burst, or `BACKLOG_S` have passed.
    The last condition alone does not prove that a mode is current.

    Attributes:
        proven: A message was received that was sent after the latest gap.
    """

    def __init__(self) -> None:
        self._gap_s = 0.0  # latest gap, on our clock; 0 once it was reported
        self.proven = True
        self._came_s: float | None = None  # last reception, monotonic
        self._boot_s = 0.0  # the vehicle's latest time
        self._boot_at_s: float | None = None  # its reception; None: none received
        self._suspected_s = 0.0  # length of a gap that may be our stall
        self._fresh_s = 0.0  # messages from this vehicle time on are current
        self._first: tuple[float, float] | None = (
            None  # first vehicle time after the gap, reception
        )
        self._until_s = -math.inf  # monotonic; later messages are current

    def holds(self, fields: Mapping[str, Any], arrived_s: float, rate: float) -> bool:
        """Whether a message was sent before a gap.

        Args:
            fields: The message's fields.
            arrived_s: Time of reception.
            rate: Rate of the vehicle's clock relative to ours.
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
        """Messages are old from now on."""
        self._gap_s, self._suspected_s = self._suspected_s, 0.0
        self.proven, self._until_s = False, arrived_s + BACKLOG_S

    def new_gap_s(self) -> float:
        """Length of a gap not reported yet, on our clock; 0: none."""
        gap_s, self._gap_s = self._gap_s, 0.0
        return gap_s

    def is_read(self) -> None:
        """Messages from now on were sent after the gap."""
        self._suspected_s = 0.0
        self.proven, self._until_s = True, -math.inf


class Px4Messages:
    """Passes PX4's messages to their handlers, and wakes waiting callers.

    Args:
        clock: The vehicle's clock.

    Attributes:
        clock: The same; any thread may read it.
        system_id: The vehicle's and our system id; 0 until `listen`.
        reports: PX4's health and arming reports.
        refusals: PX4's reasons for refusing a plan, since `forget_texts`.
        parameters: Parameters received so far, by name.
        absent_parameters: Parameters that PX4 reports as absent.
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
        self._received_s = loop_s()  # last reception, loop's clock
        self._arrived_s: dict[str, float] = {}  # last reception by message, monotonic
        self._watchers: list[Watcher] = []  # called with all messages, in order
        self._backlog = Backlog()
        self._boot_clock = BootClock()
        self._texts: deque[str] = deque(maxlen=TEXTS_KEPT)  # newest STATUSTEXTs

    def listen(self, direct: MavlinkDirect, system_id: int) -> None:
        """Start sending and receiving, for the autopilot with this system id."""
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
        """Also pass messages of these names to handlers; waiting callers then check again."""
        for name, handler in handlers.items():
            subscribe(self._direct, name, self._only_autopilot(name, handler))

    def watch(self, watcher: Watcher) -> None:
        """Also pass all accepted messages to this watcher, in the order of the link."""
        self._watchers.append(watcher)

    def send(self, name: str, fields: dict[str, Any], *, to_all: bool = False) -> str | None:
        """Send a message once, to PX4 or to all; return why it was not sent."""
        target = {"target_system": self.system_id, "target_component": AUTOPILOT}
        try:
            self._direct.send_message(message(name, fields if to_all else target | fields))
        except MavlinkDirectError as error:
            return str(error.result.name)
        return None

    async def request_result(self, command: int, *params: float, limit_s: float) -> int | None:
        """Send a COMMAND_LONG, which MAVSDK repeats until it is acknowledged.

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
        """Last reception of these messages, on the monotonic clock; long ago if none."""
        return max(self._arrived_s.get(name, -math.inf) for name in names)

    def texts(self) -> str:
        """PX4's last texts, to append to an error."""
        return f' (PX4 reports: "{"; ".join(self._texts)}")' if self._texts else ""

    def forget_texts(self) -> None:
        """Forget earlier texts: a new request is sent."""
        self._texts.clear()
        self.refusals.clear()

    def forget_parameters(self) -> None:
        """Forget all parameters, to read them again."""
        self.parameters.clear()
        self.absent_parameters.clear()

    async def shows(self, condition: Callable[[], bool], limit_s: float) -> bool:
        """Wait until `condition`, checked after every message, holds; False on a time-out."""
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
        """Whether a message may have been sent before a stall of this program."""
        if self.clock.most_ahead_s < math.inf:
            return False  # the vehicle's time stopped as well
        backlog = self._backlog
        old = backlog.holds(received.fields, received.arrived_s, self.clock.rate)
        if (silent_s := backlog.new_gap_s()) > 0.0:
            self._came_back(silent_s)
        return old or (name in MODES and not backlog.proven)

    def up_to_date(self) -> None:
        """Messages from now on were sent after the latest gap: an answer has proven it."""
        self._backlog.is_read()

    def _came_back(self, silent_s: float) -> None:
        """Handle the first message after a silence."""

    def _handed(self, name: str, received: Received, handler: Handler, *, old: bool) -> None:
        """Pass a message on; an old one updates no age."""
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
            return  # the bits of a negative integer are NaN as a float
        if fields["param_type"] == INT32:
            (value,) = struct.unpack("<i", struct.pack("<f", value))
        self.parameters[str(fields["param_id"]).rstrip("\0")] = float(value)

    def _on_parameter_error(self, fields: dict[str, Any]) -> None:
        if fields["error"] == NO_SUCH_PARAMETER:
            self.absent_parameters.add(str(fields["param_id"]).rstrip("\0"))
