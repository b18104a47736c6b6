"""The vehicle's flight modes together: which can be flown now, and those that fly by sticks."""

import math
from dataclasses import dataclass, replace
from typing import Final

from sitl.px4sim.auto_modes import Flight, HoldFlight, LandFlight, ReturnFlight, TakeoffFlight
from sitl.px4sim.failsafe import Action
from sitl.px4sim.mission_flight import MissionFlight
from sitl.px4sim.motion import Direct, MotionDemand, Setpoint, SetpointKind
from sitl.px4sim.state import FlightMode, Situation

_DEAD_ZONE: Final = 0.1
_EXPONENT: Final = 0.6
_SLOW_M_S: Final = 0.3
_TILT_SPEED_M_S: Final = 12.0
_YAW_RATE_RAD_S: Final = math.radians(150.0)
_TAKE_OFF: Final = 0.6
_NO_STICKS: Final = 4  # COM_RC_IN_MODE
_YAW_NUDGING: Final = 1  # bit of MPC_AUTO_NUDGING


@dataclass(frozen=True, slots=True)
class Sticks:
    """Where the sticks are: -1 to 1, throttle too (0 is its middle); pitch forward is positive."""

    pitch: float = 0.0
    roll: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0


_SMOOTHED_S: Final = 0.05
_SAME_WAY: Final = 3
"""So often in turn a stick has to move the same way: noise does not."""


class StickSpeed:
    """How fast one axis is moved, smoothed.

    Attributes:
        per_s: Stick travel per second; positive towards 1.
    """

    def __init__(self) -> None:
        self.per_s = 0.0
        self._at: tuple[float, float] | None = None  # simulated time and place of the last
        self._same_way = 0  # moves in turn that way; positive towards 1

    def move(self, now_s: float, place: float) -> None:
        """It is there now."""
        before, self._at = self._at, (now_s, place)
        if before is None or now_s <= before[0]:
            return
        passed_s, moved = now_s - before[0], place - before[1]
        self.per_s += (moved / passed_s - self.per_s) * passed_s / (passed_s + _SMOOTHED_S)
        if moved > 0.0:
            self._same_way = max(self._same_way, 0) + 1
        elif moved < 0.0:
            self._same_way = min(self._same_way, 0) - 1

    def exceeds(self, per_s: float) -> bool:
        """Whether it is moved on purpose, and faster than that."""
        return abs(self.per_s) > per_s and abs(self._same_way) >= _SAME_WAY


class StickInput:
    """The state of the pilot's sticks.

    Attributes:
        sticks: As received last.
    """

    def __init__(self) -> None:
        self.sticks = Sticks()
        self._received_s = -math.inf  # simulated time of the last MANUAL_CONTROL
        self._rest = Sticks()  # the first received: sticks that are moved have left it
        self._speeds = tuple(StickSpeed() for _ in range(4))  # by axis
        self._nudging = False  # the yaw stick has turned the vehicle in the present automatic mode

    def on_sticks(self, sticks: Sticks, situation: Situation) -> None:
        """MANUAL_CONTROL came in."""
        if not self.present(situation):
            self._rest = sticks
            self._speeds = tuple(StickSpeed() for _ in range(4))
        axes = (sticks.pitch, sticks.roll, sticks.throttle, sticks.yaw)
        for speed, place in zip(self._speeds, axes, strict=True):
            speed.move(situation.time_s, place)
        self.sticks, self._received_s = sticks, situation.time_s

    def present(self, situation: Situation) -> bool:
        """Whether sticks are received: COM_RC_IN_MODE admits joysticks, within COM_RC_LOSS_T."""
        if int(situation.parameters["COM_RC_IN_MODE"]) == _NO_STICKS:
            return False
        patience_s = situation.parameters.limited("COM_RC_LOSS_T", 0.0, 60.0)
        return situation.time_s - self._received_s <= patience_s

    def takes_over(self, situation: Situation) -> bool:
        """Whether the sticks are moved so far that a pilot means it (COM_RC_STICK_OV)."""
        if not self.present(situation):
            return False
        threshold = situation.parameters.limited("COM_RC_STICK_OV", 5.0, 80.0) / 100.0
        now, rest = self.sticks, self._rest
        moved = max(abs(now.pitch - rest.pitch), abs(now.roll - rest.roll), abs(now.yaw - rest.yaw))
        return moved > threshold

    def moves_fast(self, situation: Situation) -> bool:
        """Whether a stick is moved so fast that a pilot means it (MAN_OVERRIDE_SPD)."""
        limit_per_s = situation.parameters["MAN_OVERRIDE_SPD"]
        return limit_per_s >= 0.0 and any(speed.exceeds(limit_per_s) for speed in self._speeds)

    def nudged(self, wanted: MotionDemand, situation: Situation) -> MotionDemand:
        """What an automatic mode wants, turned by the yaw stick if MPC_AUTO_NUDGING lets it.

        Without the stick the heading stays until the mode changes.
        """
        allowed = int(situation.parameters.get("MPC_AUTO_NUDGING", 0)) & _YAW_NUDGING
        if not allowed or not self.present(situation):
            self._nudging = False
            return wanted
        turn = shaped(self.sticks.yaw)
        self._nudging = self._nudging or turn != 0.0
        if not self._nudging:
            return wanted
        return replace(wanted, yaw_rad=None, yaw_rate_rad_s=turn * _YAW_RATE_RAD_S)

    def end_nudging(self) -> None:
        """The mode changes: it turns as the new one wants."""
        self._nudging = False


@dataclass(eq=False)
class StickFlight(Flight):
    """Position mode, or Altitude mode, which does not hold a place.

    Attributes:
        pilot: Whose sticks.
        holds_place: Whether it stays where it is while the sticks rest.
    """

    pilot: StickInput
    holds_place: bool
    _place: tuple[float, float] | None = None  # north, east, held while the sticks rest
    _altitude_m: float | None = None  # AMSL, held while the throttle rests

    def activate(self, situation: Situation) -> None:  # noqa: ARG002 - see `Flight`
        """See `Flight`."""
        self._place = self._altitude_m = None

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        sticks = self.pilot.sticks if self.pilot.present(situation) else Sticks()
        if situation.landed and sticks.throttle < _TAKE_OFF:
            return Setpoint()
        velocity_m_s = self._horizontal(sticks, situation)
        up_m_s = self._vertical(sticks, situation)
        turn = shaped(sticks.yaw) * _YAW_RATE_RAD_S
        direct = Direct(self._place, self._altitude_m, velocity_m_s, up_m_s, turn)
        return Setpoint(SetpointKind.DIRECT, direct=direct)

    def _horizontal(self, sticks: Sticks, situation: Situation) -> tuple[float, float]:
        """The velocity that the sticks demand; updates the position to hold."""
        most_m_s = situation.parameters.limited("MPC_VEL_MANUAL", 3.0, 20.0)
        speed_m_s = most_m_s if self.holds_place else _TILT_SPEED_M_S
        forward, right = shaped(sticks.pitch) * speed_m_s, shaped(sticks.roll) * speed_m_s
        if self.holds_place and forward == right == 0.0:
            north, east, _ = situation.velocity_m_s
            if self._place is None and math.hypot(north, east) < _SLOW_M_S:
                self._place = situation.here
            return 0.0, 0.0
        self._place = None
        cosine, sine = math.cos(situation.heading_rad), math.sin(situation.heading_rad)
        return forward * cosine - right * sine, forward * sine + right * cosine

    def _vertical(self, sticks: Sticks, situation: Situation) -> float:
        """The climb that the sticks demand; updates the altitude to hold."""
        up = shaped(sticks.throttle)
        if up == 0.0:
            if self._altitude_m is None and abs(situation.velocity_m_s[2]) < _SLOW_M_S:
                self._altitude_m = situation.altitude_m
            return 0.0
        self._altitude_m = None
        name = "MPC_Z_VEL_MAX_UP" if up > 0 else "MPC_Z_VEL_MAX_DN"
        return up * situation.parameters.limited(name, 0.5, 8.0)


def shaped(value: float) -> float:
    """A stick as PX4 shapes it: a dead zone in the middle, then finer there than at the end."""
    sign = math.copysign(1.0, value)
    part = (min(abs(value), 1.0) - _DEAD_ZONE) / (1.0 - _DEAD_ZONE)
    if part <= 0.0:
        return 0.0
    return sign * ((1.0 - _EXPONENT) * part + _EXPONENT * part**3)


_WITHOUT_POSITION: Final = frozenset(
    {FlightMode.ALTCTL, FlightMode.AUTO_LAND, FlightMode.TERMINATION}
)


class FlightModes:
    """How each mode flies.

    Args:
        mission: Of Mission mode; others know it as well.

    Attributes:
        hold: Of Hold.
        takeoff: Of Takeoff.
        returning: Of Return.
        pilot: Whose sticks the stick modes fly by.
        flights: How each mode flies; what has no entry is not flown.
    """

    def __init__(self, mission: MissionFlight) -> None:
        self._mission = mission
        self.hold = HoldFlight()
        self.takeoff = TakeoffFlight()
        self.returning = ReturnFlight()
        self.pilot = StickInput()
        self.flights: dict[FlightMode, Flight] = {
            FlightMode.AUTO_LOITER: self.hold,
            FlightMode.AUTO_TAKEOFF: self.takeoff,
            FlightMode.AUTO_MISSION: mission,
            FlightMode.AUTO_RTL: self.returning,
            FlightMode.AUTO_LAND: LandFlight(),
            FlightMode.POSCTL: StickFlight(self.pilot, holds_place=True),
            FlightMode.ALTCTL: StickFlight(self.pilot, holds_place=False),
        }

    def can_fly(self, mode: FlightMode, situation: Situation) -> bool:
        """Whether a mode can be flown now, in the air."""
        if mode not in self.flights or _lacks_position(mode, situation):
            return False
        if mode is FlightMode.AUTO_MISSION:
            return self._mission.valid
        if mode is FlightMode.AUTO_RTL:
            return situation.home is not None
        return not mode.needs_pilot or self.pilot.present(situation)

    def blocks_arming(self, mode: FlightMode, situation: Situation) -> bool:
        """Whether PX4 refuses to arm in a mode now."""
        if mode.prevents_arming or _lacks_position(mode, situation):
            return True
        needs_more = mode in (FlightMode.AUTO_MISSION, FlightMode.OFFBOARD) or mode.needs_pilot
        return needs_more and not self.can_fly(mode, situation)

    def fallback(self, mode: FlightMode, situation: Situation) -> Action:
        """What the vehicle does instead of a mode that it was flying and cannot fly any more."""
        lands = mode is FlightMode.AUTO_LAND and not situation.position_valid  # it knows no place
        if lands or _lacks_position(mode, situation):
            piloted = mode is FlightMode.POSCTL and self.pilot.present(situation)
            return Action.FALLBACK_ALTITUDE if piloted else Action.DESCEND
        lost = mode.needs_pilot and not self.pilot.present(situation)
        return Action.RTL if lost else Action.NONE


def _lacks_position(mode: FlightMode, situation: Situation) -> bool:
    return mode not in _WITHOUT_POSITION and not situation.position_valid
