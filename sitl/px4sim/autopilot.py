"""The simulated autopilot: modes, arming, take-off and landing, as PX4 1.17 does them.

Pure: `step` moves the simulated time on, methods are commands that came in, `take_notices`
returns what it announces. It knows nothing of MAVLink but PX4's mode numbers and item layouts.
"""

from dataclasses import replace
from typing import Final

from sitl.px4sim.auto_modes import go_to
from sitl.px4sim.estimation import ArmingReason, GroundContact, Positioning
from sitl.px4sim.failsafe import (
    Action,
    AltitudeLoss,
    Cause,
    Failsafe,
    Watchdog,
    receivers_forbid_arming,
)
from sitl.px4sim.fence import Fence
from sitl.px4sim.flight_modes import FlightModes, Sticks
from sitl.px4sim.mission_flight import MissionFlight, PlanIntake
from sitl.px4sim.motion import (
    GRAVITY_M_S2,
    EstimateErrors,
    Multirotor,
    Setpoint,
    SetpointKind,
    Wind,
    WindSettings,
    wanted_velocity,
)
from sitl.px4sim.parameters import Parameters
from sitl.px4sim.plan_store import PlanStore
from sitl.px4sim.state import FlightMode, MapProjection, Notice, Severity, Situation, StartPosition

HOME_AFTER_S: Final = 2.2
ARMABLE_AFTER_S: Final = 4.5
_DRAG_LEAVES: Final = 0.9
_HOLD: Final = 4
_BOOT_MODES: Final = {  # COM_FLTMODE_BOOT
    1: FlightMode.ALTCTL,
    2: FlightMode.POSCTL,
    3: FlightMode.AUTO_MISSION,
    _HOLD: FlightMode.AUTO_LOITER,
    14: FlightMode.OFFBOARD,
    17: FlightMode.AUTO_TAKEOFF,
}
_ROTORS: Final = 4


class Autopilot:
    """A multirotor and its autopilot.

    Its parts are public to be read; `situation` is what they share. `report_requested` is set by
    RUN_PREARM_CHECKS, and taken back when the report is made; `events_sent` numbers its EVENTs.

    Args:
        place: Where it stands.
        parameters: On board; with them, of which version of PX4 it is.
        seed: Of the estimate's errors.
        time_scale: How much faster than the wall clock the simulation is meant to run; links are
            watched on the wall's clock.
        wind: That blows; None: no wind.
    """

    def __init__(
        self,
        place: StartPosition,
        parameters: Parameters,
        *,
        seed: int = 0,
        time_scale: float = 1.0,
        wind: WindSettings | None = None,
    ) -> None:
        behaviour = self.behaviour = parameters.behaviour
        self.place = place
        self.parameters = parameters
        self.start_unix_s = 0.0  # Unix time of simulated time zero
        self.airframe = Multirotor()
        self.errors = EstimateErrors(seed)
        self.wind = Wind(wind or WindSettings(), seed)
        self.plan = PlanStore()
        self.positioning = Positioning()
        self.failsafe = Failsafe()
        self.watchdog = Watchdog(time_scale, companion_s=behaviour.companion_s)
        self._altitude_loss = AltitudeLoss()
        self.fence = Fence(self.plan)
        self.mission = MissionFlight()
        self.modes = FlightModes(self.mission)
        self.situation = Situation(
            MapProjection(place.latitude_deg, place.longitude_deg),
            parameters,
            self.request_mode,
            place.altitude_m,
            altitude_m=place.altitude_m,
            home_altitude_m=place.altitude_m,
        )
        # PX4's nav_state, nav_state_user_intention, and what disarming puts back into the latter.
        begins_in = _BOOT_MODES.get(int(parameters.get("COM_FLTMODE_BOOT", _HOLD)))
        self.mode = self.intended = self._after_disarming = begins_in or FlightMode.AUTO_LOITER
        self.flying_mode: FlightMode | None = None  # in the last step; None: it was disarmed
        self.terminated = False  # for good: it never arms again (flight termination)
        self.report_requested = False
        self.events_sent = 0
        self._intake = PlanIntake(self.plan, self.fence, self.mission, self.modes.returning)
        self._home_base_m = place.altitude_m  # home's AMSL before the wandering error is added
        self._ground = GroundContact()
        # Sticks choose Position only before any mode command, and not from 1.18 on.
        self._mode_requested = not behaviour.mode_by_first_sticks

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
        blocked = self.modes.blocks_arming(self.mode, self.situation)
        ready = self.time_s >= ARMABLE_AFTER_S and not self.fence.violated
        ready = ready and not receivers_forbid_arming(self.situation)
        return ready and not blocked and not self.terminated

    @property
    def shown_mode(self) -> FlightMode:
        """The mode that PX4 reports: 1.18 does not report a failsafe's termination."""
        hides = self.terminated and self.behaviour.shows_intended_in_termination
        return self.intended if hides else self.mode

    @property
    def taking_off(self) -> bool:
        """Whether EXTENDED_SYS_STATE reports "taking off"."""
        return not self.situation.landed and (
            self.mode is FlightMode.AUTO_TAKEOFF
            or (self.mode is FlightMode.AUTO_MISSION and self.mission.climbing)
        )

    @property
    def landing(self) -> bool:
        """Whether EXTENDED_SYS_STATE reports "landing"."""
        return not self.situation.landed and self.situation.setpoint.kind is SetpointKind.LAND

    def take_notices(self) -> list[Notice]:
        """The announcements since the last call."""
        notices, self.situation.notices = self.situation.notices, []
        return notices

    # Commands

    def request_mode(self, mode: FlightMode, *, forced: bool = False) -> bool:
        """Change the mode as PX4's users do; whether it was allowed.

        Disarmed nearly everything is. A mode command during a failsafe takes the vehicle over.
        """
        can_fly = self.modes.can_fly(mode, self.situation)
        ended = self.terminated and not self.behaviour.mode_ends_termination
        if ended or (self.armed and not forced and not can_fly):
            return False
        self.terminated = False
        self.intended = mode
        self._mode_requested = True
        if not mode.prevents_arming and mode is not FlightMode.AUTO_TAKEOFF:
            self._after_disarming = mode
        self.failsafe.taken_over(self.situation)
        return True

    def reposition(
        self,
        point: tuple[float, float] | None,
        altitude_m: float | None,
        speed_m_s: float | None = None,
    ) -> bool:
        """Go to a point in Hold mode, which a mode command requests; see `HoldFlight.move_to`.

        Returns whether it goes there: not on the ground, nor out of its fence.
        """
        if not self.armed:
            return False
        situation = self.situation
        allowed = self.fence.allows(*(point or situation.here), situation)
        if allowed:
            self.modes.hold.move_to(point, altitude_m, speed_m_s, situation)
        else:
            situation.announce("navigator_reposition_outside_geofence")
        return allowed

    def move_sticks(self, sticks: Sticks) -> None:
        """A pilot's sticks are there; moved, they take an automatic mode over.

        COM_RC_OVERRIDE lets them, or from 1.18 on MAN_OVERRIDE_SPD.
        """
        situation, pilot = self.situation, self.modes.pilot
        pilot.on_sticks(sticks, situation)
        if not self.armed:
            if not self._mode_requested:
                self.request_mode(FlightMode.POSCTL)
            return
        if self.behaviour.overrides_by_speed:
            overridden = pilot.moves_fast(situation)
        else:  # in automatic modes
            allowed = bool(int(self.parameters["COM_RC_OVERRIDE"]) & 1)
            overridden = allowed and pilot.takes_over(situation)
        if self.mode.needs_pilot or not overridden:
            return
        acting = self.failsafe.acting
        if self.request_mode(FlightMode.POSCTL) and not acting:
            situation.announce("commander_rc_override")

    def set_home(self, point: tuple[float, float], altitude_m: float) -> None:
        """Move home."""
        self.situation.home = point
        self._home_base_m = altitude_m - self.errors.home_altitude_m

    def arm(self, reason: ArmingReason = ArmingReason.COMMAND) -> bool:
        """Start the motors if PX4's checks allow it."""
        situation = self.situation
        if self.armed:
            return True
        alone = self.can_arm and self.watchdog.misses_ground_station(situation)
        if alone:
            text = "Preflight Fail: No connection to the GCS"
            situation.notices.append(Notice(Severity.WARNING, text))
        if alone or not self.can_arm:
            situation.announce("commander_arm_denied_resolve_failures")
            return False
        situation.armed, situation.took_off_s = True, None
        self._ground.armed(self.time_s)
        self.watchdog.armed()
        self._set_home_here()
        situation.announce("commander_armed_by", reason.number, reason=reason.text)
        return True

    def disarm(self, reason: ArmingReason = ArmingReason.COMMAND, *, forced: bool = False) -> bool:
        """Stop the motors; in flight only if forced, and then it falls."""
        situation = self.situation
        if not self.armed:
            return True
        if not situation.landed and not forced:
            situation.announce("commander_disarm_denied_not_landed")
            return False
        situation.armed = False
        self.intended = self._after_disarming
        self.mission.disarmed()
        self.failsafe.reset()
        self.modes.hold.forget()
        situation.announce("commander_disarmed_by", reason.number, reason=reason.text)
        return True

    def terminate(self) -> bool:
        """Flight termination: motors off for good."""
        if not self.armed:
            return False
        self.terminated = True
        self.intended = FlightMode.TERMINATION
        if not self.behaviour.mode_ends_termination:
            self._after_disarming = FlightMode.TERMINATION
        return True

    def take_up_plan(self) -> None:
        """Take up a plan that was stored; every step does so, too."""
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
        situation, errors = self.situation, self.errors
        self.positioning.step(step_s, errors, self.airframe, situation)
        situation.home_altitude_m = self._home_base_m + errors.home_altitude_m
        if situation.home is None and self.time_s >= HOME_AFTER_S:
            self._set_home_here()

    def _watch(self, step_s: float) -> None:
        situation = self.situation
        sticks = self.modes.pilot.present(situation)
        for action, cause in self.watchdog.step(step_s, self.intended, situation, sticks=sticks):
            self.failsafe.trigger(action, cause, self.intended, situation)
        if self.behaviour.holds_end_with_cause:
            self.failsafe.end(self.watchdog.over())
        action = self.fence.breach(situation)
        if action is Action.HOLD:
            # It holds where the breach was seen: it overshoots and comes back to that point.
            here = go_to(*situation.here, situation.altitude_m, situation)
            self.modes.hold.reposition(here)
        self.failsafe.trigger(action, Cause.GENERIC, self.intended, situation)
        lost = self._altitude_loss.step(situation)
        if lost is not None:
            self.failsafe.trigger(*lost, self.intended, situation)
        self.failsafe.fall_back(
            self.modes.fallback(self.intended, situation), self.intended, situation
        )
        self.failsafe.step(self.intended, situation)

    def _fly(self, step_s: float) -> None:
        situation = self.situation
        self.mode = self.failsafe.mode(self.intended)
        if self.terminated or self.mode is FlightMode.TERMINATION:
            self.terminated, self.mode = True, FlightMode.TERMINATION
        flying_mode = self.mode if self.armed else None
        flight = self.modes.flights.get(self.mode) if self.armed else None
        if flying_mode is not self.flying_mode:
            if self.flying_mode is FlightMode.AUTO_MISSION:
                self.mission.deactivate()
            self.flying_mode = flying_mode
            self.modes.pilot.end_nudging()
            if flight is not None:
                situation.speed_m_s = None
                flight.activate(situation)
            if self.mode in (FlightMode.AUTO_TAKEOFF, FlightMode.AUTO_LAND) and self.armed:
                self.mission.finished = False
        situation.setpoint = Setpoint() if flight is None else flight.update(situation)
        self._complete_mode()
        self._move(step_s)

    def _complete_mode(self) -> None:
        """A take-off or a mission that has ended goes over into Hold."""
        flown, mission, landed = self.flying_mode, self.mission, self.situation.landed
        took_off = flown is FlightMode.AUTO_TAKEOFF and self.modes.takeoff.done
        if took_off or (flown is FlightMode.AUTO_LAND and landed):
            mission.finished = True
        flies_mission = flown is self.intended is FlightMode.AUTO_MISSION and not landed
        if took_off or (flies_mission and mission.finished):
            self.request_mode(FlightMode.AUTO_LOITER, forced=True)

    def _move(self, step_s: float) -> None:
        situation = self.situation
        airframe = self.airframe
        velocity_m_s = (airframe.velocity_north_m_s, airframe.velocity_east_m_s)
        push = self.wind.step(step_s, velocity_m_s, flying=not airframe.on_ground)
        if not self.armed or self.terminated or self._lacks_lift():
            airframe.step(step_s, None, push)
            return
        wanted = self._ground.hold_down(situation) or wanted_velocity(
            situation.setpoint,
            (*situation.here, situation.altitude_m),
            situation.ground_altitude_m,
            situation.cruise_m_s,
            situation.speed_limits(),
        )
        if not situation.position_valid:  # it cannot know where it drifts, and brakes by drag alone
            wanted = replace(
                wanted,
                north_m_s=velocity_m_s[0] * _DRAG_LEAVES,
                east_m_s=velocity_m_s[1] * _DRAG_LEAVES,
            )
        if not self.mode.needs_pilot:
            wanted = self.modes.pilot.nudged(wanted, situation)
        airframe.step(step_s, wanted, push)

    def _lacks_lift(self) -> bool:
        """Whether its rotors do not carry it: PX4's simulator takes that from two parameters."""
        limited = self.parameters.limited
        lift_n = _ROTORS * limited("SIH_T_MAX", 0.0, 1000.0)
        return lift_n < limited("SIH_MASS", 0.0, 1000.0) * GRAVITY_M_S2

    def _end_step(self) -> None:
        situation = self.situation
        if self._ground.detect(self.airframe, situation):
            self._set_home_here()
        if not self.armed or not situation.landed:
            return
        in_mission = self.mode is FlightMode.AUTO_MISSION and not self.mission.finished
        reason = self._ground.disarm_due(situation, in_mission=in_mission)
        if reason is not None:
            self.disarm(reason)

    def _set_home_here(self) -> None:
        situation = self.situation
        self.set_home(situation.here, situation.altitude_m)
        situation.home_altitude_m = situation.altitude_m
