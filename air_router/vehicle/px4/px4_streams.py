"""Plausibility and age of a PX4's messages. Pure.

The mode is combined from two messages that may contradict each other for a moment. A position has
to be plausible after the previous one. A stream ages if it repeats itself, or stops while others
continue.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from air_router.vehicle import LANDED_STATE_S, Ages, FlightMode
from air_router.vehicle.px4.limits import (
    FLYING_M,
    MODE_SETTLED_S,
    MOVING_CM_S,
    POSITION_AHEAD_S,
    POSITION_BACK_S,
    POSITION_JUMP_M,
    POSITION_LATE_MS,
    POSITION_SPEED_M_S,
    POSITIONS_AGREEING,
    POSITIONS_QUIET_S,
    STREAM_PAUSE_S,
)
from air_router.vehicle.px4.mavlink_values import ARMED, CRITICAL, MAIN_AUTO, ON_GROUND, TERMINATED
from geo.frame import Point

_Fields = Mapping[str, Any]


_AUTO_MODES: Final[Mapping[int, FlightMode]] = {
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    4: FlightMode.MISSION,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
}
_MANUAL_MODES: Final = MappingProxyType({2: FlightMode.ALTITUDE, 3: FlightMode.POSITION})
_SUB_MODES: Final = MappingProxyType({mode: sub for sub, mode in _AUTO_MODES.items()})


def flight_mode(custom_mode: int) -> FlightMode:
    """The mode in custom_mode of HEARTBEAT or CURRENT_MODE: main and sub mode bytes."""
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main != MAIN_AUTO:
        return FlightMode.OTHER if sub else _MANUAL_MODES.get(main, FlightMode.OTHER)
    return _AUTO_MODES.get(sub, FlightMode.OTHER)


def sub_mode(mode: FlightMode) -> int:
    """The sub mode of an automatic mode (main mode `MAIN_AUTO`). Raises KeyError."""
    return _SUB_MODES[mode]


@dataclass(slots=True)
class ModeState:
    """Mode, arming and failsafe, from HEARTBEAT and CURRENT_MODE.

    PX4 returns to the mode before a landing when it disarms. CURRENT_MODE, which does not include
    arming, may report that up to a second before HEARTBEAT. Until then `reported` stays Land, and
    an intended mode other than Land is no failsafe.

    Attributes:
        mode: The last mode of either message.
        reported: The same, but Land until it is known whether disarming ended it.
        armed, terminated: By the last HEARTBEAT.
        failsafe: By the newer message: critical, or in another mode than intended.
        known: Whether a HEARTBEAT was received.
    """

    mode: FlightMode = FlightMode.OTHER
    reported: FlightMode = FlightMode.OTHER
    armed: bool = False
    terminated: bool = False
    failsafe: bool = False
    known: bool = False
    _landing_left_s: float | None = None  # Land has ended; PX4 may disarm
    _overruled: bool = False  # in another mode than intended

    def heartbeat(self, fields: _Fields) -> bool:
        """Handle a HEARTBEAT; return whether the mode has changed."""
        self.known = True
        self.armed = bool(fields["base_mode"] & ARMED)
        self.failsafe = fields["system_status"] >= CRITICAL
        self.terminated = fields["system_status"] == TERMINATED
        before, self.mode = self.mode, flight_mode(fields["custom_mode"])
        self._landing_left_s, self._overruled = None, False
        self.reported = self.mode
        return self.mode is not before

    def current_mode(self, fields: _Fields, now_s: float) -> bool:
        """Handle a CURRENT_MODE; return whether the mode has changed."""
        custom, intended = fields["custom_mode"], fields.get("intended_custom_mode", 0)
        before, self.mode = self.mode, flight_mode(custom)
        self._overruled = self.armed and intended not in {0, custom}
        landed = before is FlightMode.LAND and (self._overruled or self.mode is not before)
        if landed and self._landing_left_s is None:
            self._landing_left_s = now_s
        self.expire(now_s)
        return self.mode is not before

    def expire(self, now_s: float) -> None:
        """After a time-out, report a new mode even without a HEARTBEAT."""
        since_s = self._landing_left_s
        in_doubt = self._overruled or self.mode is not self.reported
        if since_s is not None and now_s - since_s < MODE_SETTLED_S and in_doubt:
            return
        self._landing_left_s = None
        self.reported = self.mode
        self.failsafe = self.failsafe or self._overruled


_AGES: Final[Mapping[str, str]] = {
    "GLOBAL_POSITION_INT": "position_s",
    "HEARTBEAT": "armed_s",
    "SYS_STATUS": "battery_s",
    "GPS_RAW_INT": "fix_s",
    "EXTENDED_SYS_STATE": "landed_s",
    "MISSION_CURRENT": "item_s",
    "POSITION_TARGET_GLOBAL_INT": "target_s",
}


class Streams:
    """Measures the ages of all streams, in vehicle time while anything is received.

    Attributes:
        received_s: Vehicle time with reception.
    """

    def __init__(self) -> None:
        self.received_s = 0.0
        self._targets_from_s = 0.0  # earlier targets, on the vehicle's clock, are another mode's
        self._last_s: float | None = None  # last reception, monotonic
        self._at_s: dict[str, tuple[float, float]] = {}  # by message: newest and previous
        self._position: _Fields | None = None  # the newest, plausible or not
        self._believed: _Fields | None = None  # the newest plausible one
        self._gps_us = 0  # timestamp of the newest fix

    def message(self, arrived_s: float, rate: float, most_s: float = STREAM_PAUSE_S) -> None:
        """Note the reception of any message.

        Args:
            arrived_s: Time of reception on our clock.
            rate: Rate of the vehicle's clock relative to ours.
            most_s: Largest advance of the vehicle's time since the previous message.
        """
        if self._last_s is not None:
            passed_s = max(0.0, arrived_s - self._last_s) * rate
            self.received_s += min(passed_s, most_s, STREAM_PAUSE_S)
        self._last_s = max(arrived_s, self._last_s or arrived_s)

    def is_new(self, name: str, fields: _Fields, *, armed: bool) -> bool:
        """Whether a message counts: not late, frozen, or contradicted by the motion."""
        match name:
            case "GLOBAL_POSITION_INT":
                is_new = self._is_position(fields)
            case "GPS_RAW_INT":
                before_us, self._gps_us = self._gps_us, fields.get("time_usec", 0)
                is_new = self._gps_us == 0 or self._gps_us != before_us
            case "EXTENDED_SYS_STATE":
                is_new = not (
                    fields["landed_state"] == ON_GROUND and armed and self.moves_above(FLYING_M)
                )
            case "POSITION_TARGET_GLOBAL_INT":
                is_new = fields["time_boot_ms"] / 1e3 >= self._targets_from_s
            case _:
                is_new = True
        if is_new:
            before_s, _ = self._at_s.get(name, (self.received_s, 0.0))
            self._at_s[name] = (self.received_s, before_s)
        return is_new

    def void_targets_before(self, time_s: float) -> None:
        """Ignore targets reported before this vehicle time: they are another mode's."""
        self._targets_from_s = time_s

    def void(self, name: str) -> None:
        """Ignore the last message of this name: it has no usable content."""
        if name in self._at_s:
            _, before_s = self._at_s[name]
            self._at_s[name] = (before_s, before_s)
            if name == "GLOBAL_POSITION_INT":
                self._position = self._believed

    def ages(self) -> Ages:
        """The current ages, rounded for records."""
        ages = {age: self._age_s(name) for name, age in _AGES.items()}
        return Ages(**ages, mode_s=min(self._age_s("HEARTBEAT"), self._mode_age_s()))

    def missing(self, age_s: float) -> list[str]:
        """Streams that have been missing for this long while others are received."""
        return [name for name in _AGES if self._age_s(name) >= age_s]

    def _mode_age_s(self) -> float:
        return self._age_s("CURRENT_MODE") if "CURRENT_MODE" in self._at_s else math.inf

    def _age_s(self, name: str) -> float:
        at_s, _ = self._at_s.get(name, (self.received_s, 0.0))
        return round(self.received_s - at_s, 1)

    def _is_position(self, fields: _Fields) -> bool:
        """Whether a position is not late, and no repetition in spite of a velocity."""
        last = self._believed = self._position
        if last is None:
            self._position = fields
            return True
        if -POSITION_LATE_MS <= fields["time_boot_ms"] - last["time_boot_ms"] <= 0:
            return False
        self._position = fields
        moves = math.hypot(fields["vx"], fields["vy"]) >= MOVING_CM_S
        climbs = abs(fields["vz"]) >= MOVING_CM_S
        return not (
            (moves and (fields["lat"], fields["lon"]) == (last["lat"], last["lon"]))
            or (climbs and fields["alt"] == last["alt"])
        )

    def moves_above(self, height_m: float) -> bool:
        """Whether the vehicle moves above this altitude, by its last position."""
        last = self._position
        if last is None or last["relative_alt"] < height_m * 1e3:
            return False
        return math.hypot(last["vx"], last["vy"], last["vz"]) >= MOVING_CM_S

    def height_m(self) -> float:
        """Altitude above PX4's home, by the last position; 0 before the first."""
        return 0.0 if self._position is None else float(self._position["relative_alt"]) / 1e3

    def in_air(self, landed_state: bool, *, armed: bool) -> bool:
        """Whether the vehicle is in the air, by its landed state or (if missing) altitude."""
        if self._age_s("EXTENDED_SYS_STATE") <= LANDED_STATE_S:
            return landed_state
        high = self._position is not None and self._position["relative_alt"] >= FLYING_M * 1e3
        return armed and (landed_state or high)


class ReportedPosition(NamedTuple):
    """A position message: seconds since boot; meters east/north of the origin."""

    boot_s: float
    position: Point


class Continuity:
    """Decides for each position whether it is plausible. Has no clock of its own."""

    def __init__(self) -> None:
        self._last: ReportedPosition | None = None  # the newest accepted one
        self._last_s = -math.inf  # its reception
        self._doubted: ReportedPosition | None = None  # the newest rejected one
        self._count = 0  # consistent rejected ones

    def believes(self, position: ReportedPosition, now_s: float, rate: float) -> bool:
        """Whether to accept a position received at `now_s` of our monotonic clock.

        `rate` is the vehicle's seconds per second of ours: 1 outside of simulations.
        """
        rate = max(rate, 1.0)
        if self._last is None or _follows(self._last, position, rate):
            self._doubted, self._count = None, 0
        else:
            agrees = self._doubted is not None and _follows(self._doubted, position, rate)
            self._doubted, self._count = position, self._count + 1 if agrees else 1
            if self._count < POSITIONS_AGREEING or now_s - self._last_s < POSITIONS_QUIET_S / rate:
                return False
            self._doubted, self._count = None, 0
        self._last, self._last_s = position, now_s
        return True


def _follows(before: ReportedPosition, after: ReportedPosition, rate: float) -> bool:
    passed_s = after.boot_s - before.boot_s
    if not -POSITION_BACK_S <= passed_s <= POSITION_AHEAD_S * rate:
        return False
    way_m = math.dist(tuple(before.position), tuple(after.position))
    return way_m <= POSITION_JUMP_M + POSITION_SPEED_M_S * max(passed_s, 0.0)
