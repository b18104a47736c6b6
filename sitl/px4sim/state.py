"""What the parts of the simulated autopilot share: its modes, its notices, what it believes."""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from importlib import resources
from typing import Final, Self

from sitl.px4sim.motion import Setpoint, SpeedLimits
from sitl.px4sim.parameters import Parameters

CUSTOM_MODE_ENABLED: Final = 1  # MAV_MODE_FLAG
_AUTO_MODE_ENABLED: Final = 4
_AUTO_MAIN: Final = 4
_BY_STICKS: Final = {(2, 0), (3, 0)}  # Altitude and Position: a pilot flies it
_NOT_TO_ARM_IN: Final = {(4, 5), (4, 6), (10, 0)}  # Return, Land and Termination


class UnsupportedAutoModeError(Exception):
    """A DO_SET_MODE names an AUTO submode that PX4 does not have."""


class FlightMode(Enum):
    """A mode: PX4's main and sub mode, its name in PX4's texts, and flags of HEARTBEAT.base_mode.

    Manual, Acro and Stabilized are left out. ORBIT and OFFBOARD are known, but never flown here.

    The values are those of px4_custom_mode.h; in HEARTBEAT.custom_mode the main mode is in bits
    16..23 and the submode in bits 24..31.
    """

    ALTCTL = (2, 0, "Altitude", 0x51)
    POSCTL = (3, 0, "Position", 0x51)
    ORBIT = (3, 1, "Orbit", 0x1D)
    AUTO_TAKEOFF = (4, 2, "Takeoff", 0x1D)
    AUTO_LOITER = (4, 3, "Hold", 0x1D)
    AUTO_MISSION = (4, 4, "Mission", 0x1D)
    AUTO_RTL = (4, 5, "Return", 0x1D)
    AUTO_LAND = (4, 6, "Land", 0x1D)
    OFFBOARD = (6, 0, "Offboard", 0x11)
    TERMINATION = (10, 0, "Termination", 0x01)

    __hash__ = object.__hash__  # looked up some hundred times a simulated second

    def __init__(self, main: int, sub: int, label: str, base_mode: int) -> None:
        self.custom_mode = main << 16 | sub << 24
        self.label = label
        self.base_mode = base_mode
        self.needs_pilot = (main, sub) in _BY_STICKS
        self.prevents_arming = (main, sub) in _NOT_TO_ARM_IN


_BY_NUMBER: Final = {(mode.value[0], mode.value[1]): mode for mode in FlightMode}
_BY_MAIN: Final = {
    main: mode
    for (main, sub), mode in _BY_NUMBER.items()
    if sub == 0 and mode is not FlightMode.TERMINATION
}


def requested_mode(base_mode: int, main: int, sub: int) -> FlightMode | None:
    """The mode that a DO_SET_MODE or SET_MODE requests; None is PX4's silent "nothing to do".

    Raises:
        UnsupportedAutoModeError: no such AUTO submode.
    """
    if not base_mode & CUSTOM_MODE_ENABLED:
        return FlightMode.AUTO_MISSION if base_mode & _AUTO_MODE_ENABLED else None
    if main != _AUTO_MAIN:
        return _BY_MAIN.get(main)
    if sub == 0:
        return FlightMode.AUTO_MISSION
    try:
        return _BY_NUMBER[(main, sub)]
    except KeyError:
        raise UnsupportedAutoModeError(f"AUTO submode {sub}") from None


class Severity(IntEnum):
    """MAV_SEVERITY, and the log levels of events."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


EVENTS: Final = {
    line.partition("\t")[0]: line.split("\t")[1:]
    for line in resources.files("sitl").joinpath("px4_1_17_events.tsv").read_text().splitlines()
    if not line.startswith("#")
}
_FNV_OFFSET: Final = 0x811C9DC5
_FNV_PRIME: Final = 0x01000193
_AUTOPILOT_COMPONENT: Final = 1


@dataclass(frozen=True, slots=True)
class Notice:
    """One announcement: a STATUSTEXT, an EVENT, or both.

    PX4 writes most of its texts twice: as a STATUSTEXT, which only ground stations are sent, and
    as an EVENT with a numeric id, which every link gets. A text that has an event twin ends in a
    tab, so that a ground station that shows events can leave it out.

    Attributes:
        severity: Of the text.
        text: The STATUSTEXT; empty if there is only an event.
        event: PX4's name of the event, such as `commander_armed_by`; empty if there is none.
        event_severity: The event's own level, mostly that of the text; 8 is for programs only.
        arguments: The event's arguments, as on the wire.
    """

    severity: Severity
    text: str = ""
    event: str = ""
    event_severity: int | None = None
    arguments: bytes = b""

    @classmethod
    def of(cls, event: str, *values: float, **details: str) -> Self:
        """One of PX4's events; `values` are its arguments, `details` fill its text."""
        severity, level, layout, text = EVENTS[event]
        filled = text.format(*values, **details)
        packed = struct.pack(f"<{layout}", *values)
        return cls(Severity(int(severity)), filled, event, int(level) if level else None, packed)

    @property
    def status_text(self) -> str:
        """The text as PX4 sends it."""
        return f"{self.text}\t" if self.text and self.event else self.text

    @property
    def event_id(self) -> int:
        """The EVENT's id: component in the top byte, FNV-1a hash of the name below."""
        value = _FNV_OFFSET
        for byte in self.event.encode():
            value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
        return _AUTOPILOT_COMPONENT << 24 | value & 0xFFFFFF

    @property
    def log_levels(self) -> int:
        """EVENT.log_levels: internal level in the upper half byte, external in the lower."""
        level = self.severity if self.event_severity is None else self.event_severity
        return level << 4 | level


@dataclass(frozen=True, slots=True)
class StartPosition:
    """Where the vehicle is started: WGS-84 degrees, metres AMSL."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


_EARTH_RADIUS_M: Final = 6371000.0


class MapProjection:
    """Degrees to local metres and back, the way PX4 does it, so that straight lines are PX4's.

    An azimuthal equidistant projection on a sphere, around the place where it was started.

    Args:
        latitude_deg: Of the origin.
        longitude_deg: Of the origin.
    """

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        self._origin = (latitude_deg, longitude_deg)
        latitude_rad = math.radians(latitude_deg)
        self._longitude_rad = math.radians(longitude_deg)
        self._sin_latitude = math.sin(latitude_rad)  # of the origin
        self._cos_latitude = math.cos(latitude_rad)

    def to_local(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Metres (north, east) of the origin; any pair of numbers of degrees is taken."""
        latitude_rad = math.radians(latitude_deg)
        difference_rad = math.radians(longitude_deg) - self._longitude_rad
        sin_latitude, cos_latitude = math.sin(latitude_rad), math.cos(latitude_rad)
        cos_difference = math.cos(difference_rad)
        cosine = (
            self._sin_latitude * sin_latitude + self._cos_latitude * cos_latitude * cos_difference
        )
        angle_rad = math.acos(max(-1.0, min(1.0, cosine)))
        sine = math.sin(angle_rad)
        scale_m = _EARTH_RADIUS_M * (angle_rad / sine if sine > 1e-12 else 1.0)
        north = (
            self._cos_latitude * sin_latitude - self._sin_latitude * cos_latitude * cos_difference
        )
        return north * scale_m, cos_latitude * math.sin(difference_rad) * scale_m

    def to_global(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Degrees (latitude, longitude) of a local point."""
        north_rad, east_rad = north_m / _EARTH_RADIUS_M, east_m / _EARTH_RADIUS_M
        angle_rad = math.hypot(north_rad, east_rad)
        if angle_rad == 0.0:
            return self._origin
        sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
        sin_latitude = (
            cosine * self._sin_latitude + north_rad * sine * self._cos_latitude / angle_rad
        )
        longitude_rad = self._longitude_rad + math.atan2(
            east_rad * sine,
            angle_rad * self._cos_latitude * cosine - north_rad * self._sin_latitude * sine,
        )
        latitude_rad = math.asin(max(-1.0, min(1.0, sin_latitude)))
        return math.degrees(latitude_rad), math.degrees(longitude_rad)


@dataclass(slots=True)
class Situation:
    """The autopilot's knowledge at one moment; it renews the numbers every step.

    Attributes:
        projection: Degrees to local metres and back.
        parameters: On board.
        request_mode: Lets a mission or a finished mode request another mode.
        time_s: Since start.
        north_m: Estimated.
        east_m: Estimated.
        altitude_m: Estimated, AMSL.
        velocity_m_s: North, east, up.
        heading_rad: Of the nose.
        position_valid: Whether the position is good enough to fly by.
        landed: Whether it stands on the ground.
        took_off_s: When it took off since it was armed; None if it has not.
        armed: Whether the motors turn.
        home: North, east in metres, once set.
        home_altitude_m: AMSL; wanders in flight.
        ground_altitude_m: AMSL, of the flat ground.
        speed_m_s: Cruise speed that was requested in this mode; None: MPC_XY_CRUISE.
        setpoint: The target of the flight controller.
        notices: Announced and not yet sent.
    """

    projection: MapProjection
    parameters: Parameters
    request_mode: Callable[[FlightMode], object]
    ground_altitude_m: float
    time_s: float = 0.0
    north_m: float = 0.0
    east_m: float = 0.0
    altitude_m: float = 0.0
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading_rad: float = 0.0
    position_valid: bool = True
    landed: bool = True
    took_off_s: float | None = None
    armed: bool = False
    home: tuple[float, float] | None = None
    home_altitude_m: float = 0.0
    speed_m_s: float | None = None
    setpoint: Setpoint = field(default_factory=Setpoint)
    notices: list[Notice] = field(default_factory=list)

    @property
    def here(self) -> tuple[float, float]:
        """North and east."""
        return self.north_m, self.east_m

    @property
    def cruise_m_s(self) -> float:
        """The speed to fly with, within what the vehicle can do."""
        wanted = self.parameters["MPC_XY_CRUISE"] if self.speed_m_s is None else self.speed_m_s
        return max(0.1, min(wanted, self.parameters.limited("MPC_XY_VEL_MAX", 0.1, 20.0)))

    @property
    def acceptance_m(self) -> float:
        """NAV_ACC_RAD."""
        return self.parameters.limited("NAV_ACC_RAD", 0.05, 200.0)

    @property
    def altitude_acceptance_m(self) -> float:
        """NAV_MC_ALT_RAD."""
        return self.parameters.limited("NAV_MC_ALT_RAD", 0.05, 200.0)

    def speed_limits(self) -> SpeedLimits:
        """Speed limits of this moment's parameters."""
        limited = self.parameters.limited
        return SpeedLimits(
            limited("MPC_Z_V_AUTO_UP", 0.5, 8.0),
            limited("MPC_Z_V_AUTO_DN", 0.5, 4.0),
            limited("MPC_TKO_SPEED", 0.5, 5.0),
            limited("MPC_LAND_SPEED", 0.4, 4.0),
            limited("MPC_ACC_HOR", 2.0, 15.0),
            limited("MPC_JERK_AUTO", 1.0, 80.0),
            limited("MPC_XY_VEL_MAX", 0.1, 20.0),
            limited("MPC_Z_VEL_MAX_UP", 0.5, 8.0),
            limited("MPC_Z_VEL_MAX_DN", 0.5, 4.0),
        )

    def announce(self, event: str, *values: float, **details: str) -> None:
        """Announce one of PX4's events; see `Notice.of`."""
        self.notices.append(Notice.of(event, *values, **details))
