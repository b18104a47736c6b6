"""The state of the flight that all parts of the controller share, and their announcements."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

from air_router.controller.model.actions import Action, Announce
from air_router.controller.model.airspace_in_force import AirspaceInForce
from air_router.controller.model.authority import Authority
from air_router.controller.model.interlocks_raised import RaisedInterlocks
from air_router.controller.model.standing_alarms import StandingAlarms
from air_router.controller.model.states import Signal, State
from air_router.controller.model.task import EndReason, Task
from air_router.mission import Mission
from air_router.routing import Pace, Router
from air_router.vehicle import InputWatch, Instruction, Severity, Telemetry


def _no_machine(signal: Signal) -> None:
    """Ignore a signal: a context without a state machine keeps its state."""


class MissionContext:
    """The state of the flight, in four parts. It decides nothing.

    All other parts read this state and copy nothing, so no part needs an update when zones change.
    A part that caches results keeps the mission they belong to. Only a part's own methods change
    it.

    Args:
        mission: The mission to fly.
        router: Plans routes for the mission.
        signal: Sends a signal to the state machine.
        telemetry: The vehicle's last telemetry.
        task: The mission's state and task.

    Attributes:
        airspace: The zones and fences in force.
        authority: Who commands the vehicle, and whose plan is on board.
        interlocks: Anomalies found by monitors that block motions.
        task: The mission's state, robot, timer and route.
        signal: As above.
        telemetry: The vehicle's last telemetry; None: nothing was received yet.
        inputs: Knows which inputs of the flight are missing.
        silent_s: Time without any message from the vehicle, as the link reports.
        now_s: Seconds on the vehicle's clock; never decreases.
        actions: The actions for the current event, in order.
        alarms: The alarms that last.
    """

    def __init__(
        self,
        mission: Mission,
        router: Router,
        signal: Callable[[Signal], None] = _no_machine,
        *,
        telemetry: Telemetry | None = None,
        task: Task | None = None,
    ) -> None:
        self.airspace = AirspaceInForce(mission, router)
        self.authority = Authority()
        self.interlocks = RaisedInterlocks()
        self.task = Task() if task is None else task
        self.signal = signal
        self.telemetry = telemetry
        self.inputs = InputWatch()
        self.silent_s = 0.0
        self.now_s = 0.0
        self.actions: list[Action] = []
        self.alarms = StandingAlarms()

    # Events.

    def begin(self, now_s: float) -> None:
        """Begin an event, at this time on the vehicle's clock."""
        self.actions = []
        self.now_s = max(self.now_s, now_s)

    def received(self, telemetry: Telemetry) -> None:
        """Store telemetry from the vehicle; its charge is filtered."""
        self.telemetry = telemetry

    def silent_for(self, silent_s: float) -> None:
        """Store how long the vehicle has been silent; 0: it is not."""
        self.silent_s = silent_s

    # Queries.

    @cached_property
    def pace(self) -> Pace:
        """The vehicle's pace on routes; zones do not change it."""
        return Pace.of(self.airspace.mission)

    @cached_property
    def layer_top_m(self) -> float:
        """Top of the vehicle's layer above home; zones do not change it."""
        return self.airspace.mission.layer_top_m

    @property
    def in_air(self) -> bool:
        """Whether the vehicle is in the air, by its own telemetry."""
        return self.telemetry is not None and self.telemetry.in_air

    @property
    def last_telemetry(self) -> Telemetry:
        """The vehicle's last telemetry, where it must have been received before."""
        assert self.telemetry is not None  # noqa: S101 - a vehicle in the air has sent telemetry
        return self.telemetry

    @property
    def ending_why(self) -> str | None:
        """Why the vehicle comes home or lands; None: it does neither."""
        return None if self.task.ending is None else self.task.ending.why

    @property
    def in_charge(self) -> bool:
        """Whether this program commands the vehicle in the air."""
        return self.authority.handed_over if self.task.state is State.READY else self.task.spec.ours

    def knows(self, signal: Signal) -> bool:
        """Whether the current state responds to a signal."""
        return signal in self.task.spec.on

    def come_home(
        self, why: str, instruction: Instruction | None = None, *, by_request: bool = False
    ) -> None:
        """End the mission; in the air, fly home.

        A requested return that is already under way can no longer be canceled. A vehicle that is
        `held` stays where it is.

        Args:
            why: The reason, as text.
            instruction: Action of the pilot or the operator; None: a normal end.
            by_request: The return may be canceled.
        """
        held, task = self.authority.held, self.task
        if held is not None:  # its way home is not checked
            if self.ending_why != why:
                task.end(EndReason(why, by_request, instruction=instruction))
                self.alarm(f"{why}: it should come home, and cannot: {held.why}", held.instruction)
            return
        if not self.knows(Signal.COME_HOME):
            requested = task.ending if self.task.state is State.HOME else None
            if requested is not None and requested.by_request and not by_request:
                # It can no longer be canceled.
                words = f"{requested.why}; {why}"
                task.end(EndReason(words, urgent=requested.urgent, instruction=instruction))
            return
        task.end(EndReason(why, by_request, instruction=instruction))
        if self.in_air:
            self.signal(Signal.COME_HOME)
        else:
            task.stay(why)
            self.signal(Signal.GROUNDED)

    def inform(self, text: str) -> None:
        """Announce information that requires no action."""
        self.actions.append(Announce(text))

    def warn(self, text: str, instruction: Instruction) -> None:
        """Announce a warning, with the action of the pilot or the operator."""
        self.actions.append(Announce(text, Severity.WARNING, instruction))

    def alarm(self, text: str, instruction: Instruction) -> None:
        """Announce an alarm, with the action that the pilot has to take now."""
        self.actions.append(Announce(text, Severity.ALARM, instruction))

    def alarm_until_over(
        self, about: str, text: str, instruction: Instruction, *, lasting: str, since_s: float
    ) -> None:
        """Raise an alarm that repeats until `over` or until the pilot takes over.

        Args:
            about: Subject of the alarm, as in `over`.
            text: What happened.
            instruction: Action of the pilot or the operator.
            lasting: Text of the repetition; a duration follows it.
            since_s: Since when, vehicle's clock.
        """
        if self.alarms.stand(about, lasting, instruction, self.now_s, since_s):
            self.actions.append(Announce(text, Severity.ALARM, instruction, about))

    def over(self, about: str, text: str = "") -> None:
        """End an alarm; announce it if the alarm was up and there is a text."""
        if self.alarms.end(about) and text:
            self.actions.append(Announce(text, about=about))

    def announce(self, text: str, instruction: Instruction | None, *, alarms: bool = False) -> None:
        """Announce a text: an alarm, a warning (with an instruction), or information."""
        if instruction is None:
            self.inform(text)
        elif alarms:
            self.alarm(text, instruction)
        else:
            self.warn(text, instruction)

    # The state's timer, and retries, by the vehicle's clock.

    def start_timer(self) -> None:
        """Start the state's timer."""
        self.task.start_timer(self.now_s)

    @property
    def left_s(self) -> float | None:
        """Seconds until the state's timer expires; None while it does not run."""
        ends_s = self.task.ends_s
        return None if ends_s is None else max(0.0, ends_s - self.now_s)

    def retry_in(self, pause_s: float) -> None:
        """Schedule a retry after a pause."""
        self.task.retry_at(self.now_s + pause_s)

    def take_retry(self) -> bool:
        """Whether a retry is due; reports it once."""
        return self.task.take_retry(self.now_s)
