"""One of the autopilot's MAVLink links: what comes in on it, and what goes out. No sockets."""

import logging
import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

from sitl.mavlink.codec import NAMES, Outgoing, Receiver, Sender
from sitl.mavlink.mission_protocol import MissionProtocol, Reply
from sitl.mavlink.reports import MissionReporter, TextChannel, worded_as
from sitl.mavlink.telemetry import StreamSchedule, knows
from sitl.mavlink.telemetry import message as telemetry
from sitl.px4sim import (
    DO_SET_MODE,
    GROUND_STATION,
    Autopilot,
    CommandResult,
    Commands,
    Notice,
    Params,
    Sticks,
    unused_param_of_command,
)

_log = logging.getLogger(__name__)

_AUTOPILOT: Final = 1
_INJECT_FAILURE: Final = 420  # MAV_CMD
_SET_MESSAGE_INTERVAL: Final = 511
_REQUEST_MESSAGE: Final = 512
_REQUESTS: Final = {410: 242, 520: 148, 528: 264}
"""GET_HOME_POSITION, REQUEST_AUTOPILOT_CAPABILITIES, REQUEST_FLIGHT_INFORMATION: the message."""

_NO_SUCH_PARAMETER: Final = 1  # MAV_PARAM_ERROR_DOES_NOT_EXIST
_NOTHING: Final = 2**31 - 1
_STARTUP_SILENCE_S: Final = 1.4  # PX4 is silent for so long after its start
_SECOND_ACK_S: Final = 0.008


class MavlinkLink:
    """A link with its own streams, mission transfers and partner.

    Args:
        autopilot: Whose.
        rates_hz: The streams from the start.
        time_scale: Simulated seconds per wall-clock second. Time-outs that wait for a partner
            out there are kept on the wall's clock.
        reports_mission: Whether MISSION_CURRENT and the like go out here.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        rates_hz: Mapping[str, float],
        *,
        time_scale: float = 1.0,
        reports_mission: bool = True,
    ) -> None:
        self._autopilot = autopilot
        self._time_scale = time_scale
        self._system_id = int(autopilot.parameters["MAV_SYS_ID"])
        self._sender = Sender(self._system_id)
        self._receiver = Receiver()
        self._commands = Commands(autopilot)
        self._protocol = MissionProtocol(autopilot.plan, self._system_id, autopilot.behaviour)
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
            "MANUAL_CONTROL": self._on_manual_control,
            **dict.fromkeys(self._protocol.messages, self._on_mission),
        }

    # In

    def receive(self, datagram: bytes) -> list[bytes]:
        """Act on a datagram; returns the frames in it that the other links are to pass on."""
        passed_on: list[bytes] = []
        for message in self._receiver.parse(datagram):
            if _sender(message) == (self._system_id, _AUTOPILOT):
                continue
            target = getattr(message, "target_system", 0)
            component = getattr(message, "target_component", _AUTOPILOT)
            if (target, component) != (self._system_id, _AUTOPILOT):
                passed_on.append(bytes(message.get_msgbuf()))
            name = message.get_type()
            if name in self._handlers:
                self._handlers[name](message)
            elif name not in self._passed_over:
                self._passed_over.add(name)
                _log.warning("%s is not simulated: passed over", name)
        return passed_on

    def pass_on(self, frame: bytes) -> None:
        """Send a frame that came in on another link."""
        self._queue.append(frame)

    def _is_for_us(self, message: Any) -> bool:
        ours = message.target_component in (0, _AUTOPILOT)
        all_systems = self._autopilot.behaviour.takes_system_0 and message.target_system == 0
        return bool((message.target_system == self._system_id or all_systems) and ours)

    def _on_heartbeat(self, message: Any) -> None:
        if message.type == GROUND_STATION:
            self._texts.on_ground_station(self._autopilot.time_s)
        elif message.get_srcSystem() != self._system_id:
            return
        self._autopilot.watchdog.on_heartbeat(message.type, self._autopilot.situation)

    def _on_mission(self, message: Any) -> None:
        self._reply(self._protocol.handle(message, self._wall_s))

    def _on_command_long(self, message: Any) -> None:
        place = (message.param5, message.param6, message.param7)
        params = (message.param1, message.param2, message.param3, message.param4, *place)
        self._on_command(message, params)

    def _on_command_int(self, message: Any) -> None:
        x, y = (math.nan if value == _NOTHING else value * 1e-7 for value in (message.x, message.y))
        params = (message.param1, message.param2, message.param3, message.param4, x, y, message.z)
        self._on_command(message, params)

    def _on_command(self, message: Any, params: Params) -> None:
        command, sender = message.command, _sender(message)
        if not self._is_for_us(message):
            _log.info("command %d is for another", command)
            if self._autopilot.behaviour.answers_aliens and message.target_system != 0:
                self._acknowledge(command, CommandResult.FAILED, sender)
            return
        behaviour = self._autopilot.behaviour
        if behaviour.refuses_unused_params and unused_param_of_command(command, params):
            self._acknowledge(command, CommandResult.DENIED, sender)
            return
        if command == _INJECT_FAILURE:
            if behaviour.answers_failure_injection:
                self._acknowledge(command, CommandResult.ACCEPTED, sender)
            return
        result = self._message_command(command, params)
        if result is not None:
            self._acknowledge(command, result, sender)
            return
        twice = command == DO_SET_MODE and behaviour.answers_mode_twice
        if twice:  # PX4 1.16 and 1.17 accept first and decide later
            self._acknowledge(command, CommandResult.ACCEPTED, sender)
        result = self._commands.execute(command, params, sender[1])
        delay_s = _SECOND_ACK_S if twice else 0.0
        self._acknowledge(command, result, sender, delay_s)

    def _message_command(self, command: int, params: Params) -> CommandResult | None:
        """Commands about messages; None for all others."""
        requests = _REQUESTS if self._autopilot.behaviour.answers_old_requests else {}
        number = requests.get(command, _whole(params[0]))
        name = NAMES.get(number, "")
        known = knows(name)
        if command == _SET_MESSAGE_INTERVAL:
            if not known or not math.isfinite(params[1]):
                return CommandResult.FAILED
            self._streams.set_interval(name, params[1])
            return CommandResult.ACCEPTED
        if command not in (_REQUEST_MESSAGE, *requests):
            return None
        message = telemetry(name, self._autopilot) if known else None
        if message is None:
            return CommandResult.DENIED
        self._queue.append(message)
        return CommandResult.ACCEPTED

    def _on_set_mode(self, message: Any) -> None:
        if message.target_system != self._system_id:
            return
        main, sub = message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24 & 0xFF
        params = (message.base_mode, main, sub, *(math.nan,) * 4)
        sender = _sender(message)
        result = self._commands.execute(DO_SET_MODE, params, sender[1])
        self._acknowledge(DO_SET_MODE, result, sender)

    def _on_ping(self, message: Any) -> None:
        if (message.target_system, message.target_component) == (0, 0):
            reply = {"time_usec": message.time_usec, "seq": message.seq}
            self._queue.append(Outgoing("PING", reply | _target(_sender(message))))

    def _on_timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            now_ns = round(self._autopilot.time_s * 1e6) * 1000
            self._queue.append(Outgoing("TIMESYNC", {"tc1": now_ns, "ts1": message.ts1}))

    def _on_param_read(self, message: Any) -> None:
        if self._is_for_us(message):
            found = self._autopilot.parameters.read(message.param_id, message.param_index)
            self._queue_values(found)
            if not found and self._autopilot.behaviour.names_absent_parameters:
                self._report_absent(message)

    def _report_absent(self, message: Any) -> None:
        """It has no such parameter."""
        fields = {"param_id": message.param_id.encode(), "param_index": message.param_index}
        error = {"error": _NO_SUCH_PARAMETER} | _target(_sender(message))
        self._queue.append(Outgoing("PARAM_ERROR", fields | error))

    def _on_param_list(self, message: Any) -> None:
        if self._is_for_us(message):
            self._listing = 0

    def _on_param_set(self, message: Any) -> None:
        if self._is_for_us(message):
            wanted = (message.param_id, message.param_value, message.param_type)
            self._queue_values(self._autopilot.parameters.set(*wanted))

    def _on_text(self, message: Any) -> None:
        _log.info("STATUSTEXT of %d/%d: %s", *_sender(message), message.text)

    def _on_manual_control(self, message: Any) -> None:
        """Axes out of range are in the middle."""
        if message.target in (0, self._system_id):
            throttle = message.z / 500.0 - 1.0 if 0 <= message.z <= 1000 else 0.0
            pitch, roll, yaw = (
                value / 1000.0 if -1000 <= value <= 1000 else 0.0
                for value in (message.x, message.y, message.r)
            )
            self._autopilot.move_sticks(Sticks(pitch, roll, throttle, yaw))

    # Out

    def step(self, notices: list[Notice], events: list[Outgoing]) -> None:
        """Queue the messages that are due; to be called after every step of the autopilot.

        Args:
            notices: The autopilot's announcements in this step.
            events: The EVENT messages of it, and whatever else every link sends.
        """
        now_s = self._autopilot.time_s
        for notice in notices:
            self._texts.add(notice, now_s)
        if now_s < _STARTUP_SILENCE_S:
            return
        while self._delayed and self._delayed[0][0] <= now_s:
            self._queue.append(self._delayed.popleft()[1])
        self._queue += self._texts.take(now_s)
        self._queue += events
        self._reply(self._protocol.tick(self._wall_s))
        if self._reporter is not None:
            self._queue += self._reporter.step(now_s)
        if self._listing is not None:
            values = self._autopilot.parameters.listed(self._listing)
            self._queue_values(values)
            self._listing = self._listing + len(values) if values else None
        for name in self._streams.due(now_s):
            message = telemetry(name, self._autopilot)
            if message is not None:
                self._queue.append(message)

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

    def _queue_values(self, values: Iterable[dict[str, Any]]) -> None:
        self._queue += [Outgoing("PARAM_VALUE", fields) for fields in values]

    def _reply(self, replies: list[Reply]) -> None:
        """Send replies; a text goes out on this link only, its event on all."""
        for reply in replies:
            if isinstance(reply, Outgoing):
                self._queue.append(reply)
            else:
                notice = worded_as(reply, self._autopilot.behaviour)
                self._texts.add(notice, self._autopilot.time_s)
                self._autopilot.situation.notices.append(replace(reply, text=""))

    def _acknowledge(
        self, command: int, result: CommandResult, receiver: tuple[int, int], delay_s: float = 0.0
    ) -> None:
        fields = {"command": command, "result": result} | _target(receiver)
        message = Outgoing("COMMAND_ACK", fields)
        if delay_s > 0:
            self._delayed.append((self._autopilot.time_s + delay_s, message))
        else:
            self._queue.append(message)


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _target(receiver: tuple[int, int]) -> dict[str, int]:
    return {"target_system": receiver[0], "target_component": receiver[1]}


def _whole(value: float) -> int:
    return int(value + 0.5) if math.isfinite(value) and abs(value) < 2**31 else -1
