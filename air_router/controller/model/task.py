"""What the mission is doing, for whom, until when, and on which way: a part of the context."""

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
        why: In words.
        by_request: Such a return may be called off.
        place: Where it lands, as text.
        urgent: The battery demands it: it does not wait for an upload.
        instruction: What the pilot or the operator does about it; None: it ends as it was to.
    """

    why: str
    by_request: bool = False
    place: str = "at home"
    urgent: bool = False
    instruction: Instruction | None = None


class Progress(Enum):
    """How far the flight to a goal is."""

    IDLE = "nowhere to go"
    FLYING = "on the way"
    ARRIVED = "there"
    NO_ROUTE = "no clear way from here"


@dataclass(frozen=True, slots=True)
class Goal:
    """Where to: a node of the plan, or any point."""

    position: Point
    node: int | None = None  # None: a point that is no node


@dataclass(frozen=True, slots=True)
class Planned:
    """A way was planned already: its first motion; None: see `ActiveRoute.progress`."""

    motion: Motion | None


@dataclass(frozen=True, slots=True)
class Hover:
    """Go nowhere any more, and hover.

    Attributes:
        why: In words.
        instruction: What the pilot does about it: that is announced, and a way planned again in
            a moment; None: it hovers because that is wanted.
        at_leg_end: The leg under way ends where it would stop: it is not braked for.
    """

    why: str
    instruction: Instruction | None = None
    at_leg_end: bool = False


@dataclass(frozen=True, slots=True)
class NoWay:
    """Hover where no clear way leads on, announce it, and check again in a moment."""

    refusal: str


@dataclass(frozen=True, slots=True)
class Rest:
    """Nothing is commanded.

    Attributes:
        why: In words.
        again_s: `retry` is called after so long; None: the state waits for events. At a goal
            `arrived` is called with every telemetry update, whatever it returned.
    """

    why: str
    again_s: float | None = None


Wanted = Goal | Motion | Signal | Planned | Hover | NoWay | Rest
"""What a state wants next.

A `Goal` is flown to, by legs that are planned and checked; another motion is commanded as it is; a
`Signal` leads to another state. The navigator hands a motion to the gate, which commands legs and
landings only past `INTERLOCKS`.
"""


class StateHandler:
    """What is flown in a state: asked while it lasts, never in another. This one flies nothing.

    Each method returns what is wanted next. It may announce (`MissionContext.inform`, `warn`,
    `alarm`) and plan (`Navigator.plan_to`), and command nothing. `HoldState` and `ReadyState` have
    other methods that do.
    """

    def begin(self) -> Wanted:
        """The state was entered."""
        return Rest("nothing is flown in this state")

    def arrived(self) -> Wanted:
        """The vehicle is where it was sent; called again as long as it stays there."""
        return Rest("it is there")

    def no_route(self, refusal: str) -> Wanted:
        """No clear way leads there from here, and why."""
        return NoWay(refusal)

    def retry(self) -> Wanted:
        """The pause is over after something that could not be done."""
        return Rest("nothing waits in this state")

    def replan(self) -> Wanted:
        """Other zones count from now on, and nothing was commanded meanwhile: plan anew."""
        return Rest("nothing is flown in this state")


@dataclass(slots=True, eq=False)
class ActiveRoute:
    """What is left of the way to a goal. Only its methods change it.

    Attributes:
        goal: Where to; None: nowhere.
        leg: The leg under way.
        legs: Those behind it.
        progress: How far the flight to the goal is.
        refusal: Why there is no way, with `Progress.NO_ROUTE`.
        braking: The vehicle stops, and a way is searched for again once it stands.
        rechecks: How often it checked again in vain.
        stands_since_s: Since when it stands short of its leg's end, vehicle's clock.
        swept: What the leg under way was checked for.
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
        """The legs that are still to be flown, the one under way first."""
        return () if self.leg is None else (self.leg, *self.legs)

    def fly(self, leg: Leg, swept: tuple[Point, ...]) -> None:
        """This leg is under way, and was checked for all that."""
        self.leg, self.swept = leg, swept
        self.braking, self.progress = False, Progress.FLYING

    def follow(self, legs: Iterable[Leg]) -> None:
        """These are the legs to the goal, from where the vehicle is."""
        self.legs = deque(legs)

    def rechecked(self, swept: tuple[Point, ...]) -> None:
        """The leg under way was checked anew, for all that."""
        self.swept = swept

    def arrive(self) -> None:
        """The vehicle is where it was sent."""
        self.leg = None
        self.legs.clear()
        self.progress = Progress.ARRIVED

    def refuse(self, refusal: NoRoute) -> None:
        """There is no way from here, and why."""
        self.refusal, self.progress = refusal, Progress.NO_ROUTE

    def stop(self) -> None:
        """The vehicle is stopped, and a way is searched for once it stands."""
        self.braking, self.progress = True, Progress.FLYING

    def brake(self) -> None:
        """The same, and what was planned is void."""
        self.leg = None
        self.legs.clear()
        self.stop()

    def go_on(self) -> None:
        """It is not stopped after all."""
        self.braking = False

    def stand(self, since_s: float | None) -> None:
        """It stands short of its leg's end since then, vehicle's clock; None: it moves."""
        self.stands_since_s = since_s

    def recheck(self) -> int:
        """The navigator checks again for a clear leg on; how often it did, with this time."""
        self.rechecks += 1
        return self.rechecks


@dataclass(slots=True, eq=False)
class Task:
    """The row of the table of states that is flown. Only its methods change it.

    Attributes:
        state: What the mission is doing.
        spec: The row of the table of states for it.
        handler: What is flown in this state.
        way: What is left of the way to where the vehicle is sent.
        robot: Who is sought or hovered over; None while no robot is.
        ending: Why the vehicle comes home or lands; None while it does not.
        stayed_why: Why the mission ended before take-off, if it does.
        airborne_s: When the mission began in the air; None: it has not.
        home_by_s: When it comes home, vehicle's clock, where zones have active hours: other zones
            may apply later.
        limit_s: How long the state lasts once its timer runs; None: it has none.
        remaining_s: How long the next state lasts, instead of the time set in the mission.
        ends_s: When the state's timer ends; None while it does not run.
        retry_at_s: When something that could not be done is tried again; None: nothing waits.
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
        """Another state begins, or the same anew.

        Args:
            state: That one.
            spec: Its row.
            handler: What is flown in it.
            own_s: How long it lasts, as set in the mission; None: it has no timer.
            now_s: Vehicle's clock.
        """
        self.state, self.spec, self.handler = state, spec, handler
        self.limit_s = own_s if self.remaining_s is None else self.remaining_s
        self.ends_s = self.remaining_s = self.retry_at_s = None
        if spec.timer_from is TimerStart.ENTRY:
            self.start_timer(now_s)
        if spec.requests is CommandPolicy.ANY:  # a way home that was flown before is called off
            self.ending = None

    def carry(self, limit_s: float | None) -> None:
        """The state that begins next lasts so long, instead of the time set in the mission."""
        self.remaining_s = limit_s

    def start_timer(self, now_s: float) -> None:
        """The state's timer begins now, if it has one."""
        if self.limit_s is not None:
            self.ends_s = now_s + self.limit_s

    def stop_timer(self) -> None:
        """The state's timer begins later."""
        self.ends_s = None

    def retry_at(self, at_s: float) -> None:
        """Something is to be tried again then, vehicle's clock."""
        self.retry_at_s = at_s

    def take_retry(self, now_s: float) -> bool:
        """Whether it is time to try again; reports it once."""
        if self.retry_at_s is None or now_s < self.retry_at_s:
            return False
        self.retry_at_s = None
        return True

    def head_for(self, goal: Goal | None) -> None:
        """The vehicle is sent there from now on; None: nowhere."""
        self.way = ActiveRoute(goal)

    def seek(self, robot: str | None) -> None:
        """This robot is sought or hovered over from now on; None: no robot is."""
        self.robot = robot

    def end(self, ending: EndReason) -> None:
        """The vehicle comes home or lands, and why."""
        self.ending = ending

    def stay(self, why: str) -> None:
        """The mission ends before take-off, and why."""
        self.stayed_why = why

    def fly_since(self, airborne_s: float) -> None:
        """The mission began in the air then, vehicle's clock."""
        self.airborne_s = airborne_s

    def come_home_by(self, at_s: float) -> None:
        """The zones may be others later than that, vehicle's clock."""
        self.home_by_s = at_s
