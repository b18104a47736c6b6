"""Ground stations and the pilot of a rehearsal: what they send, and what they put on board."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from sitl.mavlink.mavlink_codec import MessagePacker
from sitl.mavlink.mavlink_vehicle import MavlinkVehicle
from sitl.px4sim.plan.mission_items import Command, MissionItem, MissionType
from sitl.px4sim.state.px4_modes import FlightMode

GROUND_CONTROL: Final = 190
SET_MODE, SET_HOME, CHANGE_SPEED, ARM_DISARM = 176, 179, 178, 400  # MAV_CMD
ZONE_M: Final = 15.0
STOP_M: Final = 12.0
REAL32: Final = 9  # MAV_PARAM_TYPE
INT32: Final = 6
_EXCLUSION: Final = 5002
_AHEAD: Final = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))

Tell = Callable[[MessagePacker, str, Mapping[str, Any]], object]


class Stations:
    """Two ground stations, a pilot's transmitter, and what they do to a vehicle.

    Args:
        vehicle: Theirs.
        tell: Takes every message that they send, for the record.
    """

    def __init__(self, vehicle: MavlinkVehicle, tell: Tell) -> None:
        self._vehicle = vehicle
        self._tell = tell
        self._senders = (
            MessagePacker(255, GROUND_CONTROL),
            MessagePacker(254, GROUND_CONTROL),
        )  # by `station`
        self._plan_ids = 1 << 20  # counted up: no two plans look alike to the vehicle

    # Messages

    def send(self, name: str, fields: Mapping[str, Any], *, station: int = 0) -> None:
        """One of the stations sends this."""
        sender, vehicle = self._senders[station], self._vehicle
        self._tell(sender, name, fields)
        vehicle.receive(vehicle.ground, sender.pack(name, fields))

    def command(self, number: int, *params: float, station: int = 0) -> None:
        """A COMMAND_LONG."""
        values = (*params, *(0.0,) * (7 - len(params)))
        fields = {f"param{n}": value for n, value in enumerate(values, start=1)}
        target = {"target_system": 1, "target_component": 1}
        self.send("COMMAND_LONG", {**target, "command": number, **fields}, station=station)

    def choose(self, mode: FlightMode, *, station: int = 0) -> bool:
        """Choose a mode; whether the vehicle took it."""
        main, sub = mode.custom_mode >> 16 & 0xFF, mode.custom_mode >> 24 & 0xFF
        self.command(SET_MODE, 1.0, float(main), float(sub), station=station)
        return self._vehicle.autopilot.intended is mode

    def sticks(self, pitch: float = 0.0, roll: float = 0.0) -> None:
        """The transmitter says where its sticks are; throttle in the middle."""
        fields = {"target": 1, "x": pitch * 1000, "y": roll * 1000, "z": 500, "r": 0, "buttons": 0}
        self.send("MANUAL_CONTROL", fields)

    def download(self) -> None:
        """Begin to download the plan over the companion's own link, and leave it at that."""
        vehicle, sender = self._vehicle, self._senders[1]
        fields = {"target_system": 1, "target_component": 1, "mission_type": 0}
        self._tell(sender, "MISSION_REQUEST_LIST", fields)
        vehicle.receive(vehicle.onboard, sender.pack("MISSION_REQUEST_LIST", fields))

    def downloaded(self) -> None:
        """The download is over."""
        vehicle, sender = self._vehicle, self._senders[1]
        fields = {"target_system": 1, "target_component": 1, "mission_type": 0, "type": 0}
        self._tell(sender, "MISSION_ACK", fields)
        vehicle.receive(vehicle.onboard, sender.pack("MISSION_ACK", fields))

    def set_home(self, latitude_deg: float, longitude_deg: float, amsl_m: float) -> None:
        """DO_SET_HOME."""
        place = {"x": latitude_deg * 1e7, "y": longitude_deg * 1e7, "z": amsl_m, "frame": 5}
        target = {"target_system": 1, "target_component": 1, "command": SET_HOME}
        self.send("COMMAND_INT", {**target, **place})

    def parameter(self, name: str, value: float) -> None:
        """Set a parameter of the simulation, by no message."""
        parameters = self._vehicle.autopilot.parameters
        if isinstance(parameters[name], int):
            (bits,) = struct.unpack("<f", struct.pack("<i", int(value)))
            parameters.set(name, bits, INT32)
        else:
            parameters.set(name, value, REAL32)

    # Plans: stored as an upload has stored them in the end

    def same_plan(self) -> None:
        """The mission on board again, its coordinates rounded otherwise."""
        items = self._items(MissionType.MISSION)
        self._store(MissionType.MISSION, tuple(replace(i, x=i.x + 1) for i in items))

    def other_plan(self) -> None:
        """The same places in another order."""
        first, *others = self._items(MissionType.MISSION)
        self._store(MissionType.MISSION, (first, *reversed(others)))

    def delete(self, kind: MissionType) -> None:
        """Nothing is on board any more."""
        self._store(kind, ())

    def add_zone(self, ahead_m: float) -> None:
        """The fence on board gets one more zone, ahead of the vehicle."""
        airframe = self._vehicle.autopilot.airframe
        north, east = airframe.velocity_north_m_s, airframe.velocity_east_m_s
        speed_m_s = math.hypot(north, east)
        north, east = (north / speed_m_s, east / speed_m_s) if speed_m_s > 1.0 else (0.0, 1.0)
        ahead_m += STOP_M + ZONE_M
        middle = airframe.north_m + north * ahead_m, airframe.east_m + east * ahead_m
        projection = self._vehicle.autopilot.situation.projection
        zone = []
        for n, e in _AHEAD:
            corner = middle[0] + n * ZONE_M / 1.5, middle[1] + e * ZONE_M / 1.5
            x, y = (round(degrees * 1e7) for degrees in projection.to_global(*corner))
            params = (float(len(_AHEAD)), 0.0, 0.0, 0.0)
            zone.append(MissionItem(5, Command(_EXCLUSION), False, params, x, y, 0.0))
        self._store(MissionType.FENCE, (*self._items(MissionType.FENCE), *zone))

    def divert(self) -> bool:
        """Make another item of the plan the current one; whether there is one."""
        autopilot = self._vehicle.autopilot
        last = len(self._items(MissionType.MISSION)) - 1
        if last < 1:
            return False
        item = last if autopilot.mission.index != last else last - 1
        fields = {"target_system": 1, "target_component": 1, "seq": item}
        self.send("MISSION_SET_CURRENT", fields)
        return True

    def _items(self, kind: MissionType) -> tuple[MissionItem, ...]:
        return self._vehicle.autopilot.plan.items(kind)

    def _store(self, kind: MissionType, items: tuple[MissionItem, ...]) -> None:
        self._plan_ids += 1
        self._vehicle.autopilot.plan.store(kind, items, self._plan_ids, 0)
        self._vehicle.autopilot.take_up_plan()
