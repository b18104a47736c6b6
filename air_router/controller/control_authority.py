"""Giving the vehicle away, to a pilot or a failsafe, and taking it back when the operator asks.

Before hands are off for a reason of ours (it is in a zone, the plan on board is another) it is
told to hold, because it flies a leg of ours; and again, until it does, or the pilot takes it. So it
is while a plan that a ground station uploaded is compared with ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from air_router.controller.model.actions import (
    ControlHolder,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    Motion,
)
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.states import Signal, State
from air_router.controller.monitor.flight_phase import FlightPhase
from air_router.controller.monitor.safety_monitor import low, why_not_resumed
from air_router.controller.motion.command_gate import RETRY_S, CommandGate
from air_router.controller.motion.pending_setpoints import stopping_point
from air_router.mission.mission import Mission
from air_router.vehicle.vehicle import PlanCompared, PlanReplaced, Telemetry

HOLDS: Final = 6
"""How often a vehicle is told to hold before hands are off though it does not."""

COMPARED_S: Final = 60.0
"""A plan that was not compared within this time counts as another: the link is too poor."""


CLIMB_S: Final = 20.0
PROGRESS_M: Final = 0.5
"""A climb that gains less than this in that time does not go on."""


class OnBoard(Enum):
    """Whose the plan on board is."""

    OURS = "this mission's"
    REPLACED = "uploaded by a ground station, and not yet compared with this mission's"
    ANOTHER = "another"


@dataclass(slots=True, eq=False)
class InitialClimb:
    """Has a vehicle climb straight up where it is, and only then fly its legs.

    Args:
        context: How high it is, and what is flown once it is level.
        gate: Commands the climb.

    Attributes:
        wanted: The next leg is begun at the mission's altitude: the vehicle was taken over, and
            may be anywhere. Stays until it is there.
        climb: Its way up; None: it does not climb.
    """

    _context: MissionContext
    _gate: CommandGate
    wanted: bool = False
    climb: FlyToPoint | None = None
    _gained: tuple[float, float] = (0.0, 0.0)  # the last progress: altitude, time

    def why_not(self, telemetry: Telemetry) -> str | None:
        """Why it cannot climb here by itself, and what the pilot does; None if it can, or is up."""
        mission, here = self._context.mission, telemetry.position
        if not low(mission, telemetry):
            return None
        drift_m = mission.planner.tracking_margin_m
        airspace = mission.climb_airspace.as_drawn().with_margin(drift_m)
        names = airspace.blockers(here, here) or _layers_between(mission, telemetry)
        if not names:
            return None
        return (
            f"it is {telemetry.altitude_m:.0f} m above home, too near to {' and '.join(names)} to "
            f"climb by itself: climb to {mission.altitude_above_home_m:.0f} m by hand, then choose "
            "Hold"
        )

    def first(self, motion: Motion) -> Motion | None:
        """An interlock: the leg of a vehicle that is low waits, and it climbs instead."""
        if not self.wanted or not isinstance(motion, FlyToNode | FlyToPoint):
            return motion
        mission, telemetry = self._context.mission, self._context.heard
        if not low(mission, telemetry):
            self.wanted = False
            return motion
        self._gate.navigator.stop()
        why_not = self.why_not(telemetry)
        if why_not is not None:
            self._gate.wait_here(why_not)
            return None
        if self.climb is None:
            self._context.say(
                f"climbing from {telemetry.altitude_m:.0f} to "
                f"{mission.altitude_above_home_m:.0f} m first"
            )
            self._gained = (telemetry.altitude_m, self._context.now_s)
        place = stopping_point(telemetry, self._gate.navigator.reaction_s)
        self.climb = FlyToPoint(place, mission.altitude_above_home_m)
        return self.climb

    def go_on(self, telemetry: Telemetry) -> bool:
        """Whether it climbs, and everything else waits."""
        if self.climb is None:
            return False
        if self._gate.commanded_mode.last is not self.climb:
            # It did not follow, or was told to hold: the climb begins anew before the next leg.
            self.climb = None
            return False
        if low(self._context.mission, telemetry):
            if telemetry.altitude_m > self._gained[0] + PROGRESS_M:
                self._gained = (telemetry.altitude_m, telemetry.time_s)
            return True
        self.climb = None
        self.wanted = False
        self._context.handler.replan()
        return True

    @property
    def stuck(self) -> bool:
        """Whether a climb has not gone on for some time."""
        return self.climb is not None and self._context.now_s - self._gained[1] >= CLIMB_S


@dataclass(slots=True, eq=False)
class ControlAuthority:
    """Knows whose the vehicle is.

    Args:
        context: Where it signals that the pilot flies, and that we do again.
        gate: Has it hold.
        flight_phase: Whether it was handed over to us on the ground.
        initial_climb: Whether a vehicle that is taken back climbs to the mission's altitude.

    Attributes:
        giving_up: Why hands will be off as soon as it holds; None if they will not.
        compares: What was replaced on board, while it holds until that was compared; None: it
            does not.
        taken_by: The pilot or failsafe that has, or had, the vehicle; None: we do.
        on_board: Whose the plan on board is.
    """

    _context: MissionContext
    _gate: CommandGate
    _flight_phase: FlightPhase
    _initial_climb: InitialClimb
    giving_up: str | None = None
    taken_by: ControlHolder | None = None
    on_board: OnBoard = OnBoard.OURS
    compares: str | None = None
    _compared_by_s: float = 0.0  # so long the comparison is waited for
    _holds: int = 0  # commanded before hands are off
    _hold_again_s: float = 0.0  # the next attempt, vehicle's clock

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        if self._context.state is State.READY:
            return self._flight_phase.handed_over
        return self._context.spec.ours

    @property
    def waits(self) -> bool:
        """Whether it only holds: it is about to be given away, or the plan on board is compared."""
        return self.giving_up is not None or self.compares is not None

    def only_hold(self, motion: Motion) -> Motion | None:
        """An interlock: what is to be given away, or may follow another plan, is sent nowhere."""
        return motion if self.giving_up is None and self.compares is None else None

    # Away.

    def give_up(self, why: str) -> None:
        """Have it hold, then hands off."""
        self.giving_up = why
        self.compares = None
        self._holds = 0
        self._hold_at_last(why)

    def _hold_at_last(self, why: str) -> None:
        self._holds += 1
        self._hold_again_s = self._context.now_s + RETRY_S
        self._gate.command(HoldHere(why))

    def check(self) -> None:
        """Say the hold again that was lost, or let go at last."""
        commanded_mode, now_s = self._gate.commanded_mode, self._context.now_s
        if not self.waits or commanded_mode.pending is not None:
            return
        holds = isinstance(commanded_mode.last, HoldHere)
        if self.compares is not None:
            if now_s >= self._compared_by_s:
                self._differs(f"{self.compares}, and cannot be read")
            elif not holds and now_s >= self._hold_again_s:
                self._hold_at_last(self.compares)
        elif self.giving_up is not None:
            if holds:
                self._let_go(self.giving_up)
            elif self._holds >= HOLDS:
                self._let_go(f"{self.giving_up}; it was told to hold and did not")
            elif now_s >= self._hold_again_s:
                self._hold_at_last(self.giving_up)

    def _let_go(self, why: str) -> None:
        self.giving_up = None
        self.take_over(ControlHolder.PILOT, why)

    def take_over(self, who: ControlHolder, why: str) -> None:
        """The pilot, or a failsafe, flies from now on."""
        if self._context.knows(Signal.TAKEN_OVER):
            self.taken_by = who
            self._context.say(f"hands off: {why}")
            self._context.signal(Signal.TAKEN_OVER)

    def fallen(self, why: str) -> None:
        """Its motors were stopped in the air: nothing can be done for it."""
        self.taken_by = None
        self._context.say(f"hands off: {why}")
        if self._context.knows(Signal.TAKEN_OVER):
            self._context.signal(Signal.TAKEN_OVER)

    def settled(self) -> None:
        """Hands are off, or the flight is over: nothing is left to give up."""
        self.giving_up = self.compares = None

    # The plan on board.

    def plan_replaced(self, event: PlanReplaced) -> None:
        """A ground station has put a plan, or a fence, on board: hold until it was compared.

        The leg under way may lead where a zone is now, and PX4 goes to the item that it likes. A
        landing needs no plan.
        """
        self.on_board = OnBoard.REPLACED
        what = f"the {'fence' if event.only_fence else 'plan'} on board was replaced"
        self._context.say(f"{what}; comparing it with this mission's")
        if self.in_charge and self._context.state is not State.LAND and self.giving_up is None:
            self.compares = what
            self._compared_by_s = self._context.now_s + COMPARED_S
            self._hold_again_s = self._context.now_s + RETRY_S
            self._gate.navigator.stop()
            self._gate.hold(what)

    def plan_compared(self, event: PlanCompared) -> None:
        """Go on if it flies as ours does; otherwise hands off."""
        if event.difference is not None:
            self._differs(f"another plan is on board ({event.difference})")
            return
        self.on_board = OnBoard.OURS
        again = "the plan on board flies as this mission's does"
        if self.compares is None:
            self._context.say(again)
            return
        self.compares = None
        self._context.say(f"{again}: going on")
        self._initial_climb.wanted = True  # it may have sunk, or have been stopped in its climb
        if not self._context.in_air:
            return
        if self._context.state is State.READY:  # it hovers, stopped in its climb
            self._flight_phase.resumed(self._context.now_s)
            self._context.signal(Signal.AIRBORNE)
        else:
            self._context.handler.replan()

    def _differs(self, why: str) -> None:
        """Another plan is on board."""
        self.on_board = OnBoard.ANOTHER
        context, telemetry = self._context, self._context.telemetry
        if context.state is State.READY and telemetry is not None and not telemetry.armed:
            self._flight_phase.stayed_why = why
            context.signal(Signal.GROUNDED)
        elif context.state is State.READY and not self.in_charge:
            self.take_over(ControlHolder.PILOT, why)
        elif context.state in {State.LAND, State.PASSIVE}:
            context.say(why)
        elif self.in_charge and self.giving_up is None:
            self.give_up(why)

    # And back.

    def why_not_back(self, *, flies_plan: bool = True) -> str | None:
        """What has to be done before the vehicle can be taken back; None if nothing.

        Args:
            flies_plan: It is to fly by the plan on board; otherwise it is sent to points.
        """
        telemetry = self._context.telemetry
        if telemetry is None:
            return "nothing was heard of the vehicle: wait for it"
        why = why_not_resumed(self._context.mission, telemetry)
        why = why or self._initial_climb.why_not(telemetry)
        if why is not None or not flies_plan:
            return why
        if self.on_board is OnBoard.REPLACED:
            return "the plan on board is being read: ask again in a moment"
        if self.on_board is OnBoard.ANOTHER:
            return (
                "another plan is on board: 'resume upload' puts this mission's there and goes on, "
                "'home' comes home without it"
            )
        return None

    @property
    def way_back(self) -> str:
        """What the operator can do about a vehicle that is not ours."""
        return self.why_not_back() or "'resume' takes it back, 'home' brings it home"

    def resume(self, *, upload: bool = False) -> str | None:
        """Go on with a flight that was given away, or that a companion before us has left.

        Args:
            upload: Another plan may be on board: ours is put there.

        Returns why not, if not.
        """
        why = self.why_not_back(flies_plan=not upload)
        if why is not None:
            self._context.say(f"not resumed: {why}")
            return why
        self._context.say("resumed: the mission goes on from here")
        self._take_back()
        ready = self._context.state is State.READY
        self._context.signal(Signal.AIRBORNE if ready else Signal.RESUMED)
        return None

    def take_home(self) -> str | None:
        """Take it back to come home, whatever plan is on board; returns why not, if not."""
        why = self.why_not_back(flies_plan=False)
        if why is None:
            self._gate.navigator.by_points |= self.on_board is not OnBoard.OURS
            self._take_back()
        return why

    def _take_back(self) -> None:
        self._flight_phase.resumed(self._context.now_s)
        self.taken_by = None
        self._gate.commanded_mode.assume(self._context.heard.mode)
        self._initial_climb.wanted = True


def _layers_between(mission: Mission, telemetry: Telemetry) -> tuple[str, ...]:
    """The other UAVs that fly between where the vehicle is and its own layer."""
    own = next((layer for layer in mission.layers if layer.uav == mission.uav), None)
    if own is None:
        return ()
    here_m = telemetry.altitude_m + own.level_m - own.altitude_m
    lowest_m = here_m - mission.planner.vertical_separation_m
    return tuple(o.uav for o in mission.layers if lowest_m < o.level_m < own.level_m)
