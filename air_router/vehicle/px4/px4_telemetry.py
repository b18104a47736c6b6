"""What a PX4 says of itself, put together from its messages into `Telemetry` and events."""

import logging
from collections.abc import Callable
from typing import Any, Final

from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect

from air_router.vehicle import (
    REBOOT_S,
    AirframeWatch,
    FlightMode,
    GpsFix,
    HeightFrame,
    ItemReached,
    LinkSilent,
    PlanReplaced,
    PlanTried,
    Telemetry,
    VehicleClock,
    VehicleEvent,
    WrongVehicle,
    loop_s,
)
from air_router.vehicle.px4.boot_clock import TwinWatch
from air_router.vehicle.px4.limits import (
    GPS_HEIGHT_S,
    LIFTED_M,
    SURELY_FLIES_M,
    SYSTEM_TIME_NEAR_S,
    TELEMETRY_EVERY_S,
)
from air_router.vehicle.px4.mavlink_values import (
    ARMED,
    COMPANION_COMPONENT,
    FENCE,
    MISSION_ACCEPTED,
    PREARM_GOOD,
    TERMINATED,
    UNKNOWN_16,
)
from air_router.vehicle.px4.mavsdk_bridge import Received
from air_router.vehicle.px4.plan_guard import PlanGuard, PlanIds
from air_router.vehicle.px4.px4_messages import MODES, Handler, Px4Messages
from air_router.vehicle.px4.px4_streams import Continuity, ModeState, ReportedPosition, Streams
from geo.frame import FrameError, LocalFrame, Point

_log = logging.getLogger(__name__)

IN_AIR: Final = frozenset({2, 3, 4})  # MAV_LANDED_STATE: in air, taking off, landing
TARGETED: Final = frozenset({FlightMode.MISSION, FlightMode.HOLD})


class Px4Telemetry(Px4Messages):
    """Listens to a PX4 and keeps what it said last; all of it on the event loop."""

    def __init__(self, frame: LocalFrame, clock: VehicleClock) -> None:
        super().__init__(clock)
        self._frame = frame
        self._callbacks: list[Callable[[VehicleEvent], None]] = []  # told of telemetry and events
        self.plan_ids: PlanIds | None = None  # as said last
        self.guard = PlanGuard()  # of the plan on board
        self._guarding = False  # changes of the plan are told
        self._last_reached: tuple[int, int | None] | None = None  # seq, item that was current then
        self._continuity = Continuity()
        self._twins = TwinWatch()  # of positions
        self._uids: set[int] = set()  # of the autopilots that answered
        self._disarmed_once = False  # by the latest HEARTBEAT, which may be another's
        self._target: Point | None = None  # of POSITION_TARGET, in the mission frame
        self._target_amsl_m: float | None = None  # its height; None: not told
        self._unix: tuple[float, float] | None = None  # Unix time, when heard
        self._heights = HeightFrame()  # home of the take-off
        self._gps_height: tuple[float, float] | None = None  # metres AMSL, receiver's time
        self.gps: GpsFix | None = None  # None until it was heard
        self.voltage_v: float | None = None  # None: unknown
        self.wind_m_s: tuple[float, float] | None = None  # east, north
        self.position: Point | None = None  # in the mission frame; None before it said so
        self.time_s = 0.0  # since boot, of the newest position
        self.altitude_m = 0.0  # above the home of the take-off
        self.altitude_amsl_m = 0.0  # as the autopilot says
        self.velocity_m_s = (0.0, 0.0)  # east, north
        self.heading_deg: float | None = None  # clockwise from north
        self.mode = FlightMode.OTHER  # from HEARTBEAT and CURRENT_MODE
        self.armed = False  # from HEARTBEAT
        self._mode = ModeState()
        self.airframes = AirframeWatch()  # which vehicle it says that it is
        self._streams = Streams()
        self._told_s = 0.0  # vehicle time of the latest telemetry
        self.in_air: bool | None = None  # None until it was heard
        self.battery: float | None = None  # 0 to 1; None: unknown
        self.health_good = False  # PX4's pre-arm checks pass
        self.item: int | None = None  # of the plan, current
        self.item_total = 0  # items on board
        self.mission_state = 0  # MISSION_CURRENT.mission_state
        self.mission_reports = 0  # MISSION_CURRENT so far
        self.home: Point | None = None  # of the autopilot, in the mission frame
        self.home_altitude_amsl_m: float | None = None  # of the autopilot's home
        self.version: str | None = None  # of PX4, once it was asked
        self.told_flight = False  # FLIGHT_INFORMATION has come
        self.took_off_s: float | None = None  # since boot, as it says

    def listen(self, direct: MavlinkDirect, system_id: int) -> None:
        """Take all that the autopilot with this system id says."""
        super().listen(direct, system_id)
        handlers: dict[str, Handler] = {
            "HEARTBEAT": self._on_heartbeat,
            "CURRENT_MODE": self._on_current_mode,
            "GLOBAL_POSITION_INT": self._on_position,
            "EXTENDED_SYS_STATE": self._on_extended_state,
            "SYS_STATUS": self._on_sys_status,
            "SYSTEM_TIME": self._on_system_time,
            "HOME_POSITION": self._on_home,
            "MISSION_CURRENT": self._on_mission_current,
            "MISSION_ACK": self._on_mission_ack,
            "MISSION_ITEM_REACHED": self._on_item_reached,
            "GPS_RAW_INT": self._on_gps,
            "WIND_COV": self._on_wind,
            "POSITION_TARGET_GLOBAL_INT": self._on_target,
            "AUTOPILOT_VERSION": self._on_version,
            "FLIGHT_INFORMATION": self._on_flight_information,
        }
        self.take(handlers)

    def subscribe(self, callback: Callable[[VehicleEvent], None]) -> None:
        """Hand every event to `callback`; what stands against the vehicle already, at once."""
        self._callbacks.append(callback)
        if self._are_twins:
            callback(self._wrong_vehicle())

    def complete(self) -> bool:
        """Whether everything that a flight rests on was heard once."""
        return self.position is not None and self._mode.known and self.in_air is not None

    def introduced(self) -> bool:
        """Whether what is asked for once has come: version, home, since when it flies."""
        return self.version is not None and self.home is not None and self.told_flight

    def missing(self, age_s: float) -> list[str]:
        """Messages that have not come for so long while others do, seconds of the vehicle's."""
        return self._streams.missing(age_s)

    def unix_s(self) -> float | None:
        """The vehicle's own Unix time now, None until it told it."""
        if self._unix is None:
            return None
        unix_s, heard_s = self._unix
        return unix_s + loop_s() - heard_s

    @property
    def target(self) -> Point | None:
        """Where it flies to or hovers in its present mode, as it reports."""
        return self._target if self.mode in TARGETED else None

    def plan_refused(self) -> None:
        """PX4 takes no list of ours: it is busy with one of another sender."""
        self._emit(PlanTried(self.time_s, "another ground station"))

    def guard_plan(self, ids: PlanIds | None) -> None:
        """From now on report when the plan on board is another; None: than the one said next."""
        self.guard.begin(ids)
        self.watch_plan()

    def watch_plan(self) -> None:
        """The same, than what the guard knows of."""
        self._guarding = True

    @property
    def failsafe(self) -> bool:
        """Whether the autopilot flies by itself."""
        return self._mode.failsafe

    def count_heights_from(self, home_amsl_m: float) -> None:
        """See `Vehicle.count_heights_from`."""
        altitude_m = self._heights.took_off_from(home_amsl_m)
        if altitude_m is not None:
            self.altitude_m = altitude_m
            self._emit_snapshot()

    def snapshot(self) -> Telemetry | None:
        """The telemetry of this moment, None before the first position."""
        if self.position is None or not self._mode.known:
            return None
        return Telemetry(
            time_s=self.time_s,
            position=self.position,
            altitude_m=self.altitude_m,
            velocity_m_s=self.velocity_m_s,
            heading_deg=self.heading_deg,
            armed=self.armed,
            in_air=self._streams.in_air(bool(self.in_air), armed=self.armed),
            mode=self._mode.told,
            failsafe=self.failsafe,
            battery=self.battery,
            item=self.item,
            fix=self.gps is None or self.gps.good,
            target=self.target,
            altitude_amsl_m=self.altitude_amsl_m,
            gps_amsl_m=self._gps_amsl_m(),
            home_moved=self._heights.moved,
            wind_m_s=self.wind_m_s,
            terminated=self._mode.terminated,
            ages=self._streams.ages(),
            voltage_v=self.voltage_v,
            satellites=None if self.gps is None else self.gps.satellites,
            target_altitude_m=self._heights.above_m(self._target_amsl_m),
            accuracy_m=None if self.gps is None or not self.gps.good else self.gps.accuracy_m,
        )

    def _came_back(self, silent_s: float) -> None:
        """Tell of a silence that is over, also if this program stood still in it.

        A mode that came just before may have waited in the socket.
        """
        for name in MODES:
            self._streams.void(name)
        self._emit(LinkSilent(self.time_s, silent_s, over=True))

    def _handed(self, name: str, received: Received, handler: Handler, *, old: bool) -> None:
        """Hand a message on, unless it says nothing, and tell how the vehicle is now and then."""
        if old:  # a mode that a pilot chose is told at once all the same
            handler(received.fields)
            return
        self.clock.alive()
        clock = self.clock
        self._streams.message(received.arrived_s, clock.rate, clock.most_ahead_s)
        if self._streams.news(name, received.fields, armed=self.armed):
            handler(received.fields)
        self._mode.settle(received.arrived_s)
        if self._streams.heard_s - self._told_s >= TELEMETRY_EVERY_S:
            self._emit_snapshot()

    def _emit(self, event: VehicleEvent) -> None:
        for callback in self._callbacks:
            callback(event)

    def _emit_snapshot(self) -> None:
        snapshot = self.snapshot()
        self._told_s = self._streams.heard_s
        if snapshot is not None:
            self._emit(snapshot)

    def _on_heartbeat(self, fields: dict[str, Any]) -> None:
        if self.airframes.heartbeat(fields):  # before its mode, whose numbers may be another's
            self._emit(self._wrong_vehicle())
        if self._may_be_a_twins(fields):
            return
        self._note_mode(changed=self._mode.heartbeat(fields))

    def _on_current_mode(self, fields: dict[str, Any]) -> None:
        now_s = self.arrived_s("CURRENT_MODE")
        self._note_mode(changed=self._mode.current_mode(fields, now_s))

    def _wrong_vehicle(self) -> WrongVehicle:
        """Whether something stands against what is on the link; two autopilots before a wrong one.

        A vehicle among two of one system id may be any of them, whatever is announced of it.
        """
        if not self._are_twins:
            return WrongVehicle(self.time_s, self.airframes.why_not)
        apart_s = self._twins.apart_s
        how = "" if apart_s is None else f" (their clocks are {apart_s:.0f} s apart)"
        return WrongVehicle(
            self.time_s,
            f"two autopilots answer with the same system id{how}: what they say is mixed up",
            twins=True,
        )

    @property
    def _are_twins(self) -> bool:
        return self._twins.apart_s is not None or len(self._uids) > 1

    def _may_be_a_twins(self, fields: dict[str, Any]) -> bool:
        """Whether a HEARTBEAT may be of another vehicle, which stands on the ground.

        One that flies high and is disarmed says so in every HEARTBEAT; two that take turns do not.
        """
        disarmed = not fields["base_mode"] & ARMED and fields["system_status"] != TERMINATED
        high = self._streams.height_m() >= SURELY_FLIES_M
        waits = self.armed and disarmed and high and not self._disarmed_once
        self._disarmed_once = waits
        return waits

    def _note_mode(self, *, changed: bool) -> None:
        state = self._mode
        self.mode, self.armed = state.mode, state.armed
        if changed:
            self._target = None  # it was the other mode's
            self._streams.targets_from_s = self.time_s  # and what is still on its way
            self._emit_snapshot()  # at once: it may be the pilot's, and a command about to leave

    def _on_position(self, fields: dict[str, Any]) -> None:
        boot_s = fields["time_boot_ms"] / 1e3
        try:
            position = self._frame.to_local(fields["lat"] / 1e7, fields["lon"] / 1e7)
        except FrameError as error:
            _log.warning("a position of the vehicle is left out: %s", error)
            self._streams.void("GLOBAL_POSITION_INT")
            return
        if self._twins.take(boot_s, self.arrived_s("GLOBAL_POSITION_INT"), self.clock.rate):
            self._emit(self._wrong_vehicle())
        reported = ReportedPosition(boot_s, position)
        if not self._continuity.believes(reported, loop_s(), self.clock.rate):
            _log.info("a position that does not follow from the one before waits for others")
            self._streams.void("GLOBAL_POSITION_INT")
            return
        self.time_s, self.position = boot_s, position
        self.clock.heard(boot_s)
        self.altitude_amsl_m = fields["alt"] / 1e3
        lifted = self._streams.moves_above(LIFTED_M)  # or falls, disarmed, which counts as landed
        self.altitude_m = self._heights.altitude_m(
            self.altitude_amsl_m,
            fields["relative_alt"] / 1e3,
            self.home,
            armed=self.armed,
            in_air=self.in_air is not False or lifted,  # it may be met in the air
        )
        self.velocity_m_s = (fields["vy"] / 100, fields["vx"] / 100)  # MAVLink: x north, y east
        self.heading_deg = None if fields["hdg"] == UNKNOWN_16 else fields["hdg"] / 100
        self._emit_snapshot()

    def _on_extended_state(self, fields: dict[str, Any]) -> None:
        self.airframes.state(fields)
        if fields["landed_state"] != 0:
            self.in_air = fields["landed_state"] in IN_AIR

    def _on_sys_status(self, fields: dict[str, Any]) -> None:
        remaining = fields["battery_remaining"]
        if remaining is not None and remaining >= 0:
            self.battery = remaining / 100
        elif self.battery is not None:  # it was known: what is not told any more grows old
            self._streams.void("SYS_STATUS")
        voltage_mv = fields["voltage_battery"]
        self.voltage_v = None if voltage_mv in {None, UNKNOWN_16} else voltage_mv / 1e3
        self.health_good = bool(fields["onboard_control_sensors_health"] & PREARM_GOOD)

    def _on_system_time(self, fields: dict[str, Any]) -> None:
        boot_s = fields["time_boot_ms"] / 1e3
        if (
            -REBOOT_S <= boot_s - self.clock.boot_s() <= SYSTEM_TIME_NEAR_S
        ):  # another's: by positions
            self.clock.heard(boot_s)
        if fields["time_unix_usec"] > 0:
            self.clock.heard_unix(fields["time_unix_usec"] / 1e6, boot_s)
            self._unix = (fields["time_unix_usec"] / 1e6, loop_s())

    def _on_home(self, fields: dict[str, Any]) -> None:
        try:
            self.home = self._frame.to_local(fields["latitude"] / 1e7, fields["longitude"] / 1e7)
        except FrameError as error:
            _log.warning("the vehicle's home is left out: %s", error)
            return
        self.home_altitude_amsl_m = fields["altitude"] / 1e3

    def _on_mission_current(self, fields: dict[str, Any]) -> None:
        total = fields.get("total", UNKNOWN_16)
        self.item_total = 0 if total == UNKNOWN_16 else total
        self.mission_state = fields.get("mission_state", 0)
        self.mission_reports += 1
        self.item = fields["seq"]
        self.plan_ids = PlanIds(*(fields.get(name, 0) for name in PlanIds._fields))
        changed = self.guard.told(self.plan_ids)
        if changed and self._guarding:
            self._emit(PlanReplaced(self.time_s, only_fence=changed == {FENCE}))

    def _on_mission_ack(self, fields: dict[str, Any]) -> None:
        kind, stored = fields.get("mission_type", 0), fields["type"] == MISSION_ACCEPTED
        sender = fields["target_system"], fields["target_component"]
        if sender in {(self.system_id, COMPANION_COMPONENT), (0, 0)}:
            tell = self.guard.stored if stored else self.guard.refused
            tell(kind, fields.get("opaque_id"))
        elif not stored:
            self._emit(PlanTried(self.time_s, f"ground station {sender[0]}"))

    def _on_item_reached(self, fields: dict[str, Any]) -> None:
        # PX4 repeats the report once or twice a second while it holds; once is enough.
        reached = (fields["seq"], self.item)
        if reached != self._last_reached:
            self._last_reached = reached
            self._emit(ItemReached(self.time_s, fields["seq"]))

    def _on_gps(self, fields: dict[str, Any]) -> None:
        satellites = fields["satellites_visible"]
        accuracy_mm = fields.get("h_acc") or 0
        self.gps = GpsFix(
            kind=fields["fix_type"],
            satellites=None if satellites in {None, 255} else satellites,
            accuracy_m=accuracy_mm / 1e3 if accuracy_mm else None,
        )
        self._gps_height = (fields["alt"] / 1e3, fields["time_usec"] / 1e6)

    def _gps_amsl_m(self) -> float | None:
        """The receiver's own altitude, if it has a fix and the message is not old."""
        if self._gps_height is None or self.gps is None or not self.gps.good:
            return None
        amsl_m, at_s = self._gps_height
        return amsl_m if abs(self.time_s - at_s) <= GPS_HEIGHT_S else None

    def _on_wind(self, fields: dict[str, Any]) -> None:
        north_m_s, east_m_s = fields["wind_x"], fields["wind_y"]
        known = north_m_s is not None and east_m_s is not None  # what is no number is nothing
        self.wind_m_s = (east_m_s, north_m_s) if known else None

    def _on_target(self, fields: dict[str, Any]) -> None:
        self._target_amsl_m = fields["alt"]
        place = fields["lat_int"] / 1e7, fields["lon_int"] / 1e7
        try:
            self._target = self._frame.to_local(*place) if any(place) else None  # 0, 0: none
        except FrameError:
            self._target = None

    def _on_flight_information(self, fields: dict[str, Any]) -> None:
        # PX4 counts from its boot, whatever the field is called.
        since_boot_s = fields["takeoff_time_utc"] / 1e6
        flies = 0.0 < since_boot_s <= fields["time_boot_ms"] / 1e3
        self.took_off_s = since_boot_s if flies else None
        self.told_flight = True

    def _on_version(self, fields: dict[str, Any]) -> None:
        if (uid := fields.get("uid") or 0) and uid not in self._uids:
            self._uids.add(uid)
            if len(self._uids) > 1:
                self._emit(self._wrong_vehicle())
        number = fields["flight_sw_version"]
        self.version = ".".join(str((number >> shift) & 0xFF) for shift in (24, 16, 8))
