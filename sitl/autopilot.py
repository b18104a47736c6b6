"""The simulated autopilot: modes, arming, take-off and landing, as PX4 1.17 does them.

Pure: `step` moves the simulated time on, methods are commands that came in, `take_notices` is
what it says. It knows nothing of MAVLink but PX4's mode numbers and item layouts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from sitl.arming import ArmingReason, disarm_due
from sitl.auto_modes import Flight, HoldFlight, LandFlight, ReturnFlight, TakeoffFlight, go_to
from sitl.battery import Battery
from sitl.dynamics import Multirotor
from sitl.estimator import EstimateErrors
from sitl.failsafe import Action, Cause, Failsafe
from sitl.fence_guard import FenceGuard
from sitl.ground_contact import GroundContact
from sitl.guidance import Setpoint, SetpointKind, wanted_velocity
from sitl.mission_flight import MissionFlight
from sitl.notice import Notice, Severity
from sitl.parameters import Parameters
from sitl.plan_intake import PlanIntake
from sitl.plan_store import PlanStore
from sitl.projection import MapProjection
from sitl.px4_modes import FlightMode
from sitl.situation import Place, Situation
from sitl.watchdog import Watchdog

HOME_AFTER_S: Final = 2.2
ARMABLE_AFTER_S: Final = 4.5


class Autopilot:
    """A multirotor and its autopilot.

    Args:
        place: Where it stands.
        parameters: On board.
        seed: Of the estimate's errors.
        time_scale: How much faster than the wall clock the simulation is meant to run; links are
            watched on the wall's clock.
    """

    def __init__(
        self, place: Place, parameters: Parameters, *, seed: int = 0, time_scale: float = 1.0
    ) -> None:
        self.place = place
        self.parameters = parameters
        self.airframe = Multirotor()
        self.errors = EstimateErrors(seed)
        self.battery = Battery()
        self.plan = PlanStore()
        self.failsafe = Failsafe()
        self.watchdog = Watchdog(time_scale)
        self.guard = FenceGuard(self.plan)
        self.mission = MissionFlight()
        self._hold = HoldFlight()
        self._takeoff = TakeoffFlight()
        self._return = ReturnFlight()
        self._flights: dict[FlightMode, Flight] = {
            FlightMode.AUTO_LOITER: self._hold,
            FlightMode.AUTO_TAKEOFF: self._takeoff,
            FlightMode.AUTO_MISSION: self.mission,
            FlightMode.AUTO_RTL: self._return,
            FlightMode.AUTO_LAND: LandFlight(),
        }
        self.situation = Situation(
            MapProjection(place.latitude_deg, place.longitude_deg),
            parameters,
            self._ask_mode,
            place.altitude_m,
            altitude_m=place.altitude_m,
            home_altitude_m=place.altitude_m,
        )
        self.mode = self.intended = self._after_disarming = FlightMode.AUTO_LOITER
        self._flying_mode: FlightMode | None = None
        self.setpoint = Setpoint()
        self.terminated = False
        self._intake = PlanIntake(self.plan, self.guard, self.mission, self._return)
        self._home_base_m = place.altitude_m
        self._ground = GroundContact()
        self._armed_s = 0.0

    # What the world may see

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start."""
        return self.situation.time_s

    @property
    def armed(self) -> bool:
        """Whether the motors turn."""
        return self.situation.armed

    @property
    def can_arm(self) -> bool:
        """Whether PX4's health and arming checks pass in the present mode."""
        mission_missing = self.mode is FlightMode.AUTO_MISSION and not self.mission.result.valid
        blocked = self.mode.prevents_arming or self.mode.needs_pilot or mission_missing
        offboard = self.mode is FlightMode.OFFBOARD
        ready = self.time_s >= ARMABLE_AFTER_S and not self.guard.violated
        return ready and not blocked and not offboard and not self.terminated

    @property
    def taking_off(self) -> bool:
        """Whether EXTENDED_SYS_STATE says "taking off"."""
        return not self.situation.landed and (
            self.mode is FlightMode.AUTO_TAKEOFF
            or (self.mode is FlightMode.AUTO_MISSION and self.mission.climbing)
        )

    @property
    def landing(self) -> bool:
        """Whether EXTENDED_SYS_STATE says "landing"."""
        return not self.situation.landed and self.setpoint.kind is SetpointKind.LAND

    def take_notices(self) -> list[Notice]:
        """What was said since the last call."""
        said, self.situation.notices = self.situation.notices, []
        return said

    # Commands

    def request_mode(self, mode: FlightMode, *, forced: bool = False) -> bool:
        """Change the mode as PX4's users do; whether it was allowed.

        Disarmed nearly everything is. A mode command during a failsafe takes the vehicle over.
        """
        if self.terminated or (self.armed and not forced and not self._can_fly(mode)):
            return False
        self.intended = mode
        if not mode.prevents_arming and mode is not FlightMode.AUTO_TAKEOFF:
            self._after_disarming = mode
        self.failsafe.taken_over(self.situation)
        return True

    def reposition(
        self,
        point: tuple[float, float] | None,
        altitude_m: float | None,
        yaw_rad: float | None = None,
        speed_m_s: float | None = None,
    ) -> None:
        """Go to a point in Hold mode; None keeps what is. The mode is asked for separately."""
        if not self.armed:
            return
        situation = self.situation
        north, east = point or (self.setpoint.north_m, self.setpoint.east_m)
        if point is None and self.setpoint.kind is SetpointKind.IDLE:
            north, east = situation.north_m, situation.east_m
        if not self.guard.allows(*(point or (situation.north_m, situation.east_m))):
            situation.say(
                "Reposition is outside geofence",
                "navigator_reposition_outside_geofence",
                Severity.CRITICAL,
                Severity.ERROR,
            )
            return
        target_m = situation.altitude_m if altitude_m is None else altitude_m
        target = replace(go_to(north, east, target_m, situation), yaw_rad=yaw_rad)
        self._hold.reposition(target, speed_m_s)

    def take_off(self, altitude_m: float) -> None:
        """Set the height of the next take-off, AMSL; NaN: MIS_TAKEOFF_ALT above here."""
        self._takeoff.request(altitude_m)

    def set_home(self, point: tuple[float, float], altitude_m: float) -> None:
        """Move home."""
        self.situation.home = point
        self._home_base_m = altitude_m - self.errors.home_altitude_m

    def arm(self, reason: ArmingReason = ArmingReason.COMMAND) -> bool:
        """Start the motors if PX4's checks allow it."""
        if self.armed:
            return True
        if not self.can_arm or self.watchdog.refuses_arming(self.situation):
            self.situation.say(
                "Arming denied: Resolve system health failures first",
                "commander_arm_denied_resolve_failures",
                Severity.CRITICAL,
            )
            return False
        situation = self.situation
        situation.armed = True
        self._armed_s = self.time_s
        self._ground.armed(self.time_s)
        self.watchdog.armed()
        self._set_home_here()
        situation.say(f"Armed by {reason.words}", "commander_armed_by", arguments=bytes((reason,)))
        return True

    def arm_for_mission(self) -> bool:
        """What MISSION_START does."""
        return self.request_mode(FlightMode.AUTO_MISSION) and self.arm(ArmingReason.MISSION_START)

    def disarm(self, reason: ArmingReason = ArmingReason.COMMAND, *, forced: bool = False) -> bool:
        """Stop the motors; in flight only if forced, and then it falls."""
        situation = self.situation
        if not self.armed:
            return True
        if not situation.landed and not forced:
            situation.say(
                "Disarming denied: not landed",
                "commander_disarm_denied_not_landed",
                Severity.CRITICAL,
            )
            return False
        situation.armed = False
        self.intended = self._after_disarming
        self.mission.disarmed()
        self.failsafe.disarmed()
        self._hold.forget()
        situation.say(
            f"Disarmed by {reason.words}", "commander_disarmed_by", arguments=bytes((reason,))
        )
        return True

    def terminate(self) -> bool:
        """Flight termination: motors off for good."""
        if not self.armed:
            return False
        self.terminated = True
        return True

    def take_up_plan(self) -> None:
        """Look whether another plan was stored; also done with every step."""
        self._intake.step(self.situation)

    # Time

    def step(self, step_s: float) -> None:
        """Let `step_s` simulated seconds pass."""
        self._renew(step_s)
        self._watch(step_s)
        self.take_up_plan()
        self._fly(step_s)
        self._end_step()

    def _renew(self, step_s: float) -> None:
        situation, airframe, errors = self.situation, self.airframe, self.errors
        situation.time_s += step_s
        errors.step(step_s, in_air=not situation.landed)
        situation.north_m = airframe.north_m + errors.north_m
        situation.east_m = airframe.east_m + errors.east_m
        situation.altitude_m = self.place.altitude_m + airframe.up_m + errors.altitude_m
        situation.velocity_m_s = (
            airframe.velocity_north_m_s,
            airframe.velocity_east_m_s,
            airframe.velocity_up_m_s,
        )
        situation.heading_rad = airframe.yaw_rad
        situation.home_altitude_m = self._home_base_m + errors.home_altitude_m
        if situation.home is None and self.time_s >= HOME_AFTER_S:
            self._set_home_here()

    def _watch(self, step_s: float) -> None:
        parameters, situation = self.parameters, self.situation
        self.battery.step(
            step_s,
            armed=self.armed,
            drain_s=parameters["SIM_BAT_DRAIN"],
            least=parameters["SIM_BAT_MIN_PCT"] / 100.0,
            thresholds=(
                parameters["BAT_LOW_THR"],
                parameters["BAT_CRIT_THR"],
                parameters["BAT_EMERGEN_THR"],
            ),
        )
        for action, cause in self.watchdog.step(self.battery, situation):
            self.failsafe.trigger(action, cause, self.intended, situation)
        action = self.guard.breach(situation)
        if action is Action.HOLD:
            # It holds where the breach was seen: it overshoots and comes back to that point.
            here = (situation.north_m, situation.east_m, situation.altitude_m)
            self._hold.reposition(go_to(*here, situation))
        self.failsafe.trigger(action, Cause.GENERIC, self.intended, situation)
        self.failsafe.step(self.intended, situation)

    def _fly(self, step_s: float) -> None:
        situation = self.situation
        self.mode = self.failsafe.mode(self.intended)
        if self.terminated or self.mode is FlightMode.TERMINATION:
            self.terminated, self.mode = True, FlightMode.TERMINATION
        flying_mode = self.mode if self.armed else None
        flight = self._flights.get(self.mode) if self.armed else None
        if flying_mode is not self._flying_mode:
            if self._flying_mode is FlightMode.AUTO_MISSION:
                self.mission.deactivate()
            self._flying_mode = flying_mode
            if flight is not None:
                flight.activate(situation, self.setpoint)
            if self.mode in (FlightMode.AUTO_TAKEOFF, FlightMode.AUTO_LAND) and self.armed:
                self.mission.result.finished = False
        self.setpoint = Setpoint() if flight is None else flight.update(situation)
        self._complete_mode()
        self._move(step_s)

    def _complete_mode(self) -> None:
        """A take-off or a mission that has ended goes over into Hold."""
        if self._flying_mode is FlightMode.AUTO_TAKEOFF and self._takeoff.done:
            self.mission.result.finished = True
            self.request_mode(FlightMode.AUTO_LOITER, forced=True)
        elif self._flying_mode is FlightMode.AUTO_LAND and self.situation.landed:
            self.mission.result.finished = True
        elif (
            self._flying_mode is FlightMode.AUTO_MISSION
            and self.mission.result.finished
            and self.intended is FlightMode.AUTO_MISSION
            and not self.situation.landed
        ):
            self.request_mode(FlightMode.AUTO_LOITER, forced=True)

    def _move(self, step_s: float) -> None:
        situation = self.situation
        if not self.armed or self.terminated:
            self.airframe.step(step_s, None)
            return
        wanted = self._ground.hold_down(self.setpoint, situation) or wanted_velocity(
            self.setpoint,
            (situation.north_m, situation.east_m, situation.altitude_m),
            situation.ground_altitude_m,
            situation.cruise_m_s,
            situation.pace(),
        )
        self.airframe.step(step_s, wanted)

    def _end_step(self) -> None:
        situation = self.situation
        if self._ground.detect(self.airframe, situation):
            self._set_home_here()
        if not self.armed or not situation.landed:
            return
        landed_s = self._ground.landed_s
        reason = disarm_due(
            self.parameters,
            armed_for_s=self.time_s - self._armed_s,
            landed_for_s=None if landed_s is None else self.time_s - landed_s,
            in_mission=self.mode is FlightMode.AUTO_MISSION and not self.mission.result.finished,
        )
        if reason is not None:
            self.disarm(reason)

    def _can_fly(self, mode: FlightMode) -> bool:
        if mode is FlightMode.AUTO_MISSION:
            return self.mission.result.valid
        if mode is FlightMode.AUTO_RTL:
            return self.situation.home is not None
        return mode in self._flights

    def _ask_mode(self, mode: FlightMode) -> None:
        self.request_mode(mode)

    def _set_home_here(self) -> None:
        situation = self.situation
        self.set_home((situation.north_m, situation.east_m), situation.altitude_m)
        situation.home_altitude_m = situation.altitude_m
