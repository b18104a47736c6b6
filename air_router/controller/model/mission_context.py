"""What all parts of the controller share: what they read, and how they announce."""

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
    """A context of its own, without a state machine, keeps its state."""


class MissionContext:
    """What is known of the flight, in four parts; it decides nothing.

    Everything else reads it here and copies nothing, so that nothing has to be informed when zones
    change; what a part has worked out from them it keeps beside the mission that it is true of.
    Each part is changed by its own methods alone.

    Args:
        mission: What is flown.
        router: Plans over it.
        signal: Informs the state machine that something has happened to the mission.
        telemetry: What the vehicle reported last.
        task: What the mission is doing.

    Attributes:
        airspace: The zones and fences that count now.
        authority: Who has the vehicle, and whose plan is on board.
        interlocks: What monitors have found that stands against a motion.
        task: What the mission is doing, for whom, until when, and on which way.
        signal: As above.
        telemetry: What the vehicle reported last; None before it was received.
        inputs: Which inputs of a flight are missing.
        silent_s: For how long nothing has come since, as the link reports.
        now_s: Seconds on the vehicle's clock, which never runs back here.
        actions: What to do about the event that is being taken in, in order.
        alarms: What the pilot has to act on, until it is over.
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

    # What happens.

    def begin(self, now_s: float) -> None:
        """An event is taken in, at this time on the vehicle's clock."""
        self.actions = []
        self.now_s = max(self.now_s, now_s)

    def received(self, telemetry: Telemetry) -> None:
        """The vehicle has reported this."""
        self.telemetry = telemetry

    def silent_for(self, silent_s: float) -> None:
        """Nothing has come from the vehicle for so long; 0: it has."""
        self.silent_s = silent_s

    # What others read.

    @cached_property
    def pace(self) -> Pace:
        """What ways take the vehicle: zones do not change that."""
        return Pace.of(self.airspace.mission)

    @cached_property
    def layer_top_m(self) -> float:
        """Higher above home it would be in the layer of another UAV; nor do they change that."""
        return self.airspace.mission.layer_top_m

    @property
    def in_air(self) -> bool:
        """Whether the vehicle flies, by its own telemetry."""
        return self.telemetry is not None and self.telemetry.in_air

    @property
    def last_telemetry(self) -> Telemetry:
        """What the vehicle reported last, where it must have been received before."""
        assert self.telemetry is not None  # noqa: S101 - in the air there was telemetry
        return self.telemetry

    @property
    def ending_why(self) -> str | None:
        """Why the vehicle comes home or lands, once it does."""
        return None if self.task.ending is None else self.task.ending.why

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        return self.authority.handed_over if self.task.state is State.READY else self.task.spec.ours

    def knows(self, signal: Signal) -> bool:
        """Whether the state reacts to a signal."""
        return signal in self.task.spec.on

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
        held, task = self.authority.held, self.task
        if held is not None:  # by what ways it would come home, is not checked
            if self.ending_why != why:
                task.end(EndReason(why, by_request, instruction=instruction))
                self.alarm(f"{why}: it should come home, and cannot: {held.why}", held.instruction)
            return
        if not self.knows(Signal.COME_HOME):
            requested = task.ending if self.task.state is State.HOME else None
            if requested is not None and requested.by_request and not by_request:
                # It may not be called off any more.
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
        """Alarm once, and again, more severe, until `over` or until the pilot has the vehicle.

        Args:
            about: What goes on: the same as in `over`.
            text: What happened.
            instruction: What the pilot or the operator does.
            lasting: How it is repeated, in words that a duration follows.
            since_s: Since when, vehicle's clock.
        """
        if self.alarms.stand(about, lasting, instruction, self.now_s, since_s):
            self.actions.append(Announce(text, Severity.ALARM, instruction, about))

    def over(self, about: str, text: str = "") -> None:
        """What was alarmed of is over; it is announced if it stood and there are words."""
        if self.alarms.end(about) and text:
            self.actions.append(Announce(text, about=about))

    def announce(self, text: str, instruction: Instruction | None, *, alarms: bool = False) -> None:
        """Announce one of a kind: with an instruction it is a warning, or alarms the pilot."""
        if instruction is None:
            self.inform(text)
        elif alarms:
            self.alarm(text, instruction)
        else:
            self.warn(text, instruction)

    # The state's timer, and what is tried again, by the clock of now.

    def start_timer(self) -> None:
        """The state's timer begins now."""
        self.task.start_timer(self.now_s)

    @property
    def left_s(self) -> float | None:
        """Seconds until the state's timer ends, None while it does not run."""
        ends_s = self.task.ends_s
        return None if ends_s is None else max(0.0, ends_s - self.now_s)

    def retry_in(self, pause_s: float) -> None:
        """Something is to be tried again after a pause."""
        self.task.retry_at(self.now_s + pause_s)

    def take_retry(self) -> bool:
        """Whether it is time to try again; reports it once."""
        return self.task.take_retry(self.now_s)
