"""What all parts of the controller share: what they read, and how they are heard."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

from air_router.controller.model.actions import Action, Announce, ControlHolder
from air_router.controller.model.standing_alarms import StandingAlarms
from air_router.controller.model.states import Signal, Spec, State
from air_router.mission import Mission
from air_router.routing import Leg, NoRoute, Pace, Router
from air_router.vehicle import InputWatch, Instruction, Severity, Telemetry
from geo.frame import Point


class StateHandler:
    """What is flown in a state: asked while it lasts, never in another. This one flies nothing."""

    def begin(self) -> None:
        """The state was entered."""

    def arrived(self) -> None:
        """The vehicle is where it was sent; said again as long as it stays there."""

    def no_route(self, refusal: str) -> None:
        """No clear way leads there from here, and why."""

    def retry(self) -> None:
        """The pause is over after something that could not be done."""

    def replan(self) -> None:
        """Other zones count from now on, and nothing was commanded meanwhile: plan anew."""


class OnBoard(Enum):
    """Whose the plan on board is."""

    OURS = "this mission's"
    REPLACED = "uploaded by a ground station, and not yet compared with this mission's"
    ANOTHER = "another"


class ZoneChange(Enum):
    """How far a change of zones is."""

    CLEARING = "the vehicle stops where it may not go on any more"
    LEAVING = "the vehicle flies out of what was drawn over it"
    UPLOADING = "the new fence is being put on board"


@dataclass(frozen=True, slots=True)
class Ending:
    """Why the mission ends.

    Attributes:
        why: In words.
        by_request: Such a return may be called off.
        place: Where it lands, in words.
        in_haste: The battery demands it: it waits for nothing that is put on board.
        instruction: What the pilot or the operator does about it; None: it ends as it was to.
    """

    why: str
    by_request: bool = False
    place: str = "at home"
    in_haste: bool = False
    instruction: Instruction | None = None


@dataclass(frozen=True, slots=True)
class Held:
    """Why a vehicle that was handed over hovers, and what the pilot does about it."""

    why: str
    instruction: Instruction


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


@dataclass(slots=True, eq=False)
class Way:
    """What is left of the way to a goal.

    Attributes:
        goal: Where to; None: nowhere.
        leg: The leg under way.
        legs: Those behind it.
        progress: How far the flight to the goal is.
        refusal: Why there is no way, once `progress` says so.
        braking: The vehicle stops, and a way is looked for again once it stands.
        settled: How often it looked again in vain.
        stands_since_s: Since when it stands short of its leg's end, vehicle's clock.
        swept: What the leg under way was checked for.
    """

    goal: Goal | None = None
    leg: Leg | None = None
    legs: deque[Leg] = field(default_factory=deque)
    progress: Progress = Progress.IDLE
    refusal: NoRoute | None = None
    braking: bool = False
    settled: int = 0
    stands_since_s: float | None = None
    swept: tuple[Point, ...] = ()

    @property
    def ahead(self) -> tuple[Leg, ...]:
        """The legs that are still to be flown, the one under way first."""
        return () if self.leg is None else (self.leg, *self.legs)

    def brake(self) -> None:
        """The vehicle is stopped first, and the way is planned anew from there."""
        self.leg = None
        self.legs.clear()
        self.braking = True
        self.progress = Progress.FLYING


def _no_machine(signal: Signal) -> None:
    """A context of its own, without a state machine, keeps its state."""


@dataclass(eq=False)
class MissionContext:
    """Owns the mission, its airspace and the router, the vehicle's telemetry, and who has it.

    Everything else reads them here and copies nothing, so that nothing has to be told when zones
    change; what a part has worked out from them it keeps beside the mission that it is true of.
    It decides nothing.

    Attributes:
        mission: With the zones and fences of now.
        router: Plans among these.
        way_out_router: Plans the way out of a zone among what applies from the vehicle's height to
            the cruise altitudes; None: `router` does.
        signal: Tells the state machine that something has happened to the mission.
        state: What the mission is doing; the state machine enters it.
        spec: The row of the table of states for it.
        handler: What is flown in this state.
        telemetry: What the vehicle said last; None before it was heard.
        inputs: Which inputs of a flight are missing.
        silent_s: For how long nothing has come since, as the link reports.
        now_s: Seconds on the vehicle's clock, which never runs back here.
        actions: What to do about the event that is being taken in, in order.
        way: What is left of the way to where the vehicle is sent.
        alarms: What the pilot has to act on, until it is over.
        ends_s: When the state's timer ends; None while it does not run.
        retry_at_s: When something that could not be done is tried again; None: nothing waits.
        robot: Who is sought or hovered over; None while no robot is.
        ending: Why the vehicle comes home or lands; None while it does not.
        stayed_why: Why the mission ended before take-off, if it does.
        stopped_why: Why it was stopped as it took off; None once it flies, or another has it.
        airborne_s: When the mission began in the air.
        leaving: The zones that it is no breach to be in: they were drawn over the vehicle.
        handed_over: Armed in Mission mode: the pilot who did that gave the flight to us.
        taken_by: The pilot or failsafe that has, or had, the vehicle; None: we do.
        on_board: Whose the plan on board is.
        wrong_vehicle: Why no mission is flown with what is on the link; None: it is right.
        held: Why a vehicle that was handed over hovers where no leg of this mission may begin;
            None: it does not.
        giving_up: Why hands will be off as soon as the vehicle holds; None if they will not.
        compares: What was replaced on board, while it holds until that was compared.
        zones: How far a change of zones is; None if none is under way.
        has_to_stop: Zones change, and the hold for that is not confirmed yet.
        jumped: Its altitude has jumped, and it holds until that is over.
        rough: Satellites or wind are worse than planned for, and it holds until that is over.
        home_by_s: When it comes home, on the vehicle's clock, if some zones have their hours: they
            may be others later.
        doubts: An order that is not ours shows, if not for long enough to be sure of it.
        put_off: A motion was dropped for these doubts.
        climbs_first: The next leg is begun at the mission's altitude: the vehicle was taken over,
            and may be anywhere. Stays until it is there.
        limit_s: How long the state lasts once its timer runs; None: it has none.
        carried_s: How long the state that begins next lasts, instead of what the mission says.
    """

    mission: Mission
    router: Router
    signal: Callable[[Signal], None] = _no_machine
    way_out_router: Router | None = None
    state: State = State.READY
    spec: Spec = field(default_factory=Spec)
    handler: StateHandler = field(default_factory=StateHandler)
    telemetry: Telemetry | None = None
    inputs: InputWatch = field(default_factory=InputWatch)
    silent_s: float = 0.0
    now_s: float = 0.0
    actions: list[Action] = field(default_factory=list)
    way: Way = field(default_factory=Way)
    alarms: StandingAlarms = field(default_factory=StandingAlarms)
    ends_s: float | None = None
    retry_at_s: float | None = None
    robot: str | None = None
    ending: Ending | None = None
    stayed_why: str = "disarmed"
    stopped_why: str | None = None
    airborne_s: float | None = None
    leaving: frozenset[str] = frozenset()
    handed_over: bool = False
    taken_by: ControlHolder | None = None
    on_board: OnBoard = OnBoard.OURS
    wrong_vehicle: str | None = None
    held: Held | None = None
    giving_up: str | None = None
    compares: str | None = None
    zones: ZoneChange | None = None
    has_to_stop: bool = False
    jumped: bool = False
    rough: bool = False
    home_by_s: float | None = None
    doubts: bool = False
    put_off: bool = False
    climbs_first: bool = False
    limit_s: float | None = None
    carried_s: float | None = None

    @cached_property
    def pace(self) -> Pace:
        """What ways take the vehicle: zones do not change that."""
        return Pace.of(self.mission)

    @cached_property
    def layer_top_m(self) -> float:
        """Higher above home it would be in the layer of another UAV; nor do they change that."""
        return self.mission.layer_top_m

    @property
    def flown_router(self) -> Router:
        """By what the leg under way, and the next one, are planned and checked."""
        way_out = self.way_out_router if self.zones is ZoneChange.LEAVING else None
        return self.router if way_out is None else way_out

    @property
    def in_air(self) -> bool:
        """Whether the vehicle flies, by its own telemetry."""
        return self.telemetry is not None and self.telemetry.in_air

    @property
    def heard(self) -> Telemetry:
        """What the vehicle said last, where it must have been heard before."""
        assert self.telemetry is not None  # noqa: S101 - in the air there was telemetry
        return self.telemetry

    @property
    def ending_why(self) -> str | None:
        """Why the vehicle comes home or lands, once it does."""
        return None if self.ending is None else self.ending.why

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        return self.handed_over if self.state is State.READY else self.spec.ours

    def knows(self, signal: Signal) -> bool:
        """Whether the state reacts to a signal."""
        return signal in self.spec.on

    def come_home(
        self, why: str, instruction: Instruction | None = None, *, by_request: bool = False
    ) -> None:
        """End the mission, in the air by flying home.

        Where it comes home already, by request, that may not be called off any more. One that is
        `held` stays where it is.

        Args:
            why: In words.
            instruction: What the pilot or the operator does; None: the mission ends as it was to.
            by_request: Such a return may be called off.
        """
        if self.held is not None:  # by what ways it would come home, is not checked
            if self.ending_why != why:
                self.ending = Ending(why, by_request, instruction=instruction)
                self.alarm(
                    f"{why}: it should come home, and cannot: {self.held.why}",
                    self.held.instruction,
                )
            return
        if not self.knows(Signal.COME_HOME):
            requested = self.ending if self.state is State.HOME else None
            if requested is not None and requested.by_request and not by_request:
                # It may not be called off any more.
                words = f"{requested.why}; {why}"
                self.ending = Ending(words, in_haste=requested.in_haste, instruction=instruction)
            return
        self.ending = Ending(why, by_request, instruction=instruction)
        if self.in_air:
            self.signal(Signal.COME_HOME)
        else:
            self.stayed_why = why
            self.signal(Signal.GROUNDED)

    def say(self, text: str) -> None:
        """Announce what the pilot and the operator need to do nothing about."""
        self.actions.append(Announce(text))

    def warn(self, text: str, instruction: Instruction) -> None:
        """Announce what is off, and what the pilot or the operator does if it stays so."""
        self.actions.append(Announce(text, Severity.WARNING, instruction))

    def alarm(self, text: str, instruction: Instruction) -> None:
        """Announce what the pilot has to act on now, and how."""
        self.actions.append(Announce(text, Severity.ALARM, instruction))

    def alarm_until_over(
        self, about: str, text: str, instruction: Instruction, *, lasting: str, since_s: float
    ) -> None:
        """Alarm once, and again, graver, until `over` or until the pilot has the vehicle.

        Args:
            about: What goes on: the same as in `over`.
            text: What happened.
            instruction: What the pilot or the operator does.
            lasting: How it is said again, in words that a duration follows.
            since_s: Since when, vehicle's clock.
        """
        if self.alarms.stand(about, lasting, instruction, self.now_s, since_s):
            self.actions.append(Announce(text, Severity.ALARM, instruction, about))

    def over(self, about: str, text: str = "") -> None:
        """What was alarmed of is over; it is said if it stood and there are words."""
        if self.alarms.end(about) and text:
            self.actions.append(Announce(text, about=about))

    def announce(self, text: str, instruction: Instruction | None, *, alarms: bool = False) -> None:
        """Announce one of a kind: with an instruction it is a warning, or alarms the pilot."""
        if instruction is None:
            self.say(text)
        elif alarms:
            self.alarm(text, instruction)
        else:
            self.warn(text, instruction)

    # The state's timer, and what is tried again.

    def start_timer(self) -> None:
        """The state's timer begins now."""
        if self.limit_s is not None:
            self.ends_s = self.now_s + self.limit_s

    @property
    def left_s(self) -> float | None:
        """Seconds until the state's timer ends, None while it does not run."""
        return None if self.ends_s is None else max(0.0, self.ends_s - self.now_s)

    def retry_in(self, pause_s: float) -> None:
        """Something is to be tried again after a pause."""
        self.retry_at_s = self.now_s + pause_s

    def take_retry(self) -> bool:
        """Whether it is time to try again; says so once."""
        if self.retry_at_s is None or self.now_s < self.retry_at_s:
            return False
        self.retry_at_s = None
        return True
