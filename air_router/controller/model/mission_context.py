"""What all parts of the controller share: what they read, and how they are heard."""

from __future__ import annotations

from collections.abc import Callable

from air_router.controller.model.actions import Action, Announce
from air_router.controller.model.behaviour import Signal, State
from air_router.controller.model.state_handler import NO_HANDLER, StateHandler
from air_router.controller.model.state_timers import Schedule
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.vehicle.vehicle import Telemetry


class MissionContext:
    """What every part reads, and the actions they ask for. It decides nothing.

    Args:
        mission: What to fly.
        router: Plans among its zones.
        signal: Tells the state machine that something has happened to the mission.

    Attributes:
        signal: As above.
        mission: With the zones and fences of now.
        router: Plans among these.
        state: What the mission is doing; the state machine enters it.
        handler: What is flown in this state.
        schedule: The vehicle's clock, and the state's timer.
        telemetry: What the vehicle said last; None before it was heard.
        silent_s: For how long nothing has come since, by the link's word.
        actions: What to do about the event that is being taken in, in order.
    """

    def __init__(self, mission: Mission, router: Router, signal: Callable[[Signal], None]) -> None:
        self.mission = mission
        self.router = router
        self.signal = signal
        self.state = State.READY
        self.handler: StateHandler = NO_HANDLER
        self.schedule = Schedule(mission.timers)
        self.telemetry: Telemetry | None = None
        self.silent_s = 0.0
        self.actions: list[Action] = []

    @property
    def now_s(self) -> float:
        """Seconds on the vehicle's clock."""
        return self.schedule.now_s

    @property
    def in_air(self) -> bool:
        """Whether the vehicle flies, by its own word."""
        return self.telemetry is not None and self.telemetry.in_air

    @property
    def heard(self) -> Telemetry:
        """What the vehicle said last, where it must have been heard before."""
        assert self.telemetry is not None  # noqa: S101 - in the air there was telemetry
        return self.telemetry

    def begin(self, now_s: float) -> None:
        """Another event is taken in: nothing is done about it yet."""
        self.actions = []
        self.schedule.tick(now_s)

    def enter(self, state: State, handler: StateHandler) -> None:
        """Another state begins, or the same anew; only the state machine says so."""
        self.state = state
        self.handler = handler
        self.schedule.enter(state)

    def do(self, action: Action) -> None:
        """Have something done that is no motion: `CommandGate` commands those."""
        self.actions.append(action)

    def say(self, text: str) -> None:
        """Tell the pilot and the operator."""
        self.actions.append(Announce(text))
