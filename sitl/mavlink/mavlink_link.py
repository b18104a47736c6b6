"""One of the autopilot's MAVLink links: what comes in on it, and what goes out. No sockets."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

from sitl.mavlink.mavlink_codec import Receiver, Sender, message_name
from sitl.mavlink.mission_protocol import MissionProtocol, Reply
from sitl.mavlink.reports import MissionReporter, TextChannel
from sitl.mavlink.setpoint_messages import (
    RefusedSetpointError,
    global_setpoint,
    local_setpoint,
    sticks,
)
from sitl.mavlink.telemetry import StreamSchedule, Telemetry
from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.commands import CommandRequest, CommandResult, Commands
from sitl.px4sim.motion.guidance import Direct
from sitl.px4sim.safety.watchdog import GROUND_STATION
from sitl.px4sim.state.notice import Notice, Outgoing
from sitl.px4sim.state.parameters import DEFAULTS
from sitl.px4sim.state.situation import Situation

_log = logging.getLogger(__name__)

_AUTOPILOT: Final = 1
_DO_SET_MODE: Final = 176
_REQUEST_MESSAGE: Final = 512
_SET_MESSAGE_INTERVAL: Final = 511
_GET_MESSAGE_INTERVAL: Final = 510
_INJECT_FAILURE: Final = 420
_REQUESTS: Final = {410: 242, 520: 148}  # GET_HOME_POSITION, REQUEST_AUTOPILOT_CAPABILITIES
_NOTHING: Final = 2**31 - 1
_FIRST_WORD_S: Final = 1.4  # PX4 is silent for so long after its start
_SECOND_ACK_S: Final = 0.008


class MavlinkLink:
    """A link with its own streams, mission transfers and partner.

    Args:
        autopilot: The vehicle.
        telemetry: What can be streamed.
        rates_hz: What is streamed from the start.
        time_scale: Simulated seconds per wall-clock second. Time-outs that wait for a partner
            out there are kept on the wall's clock.
        reports_mission: Whether MISSION_CURRENT and the like go out here.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        telemetry: Telemetry,
        rates_hz: Mapping[str, float],
        *,
        time_scale: float = 1.0,
        reports_mission: bool = True,
    ) -> None:
        self._autopilot = autopilot
        self._telemetry = telemetry
        self._time_scale = time_scale
        self.system_id = int(autopilot.parameters["MAV_SYS_ID"])
        self._sender = Sender(self.system_id)
        self._receiver = Receiver()
        self._commands = Commands(autopilot, telemetry.version)
        self._protocol = MissionProtocol(autopilot.plan, self.system_id)
        self._reporter = MissionReporter(autopilot) if reports_mission else None  # truth: none
        self._streams = StreamSchedule(rates_hz)
        self._queue: list[Outgoing | bytes] = []  # to be taken; bytes: passed on
        self._delayed: deque[tuple[float, Outgoing]] = deque()  # until when
        self._texts = TextChannel(time_scale)
        self._listing: int | None = None  # next param_index of PARAM_REQUEST_LIST; None: over
        self._passed_over: set[str] = set()  # names that were warned of
        self._handlers: dict[str, Callable[[Any], None]] = {  # by message name
            "HEARTBEAT": self._on_heartbeat,
            "COMMAND_LONG": self._on_command_long,
            "COMMAND_INT": self._on_command_int,
            "SET_MODE": self._on_set_mode,
            "PING": self._on_ping,
            "TIMESYNC": self._on_timesync,
            "PARAM_REQUEST_READ": self._on_param_read,
            "PARAM_REQUEST_LIST": self._on_param_list,
            "PARAM_SET": self._on_param_set,
            "STATUSTEXT": self._on_text,
            "SET_POSITION_TARGET_LOCAL_NED": partial(self._on_setpoint, local_setpoint),
            "SET_POSITION_TARGET_GLOBAL_INT": partial(self._on_setpoint, global_setpoint),
            "MANUAL_CONTROL": self._on_manual_control,
        }

    # In

    def receive(self, datagram: bytes) -> list[bytes]:
        """Act on a datagram; returns the frames in it that the other links are to pass on."""
        passed_on: list[bytes] = []
        for message in self._receiver.parse(datagram):
            own = message.get_srcSystem() == self.system_id
            if own and message.get_srcComponent() == _AUTOPILOT:
                continue
            if not self._only_for_us(message):
                passed_on.append(bytes(message.get_msgbuf()))
            name = message.get_type()
            if self._protocol.handles(name):
                self._reply(self._protocol.handle(message, self._wall_s))
            elif name in self._handlers:
                self._handlers[name](message)
            elif name not in self._passed_over:
                self._passed_over.add(name)
                _log.warning("%s is not simulated: passed over", name)
        return passed_on

    def pass_on(self, frame: bytes) -> None:
        """Send a frame that came in on another link."""
        self._queue.append(frame)

    def _only_for_us(self, message: Any) -> bool:
        target = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", _AUTOPILOT)
        return bool(target == self.system_id and component == _AUTOPILOT)

    def _is_for_us(self, message: Any) -> bool:
        return message.target_system == self.system_id and message.target_component in (
            0,
            _AUTOPILOT,
        )

    def _on_heartbeat(self, message: Any) -> None:
        if message.type != GROUND_STATION and message.get_srcSystem() != self.system_id:
            return
        if message.type == GROUND_STATION:
            self._texts.heard_ground_station(self._autopilot.time_s)
        self._autopilot.watchdog.heard(message.type, self._autopilot.situation)

    def _on_command_long(self, message: Any) -> None:
        params = (
            *(message.param1, message.param2, message.param3, message.param4),
            *(message.param5, message.param6, message.param7),
        )
        self._on_command(message, params)

    def _on_command_int(self, message: Any) -> None:
        x, y = (math.nan if value == _NOTHING else value * 1e-7 for value in (message.x, message.y))
        params = (message.param1, message.param2, message.param3, message.param4, x, y, message.z)
        self._on_command(message, params)

    def _on_command(
        self, message: Any, params: tuple[float, float, float, float, float, float, float]
    ) -> None:
        if not self._is_for_us(message):
            _log.info("command %d is for another: not answered", message.command)
            return
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.command == _INJECT_FAILURE:
            return
        result = self._link_command(message.command, params)
        if result is not None:
            self._acknowledge(message.command, result, sender)
            return
        twice = message.command == _DO_SET_MODE and self._telemetry.version.answers_modes_twice
        if twice:  # PX4 1.16 and 1.17 say yes first and decide later
            self._acknowledge(_DO_SET_MODE, CommandResult.ACCEPTED, sender)
        request = CommandRequest(message.command, params, sender[1])
        result = self._commands.execute(request)
        delay_s = _SECOND_ACK_S if twice else 0.0
        self._acknowledge(message.command, result, sender, delay_s)

    def _link_command(self, command: int, params: tuple[float, ...]) -> CommandResult | None:
        """Commands about messages; None for all others."""
        if command in (_REQUEST_MESSAGE, *_REQUESTS):
            wanted = _whole(params[0]) if command == _REQUEST_MESSAGE else _REQUESTS[command]
            return self._send_once(wanted)
        if command == _SET_MESSAGE_INTERVAL:
            name = message_name(_whole(params[0]))
            if name is None or not self._telemetry.knows(name) or not math.isfinite(params[1]):
                return CommandResult.FAILED
            self._streams.set_interval(name, params[1])
            return CommandResult.ACCEPTED
        if command == _GET_MESSAGE_INTERVAL:
            number = _whole(params[0])
            interval = self._streams.interval_us(message_name(number) or "")
            fields = {"message_id": max(0, min(number, 65535)), "interval_us": interval}
            self._send(Outgoing("MESSAGE_INTERVAL", fields))
            return CommandResult.ACCEPTED
        return None

    def _send_once(self, number: int) -> CommandResult:
        name = message_name(number)
        message = self._telemetry.message(name) if name and self._telemetry.knows(name) else None
        if message is None:
            return CommandResult.DENIED
        self._send(message)
        return CommandResult.ACCEPTED

    def _on_set_mode(self, message: Any) -> None:
        if message.target_system != self.system_id:
            return
        main, sub = message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24 & 0xFF
        params = (message.base_mode, main, sub, *(math.nan,) * 4)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        result = self._commands.execute(CommandRequest(_DO_SET_MODE, params, sender[1]))
        self._acknowledge(_DO_SET_MODE, result, sender)

    def _on_ping(self, message: Any) -> None:
        if (message.target_system, message.target_component) == (0, 0):
            answer = {
                "time_usec": message.time_usec,
                "seq": message.seq,
                "target_system": message.get_srcSystem(),
                "target_component": message.get_srcComponent(),
            }
            self._send(Outgoing("PING", answer))

    def _on_timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            now_ns = self._telemetry.status.boot_us * 1000
            self._send(Outgoing("TIMESYNC", {"tc1": now_ns, "ts1": message.ts1}))

    def _on_param_read(self, message: Any) -> None:
        if self._is_for_us(message):
            values = self._autopilot.parameters.read(message.param_id, message.param_index)
            self._send_all(Outgoing("PARAM_VALUE", value.fields()) for value in values)

    def _on_param_list(self, message: Any) -> None:
        if self._is_for_us(message):
            self._listing = 0

    def _on_param_set(self, message: Any) -> None:
        if self._is_for_us(message):
            if message.param_id == "_HASH_CHECK":  # the ground station has them all already
                self._listing = None
                return
            values = self._autopilot.parameters.set(
                message.param_id, message.param_value, message.param_type
            )
            self._send_all(Outgoing("PARAM_VALUE", value.fields()) for value in values)

    def _on_text(self, message: Any) -> None:
        _log.info(
            "%d/%d says: %s", message.get_srcSystem(), message.get_srcComponent(), message.text
        )

    def _on_setpoint(self, read: Callable[[Any, Situation], Direct], message: Any) -> None:
        targets = (message.target_system, message.target_component)
        if targets[0] not in (0, self.system_id) or targets[1] not in (0, _AUTOPILOT):
            return
        situation = self._autopilot.situation
        try:
            self._autopilot.modes.offboard.hear(read(message, situation), situation)
        except RefusedSetpointError as refusal:
            self._reply([refusal.notice])

    def _on_manual_control(self, message: Any) -> None:
        if message.target in (0, self.system_id):
            self._autopilot.move_sticks(sticks(message))

    # Out

    def step(self, spoken: list[Notice], events: list[Outgoing]) -> None:
        """Queue what is due; to be called after every step of the autopilot.

        Args:
            spoken: What the autopilot said in this step.
            events: The EVENT messages of it, and whatever else every link sends.
        """
        now_s = self._autopilot.time_s
        for notice in spoken:
            self._texts.add(notice, now_s)
        if now_s < _FIRST_WORD_S:
            return
        while self._delayed and self._delayed[0][0] <= now_s:
            self._send(self._delayed.popleft()[1])
        self._send_all(self._texts.take(now_s))
        self._send_all(events)
        self._reply(self._protocol.tick(self._wall_s))
        if self._reporter is not None:
            self._send_all(self._reporter.step(now_s))
        self._list_parameters()
        for name in self._streams.due(now_s):
            message = self._telemetry.message(name)
            if message is not None:
                self._send(message)

    def take_frames(self) -> list[bytes]:
        """The frames to be sent since the last call."""
        return [
            message if isinstance(message, bytes) else self._sender.pack(message)
            for message in self.take_queue()
        ]

    def take_queue(self) -> list[Outgoing | bytes]:
        """The same before it is bytes, for a partner in the same process; passed on frames are."""
        queue, self._queue = self._queue, []
        return queue

    @property
    def _wall_s(self) -> float:
        return self._autopilot.time_s / self._time_scale

    def _list_parameters(self) -> None:
        if self._listing is None:
            return
        values = self._autopilot.parameters.listed(self._listing)
        self._send_all(Outgoing("PARAM_VALUE", value.fields()) for value in values)
        numbered = [value.index for value in values if value.index < len(DEFAULTS)]
        self._listing = numbered[-1] + 1 if numbered else None

    def _reply(self, replies: list[Reply]) -> None:
        """Send answers; words go out on this link only, their events on all."""
        for reply in replies:
            if isinstance(reply, Outgoing):
                self._send(reply)
            else:
                self._texts.add(reply, self._autopilot.time_s)
                self._autopilot.situation.notices.append(replace(reply, text=""))

    def _acknowledge(
        self, command: int, result: CommandResult, receiver: tuple[int, int], delay_s: float = 0.0
    ) -> None:
        fields = {
            "command": command,
            "result": result,
            "target_system": receiver[0],
            "target_component": receiver[1],
        }
        if delay_s > 0:
            self._delayed.append(
                (self._autopilot.time_s + delay_s, Outgoing("COMMAND_ACK", fields))
            )
        else:
            self._send(Outgoing("COMMAND_ACK", fields))

    def _send_all(self, messages: Iterable[Outgoing]) -> None:
        for message in messages:
            self._send(message)

    def _send(self, message: Outgoing) -> None:
        self._queue.append(message)


def _whole(value: float) -> int:
    return int(value + 0.5) if math.isfinite(value) and abs(value) < 2**31 else -1
