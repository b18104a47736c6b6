"""The vehicle's flight modes together: which can be flown now, and what becomes of it if not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from sitl.px4sim.modes.auto_modes import (
    Flight,
    HoldFlight,
    LandFlight,
    ReturnFlight,
    TakeoffFlight,
)
from sitl.px4sim.modes.direct_modes import OffboardFlight, OrbitFlight, Pilot, StickFlight
from sitl.px4sim.modes.mission_flight import MissionFlight
from sitl.px4sim.safety.failsafe import STICK_LOSS_ACTIONS, Action
from sitl.px4sim.state.px4_modes import FlightMode
from sitl.px4sim.state.situation import Situation

_SETPOINT_LOSS_ACTIONS: Final[Mapping[int, Action]] = {
    3: Action.RTL,
    4: Action.LAND,
    5: Action.HOLD,
    6: Action.TERMINATE,
    7: Action.DISARM,
}
_NEED_POSITION: Final = frozenset(
    {
        FlightMode.AUTO_LOITER,
        FlightMode.AUTO_TAKEOFF,
        FlightMode.AUTO_MISSION,
        FlightMode.AUTO_RTL,
        FlightMode.POSCTL,
        FlightMode.ORBIT,
        FlightMode.OFFBOARD,
    }
)
_STICK_FALLBACKS: Final[Mapping[int, Action]] = {
    0: Action.FALLBACK_POSITION,
    1: Action.FALLBACK_ALTITUDE,
}


class FlightModes:
    """How each mode flies.

    Args:
        mission: Of Mission mode; others know it as well.

    Attributes:
        hold: Of Hold.
        takeoff: Of Takeoff.
        returning: Of Return.
        orbit: Of Orbit.
        offboard: Of Offboard.
        pilot: Whose sticks the stick modes fly by.
    """

    def __init__(self, mission: MissionFlight) -> None:
        self._mission = mission
        self.hold = HoldFlight()
        self.takeoff = TakeoffFlight()
        self.returning = ReturnFlight()
        self.orbit = OrbitFlight()
        self.offboard = OffboardFlight()
        self.pilot = Pilot()
        self._flights: dict[FlightMode, Flight] = {  # without an entry: not to be flown
            FlightMode.AUTO_LOITER: self.hold,
            FlightMode.AUTO_TAKEOFF: self.takeoff,
            FlightMode.AUTO_MISSION: mission,
            FlightMode.AUTO_RTL: self.returning,
            FlightMode.AUTO_LAND: LandFlight(),
            FlightMode.ORBIT: self.orbit,
            FlightMode.OFFBOARD: self.offboard,
        }
        for mode in FlightMode:
            if mode.needs_pilot:
                self._flights[mode] = StickFlight(self.pilot, mode)

    def flight(self, mode: FlightMode) -> Flight | None:
        """How a mode flies; None: not at all."""
        return self._flights.get(mode)

    def can_fly(self, mode: FlightMode, situation: Situation) -> bool:
        """Whether a mode can be flown now, in the air."""
        if mode in _NEED_POSITION and not situation.position_valid:
            return False
        if mode is FlightMode.AUTO_MISSION:
            return self._mission.result.valid
        if mode is FlightMode.AUTO_RTL:
            return situation.home is not None
        if mode is FlightMode.OFFBOARD:
            return self.offboard.available(situation)
        if mode.needs_pilot:
            return self.pilot.present(situation)
        return mode in self._flights

    def blocks_arming(self, mode: FlightMode, situation: Situation) -> bool:
        """Whether PX4 refuses to arm in a mode, as it is now."""
        lost = mode in _NEED_POSITION and not situation.position_valid
        if mode.prevents_arming or lost:
            return True
        if mode is FlightMode.AUTO_MISSION or mode is FlightMode.OFFBOARD or mode.needs_pilot:
            return not self.can_fly(mode, situation)
        return False

    def fallback(self, mode: FlightMode, situation: Situation) -> Action:
        """What the vehicle does instead of a mode that it was flying and cannot fly any more."""
        parameters = situation.parameters
        lost = not situation.position_valid
        if lost and (mode in _NEED_POSITION or mode is FlightMode.AUTO_LAND):  # no landing place
            piloted = mode is FlightMode.POSCTL and self.pilot.present(situation)
            return Action.FALLBACK_ALTITUDE if piloted else Action.DESCEND
        if mode is FlightMode.OFFBOARD and not self.offboard.available(situation):
            choice = int(parameters["COM_OBL_RC_ACT"])
            if choice in _STICK_FALLBACKS and self.pilot.present(situation):
                return _STICK_FALLBACKS[choice]
            if choice in _STICK_FALLBACKS:
                return STICK_LOSS_ACTIONS.get(int(parameters["NAV_RCL_ACT"]), Action.RTL)
            return _SETPOINT_LOSS_ACTIONS.get(choice, Action.RTL)
        if mode.needs_pilot and not self.pilot.present(situation):
            return Action.RTL
        return Action.NONE
