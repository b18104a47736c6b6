"""The interface through which the controller observes and commands a vehicle.

One implementation flies a real or simulated PX4 (`vehicle.px4`); tests use another with the same
flight loop. Positions are east/north meters in the mission's local frame, altitudes meters above
home, and times seconds on the vehicle's clock.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Final, Protocol

from air_router.errors import NotConfirmedError
from air_router.mission import FlightPlan
from air_router.vehicle.airframe import Airframe
from air_router.vehicle.height_frame import HomeMove
from air_router.vehicle.instructions import Severity
from air_router.vehicle.limits import TARGET_REACHED_UP_M
from geo.frame import Point


class FlightMode(Enum):
    """The flight modes that matter to a mission, by the names that pilots know."""

    MISSION = "Mission"
    HOLD = "Hold"
    TAKEOFF = "Takeoff"
    RETURN = "Return"
    LAND = "Land"
    POSITION = "Position"  # flown by hand; moving the sticks leads here
    ALTITUDE = "Altitude"  # flown by hand
    OTHER = "another"  # Manual, Offboard, Orbit ...


@dataclass(frozen=True, slots=True)
class Ages:
    """How long each input has been missing while others were received, in vehicle seconds.

    During a silence of all inputs none ages; `LinkSilent` covers that. An input that was never
    received has no age.

    Attributes:
        position_s: GLOBAL_POSITION_INT; one that repeats itself in motion does not count.
        mode_s: HEARTBEAT or CURRENT_MODE, the younger.
        armed_s: HEARTBEAT.
        battery_s: SYS_STATUS.
        fix_s: GPS_RAW_INT.
        landed_s: EXTENDED_SYS_STATE; one that contradicts the motion does not count.
        item_s: MISSION_CURRENT.
        target_s: POSITION_TARGET_GLOBAL_INT.
    """

    position_s: float = 0.0
    mode_s: float = 0.0
    armed_s: float = 0.0
    battery_s: float = 0.0
    fix_s: float = 0.0
    landed_s: float = 0.0
    item_s: float = 0.0
    target_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Telemetry:
    """The vehicle's last reported state: everything that changes steadily, in one value.

    Attributes:
        time_s: Time of the position, seconds on its clock since boot.
        position: Horizontal position, meters east/north of the mission's origin.
        altitude_m: Meters above the home of the take-off.
        velocity_m_s: Velocity (east, north) in meters per second.
        heading_deg: Clockwise from true north, None when unknown.
        armed: The motors may turn.
        in_air: As PX4 reports, not inferred from the altitude.
        mode: The flight mode that PX4 reports, never the requested one.
        failsafe: PX4 is in a failsafe: it flies another mode than intended.
        battery: Remaining charge from 0 to 1, None when unknown.
        item: Sequence number of the current plan item, None when unknown.
        fix: The satellite receiver has a fix; True also while it reports nothing.
        target: Reported destination or hover position; None when unknown.
        altitude_amsl_m: Meters above mean sea level; None when unknown.
        gps_amsl_m: The same by the satellite receiver alone; None when unknown or old.
        home_moved: Offset of PX4's home from the home of the take-off; the plan's altitudes are
            relative to PX4's home. None while both are the same.
        wind_m_s: PX4's estimate of the air's motion (east, north); None without one, as on a
            multicopter without EKF2_DRAG_CTRL.
        terminated: Motors stopped for good, by a kill switch or flight termination.
        ages: The age of each input.
        voltage_v: Battery voltage; None when unknown.
        satellites: Number of satellites used; None when unknown.
        target_altitude_m: Altitude of `target` above the home of the take-off; None: unknown.
        accuracy_m: The receiver's horizontal accuracy; None when unknown.
    """

    time_s: float
    position: Point
    altitude_m: float
    velocity_m_s: tuple[float, float] = (0.0, 0.0)
    heading_deg: float | None = None
    armed: bool = False
    in_air: bool = False
    mode: FlightMode = FlightMode.OTHER
    failsafe: bool = False
    battery: float | None = None
    item: int | None = None
    fix: bool = True
    target: Point | None = None
    altitude_amsl_m: float | None = None
    gps_amsl_m: float | None = None
    home_moved: HomeMove | None = None
    wind_m_s: tuple[float, float] | None = None
    terminated: bool = False
    ages: Ages = Ages()
    voltage_v: float | None = None
    satellites: int | None = None
    target_altitude_m: float | None = None
    accuracy_m: float | None = None

    def bound_for(self, place: Point, altitude_m: float | None, aside_m: float) -> bool:
        """Whether the vehicle flies to a place or hovers there, by its reports.

        Args:
            place: Meters east/north of the mission's origin.
            altitude_m: Meters above home; None: any altitude.
            aside_m: Horizontal tolerance.
        """
        target, target_m = self.target, self.target_altitude_m
        if target is None:
            return True
        up_m = 0.0 if target_m is None or altitude_m is None else target_m - altitude_m
        return math.dist(target, place) <= aside_m and abs(up_m) <= TARGET_REACHED_UP_M

    @property
    def received_s(self) -> float:
        """When the newest part was sent, vehicle's clock; `time_s` while positions arrive."""
        return self.time_s + self.ages.position_s


@dataclass(frozen=True, slots=True)
class ItemReached:
    """PX4 reports a plan item as reached."""

    time_s: float
    item: int  # sequence number in the plan on board


@dataclass(frozen=True, slots=True)
class PlanReplaced:
    """A ground station has uploaded a plan or a fence; `PlanCompared` reports whether it is ours.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        only_fence: The items are still ours; perhaps a zone was added ahead of the vehicle.
    """

    time_s: float
    only_fence: bool = False


@dataclass(frozen=True, slots=True)
class PlanTried:
    """Another sender tries to upload a plan or a fence, and PX4 refuses it.

    This is visible only by PX4's answers on our own link, or because PX4 is busy with a transfer.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        who: The sender, as text.
    """

    time_s: float
    who: str


@dataclass(frozen=True, slots=True)
class PlanCompared:
    """A replaced plan was read back and compared with ours.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        difference: What is on board instead, or why it is unknown; None: it is equivalent.
    """

    time_s: float
    difference: str | None = None


@dataclass(frozen=True, slots=True)
class LinkSilent:
    """Nothing has been received from the vehicle for a while.

    Attributes:
        time_s: The vehicle's clock at its last message.
        silent_s: Wall-clock seconds since then.
        over: The vehicle has just been received again.
    """

    time_s: float
    silent_s: float
    over: bool = False


@dataclass(frozen=True, slots=True)
class WrongVehicle:
    """The vehicle on the link is not the mission's kind, or is it again.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        why_not: Why no mission is flown with it; None: it may fly again.
        twins: Two autopilots answer under one system id.
    """

    time_s: float
    why_not: str | None
    twins: bool = False


@dataclass(frozen=True, slots=True)
class MavlinkSpoofed:
    """A signed link receives messages with the vehicle's system id but without its signature.

    They are ignored. This is reported once.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        count: Number of such messages so far.
    """

    time_s: float
    count: int


VehicleEvent = (Telemetry | ItemReached | PlanReplaced | PlanTried | PlanCompared | LinkSilent) | (
    WrongVehicle | MavlinkSpoofed
)


@dataclass(frozen=True, slots=True)
class VehicleInfo:
    """The connected vehicle: system id, autopilot, version, and home.

    `took_off_s` is the time of its take-off, on its clock; None if it is not flying, or does not
    report it. `airframe` is its reported type.
    """

    system_id: int
    autopilot: str
    version: str  # "1.17.0"
    home: Point | None  # in the mission's frame; None: unknown
    home_altitude_amsl_m: float | None
    took_off_s: float | None = None
    airframe: Airframe = field(default_factory=Airframe)


FIX_3D: Final = 3  # GPS_FIX_TYPE


@dataclass(frozen=True, slots=True)
class GpsFix:
    """A report of the satellite receiver.

    Attributes:
        kind: GPS_FIX_TYPE: 0 and 1 none, 2 without altitude, 3 full, above that corrected.
        satellites: Number used; None when unknown.
        accuracy_m: The receiver's horizontal accuracy; None when unknown.
    """

    kind: int
    satellites: int | None = None
    accuracy_m: float | None = None

    @property
    def good(self) -> bool:
        """Whether it is a 3D fix."""
        return self.kind >= FIX_3D


@dataclass(frozen=True, slots=True)
class Inspection:
    """The state of a vehicle on the ground, requested for a pre-flight check.

    Attributes:
        healthy: PX4's own health and arming checks pass.
        problems: Their findings, as text; also empty if PX4 reports none.
        warnings: Findings that do not prevent arming.
        gps: The satellite receiver; None: it reports nothing.
        battery: Remaining charge from 0 to 1, None when unknown.
        voltage_v: Battery voltage, None when unknown.
        wind_m_s: The air's motion (east, north); None when unknown.
        unix_s: The vehicle's Unix time; None until it knows the time.
        parameters: Values by name; None for one that the vehicle does not have or does not report.
        absent: Parameters that the vehicle reports as absent.
    """

    healthy: bool = True
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    gps: GpsFix | None = None
    battery: float | None = None
    voltage_v: float | None = None
    wind_m_s: tuple[float, float] | None = None
    unix_s: float | None = None
    parameters: Mapping[str, float | None] = field(default_factory=lambda: MappingProxyType({}))
    absent: frozenset[str] = frozenset()


class TakenOverError(NotConfirmedError):
    """The vehicle is in a flight mode that the command may not end.

    Attributes:
        mode: That mode, chosen by a pilot, a ground station or a failsafe.
        sent: Whether the command was sent before the mode was received.
    """

    def __init__(self, text: str, mode: FlightMode, *, sent: bool) -> None:
        super().__init__(text)
        self.mode, self.sent = mode, sent


Objection = Callable[[], str | None]
"""Why a command must not be sent; None: it may."""


def no_objection() -> str | None:
    """The command may be sent."""
    return None


Modes = Collection[FlightMode] | None
"""The flight modes that a command may end; None: the vehicle's last mode."""


class Vehicle(Protocol):
    """The commands of a vehicle. Each returns once the vehicle has confirmed it, or raises.

    A command that moves the vehicle or changes its mode is sent only if the vehicle has just
    reported a mode that the command may end (`out_of`). The modes of our own unconfirmed commands
    are included.

    Raises:
        NoVehicleError: from `connect`, with a diagnosis.
        PlanRefusedError: from `upload`, `renew` and `recognise` if the plan on board is not the one
        sent; from `start` if it was replaced meanwhile.
        PlanKeptError: from `renew`, if it was refused before anything was sent.
        ArmingRefusedError: from `arm`, with PX4's reasons; from `arm` and `start` if the pilot has
        disarmed the vehicle or chosen a mode.
        NotConfirmedError: The command was sent, but the vehicle did not follow, or the link failed.
        NotSentError: The command was not sent: the current flight mode was not received, a
        failsafe acts, or there is an objection.
        TakenOverError: The vehicle is in another mode, before the command was sent or instead of
        following it.
    """

    async def connect(self) -> VehicleInfo:
        """Find the vehicle, or raise an error with a diagnosis within seconds."""

    def subscribe(self, callback: Callable[[VehicleEvent], None]) -> None:
        """Pass every event to `callback`, in order, on the event loop."""

    async def inspect(self, parameters: Sequence[str]) -> Inspection:
        """Request the data of a pre-flight check, with the values of these parameters."""

    async def upload(self, plan: FlightPlan) -> None:
        """Upload nodes and fence, and read both back."""

    async def renew(self, plan: FlightPlan, objection: Callable[[], str | None]) -> None:
        """Upload a changed fence, also in flight, and read everything back.

        Args:
            plan: The plan with that fence.
            objection: Called before each transfer: returns why nothing may be uploaded anymore.

        Items are sent only if they differ from those on board, and never in Mission mode in the
        air: the vehicle would restart the plan.
        """

    async def recognise(self, plan: FlightPlan) -> None:
        """Verify, also in flight, that this plan is on board, without changing anything."""

    def count_heights_from(self, home_amsl_m: float) -> None:
        """Set home's altitude at the take-off, above mean sea level, and publish telemetry at once.

        For a flight taken over from another companion: home may have been moved since.
        """

    async def arm(self) -> None:
        """Arm once, after PX4's health checks pass; never after a disarming."""

    async def start(self) -> None:
        """Enter Mission mode: on the ground this takes off.

        A choice of the pilot since `arm` is respected: nothing is sent to a vehicle that was
        disarmed or is in another mode.
        Also returns if nothing shows whether the vehicle takes off: later telemetry will.
        """

    async def jump(
        self, item: int, objection: Objection = no_objection, *, out_of: Modes = None
    ) -> None:
        """Fly straight to a plan item and hover there, in Mission mode.

        Args:
            item: Sequence number in the plan on board.
            objection: Called before each message: returns why the leg must not start anymore.
            out_of: The modes that the command may end.
        """

    async def reposition(
        self,
        point: Point,
        altitude_m: float,
        objection: Objection = no_objection,
        *,
        out_of: Modes = None,
    ) -> None:
        """Fly straight to a point and hover there, in Hold mode.

        Args:
            point: Meters east/north in the mission's local frame.
            altitude_m: Meters above the home of the take-off, wherever PX4's home is now.
            objection: Called before the message: returns why the leg must not start anymore.
            out_of: The modes that the command may end.
        """

    async def hold(self, *, out_of: Modes = None) -> None:
        """Stop and hover here; `out_of`: the modes that the command may end."""

    async def land(self, *, out_of: Modes = None) -> None:
        """Descend here and touch down; `out_of`: the modes that the command may end."""

    async def announce(self, text: str, severity: Severity) -> None:
        """Send a text to the pilot: ground stations show it, PX4 logs it."""

    async def close(self) -> None:
        """Close the link; the vehicle continues what it does."""
