"""What a pilot, ground stations and strangers send to a vehicle, and what they put on board."""

from __future__ import annotations

import functools
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from sitl.mavlink import MavlinkLink, MavlinkVehicle, Sender, addressed
from sitl.px4sim import Command, FlightMode, MissionItem, MissionType

_REAL32 = 9  # MAV_PARAM_TYPE
_EXCLUSION: Final = 5002
_POLYGONS: Final = frozenset({5001, 5002})
_METRE_E7: Final = 117  # of longitude, at 40 degrees
_AHEAD: Final = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
_ZONE_M: Final = 15.0
_STOP_M: Final = 12.0

_GROUND_CONTROL: Final = 190
_SET_MODE, _CHANGE_SPEED, _SET_HOME, _ARM_DISARM = 176, 178, 179, 400  # MAV_CMD
_FORCED: Final = 21196.0
_FLOOD: Final = 300
_LANDS, _ACTIVE, _EMERGENCY = 0x06040000, 4, 6  # of HEARTBEAT: AUTO, LAND; MAV_STATE

Send = Callable[[Sender, str, Mapping[str, Any]], object]
"""Takes a message: its sender, its name and its fields."""

Answered = Callable[[Sender, int, int], object]


class Station:
    """A ground station with a pilot's transmitter.

    Args:
        system: Its system id.
        send: Takes every message that it sends to the vehicle.
        vehicle: The vehicle's system id.
    """

    def __init__(self, system: int, send: Send, vehicle: int = 1) -> None:
        self._sender = Sender(system, _GROUND_CONTROL)
        self._send, self._vehicle = send, vehicle

    def send(self, name: str, **fields: Any) -> None:
        """Send a message to the vehicle; fields that are not given are 0."""
        self._send(self._sender, name, addressed(name, self._vehicle, fields))

    def command(self, number: int, *params: float) -> None:
        """A COMMAND_LONG."""
        fields = {f"param{n}": value for n, value in enumerate(params, start=1)}
        self.send("COMMAND_LONG", command=number, **fields)

    def choose(self, mode: FlightMode) -> None:
        """DO_SET_MODE."""
        self.command(_SET_MODE, 1.0, *mode.value[:2])

    def arm(self) -> None:
        """As the pilot's switch does."""
        self.command(_ARM_DISARM, 1.0)

    def disarm(self, *, forced: bool) -> None:
        """As it is: refused in the air, unless it is forced."""
        self.command(_ARM_DISARM, 0.0, _FORCED if forced else 0.0)

    def change_speed(self, speed_m_s: float) -> None:
        """DO_CHANGE_SPEED over ground."""
        self.command(_CHANGE_SPEED, 1.0, speed_m_s, -1.0)

    def move_home(self, latitude_deg: float, longitude_deg: float, amsl_m: float) -> None:
        """DO_SET_HOME to a place."""
        place = {"x": latitude_deg * 1e7, "y": longitude_deg * 1e7, "z": amsl_m, "frame": 5}
        self.send("COMMAND_INT", command=_SET_HOME, **place)

    def sticks(self, pitch: float = 0.0, roll: float = 0.0) -> None:
        """The transmitter sends the positions of its sticks, -1 to 1; throttle in the middle."""
        self.send("MANUAL_CONTROL", x=pitch * 1000, y=roll * 1000, z=500)

    def set_parameter(self, name: str, value: float) -> None:
        """PARAM_SET of a real number."""
        self.send("PARAM_SET", param_id=name, param_value=value, param_type=_REAL32)


class Stations:
    """Two ground stations, and what they do to a vehicle in this process.

    Args:
        vehicle: Theirs.
        record: Takes every message that they send.
        answered: Takes PX4's acknowledgement of a stored list: its receiver, kind and id.

    Attributes:
        first: The pilot's, too.
        second: Another one.
        beside: That one over the companion's own link.
    """

    def __init__(self, vehicle: MavlinkVehicle, record: Send, answered: Answered) -> None:
        self._vehicle, self._answered = vehicle, answered
        self._plan_ids = 1 << 20  # counted up: no two plans look alike to the vehicle

        def send(link: MavlinkLink, sender: Sender, name: str, fields: Mapping[str, Any]) -> None:
            record(sender, name, fields)
            vehicle.receive(link, sender.pack_values(name, fields))

        ground = functools.partial(send, vehicle.ground)
        self.first, self.second = Station(255, ground), Station(254, ground)
        self.beside = Station(254, functools.partial(send, vehicle.onboard))

    def chosen(self, mode: FlightMode, station: Station) -> bool:
        """Choose a mode; whether the vehicle took it."""
        station.choose(mode)
        return self._vehicle.autopilot.intended is mode

    # Plans: stored as an upload has stored them in the end; PX4 takes one at a time

    @property
    def may_upload(self) -> bool:
        """Whether PX4 takes a plan now: while it takes another it answers with an error."""
        return not self._vehicle.autopilot.plan.transferring

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
        ahead_m += _STOP_M + _ZONE_M
        middle = airframe.north_m + north * ahead_m, airframe.east_m + east * ahead_m
        projection = self._vehicle.autopilot.situation.projection
        zone = []
        for n, e in _AHEAD:
            corner = middle[0] + n * _ZONE_M / 1.5, middle[1] + e * _ZONE_M / 1.5
            x, y = (round(degrees * 1e7) for degrees in projection.to_global(*corner))
            params = (float(len(_AHEAD)), 0.0, 0.0, 0.0)
            zone.append(MissionItem(5, Command(_EXCLUSION), False, params, x, y, 0.0))
        self._store(MissionType.FENCE, (*self._items(MissionType.FENCE), *zone))

    def move_fence(self, off_m: float, rng: random.Random) -> None:
        """The fence gets other places for one of its areas: as many points as before."""
        items = list(self._items(MissionType.FENCE))
        if not items:
            return
        first = rng.randrange(len(items))
        run = int(items[first].params[0]) if items[first].command in _POLYGONS else 1
        east_e7 = round(off_m * _METRE_E7)
        for number in range(first, min(first + run, len(items))):
            if items[number].command == items[first].command:
                items[number] = replace(items[number], y=items[number].y + east_e7)
        self._store(MissionType.FENCE, tuple(items))

    def divert(self, towards: tuple[float, float] | None = None) -> bool:
        """Make another item of the plan the current one; whether there is one.

        Args:
            towards: The one that is most in this direction: north and east; None: the last.
        """
        autopilot = self._vehicle.autopilot
        items = self._items(MissionType.MISSION)
        last = len(items) - 1
        if last < 1:
            return False
        item = last if autopilot.mission.index != last else last - 1
        if towards is not None:
            places = {n: i for n, i in enumerate(items) if i.command == Command.NAV_WAYPOINT}
            item = max(places, key=lambda n: self._along(places[n], towards), default=item)
        self.first.send("MISSION_SET_CURRENT", seq=item)
        return True

    def _along(self, item: MissionItem, towards: tuple[float, float]) -> float:
        """How much an item lies in a direction: the cosine."""
        situation = self._vehicle.autopilot.situation
        north_m, east_m = situation.projection.to_local(item.x / 1e7, item.y / 1e7)
        way = north_m - situation.north_m, east_m - situation.east_m
        return (way[0] * towards[0] + way[1] * towards[1]) / max(math.hypot(*way), 1e-6)

    def _items(self, kind: MissionType) -> tuple[MissionItem, ...]:
        return self._vehicle.autopilot.plan.items(kind)

    def _store(self, kind: MissionType, items: tuple[MissionItem, ...]) -> None:
        self._plan_ids += 1
        self._vehicle.autopilot.plan.store(kind, items, self._plan_ids, 0)
        self._vehicle.autopilot.take_up_plan()
        self._answered(Sender(255, _GROUND_CONTROL), kind.value, self._plan_ids)


def intrusion(kind: str, rng: random.Random) -> list[bytes]:
    """The datagrams of one kind; see `programs.scenes`."""
    pack = Sender(1).pack_values
    heartbeat = {"type": 2, "autopilot": 12, "custom_mode": _LANDS, "mavlink_version": 3}
    if kind == "noise":
        return [rng.randbytes(rng.randrange(1, 300)) for _ in range(20)]
    if kind == "truncated":
        whole = pack("HEARTBEAT", {**heartbeat, "system_status": _ACTIVE})
        return [whole[:length] for length in range(1, len(whole))]
    if kind == "flood":
        return [pack("PING", {"seq": number}) for number in range(_FLOOD)]
    if kind == "other vehicle":
        emergency = {**heartbeat, "system_status": _EMERGENCY}
        return [Sender(2).pack_values("HEARTBEAT", emergency)]
    boot = {"time_boot_ms": 1000}  # as a vehicle that has just been started
    place = {"lat": 399421523, "lon": -751997644}
    return [
        pack("SYSTEM_TIME", boot),
        pack("GLOBAL_POSITION_INT", {**boot, **place}),
        pack("ATTITUDE", boot),
    ]


GIMBAL, CAMERA, OTHER_COMPANION, OSD = 154, 100, 192, 201  # MAV_COMP_ID
_POSITION_MODE: Final = 3 << 16
FOREIGN: Final = ((1, GIMBAL), (1, OTHER_COMPANION), (1, CAMERA), (1, OSD), (2, 1))
"""System id and component id of the other senders on the link of system 1."""


def foreign_messages(now_s: float) -> list[tuple[tuple[int, int], str, dict[str, Any]]]:
    """Messages of components of the same system, and of another vehicle: by turns.

    Each would end the flight, or make it hold, if it counted as the autopilot's.
    """
    messages, turn = foreign_vocabulary(round(now_s * 1e3)), round(now_s * 10.0)
    name, fields = messages[turn % len(messages)]
    return [(FOREIGN[(turn // len(messages)) % len(FOREIGN)], name, fields)]


def foreign_vocabulary(boot_ms: int) -> tuple[tuple[str, dict[str, Any]], ...]:
    """Names and fields of their messages: landed, disarmed, empty, elsewhere, in another mode."""
    return (
        (
            "HEARTBEAT",
            {
                "type": 26,
                "autopilot": 8,
                "base_mode": 0,
                "custom_mode": _POSITION_MODE,
                "system_status": _EMERGENCY,
                "mavlink_version": 3,
            },
        ),
        (
            "CURRENT_MODE",
            {"standard_mode": 7, "custom_mode": _LANDS, "intended_custom_mode": _LANDS},
        ),
        ("EXTENDED_SYS_STATE", {"vtol_state": 0, "landed_state": 1}),
        (
            "SYS_STATUS",
            {
                "battery_remaining": 0,
                "voltage_battery": 9_000,
                "onboard_control_sensors_health": 0,
            },
        ),
        (
            "GPS_RAW_INT",
            {
                "fix_type": 0,
                "satellites_visible": 0,
                "h_acc": 0,
                "alt": 0,
                "time_usec": boot_ms * 1000,
            },
        ),
        ("MISSION_CURRENT", {"seq": 0, "total": 3, "mission_state": 1, "mission_id": 77}),
        (
            "GLOBAL_POSITION_INT",
            {
                "time_boot_ms": boot_ms,
                "lat": 0,
                "lon": 0,
                "alt": 0,
                "relative_alt": 0,
                "vx": 0,
                "vy": 0,
                "vz": 0,
                "hdg": 0,
            },
        ),
        (
            "POSITION_TARGET_GLOBAL_INT",
            {"time_boot_ms": boot_ms, "lat_int": 1, "lon_int": 1, "alt": 0.0},
        ),
    )
