"""What a relay has seen of a flight: the MAVLink frames of all sides, and the true track."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from sitl.mavlink import Frame, frames
from sitl.rehearsal.judge import (
    AUTOPILOT,
    COMPANION,
    FlightRecord,
    Sample,
    WireMessage,
)

MISSION: Final = "MISSION_"
"""How the messages begin by which a plan is put on board; they are all noted."""

ITEM_FIELDS: Final = (
    *("frame", "command", "current", "autocontinue", "param1", "param2", "param3", "param4"),
    *("x", "y", "z"),
)
"""The fields of an item of a plan, but for its number."""

_FROM_VEHICLE: Final = frozenset(
    {
        *("HEARTBEAT", "SYS_STATUS", "COMMAND_ACK", "HOME_POSITION", "EXTENDED_SYS_STATE"),
        "CURRENT_MODE",
    }
)
_INPUTS: Final = frozenset(
    {
        *("HEARTBEAT", "SYS_STATUS", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "MISSION_CURRENT"),
        *("EXTENDED_SYS_STATE", "CURRENT_MODE"),
    }
)
_FROM_OTHERS: Final = frozenset(
    {
        *("SET_MODE", "MANUAL_CONTROL", "COMMAND_INT", "COMMAND_LONG", "PARAM_SET", "STATUSTEXT"),
        *("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"),
    }
)
_STATE, _CLOCK = "HIL_STATE_QUATERNION", "HIL_ACTUATOR_CONTROLS"
_ARMED, _CRITICAL = 128, 5
_LANDED_M: Final = 0.3
"""So low above where it started a vehicle stands on the ground: the simulated ground is flat."""


@dataclass(slots=True)
class Recording(FlightRecord):
    """What the relay has seen, in simulated time.

    Attributes:
        time_s: Simulated seconds.
        clock_s: The vehicle's own, which begins anew when it does.
        mode: The vehicle's custom mode, as it last reported.
        armed: As it last reported.
        failsafe: Whether one acts, as it last reported.
        ground_m: Where it stood first.
        above_m: Above that.
        received_s: The vehicle's clock in the newest position that reached the companion; infinite
            before the first.
    """

    time_s: float = 0.0
    clock_s: float = 0.0
    mode: int = 0
    armed: bool = False
    failsafe: bool = False
    ground_m: float | None = None
    above_m: float = 0.0
    received_s: float = math.inf
    _before_s: float = 0.0  # its last start, simulated
    _has_truth: bool = False  # the truth's link has HEARTBEATs: those of a busy link come late

    def restart(self) -> None:
        """The vehicle is started anew: its time begins at zero again."""
        self._before_s, self.clock_s = self.time_s, 0.0
        self.armed = self.failsafe = False

    def record_frame(self, frame: Frame, *, delivered: bool) -> None:
        """Note a frame, from either side."""
        vehicle = frame.component_id == AUTOPILOT
        wanted = frame.name in (_FROM_VEHICLE if vehicle else _FROM_OTHERS)
        if not (wanted or frame.name.startswith(MISSION)) or not frame.intact:
            return
        self.messages.append(self._noted(frame, delivered=delivered))
        if vehicle and frame.name == "HEARTBEAT" and not self._has_truth:
            self._follow(self.messages[-1].fields)

    def record_datagram(self, datagram: bytes) -> None:
        """Note what reaches the companion."""
        for frame in frames(datagram):
            if frame.name in _INPUTS and frame.component_id == AUTOPILOT:
                self.received.append(self._noted(frame, delivered=True))
                if frame.name == "GLOBAL_POSITION_INT":
                    self.received_s = self.received[-1].fields["time_boot_ms"] / 1e3

    def see(self, frame: Frame) -> None:
        """Note a frame of the truth's link."""
        if frame.name not in {"HEARTBEAT", _STATE, _CLOCK}:
            return
        fields = frame.fields()
        if frame.name == "HEARTBEAT":
            self._has_truth = True
            self._follow(fields)
            return
        if fields["time_usec"]:
            self.clock_s = fields["time_usec"] / 1e6
            self.time_s = self._before_s + self.clock_s
        if frame.name == _CLOCK:
            return
        place = fields["lat"] / 1e7, fields["lon"] / 1e7, fields["alt"] / 1e3
        if self.ground_m is None:
            self.ground_m = place[2]
        self.above_m = place[2] - self.ground_m
        landed = self.above_m < _LANDED_M
        if not self.samples or self.samples[-1].time_s < self.time_s:
            sample = Sample(self.time_s, *place, self.armed, landed, self.mode, self.failsafe)
            self.samples.append(sample)

    def plan(self, *, backwards: bool) -> list[dict[str, Any]]:
        """The mission that the companion has put on board, as a station would send it again.

        All of its places are moved a little; it may go through those behind the first backwards.
        """
        items = {
            int(m.fields["seq"]): dict(m.fields)
            for m in self.messages
            if m.name == "MISSION_ITEM_INT"
            and m.component == COMPANION
            and m.fields.get("mission_type", 0) == 0
        }
        plan = [
            {**item, "x": item["x"] + 1, "y": item["y"] - 1} if item["x"] else item
            for _, item in sorted(items.items())
        ]
        return [*plan[:3], *reversed(plan[3:])] if backwards else plan

    def _follow(self, heartbeat: Mapping[str, Any]) -> None:
        self.mode = heartbeat["custom_mode"]
        self.armed = bool(heartbeat["base_mode"] & _ARMED)
        self.failsafe = heartbeat["system_status"] >= _CRITICAL

    def _noted(self, frame: Frame, *, delivered: bool) -> WireMessage:
        fields, sender = frame.fields(), (frame.system_id, frame.component_id)
        target = int(fields.get("target_system", 0))
        return WireMessage(self.time_s, *sender, target, frame.name, fields, delivered)
