"""What a relay has seen of a flight: the MAVLink frames of all sides, and the true track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from sitl.mavlink.codec import Frame, frames
from sitl.rehearsal.judge.evidence import AUTOPILOT, FlightRecord, Sample, WireMessage

MISSION: Final = frozenset({*range(37, 48), 51, 73})
"""Messages by which a plan is put on board, by number."""

_HEARTBEAT, _HIL_STATE, _HIL_ACTUATORS = 0, 115, 93
_FROM_VEHICLE: Final = frozenset({_HEARTBEAT, 1, 77, 242, 245, 436, *MISSION})
_INPUTS: Final = frozenset({_HEARTBEAT, 1, 24, 33, 42, 245, 436})
_FROM_OTHERS: Final = frozenset({11, 69, 75, 76, 84, 86, 23, 253, *MISSION})
_ARMED, _CRITICAL = 128, 5
_LANDED_M: Final = 0.3
"""So low above where it started a vehicle stands on the ground: the simulated ground is flat."""

_DECODER: Final = mavlink.MAVLink(None)


@dataclass(slots=True)
class Recording(FlightRecord):
    """What the relay has seen, in simulated time.

    Attributes:
        time_s: Simulated seconds.
        clock_s: The vehicle's own, which begins anew when it does.
        mode: The vehicle's custom mode, as it said last.
        armed: As it said last.
        failsafe: Whether one acts, as it said last.
        ground_m: Where it stood first.
        above_m: Above that.
        place: True latitude, longitude, altitude.
    """

    time_s: float = 0.0
    clock_s: float = 0.0
    mode: int = 0
    armed: bool = False
    failsafe: bool = False
    ground_m: float | None = None
    above_m: float = 0.0
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)

    _before_s: float = 0.0
    _told: bool = False
    """Whether the truth's link has HEARTBEATs: those of a busy link come late."""

    def _state(self, heartbeat: Any) -> None:
        self.mode = heartbeat.custom_mode
        self.armed = bool(heartbeat.base_mode & _ARMED)
        self.failsafe = heartbeat.system_status >= _CRITICAL

    def restart(self) -> None:
        """The vehicle is started anew: its time begins at zero again."""
        self._before_s, self.clock_s = self.time_s, 0.0
        self.armed = self.failsafe = False

    def look(self, frame: Frame, *, delivered: bool) -> None:
        """Note a frame, from either side."""
        vehicle = frame.component_id == AUTOPILOT
        wanted = _FROM_VEHICLE if vehicle else _FROM_OTHERS
        if frame.number not in wanted:
            return
        try:
            message: Any = _DECODER.decode(bytearray(frame.data))
        except mavlink.MAVError:
            return
        if vehicle and frame.number == _HEARTBEAT and not self._told:
            self._state(message)
        self.messages.append(self._noted(frame, message, delivered=delivered))

    def hear(self, datagram: bytes) -> None:
        """Note what reaches the companion."""
        for frame in frames(datagram):
            if frame.number in _INPUTS and frame.component_id == AUTOPILOT:
                message = _DECODER.decode(bytearray(frame.data))
                self.heard.append(self._noted(frame, message, delivered=True))

    def _noted(self, frame: Frame, message: Any, *, delivered: bool) -> WireMessage:
        fields = message.to_dict()
        name, target = fields.pop("mavpackettype"), int(fields.get("target_system", 0))
        sender = frame.system_id, frame.component_id
        return WireMessage(self.time_s, *sender, target, name, fields, delivered)

    def see(self, frame: Frame) -> None:
        """Note a frame of the truth's link."""
        if frame.number not in {_HEARTBEAT, _HIL_STATE, _HIL_ACTUATORS}:
            return
        message: Any = _DECODER.decode(bytearray(frame.data))
        if frame.number == _HEARTBEAT:
            self._told = True
            self._state(message)
            return
        if message.time_usec:
            self.clock_s = message.time_usec / 1e6
            self.time_s = self._before_s + self.clock_s
        if frame.number == _HIL_ACTUATORS:
            return
        self.place = message.lat / 1e7, message.lon / 1e7, message.alt / 1e3
        if self.ground_m is None:
            self.ground_m = self.place[2]
        self.above_m = self.place[2] - self.ground_m
        landed = self.above_m < _LANDED_M
        if not self.samples or self.samples[-1].time_s < self.time_s:
            self.samples.append(
                Sample(
                    self.time_s, *self.place, self.armed, landed, self.mode, failsafe=self.failsafe
                )
            )
