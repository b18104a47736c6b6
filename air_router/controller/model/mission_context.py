"""What all parts of the controller share: what they read, and how they are heard."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

from air_router.controller.model.actions import Action, Announce
from air_router.controller.model.states import From, Signal, Spec, State
from air_router.mission.mission import Mission
from air_router.routing.return_planner import Pace
from air_router.routing.router import Router
from air_router.vehicle.vehicle import Telemetry


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


def _no_machine(signal: Signal) -> None:
    """A context of its own, without a state machine, keeps its state."""


@dataclass(eq=False)
class MissionContext:
    """Owns the mission, its airspace and the router, the vehicle's telemetry and the state.

    Everything else reads them here and copies nothing, so that nothing has to be told when zones
    change; what a part has worked out from them it keeps beside the mission that it is true of.
    It decides nothing.

    Attributes:
        mission: With the zones and fences of now.
        router: Plans among these.
        signal: Tells the state machine that something has happened to the mission.
        state: What the mission is doing; the state machine enters it.
        spec: The row of the table of states for it.
        handler: What is flown in this state.
        telemetry: What the vehicle said last; None before it was heard.
        silent_s: For how long nothing has come since, as the link reports.
        now_s: Seconds on the vehicle's clock, which never runs back here.
        actions: What to do about the event that is being taken in, in order.
        retry_at_s: When something that could not be done is tried again; None: nothing waits.
    """

    mission: Mission
    router: Router
    signal: Callable[[Signal], None] = _no_machine
    state: State = State.READY
    spec: Spec = field(default_factory=Spec)
    handler: StateHandler = field(default_factory=StateHandler)
    telemetry: Telemetry | None = None
    silent_s: float = 0.0
    now_s: float = 0.0
    actions: list[Action] = field(default_factory=list)
    _limit_s: float | None = None  # of the state; None: it has no timer
    _carried_s: float | None = None  # limit of the next state instead of its own
    _from_s: float | None = None  # when the timer began
    retry_at_s: float | None = None

    def knows(self, signal: Signal) -> bool:
        """Whether the state reacts to a signal."""
        return signal in self.spec.on

    @cached_property
    def pace(self) -> Pace:
        """What ways take the vehicle: zones do not change that."""
        return Pace.of(self.mission)

    @property
    def in_air(self) -> bool:
        """Whether the vehicle flies, by its own telemetry."""
        return self.telemetry is not None and self.telemetry.in_air

    @property
    def heard(self) -> Telemetry:
        """What the vehicle said last, where it must have been heard before."""
        assert self.telemetry is not None  # noqa: S101 - in the air there was telemetry
        return self.telemetry

    def enter(self, state: State, spec: Spec, handler: StateHandler) -> None:
        """Another state begins, or the same anew, and its timer; only the state machine says so."""
        self.state, self.spec, self.handler = state, spec, handler
        limit_s = None if spec.timer is None else getattr(self.mission.timers, spec.timer)
        self._limit_s = limit_s if self._carried_s is None else self._carried_s
        self._carried_s = self.retry_at_s = None
        self._from_s = None if spec.timer_from is From.ARRIVAL else self.now_s

    def do(self, action: Action) -> None:
        """Have something done that is no motion: `CommandGate` commands those."""
        self.actions.append(action)

    def say(self, text: str) -> None:
        """Tell the pilot and the operator."""
        self.actions.append(Announce(text))

    # The state's timer, and what is tried again.

    def carry(self, limit_s: float) -> None:
        """The state that begins next lasts so long, instead of what the mission says."""
        self._carried_s = limit_s

    @property
    def timer_runs(self) -> bool:
        """Whether the state's timer has begun."""
        return self._from_s is not None

    def start_timer(self) -> None:
        """The state's timer begins now."""
        self._from_s = self.now_s

    @property
    def left_s(self) -> float | None:
        """Seconds until the state's timer ends, None while it does not run."""
        if self._limit_s is None or self._from_s is None:
            return None
        return max(0.0, self._limit_s - (self.now_s - self._from_s))

    def retry_in(self, pause_s: float) -> None:
        """Something is to be tried again after a pause."""
        self.retry_at_s = self.now_s + pause_s

    def take_retry(self) -> bool:
        """Whether it is time to try again; says so once."""
        if self.retry_at_s is None or self.now_s < self.retry_at_s:
            return False
        self.retry_at_s = None
        return True
