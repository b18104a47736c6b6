"""The reports of a PX4, by subject: position, target, plan, GPS, charge and health, identity.

Each part is updated only by the messages that its methods handle. `Px4Telemetry` passes the
messages on and reads the parts. Pure: time is part of the message.
"""

import logging
from collections.abc import Mapping
from typing import Any

from air_router.vehicle import AirframeWatch, GpsFix, HeightFrame, HomeMove, WrongVehicle
from air_router.vehicle.px4.boot_clock import TwinWatch
from air_router.vehicle.px4.limits import GPS_HEIGHT_S, SURELY_FLIES_M
from air_router.vehicle.px4.mavlink_values import (
    ARMED,
    MISSION_ACCEPTED,
    PREARM_GOOD,
    TERMINATED,
    UNKNOWN_16,
)
from air_router.vehicle.px4.plan_guard import PlanGuard, PlanIds
from air_router.vehicle.px4.px4_streams import Continuity, ReportedPosition
from geo.frame import FrameError, LocalFrame, Point

_log = logging.getLogger(__name__)

_Fields = Mapping[str, Any]


class PositionReport:
    """Position and home: GLOBAL_POSITION_INT and HOME_POSITION.

    Args:
        frame: The mission's frame.

    Attributes:
        point: In the mission frame; None before the first.
        time_s: Time of the newest position, since boot.
        altitude_m: Altitude above the home of the take-off.
        altitude_amsl_m: Altitude above mean sea level, as PX4 reports it.
        velocity_m_s: East, north.
        heading_deg: Clockwise from north; None: unknown.
        home: PX4's home in the mission frame; None before it was received.
        home_altitude_amsl_m: Its altitude.
    """

    def __init__(self, frame: LocalFrame) -> None:
        self._frame = frame
        self._continuity = Continuity()
        self._heights = HeightFrame()  # relative to the home of the take-off
        self.point: Point | None = None
        self.time_s = 0.0
        self.altitude_m = 0.0
        self.altitude_amsl_m = 0.0
        self.velocity_m_s = (0.0, 0.0)
        self.heading_deg: float | None = None
        self.home: Point | None = None
        self.home_altitude_amsl_m: float | None = None

    @property
    def home_moved(self) -> HomeMove | None:
        """Offset of PX4's home from the home of the take-off; None: the same."""
        return self._heights.moved

    def point_of(self, fields: _Fields) -> Point | None:
        """The point of a position in the mission frame; None outside the frame's range."""
        try:
            return self._frame.to_local(fields["lat"] / 1e7, fields["lon"] / 1e7)
        except FrameError as error:
            _log.warning("a position of the vehicle is ignored: %s", error)
            return None

    def believes(self, reported: ReportedPosition, now_s: float, rate: float) -> bool:
        """Whether a position is plausible after the previous ones; see `Continuity.believes`."""
        if self._continuity.believes(reported, now_s, rate):
            return True
        _log.info("an implausible position is ignored until others confirm it")
        return False

    def take(
        self, fields: _Fields, reported: ReportedPosition, *, armed: bool, in_air: bool
    ) -> None:
        """Handle a plausible position.

        Args:
            fields: The message's fields.
            reported: Its time and point.
            armed: Whether the vehicle is armed.
            in_air: Whether it may be in the air.
        """
        self.time_s, self.point = reported
        self.altitude_amsl_m = fields["alt"] / 1e3
        above_home_m = fields["relative_alt"] / 1e3
        self.altitude_m = self._heights.altitude_m(
            self.altitude_amsl_m, above_home_m, self.home, armed=armed, in_air=in_air
        )
        self.velocity_m_s = (fields["vy"] / 100, fields["vx"] / 100)  # MAVLink: x north, y east
        self.heading_deg = None if fields["hdg"] == UNKNOWN_16 else fields["hdg"] / 100

    def take_home(self, fields: _Fields) -> None:
        """Handle a HOME_POSITION."""
        try:
            self.home = self._frame.to_local(fields["latitude"] / 1e7, fields["longitude"] / 1e7)
        except FrameError as error:
            _log.warning("the vehicle's home is ignored: %s", error)
            return
        self.home_altitude_amsl_m = fields["altitude"] / 1e3

    def count_heights_from(self, home_amsl_m: float) -> bool:
        """See `Vehicle.count_heights_from`; return whether the current altitude changes."""
        altitude_m = self._heights.took_off_from(home_amsl_m)
        if altitude_m is None:
            return False
        self.altitude_m = altitude_m
        return True

    def above_m(self, amsl_m: float | None) -> float | None:
        """Convert an altitude above sea level to one above the take-off's home; None: unknown."""
        return self._heights.above_m(amsl_m)


class TargetReport:
    """Destination or hover position: POSITION_TARGET_GLOBAL_INT.

    Args:
        frame: The mission's frame.

    Attributes:
        point: In the mission frame; None: not reported.
        amsl_m: Its altitude; None: not reported.
    """

    def __init__(self, frame: LocalFrame) -> None:
        self._frame = frame
        self.point: Point | None = None
        self.amsl_m: float | None = None

    def take(self, fields: _Fields) -> None:
        """Handle a POSITION_TARGET_GLOBAL_INT."""
        self.amsl_m = fields["alt"]
        place = fields["lat_int"] / 1e7, fields["lon_int"] / 1e7
        try:
            self.point = self._frame.to_local(*place) if any(place) else None  # 0, 0: none
        except FrameError:
            self.point = None

    def mode_changed(self) -> None:
        """Forget the target: it was the previous mode's."""
        self.point = None


class PlanReport:
    """The plan on board and its progress: MISSION_CURRENT, _ACK and _ITEM_REACHED.

    Attributes:
        guard: Detects who changed the plan.
        guarding: Changes by others are reported.
        ids: The last reported ids; None before the first.
        item: The current plan item; None before the first report.
        item_total: Number of items on board.
        mission_state: MISSION_CURRENT.mission_state.
        count: Number of MISSION_CURRENT received.
    """

    def __init__(self) -> None:
        self.guard = PlanGuard()
        self.guarding = False
        self.ids: PlanIds | None = None
        self.item: int | None = None
        self.item_total = 0
        self.mission_state = 0
        self.count = 0
        self._last_reached: tuple[int, int | None] | None = None  # seq, current item then

    def watch(self) -> None:
        """Report changes by others from now on."""
        self.guarding = True

    def take(self, fields: _Fields) -> frozenset[int]:
        """Handle a MISSION_CURRENT; return the lists that another sender has changed since."""
        total = fields.get("total", UNKNOWN_16)
        self.item_total = 0 if total == UNKNOWN_16 else total
        self.mission_state = fields.get("mission_state", 0)
        self.count += 1
        self.item = fields["seq"]
        self.ids = PlanIds(*(fields.get(name, 0) for name in PlanIds._fields))
        return self.guard.reported(self.ids)

    def take_ack(self, fields: _Fields) -> None:
        """Handle a MISSION_ACK addressed to us."""
        stored = fields["type"] == MISSION_ACCEPTED
        take = self.guard.stored if stored else self.guard.refused
        take(fields.get("mission_type", 0), fields.get("opaque_id"))

    def take_reached(self, fields: _Fields) -> bool:
        """Handle a MISSION_ITEM_REACHED; return whether it is the first for its item.

        PX4 repeats the report once or twice a second while it holds.
        """
        reached = (fields["seq"], self.item)
        first = reached != self._last_reached
        self._last_reached = reached
        return first


class GpsReport:
    """The satellite receiver: GPS_RAW_INT.

    Attributes:
        fix: The last fix; None until it was received.
    """

    def __init__(self) -> None:
        self.fix: GpsFix | None = None
        self._height: tuple[float, float] | None = None  # metres AMSL, receiver's time

    def take(self, fields: _Fields) -> None:
        """Handle a GPS_RAW_INT."""
        satellites = fields["satellites_visible"]
        accuracy_mm = fields.get("h_acc") or 0
        self.fix = GpsFix(
            kind=fields["fix_type"],
            satellites=None if satellites in {None, 255} else satellites,
            accuracy_m=accuracy_mm / 1e3 if accuracy_mm else None,
        )
        self._height = (fields["alt"] / 1e3, fields["time_usec"] / 1e6)

    def amsl_m(self, now_s: float) -> float | None:
        """The receiver's altitude, with a fix and a recent message.

        Args:
            now_s: Time since the vehicle's boot.
        """
        if self._height is None or self.fix is None or not self.fix.good:
            return None
        amsl_m, at_s = self._height
        return amsl_m if abs(now_s - at_s) <= GPS_HEIGHT_S else None


class SystemStatus:
    """Charge and health: SYS_STATUS.

    Attributes:
        battery: Charge, 0 to 1; None: unknown.
        voltage_v: Voltage; None: unknown.
        health_good: PX4's pre-arm checks pass.
    """

    def __init__(self) -> None:
        self.battery: float | None = None
        self.voltage_v: float | None = None
        self.health_good = False

    def take(self, fields: _Fields) -> bool:
        """Handle a SYS_STATUS; return whether a known charge is still reported."""
        voltage_mv = fields["voltage_battery"]
        self.voltage_v = None if voltage_mv in {None, UNKNOWN_16} else voltage_mv / 1e3
        self.health_good = bool(fields["onboard_control_sensors_health"] & PREARM_GOOD)
        remaining = fields["battery_remaining"]
        if remaining is not None and remaining >= 0:
            self.battery = remaining / 100
            return True
        return self.battery is None


class Identity:
    """Type and number of vehicles on the link: AUTOPILOT_VERSION, HEARTBEAT, clocks.

    Attributes:
        airframes: The reported type.
        version: PX4's version, once received.
    """

    def __init__(self) -> None:
        self.airframes = AirframeWatch()
        self.version: str | None = None
        self._twins = TwinWatch()  # by the clocks of positions
        self._uids: set[int] = set()  # of the autopilots received
        self._disarmed_once = False  # a single HEARTBEAT, perhaps another vehicle's

    @property
    def are_twins(self) -> bool:
        """Whether two autopilots use one system id."""
        return self._twins.apart_s is not None or len(self._uids) > 1

    def wrong_vehicle(self, time_s: float) -> WrongVehicle:
        """Why no mission is flown with the vehicle on the link: two autopilots, or a wrong type.

        With two vehicles of one system id the reported type may be either's.

        Args:
            time_s: Current time since the vehicle's boot.
        """
        if not self.are_twins:
            return WrongVehicle(time_s, self.airframes.why_not)
        apart_s = self._twins.apart_s
        how = "" if apart_s is None else f" (their clocks are {apart_s:.0f} s apart)"
        return WrongVehicle(
            time_s,
            f"two autopilots answer with the same system id{how}: their messages are mixed up",
            twins=True,
        )

    def take_clock(self, boot_s: float, arrived_s: float, rate: float) -> bool:
        """Handle a position's time; return whether the number of autopilots has changed."""
        return self._twins.take(boot_s, arrived_s, rate)

    def take_version(self, fields: _Fields) -> bool:
        """Handle an AUTOPILOT_VERSION; return whether it comes from a further autopilot."""
        number = fields["flight_sw_version"]
        self.version = ".".join(str((number >> shift) & 0xFF) for shift in (24, 16, 8))
        uid = fields.get("uid") or 0
        another = bool(uid and self._uids and uid not in self._uids)
        self._uids |= {uid} - {0}
        return another

    def may_be_a_twins(self, fields: _Fields, *, armed: bool, height_m: float) -> bool:
        """Whether a HEARTBEAT may come from another vehicle on the ground.

        A vehicle disarmed in the air reports it in every HEARTBEAT; two vehicles alternate.

        Args:
            fields: The HEARTBEAT's fields.
            armed: As the previous one reported.
            height_m: Altitude above PX4's home.
        """
        disarmed = not fields["base_mode"] & ARMED and fields["system_status"] != TERMINATED
        waits = armed and disarmed and height_m >= SURELY_FLIES_M and not self._disarmed_once
        self._disarmed_once = waits
        return waits
