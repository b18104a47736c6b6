"""Combines a PX4's messages into `Telemetry` and events."""

from collections.abc import Callable
from typing import Any, Final

from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect

from air_router.vehicle import (
    REBOOT_S,
    FlightMode,
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
from air_router.vehicle.px4.limits import LIFTED_M, SYSTEM_TIME_NEAR_S, TELEMETRY_EVERY_S
from air_router.vehicle.px4.mavlink_values import COMPANION_COMPONENT, FENCE, MISSION_ACCEPTED
from air_router.vehicle.px4.mavsdk_bridge import Received
from air_router.vehicle.px4.plan_guard import PlanIds
from air_router.vehicle.px4.px4_messages import MODES, Handler, Px4Messages
from air_router.vehicle.px4.px4_reports import (
    GpsReport,
    Identity,
    PlanReport,
    PositionReport,
    SystemStatus,
    TargetReport,
)
from air_router.vehicle.px4.px4_streams import ModeState, ReportedPosition, Streams
from geo.frame import LocalFrame, Point

IN_AIR: Final = frozenset({2, 3, 4})  # MAV_LANDED_STATE: in air, taking off, landing
TARGETED: Final = frozenset({FlightMode.MISSION, FlightMode.HOLD})


class Px4Telemetry(Px4Messages):
    """Receives a PX4's messages and stores its last reports, on the event loop.

    Args:
        frame: The mission's frame.
        clock: The vehicle's clock.

    Attributes:
        place: Position and home.
        plan: The plan on board.
        gps: The satellite receiver.
        status: Charge and health.
        identity: Type and number of vehicles.
        in_air: By the landed state; None until it was received.
        wind_m_s: East, north; None: unknown.
        flight_info_received: FLIGHT_INFORMATION was received.
        took_off_s: Reported time of the take-off, since boot; None: not flying, or not reported.
    """

    def __init__(self, frame: LocalFrame, clock: VehicleClock) -> None:
        super().__init__(clock)
        self._callbacks: list[Callable[[VehicleEvent], None]] = []  # receive all events
        self.place = PositionReport(frame)
        self.plan = PlanReport()
        self.gps = GpsReport()
        self.status = SystemStatus()
        self.identity = Identity()
        self._target = TargetReport(frame)
        self._mode = ModeState()
        self._streams = Streams()
        self._snapshot_s = 0.0  # vehicle time of the latest telemetry
        self._unix: tuple[float, float] | None = None  # Unix time, its reception
        self.in_air: bool | None = None
        self.wind_m_s: tuple[float, float] | None = None
        self.flight_info_received = False
        self.took_off_s: float | None = None

    def listen(self, direct: MavlinkDirect, system_id: int) -> None:
        """Handle all messages of the autopilot with this system id."""
        super().listen(direct, system_id)
        handlers: dict[str, Handler] = {
            "HEARTBEAT": self._on_heartbeat,
            "CURRENT_MODE": self._on_current_mode,
            "GLOBAL_POSITION_INT": self._on_position,
            "EXTENDED_SYS_STATE": self._on_extended_state,
            "SYS_STATUS": self._on_sys_status,
            "SYSTEM_TIME": self._on_system_time,
            "HOME_POSITION": self.place.take_home,
            "MISSION_CURRENT": self._on_mission_current,
            "MISSION_ACK": self._on_mission_ack,
            "MISSION_ITEM_REACHED": self._on_item_reached,
            "GPS_RAW_INT": self.gps.take,
            "WIND_COV": self._on_wind,
            "POSITION_TARGET_GLOBAL_INT": self._target.take,
            "AUTOPILOT_VERSION": self._on_version,
            "FLIGHT_INFORMATION": self._on_flight_information,
        }
        self.take(handlers)

    def subscribe(self, callback: Callable[[VehicleEvent], None]) -> None:
        """Pass every event to `callback`; a known `WrongVehicle` at once."""
        self._callbacks.append(callback)
        if self.identity.are_twins:
            callback(self._wrong_vehicle())

    def complete(self) -> bool:
        """Whether every message that a flight needs was received once."""
        return self.place.point is not None and self._mode.known and self.in_air is not None

    def introduced(self) -> bool:
        """Whether one-time requests were answered: version, home, flight information."""
        home, version = self.place.home, self.identity.version
        return version is not None and home is not None and self.flight_info_received

    def missing(self, age_s: float) -> list[str]:
        """Messages missing for this long, in vehicle seconds, while others are received."""
        return self._streams.missing(age_s)

    def unix_s(self) -> float | None:
        """The vehicle's current Unix time; None until it was received."""
        if self._unix is None:
            return None
        unix_s, received_s = self._unix
        return unix_s + loop_s() - received_s

    @property
    def time_s(self) -> float:
        """Time of the newest position, since boot."""
        return self.place.time_s

    @property
    def mode(self) -> FlightMode:
        """The flight mode, from HEARTBEAT and CURRENT_MODE."""
        return self._mode.mode

    @property
    def armed(self) -> bool:
        """From HEARTBEAT."""
        return self._mode.armed

    @property
    def failsafe(self) -> bool:
        """Whether PX4 is in a failsafe."""
        return self._mode.failsafe

    @property
    def item(self) -> int | None:
        """The current plan item."""
        return self.plan.item

    @property
    def target(self) -> Point | None:
        """The reported destination or hover position in the current mode."""
        return self._target.point if self.mode in TARGETED else None

    def plan_refused(self) -> None:
        """Note that PX4 refuses our list because it is busy with another sender's."""
        self._emit(PlanTried(self.time_s, "another ground station"))

    def guard_plan(self, ids: PlanIds | None) -> None:
        """Report changes of the plan relative to these ids; None: to the next reported ones."""
        self.plan.guard.begin(ids)
        self.plan.watch()

    def count_heights_from(self, home_amsl_m: float) -> None:
        """See `Vehicle.count_heights_from`."""
        if self.place.count_heights_from(home_amsl_m):
            self._emit_snapshot()

    def snapshot(self) -> Telemetry | None:
        """The current telemetry; None before the first position."""
        place, gps = self.place, self.gps.fix
        if place.point is None or not self._mode.known:
            return None
        return Telemetry(
            time_s=place.time_s,
            position=place.point,
            altitude_m=place.altitude_m,
            velocity_m_s=place.velocity_m_s,
            heading_deg=place.heading_deg,
            armed=self.armed,
            in_air=self._streams.in_air(bool(self.in_air), armed=self.armed),
            mode=self._mode.reported,
            failsafe=self.failsafe,
            battery=self.status.battery,
            item=self.item,
            fix=gps is None or gps.good,
            target=self.target,
            altitude_amsl_m=place.altitude_amsl_m,
            gps_amsl_m=self.gps.amsl_m(place.time_s),
            home_moved=place.home_moved,
            wind_m_s=self.wind_m_s,
            terminated=self._mode.terminated,
            ages=self._streams.ages(),
            voltage_v=self.status.voltage_v,
            satellites=None if gps is None else gps.satellites,
            target_altitude_m=place.above_m(self._target.amsl_m),
            accuracy_m=None if gps is None or not gps.good else gps.accuracy_m,
        )

    def _came_back(self, silent_s: float) -> None:
        """Report the end of a silence, also after a stall of this program.

        A mode received just before may have waited in the socket.
        """
        for name in MODES:
            self._streams.void(name)
        self._emit(LinkSilent(self.time_s, silent_s, over=True))

    def _handed(self, name: str, received: Received, handler: Handler, *, old: bool) -> None:
        """Pass a usable message on, and emit telemetry at intervals."""
        if old:  # a pilot's mode is reported at once in any case
            handler(received.fields)
            return
        self.clock.alive()
        clock = self.clock
        self._streams.message(received.arrived_s, clock.rate, clock.most_ahead_s)
        if self._streams.is_new(name, received.fields, armed=self.armed):
            handler(received.fields)
        self._mode.expire(received.arrived_s)
        if self._streams.received_s - self._snapshot_s >= TELEMETRY_EVERY_S:
            self._emit_snapshot()

    def _emit(self, event: VehicleEvent) -> None:
        for callback in self._callbacks:
            callback(event)

    def _emit_snapshot(self) -> None:
        snapshot = self.snapshot()
        self._snapshot_s = self._streams.received_s
        if snapshot is not None:
            self._emit(snapshot)

    def _wrong_vehicle(self) -> WrongVehicle:
        return self.identity.wrong_vehicle(self.time_s)

    def _on_heartbeat(self, fields: dict[str, Any]) -> None:
        identity = self.identity
        if identity.airframes.heartbeat(fields):  # before its mode, perhaps another autopilot's
            self._emit(self._wrong_vehicle())
        height_m = self._streams.height_m()
        if not identity.may_be_a_twins(fields, armed=self.armed, height_m=height_m):
            self._note_mode(changed=self._mode.heartbeat(fields))

    def _on_current_mode(self, fields: dict[str, Any]) -> None:
        now_s = self.arrived_s("CURRENT_MODE")
        self._note_mode(changed=self._mode.current_mode(fields, now_s))

    def _note_mode(self, *, changed: bool) -> None:
        if changed:
            self._target.mode_changed()
            self._streams.void_targets_before(self.time_s)  # targets still under way
            self._emit_snapshot()  # at once: it may be the pilot's, and a command may be due

    def _on_position(self, fields: dict[str, Any]) -> None:
        boot_s, rate = fields["time_boot_ms"] / 1e3, self.clock.rate
        point = self.place.point_of(fields)
        if point is None:
            self._streams.void("GLOBAL_POSITION_INT")
            return
        if self.identity.take_clock(boot_s, self.arrived_s("GLOBAL_POSITION_INT"), rate):
            self._emit(self._wrong_vehicle())
        reported = ReportedPosition(boot_s, point)
        if not self.place.believes(reported, loop_s(), rate):
            self._streams.void("GLOBAL_POSITION_INT")
            return
        self.clock.received(boot_s)
        lifted = self._streams.moves_above(LIFTED_M)  # or falls disarmed: PX4 reports landed
        in_air = self.in_air is not False or lifted  # the flight may begin in the air
        self.place.take(fields, reported, armed=self.armed, in_air=in_air)
        self._emit_snapshot()

    def _on_extended_state(self, fields: dict[str, Any]) -> None:
        self.identity.airframes.state(fields)
        if fields["landed_state"] != 0:
            self.in_air = fields["landed_state"] in IN_AIR

    def _on_sys_status(self, fields: dict[str, Any]) -> None:
        if not self.status.take(fields):  # a charge no longer reported ages
            self._streams.void("SYS_STATUS")

    def _on_system_time(self, fields: dict[str, Any]) -> None:
        boot_s = fields["time_boot_ms"] / 1e3
        near = -REBOOT_S <= boot_s - self.clock.boot_s() <= SYSTEM_TIME_NEAR_S
        if near:  # else another vehicle's: positions count
            self.clock.received(boot_s)
        if fields["time_unix_usec"] > 0:
            self.clock.received_unix(fields["time_unix_usec"] / 1e6, boot_s)
            self._unix = (fields["time_unix_usec"] / 1e6, loop_s())

    def _on_mission_current(self, fields: dict[str, Any]) -> None:
        changed = self.plan.take(fields)
        if changed and self.plan.guarding:
            self._emit(PlanReplaced(self.time_s, only_fence=changed == {FENCE}))

    def _on_mission_ack(self, fields: dict[str, Any]) -> None:
        sender = fields["target_system"], fields["target_component"]
        if sender in {(self.system_id, COMPANION_COMPONENT), (0, 0)}:
            self.plan.take_ack(fields)
        elif fields["type"] != MISSION_ACCEPTED:
            self._emit(PlanTried(self.time_s, f"ground station {sender[0]}"))

    def _on_item_reached(self, fields: dict[str, Any]) -> None:
        if self.plan.take_reached(fields):
            self._emit(ItemReached(self.time_s, fields["seq"]))

    def _on_wind(self, fields: dict[str, Any]) -> None:
        north_m_s, east_m_s = fields["wind_x"], fields["wind_y"]
        known = north_m_s is not None and east_m_s is not None  # NaN: unknown
        self.wind_m_s = (east_m_s, north_m_s) if known else None

    def _on_flight_information(self, fields: dict[str, Any]) -> None:
        # PX4 counts from its boot, whatever the field is called.
        since_boot_s = fields["takeoff_time_utc"] / 1e6
        flies = 0.0 < since_boot_s <= fields["time_boot_ms"] / 1e3
        self.took_off_s = since_boot_s if flies else None
        self.flight_info_received = True

    def _on_version(self, fields: dict[str, Any]) -> None:
        if self.identity.take_version(fields):
            self._emit(self._wrong_vehicle())
