"""The port through which the controller sees and commands a vehicle.

One implementation flies a real or simulated PX4 (`vehicle.px4`); tests drive the same flight
shell with another. Positions are east/north metres in the mission's local frame; altitudes are
metres above home; times are seconds on the vehicle's own clock.
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
    """The flight modes that matter to a mission, under the names pilots know."""

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
    """For how long each input was missing while others came, seconds on the vehicle's clock.

    In a silence of all of them none ages: that is `LinkSilent`. One that never came has no age.

    Attributes:
        position_s: GLOBAL_POSITION_INT; one that repeats itself in motion is none.
        mode_s: HEARTBEAT or CURRENT_MODE, the younger.
        armed_s: HEARTBEAT.
        battery_s: SYS_STATUS.
        fix_s: GPS_RAW_INT.
        landed_s: EXTENDED_SYS_STATE; one that contradicts the motion is none.
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
    """What the vehicle reported about itself last; one value for everything that changes steadily.

    Attributes:
        time_s: When it was at this position, seconds on its clock since it booted.
        position: Horizontal position, metres east/north of the mission's origin.
        altitude_m: Metres above home, as that was at take-off.
        velocity_m_s: Velocity (east, north) in metres per second.
        heading_deg: Clockwise from true north, None when unknown.
        armed: Motors may turn.
        in_air: As the autopilot reports, not a guess from altitude.
        mode: The flight mode the autopilot reports, never the one that was requested.
        failsafe: The autopilot acts on a failsafe of its own: it flies another mode than intended.
        battery: Remaining charge from 0 to 1, None when unknown.
        item: Sequence number of the plan item it flies to, None when unknown.
        fix: The satellite receiver has a position; True also while it says nothing of itself.
        target: Where it reports to fly to or hover; None when unknown.
        altitude_amsl_m: Metres above mean sea level; None when unknown.
        gps_amsl_m: The same by the satellite receiver alone; None when unknown, or old.
        home_moved: By how much the autopilot's home is off that of the take-off, from which the
            heights of its plan do not count any more; None while it is where it was.
        wind_m_s: How the air moves (east, north), as the autopilot estimates it; None if it tells
            none, as a multicopter does without EKF2_DRAG_CTRL.
        terminated: Motors stopped for good, by a kill switch or flight termination.
        ages: How old each of these is.
        voltage_v: Of the battery; None when unknown.
        satellites: That the receiver uses; None when unknown.
        target_altitude_m: How high above home, as that was at take-off, `target` is; None: unknown.
        accuracy_m: Horizontally, as the satellite receiver reports it; None when unknown.
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
        """Whether it flies to a place, or hovers there, as far as it reports.

        Args:
            place: Metres east/north of the mission's origin.
            altitude_m: Metres above home; None: at any.
            aside_m: So far beside it is there.
        """
        target, target_m = self.target, self.target_altitude_m
        if target is None:
            return True
        up_m = 0.0 if target_m is None or altitude_m is None else target_m - altitude_m
        return math.dist(target, place) <= aside_m and abs(up_m) <= TARGET_REACHED_UP_M

    @property
    def received_s(self) -> float:
        """When the newest of it was sent, on the vehicle's clock: `time_s` if positions come."""
        return self.time_s + self.ages.position_s


@dataclass(frozen=True, slots=True)
class ItemReached:
    """The autopilot reports that it has reached a plan item."""

    time_s: float
    item: int  # seq in the plan on board


@dataclass(frozen=True, slots=True)
class PlanReplaced:
    """A ground station has uploaded a plan or a fence; `PlanCompared` tells whether it is ours.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        only_fence: The items are still ours: a zone was added, perhaps, where we are flying to.
    """

    time_s: float
    only_fence: bool = False


@dataclass(frozen=True, slots=True)
class PlanTried:
    """Another sender tries to put a plan, or a fence, on board, and PX4 does not take it.

    Only what PX4 answers on our own link can be seen, and that PX4 is busy with such a transfer.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        who: Which sender, as text.
    """

    time_s: float
    who: str


@dataclass(frozen=True, slots=True)
class PlanCompared:
    """A plan that was replaced was read back and compared with the one that we put on board.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        difference: What is on board instead, or why it is not known; None: it flies the same.
    """

    time_s: float
    difference: str | None = None


@dataclass(frozen=True, slots=True)
class LinkSilent:
    """Nothing has come from the vehicle for a while.

    Attributes:
        time_s: The vehicle's clock when its last message came.
        silent_s: Wall-clock seconds since then.
        over: It sends again just now.
    """

    time_s: float
    silent_s: float
    over: bool = False


@dataclass(frozen=True, slots=True)
class WrongVehicle:
    """What is on the link is not what the mission is for, or is so again.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        why_not: Why no mission is flown with it; None: that is over.
        twins: Two autopilots answer under one system id.
    """

    time_s: float
    why_not: str | None
    twins: bool = False


@dataclass(frozen=True, slots=True)
class MavlinkSpoofed:
    """On a signed link messages come in the vehicle's name that its key does not vouch for.

    They are ignored. It is reported once.

    Attributes:
        time_s: Seconds on the vehicle's clock.
        count: How many so far.
    """

    time_s: float
    count: int


VehicleEvent = (Telemetry | ItemReached | PlanReplaced | PlanTried | PlanCompared | LinkSilent) | (
    WrongVehicle | MavlinkSpoofed
)


@dataclass(frozen=True, slots=True)
class VehicleInfo:
    """Who answered: system id, autopilot and its version, and where its home is.

    `took_off_s` is when it took off, on its clock; None if it does not fly, or does not report it.
    `airframe` is what kind of vehicle it reports that it is.
    """

    system_id: int
    autopilot: str
    version: str  # "1.17.0"
    home: Point | None  # in the mission's frame; None: not known yet
    home_altitude_amsl_m: float | None
    took_off_s: float | None = None
    airframe: Airframe = field(default_factory=Airframe)


FIX_3D: Final = 3  # GPS_FIX_TYPE


@dataclass(frozen=True, slots=True)
class GpsFix:
    """What the satellite receiver reports.

    Attributes:
        kind: GPS_FIX_TYPE: 0 and 1 none, 2 without altitude, 3 full, above that corrected.
        satellites: In use; None when unknown.
        accuracy_m: Horizontal, as the receiver estimates it; None when unknown.
    """

    kind: int
    satellites: int | None = None
    accuracy_m: float | None = None

    @property
    def good(self) -> bool:
        """Whether it is a position in three dimensions."""
        return self.kind >= FIX_3D


@dataclass(frozen=True, slots=True)
class Inspection:
    """What a vehicle on the ground reports about itself on request: for a pre-flight check.

    Attributes:
        healthy: The autopilot's own health and arming checks pass.
        problems: What they find, as text; empty also where the autopilot does not say.
        warnings: What they find that does not keep it from arming.
        gps: The receiver; None when it says nothing.
        battery: Remaining charge from 0 to 1, None when unknown.
        voltage_v: Of the battery, None when unknown.
        wind_m_s: How the air moves (east, north); None when unknown.
        unix_s: The vehicle's own clock, None until it knows the time.
        parameters: By name; None for one that the vehicle does not have (or does not tell).
        absent: Those of which it reports that it does not have them.
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
    """The vehicle is in a flight mode in which an order may not leave, or was on its way.

    Attributes:
        mode: Which; a pilot, a ground station or a failsafe chose it.
        sent: Whether the order had left before that showed.
    """

    def __init__(self, text: str, mode: FlightMode, *, sent: bool) -> None:
        super().__init__(text)
        self.mode, self.sent = mode, sent


Objection = Callable[[], str | None]
"""Why an order must not leave, after all; None if it may."""


def no_objection() -> str | None:
    """It may leave."""
    return None


Modes = Collection[FlightMode] | None
"""The flight modes that an order may end; None: the one that the vehicle was in last."""


class Vehicle(Protocol):
    """Verbs of a vehicle. Each returns when the vehicle has confirmed it, or raises.

    What moves it, or changes its mode, leaves only when the vehicle has just reported one
    of the modes that the order may end (`out_of`); that of an order of ours which may yet show is
    one of them.

    Raises:
        NoVehicleError: from `connect`, with a diagnosis.
        PlanRefusedError: from `upload`, `renew` and `recognise`, when what is on board is not what
            was sent; from `start`, when it was replaced meanwhile.
        ArmingRefusedError: from `arm`, with the autopilot's reasons; from `arm` and `start`, where
            the pilot has disarmed the vehicle or chosen a mode.
        NotConfirmedError: when a command was sent and the vehicle did not follow.
        NotSentError: when it was not sent, because the flight mode of now was not received.
        TakenOverError: when the vehicle is in another mode, before it left or instead of following.
    """

    async def connect(self) -> VehicleInfo:
        """Find the vehicle, or say within seconds what is wrong."""

    def subscribe(self, callback: Callable[[VehicleEvent], None]) -> None:
        """Hand every event to `callback`, in order, on the event loop."""

    async def inspect(self, parameters: Sequence[str]) -> Inspection:
        """Request what a pre-flight check checks, with the values of these parameters."""

    async def upload(self, plan: FlightPlan) -> None:
        """Put nodes and fence on board and read both back."""

    async def renew(self, plan: FlightPlan, objection: Callable[[], str | None]) -> None:
        """Put a changed fence on board, in flight too, and read all back.

        Args:
            plan: With that fence.
            objection: Asked before each transfer: why nothing may be put on board any more.

        Items are sent only where they are others than those on board, and then not in Mission
        mode in the air: the vehicle would begin the plan anew.
        """

    async def recognise(self, plan: FlightPlan) -> None:
        """Make sure that this plan is on board already, in flight too, without changing it."""

    def count_heights_from(self, home_amsl_m: float) -> None:
        """Take home to have been so high above mean sea level at the take-off, and tell so at once.

        For a vehicle that another companion flew before: its home may have been moved since.
        """

    async def arm(self) -> None:
        """Arm, once, waiting for the autopilot's health first; never over a disarming."""

    async def start(self) -> None:
        """Enter Mission mode: on the ground this takes off.

        Not over what the pilot chose since `arm`: a vehicle that was disarmed, or is in another
        mode, is left as it is.
        Returns as well when nothing shows whether it does: it may, and its telemetry will tell.
        """

    async def jump(
        self, item: int, objection: Objection = no_objection, *, out_of: Modes = None
    ) -> None:
        """Fly straight to a plan item and hover there, in Mission mode.

        Args:
            item: Sequence number in the plan on board.
            objection: Asked as each message leaves: why the leg must not be begun any more.
            out_of: The modes that it may end.
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
            point: Metres east/north in the mission's local frame.
            altitude_m: Metres above the home of the take-off, whichever home PX4 has now.
            objection: Asked as it leaves: why the leg must not be begun any more.
            out_of: The modes that it may end.
        """

    async def hold(self, *, out_of: Modes = None) -> None:
        """Stop and hover here; `out_of`: the modes that it may end."""

    async def land(self, *, out_of: Modes = None) -> None:
        """Descend here and touch down; `out_of`: the modes that it may end."""

    async def announce(self, text: str, severity: Severity) -> None:
        """Inform the pilot: shown by ground stations, kept in the autopilot's log."""

    async def close(self) -> None:
        """Let go of the link; the vehicle keeps doing what it does."""
