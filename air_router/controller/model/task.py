"""The mission's state, robot, timer and route: one part of the context."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum

from air_router.controller.model.actions import Motion
from air_router.controller.model.states import CommandPolicy, Signal, State, StateSpec, TimerStart
from air_router.routing import Leg, NoRoute
from air_router.vehicle import Instruction
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class EndReason:
    """Why the mission ends.

    Attributes:
        why: The reason, as text.
        by_request: The return may be canceled.
        place: Where it lands, as text.
        urgent: The battery demands it, so it does not wait for an upload.
        instruction: Action of the pilot or the operator; None: a normal end.
    """

    why: str
    by_request: bool = False
    place: str = "at home"
    urgent: bool = False
    instruction: Instruction | None = None


class Progress(Enum):
    """Progress of the flight to a goal."""

    IDLE = "nowhere to go"
    FLYING = "on the way"
    ARRIVED = "there"
    NO_ROUTE = "no clear way from here"


@dataclass(frozen=True, slots=True)
class Goal:
    """A destination: a node of the plan, or any point."""

    position: Point
    node: int | None = None  # None: a point that is no node


@dataclass(frozen=True, slots=True)
class Planned:
    """The first motion of a planned way; None: see `ActiveRoute.progress`."""

    motion: Motion | None


@dataclass(frozen=True, slots=True)
class Hover:
    """Drop the goal and hover.

    Attributes:
        why: The reason, as text.
        instruction: The pilot's action. It is announced, and a way is planned again soon. None:
            hovering is intended.
        at_leg_end: The current leg ends where the vehicle would stop, so no hold is sent.
    """

    why: str
    instruction: Instruction | None = None
    at_leg_end: bool = False


@dataclass(frozen=True, slots=True)
class NoWay:
    """Hover without a clear way, announce it, and retry soon."""

    refusal: str


@dataclass(frozen=True, slots=True)
class Rest:
    """Nothing is commanded.

    Attributes:
        why: The reason, as text.
        again_s: Call `retry` after this time; None: the state waits for events. At a goal `arrived`
            is called with every telemetry update in any case.
    """

    why: str
    again_s: float | None = None


Wanted = Goal | Motion | Signal | Planned | Hover | NoWay | Rest
"""What a state requests next.

The navigator plans and checks legs to a `Goal`, commands any other motion unchanged, and passes a
`Signal` to the state machine. It gives motions to the gate, which commands legs and landings only
if no row of `INTERLOCKS` blocks them.
"""


class StateHandler:
    """The handler of a state; called only in that state. This base class flies nothing.

    Each method returns what the state requests next. It may announce (`MissionContext.inform`,
    `warn`, `alarm`) and plan (`Navigator.plan_to`), but never commands a motion. `HoldState` and
    `ReadyState` have other methods that do.
    """

    def begin(self) -> Wanted:
        """Called when the state is entered."""
        return Rest("nothing is flown in this state")

    def arrived(self) -> Wanted:
        """Called at the goal, repeatedly while the vehicle stays there."""
        return Rest("it is there")

    def no_route(self, refusal: str) -> Wanted:
        """Called when there is no clear way to the goal, with the reason."""
        return NoWay(refusal)

    def retry(self) -> Wanted:
        """Called after the pause that follows a failure."""
        return Rest("nothing waits in this state")

    def replan(self) -> Wanted:
        """Called to plan again: zones have changed, or a motion was blocked."""
        return Rest("nothing is flown in this state")


@dataclass(slots=True, eq=False)
class ActiveRoute:
    """The remaining route to a goal. Only its own methods change it.

    Attributes:
        goal: The destination; None: none.
        leg: The current leg.
        legs: The legs after it.
        progress: Progress of the flight to the goal.
        refusal: Why there is no way; set with `Progress.NO_ROUTE`.
        braking: The vehicle stops; the way is planned again once it hovers.
        rechecks: Number of unsuccessful checks for a next leg.
        stands_since_s: Since when the vehicle hovers short of its leg's end, vehicle's clock.
        swept: Corners of the area checked for the current leg.
    """

    goal: Goal | None = None
    leg: Leg | None = None
    legs: deque[Leg] = field(default_factory=deque)
    progress: Progress = Progress.IDLE
    refusal: NoRoute | None = None
    braking: bool = False
    rechecks: int = 0
    stands_since_s: float | None = None
    swept: tuple[Point, ...] = ()

    @property
    def ahead(self) -> tuple[Leg, ...]:
        """The remaining legs, the current one first."""
        return () if self.leg is None else (self.leg, *self.legs)

    def fly(self, leg: Leg, swept: tuple[Point, ...]) -> None:
        """Start a leg, with the corners of its checked area."""
        self.leg, self.swept = leg, swept
        self.braking, self.progress = False, Progress.FLYING

    def follow(self, legs: Iterable[Leg]) -> None:
        """Set the legs to the goal."""
        self.legs = deque(legs)

    def rechecked(self, swept: tuple[Point, ...]) -> None:
        """Replace the checked area of the current leg."""
        self.swept = swept

    def arrive(self) -> None:
        """The vehicle has reached the goal."""
        self.leg = None
        self.legs.clear()
        self.progress = Progress.ARRIVED

    def refuse(self, refusal: NoRoute) -> None:
        """There is no way from here, with the reason."""
        self.refusal, self.progress = refusal, Progress.NO_ROUTE

    def stop(self) -> None:
        """The vehicle stops; a way is planned once it hovers."""
        self.braking, self.progress = True, Progress.FLYING

    def brake(self) -> None:
        """The same, and the planned legs are void."""
        self.leg = None
        self.legs.clear()
        self.stop()

    def cancel_stop(self) -> None:
        """The stop is not needed anymore."""
        self.braking = False

    def stand(self, since_s: float | None) -> None:
        """The vehicle hovers short of its leg's end since then, vehicle's clock; None: it moves."""
        self.stands_since_s = since_s

    def recheck(self) -> int:
        """Count a check for a clear next leg; return the number of checks."""
        self.rechecks += 1
        return self.rechecks


@dataclass(slots=True, eq=False)
class Task:
    """The current state and its task. Only its own methods change it.

    Attributes:
        state: The state.
        spec: Its row in the table of states.
        handler: Its handler.
        way: The remaining route to the goal.
        robot: The robot that is sought or hovered over; None: none.
        ending: Why the vehicle comes home or lands; None: it does neither.
        stayed_why: Why the mission ended before take-off.
        airborne_s: When the mission began in the air; None: not yet.
        home_by_s: Time to come home, vehicle's clock, because zones have active hours and other
            zones may apply later.
        limit_s: Duration of the state's timer; None: it has none.
        remaining_s: Duration of the next state's timer, instead of the mission's.
        ends_s: When the state's timer expires; None while it does not run.
        retry_at_s: Time of the next retry; None: none is scheduled.
    """

    state: State = State.READY
    spec: StateSpec = field(default_factory=StateSpec)
    handler: StateHandler = field(default_factory=StateHandler)
    way: ActiveRoute = field(default_factory=ActiveRoute)
    robot: str | None = None
    ending: EndReason | None = None
    stayed_why: str = "disarmed"
    airborne_s: float | None = None
    home_by_s: float | None = None
    limit_s: float | None = None
    remaining_s: float | None = None
    ends_s: float | None = None
    retry_at_s: float | None = None

    def enter(
        self,
        state: State,
        spec: StateSpec,
        handler: StateHandler,
        own_s: float | None,
        now_s: float,
    ) -> None:
        """Enter a state, perhaps the same one again.

        Args:
            state: The state.
            spec: Its row in the table of states.
            handler: Its handler.
            own_s: Duration of its timer in the mission; None: it has no timer.
            now_s: Vehicle's clock.
        """
        self.state, self.spec, self.handler = state, spec, handler
        self.limit_s = own_s if self.remaining_s is None else self.remaining_s
        self.ends_s = self.remaining_s = self.retry_at_s = None
        if spec.timer_from is TimerStart.ENTRY:
            self.start_timer(now_s)
        if spec.requests is CommandPolicy.ANY:  # a return is canceled
            self.ending = None

    def carry(self, limit_s: float | None) -> None:
        """Set the duration of the next state's timer, instead of the mission's."""
        self.remaining_s = limit_s

    def start_timer(self, now_s: float) -> None:
        """Start the state's timer, if it has one."""
        if self.limit_s is not None:
            self.ends_s = now_s + self.limit_s

    def stop_timer(self) -> None:
        """Stop the state's timer; it starts later."""
        self.ends_s = None

    def retry_at(self, at_s: float) -> None:
        """Schedule a retry at this time, vehicle's clock."""
        self.retry_at_s = at_s

    def take_retry(self, now_s: float) -> bool:
        """Whether a retry is due; reports it once."""
        if self.retry_at_s is None or now_s < self.retry_at_s:
            return False
        self.retry_at_s = None
        return True

    def head_for(self, goal: Goal | None) -> None:
        """Set the goal; None: no goal."""
        self.way = ActiveRoute(goal)

    def seek(self, robot: str | None) -> None:
        """Set the robot to seek or hover over; None: none."""
        self.robot = robot

    def end(self, ending: EndReason) -> None:
        """The vehicle comes home or lands, for this reason."""
        self.ending = ending

    def stay(self, why: str) -> None:
        """The mission ends before take-off, for this reason."""
        self.stayed_why = why

    def fly_since(self, airborne_s: float) -> None:
        """The mission began in the air at this time, vehicle's clock."""
        self.airborne_s = airborne_s

    def come_home_by(self, at_s: float) -> None:
        """Come home at this time, vehicle's clock: other zones may apply later."""
        self.home_by_s = at_s
