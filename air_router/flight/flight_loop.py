"""The event loop of a flight: decides on events, records them, and carries actions out.

Requests of the terminal, programs and the map page all pass through here, so they are recorded,
checked and answered alike. Only the flight's own event loop may use it.
"""

from __future__ import annotations

import asyncio
import dataclasses
import json
import math
from collections import deque
from collections.abc import Callable, Collection, Coroutine, Iterable
from contextlib import AbstractAsyncContextManager, nullcontext
from typing import Any, Final, Protocol

from air_router.control import CommandRequest, View
from air_router.controller import Controller, FlightStatus
from air_router.controller.model import (
    OPERATOR,
    Action,
    Announce,
    AnyRequest,
    CommandAck,
    Event,
    Finish,
    Motion,
    PublishMap,
    ReadAgain,
    Refusal,
    RenewPlan,
    ReplanAirspace,
    Seeking,
    State,
    StateChanged,
)
from air_router.controller.motion import REACTION_S
from air_router.errors import ExitCode
from air_router.flight.flight_stats import FlightStats, ending_of
from air_router.flight.flight_view import situation
from air_router.flight.limits import COMMAND_S, DEGREE_DIGITS
from air_router.flight.mission_reloader import MissionReloader, ReloadReport
from air_router.flight.motions import MotionSender
from air_router.flight.terminal import StatusLine
from air_router.gossip import Gossip
from air_router.mission import FlightPlan
from air_router.record import Recorder
from air_router.repeats import Repeats, times
from air_router.vehicle import FlightMode, Severity, Vehicle, VehicleClock
from air_router.web import Say, Served
from geo.frame import LocalFrame
from mocha_link.errors import RequestError

_STARTING: Final = (FlightMode.HOLD, FlightMode.MISSION)
"""Modes of a vehicle after the take-off command, unless a pilot chose another."""


class Page(Served, Protocol):
    """Shows a flight in progress."""

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """Handle an event and its actions."""


class NoPage:
    """A page that shows nothing."""

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """Do nothing."""

    def serving(self, print_line: Say) -> AbstractAsyncContextManager[object]:
        """Serve nothing."""
        del print_line
        return nullcontext()


def _for_pilot(announcement: Announce) -> str:
    """An announcement for ground stations, prefixed with the program's name."""
    return f"air_router: {announcement.words}"


class CommandService:
    """Passes requests to the flight, and returns the answers.

    Args:
        frame: The mission's frame.
        status: Returns the flight's status.
        decide: Decides on a request like on any event; returns the actions.
        reading: Returns the outcome of the latest reading of the mission file.
        view: Returns further data for programs that show the flight.
    """

    def __init__(
        self,
        frame: LocalFrame,
        status: Callable[[], FlightStatus],
        decide: Callable[[AnyRequest], Iterable[Action]],
        reading: Callable[[], ReloadReport | None] = lambda: None,
        view: Callable[[View], dict[str, Any]] = lambda _: {},
    ) -> None:
        self._view = view
        self._reading = reading
        self._frame = frame
        self._status = status
        self._decide = decide
        self._number = 0  # number of the latest request without an id

    def submit(self, request: AnyRequest) -> CommandAck:
        """Submit a request, in the mission's meters; return the reply."""
        self._number += 1
        number = request.request_id or str(self._number)
        decided = self._decide(dataclasses.replace(request, request_id=number))
        for ack in decided:
            # A station numbers its own goals: deferred ones may be answered now, too.
            if isinstance(ack, CommandAck) and (ack.request_id, ack.by) == (number, request.by):
                return ack
        return CommandAck(number, request.by, False, "the flight is over", Refusal.FLIGHT_OVER)

    def from_terminal(self, print_line: Callable[[str], None], command: CommandRequest) -> None:
        """Handle a request typed by the operator; its answer is shown like any other."""
        try:
            reply = self.execute(command, OPERATOR)
        except RequestError as error:
            print_line(str(error))
        else:
            if "accepted" not in reply:
                print_line(json.dumps(reply))

    def execute(self, command: CommandRequest, by: str) -> dict[str, Any]:
        """Carry out a request, in degrees; return the answer as JSON values.

        Raises:
            RequestError: A place has no coordinates in the mission's frame.
        """
        request = command.for_mission(self._frame, by)
        if request is None:
            more = self._view(command) if isinstance(command, View) else {}
            return {
                "ok": True,
                "id": command.id,
                **situation(self._frame, self._status(), self._reading()),
                **more,
            }
        ack = self.submit(request)
        reply: dict[str, Any] = {
            "ok": True,
            "id": command.id,
            "accepted": ack.accepted,
            "why": ack.why,
            "code": ack.code,
            "state": self._status().state.name,
        }
        if ack.points:
            reply["points"] = [
                [round(degrees, DEGREE_DIGITS) for degrees in self._frame.to_geodetic(point)]
                for point in ack.points
            ]
        return reply


class FlightLoop:
    """Events in, actions out.

    Args:
        controller: Decides on events.
        stats: Statistics for the flight result.
        plan: The plan to upload.
        vehicle: Carries out motions.
        clock: The vehicle's clock.
        gossip: The UAV's node.
        recorder: Records every event and action.
        status: The operator's status line.

    Attributes:
        page: Receives every event; from `begin` on.
        motions: Sends the controller's motions to the vehicle.
        reloader: Reads the mission file again, and uploads changed zones.
        released: The vehicle was released: late events are not decided on.
    """

    page: Page
    _finish: asyncio.Future[tuple[str, ExitCode]]  # how the flight ends; from `begin` on

    def __init__(  # noqa: PLR0913 - everything that an action may use
        self,
        controller: Controller,
        stats: FlightStats,
        *,
        plan: FlightPlan,
        vehicle: Vehicle,
        clock: VehicleClock,
        gossip: Gossip,
        recorder: Recorder,
        status: StatusLine,
    ) -> None:
        self._controller = controller
        self._stats = stats
        self._vehicle = vehicle
        self._clock = clock
        self._gossip = gossip
        self._recorder = recorder
        self._status = status
        self._repeats = Repeats[str]()  # of terminal lines
        self.motions = MotionSender(
            vehicle,
            plan,
            lambda motion: controller.objection(motion, clock.boot_s()),
            lambda: controller.ended_modes,
            self.on_event,
        )
        self.reloader = MissionReloader(controller, vehicle, self.on_event, status.print_line)
        self.released = False
        # event, actions and time, to be recorded and carried out in order
        self._decided: deque[tuple[Event, list[Action], float]] = deque()
        self._tasks: set[asyncio.Task[None]] = set()  # kept from the garbage collector

    def begin(self, page: Page) -> asyncio.Future[tuple[str, ExitCode]]:
        """Start in the running event loop; return a future for the outcome of the flight.

        Args:
            page: Shows the flight.
        """
        self.page = page
        running = asyncio.get_running_loop()
        running.set_exception_handler(self._on_loop_error)
        self._finish = running.create_future()
        return self._finish

    def on_event(self, event: Event) -> None:
        """Decide on an event, and carry out the actions."""
        try:
            self.decide(event)
        finally:
            self._carry_out()

    def decide(self, event: Event) -> list[Action]:
        """Decide on an event; the actions are carried out in the loop's next turn at the latest."""
        asyncio.get_running_loop().call_soon(self._carry_out)
        now_s, actions = self._clock.boot_s(), list[Action]()
        self._decided.append((event, actions, now_s))  # also before a fault
        if not self.released:  # no decisions after the vehicle was released
            actions += self._controller.handle(event, now_s)
        return actions

    def _carry_out(self) -> None:
        """Record and carry out decided actions, before any events that follow from them."""
        while self._decided:
            event, actions, now_s = self._decided.popleft()
            self._recorder.event(event, now_s)
            self._recorder.actions(actions, now_s)
            self._stats.step(event, actions, now_s)
            self.page.step(event, actions, now_s)
            for action in actions:
                self._act(action, now_s)
            self._print_repeats(now_s)

    def _act(self, action: Action, now_s: float) -> None:
        match action:
            case _ if isinstance(action, Motion):
                self.motions.give(action)
            case PublishMap():
                self._gossip.publish_map(now_s)
                self._gossip.exchange()
            case Seeking(robot=robot):
                self._gossip.publish_sought(robot, now_s)
            case ReadAgain() | RenewPlan() | ReplanAirspace():
                self.start(self.reloader.work(action))
            case Announce():
                self._show(action, now_s)
                self.start(self._vehicle.announce(_for_pilot(action), action.severity))
            case CommandAck(by=by, accepted=accepted, why=why):
                self._gossip.publish_ack(action)
                verdict = "accepted" if accepted else "refused"
                self._print(f"{by}: {verdict}: {why}", Severity.INFO, now_s, alone=True)
            case StateChanged():
                self._on_state(action, now_s)
            case Finish():
                aborted_why = None if self._stats.flew else self._controller.ending_why
                self.end(*ending_of(action, aborted_why))

    def _on_state(self, change: StateChanged, now_s: float) -> None:
        # Every change is printed: with the times they are the flight's history.
        words = f"{change.source.name} -> {change.target.name}"
        self._status.print_line(f"{now_s:8.1f} s  {words}", Severity.INFO)
        if change.target is State.PASSIVE:
            self.motions.call_off()
        if change.source is State.READY:
            self._reckon_with_time(now_s)

    def _reckon_with_time(self, now_s: float) -> None:
        """Convert a command's delay from our time to the vehicle's, for a fast simulation.

        Also convert the end of the zones' active hours, which is in wall time.
        """
        reaction_s = REACTION_S + COMMAND_S * self._clock.rate
        self._controller.reacts_within(reaction_s)
        self._recorder.note("Reaction", now_s, {"reaction_s": reaction_s})
        mission = self._controller.mission
        latest = mission.window.latest_start
        if latest is not None and mission.duration_s is not None:
            left_s = latest.timestamp() + mission.duration_s - self._clock.now_s()
            self._controller.home_by(now_s + left_s)
            self._recorder.note("HomeBy", now_s, {"home_by_s": now_s + left_s})

    def release(self) -> None:
        """Release the vehicle: late events are not decided on."""
        self.released = True

    async def announce(self, announcement: Announce) -> None:
        """Announce to the operator (terminal) and the pilot (ground station)."""
        self._show(announcement, self._clock.boot_s())
        await self._vehicle.announce(_for_pilot(announcement), announcement.severity)

    def _show(self, announcement: Announce, now_s: float) -> None:
        label = "" if announcement.severity is Severity.INFO else f"{announcement.severity.name}: "
        self._print(f"{label}{announcement.words}", announcement.severity, now_s)

    def _print(self, text: str, severity: Severity, now_s: float, *, alone: bool = False) -> None:
        """Print a permanent line; repetitions are only counted.

        Args:
            text: The line.
            severity: Only INFO lines are counted.
            now_s: The vehicle's time.
            alone: This line is never counted.
        """
        if alone or severity is Severity.ALARM:
            self._print_repeats(now_s, last=True)
            self._repeats.clear()
        elif severity is Severity.INFO and self._repeats.again(text, now_s):
            return  # a warning is printed at once
        self._status.print_line(f"{now_s:8.1f} s  {text}", severity)

    def _print_repeats(self, now_s: float, *, last: bool = False) -> None:
        """Print how often lines repeated, when due; `last`: at the end in any case."""
        for text, count in self._repeats.due(math.inf if last else now_s):
            self._status.print_line(f"{now_s:8.1f} s  {times(count)}: {text}", Severity.INFO)

    def end(self, outcome: str, exit_code: ExitCode) -> None:
        """End the flight; only the first outcome counts."""
        if not self._finish.done():
            self._finish.set_result((outcome, exit_code))

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a background task; an error in it ends the flight."""
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._on_task_done)

    async def stop(self) -> None:
        """Cancel the background tasks, and carry out pending actions."""
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._carry_out()
        self._print_repeats(self._clock.boot_s(), last=True)

    def _on_task_done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()
        if error is not None and not self._finish.done():
            self._finish.set_exception(error)

    def _on_loop_error(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """End the flight after an error in a callback, such as a decision."""
        error = context.get("exception")
        if isinstance(error, Exception) and "handle" in context and not self._finish.done():
            self._finish.set_exception(error)
        else:
            loop.default_exception_handler(context)

    def may_be_taken(self) -> bool:
        """Whether the flight mode has been missing for so long that a pilot may have taken over."""
        return self._controller.may_be_taken

    def flies_by_us(self, *, starts: FlightMode | None) -> bool:
        """Whether the vehicle flies, or is taking off, by our command.

        Args:
            starts: The mode before the take-off command, while the new one is not reported yet.
        """
        controller, telemetry = self._controller, self._controller.telemetry
        if telemetry is None or telemetry.in_air:
            return telemetry is not None and controller.in_charge
        # Armed in Mission mode on the ground, the vehicle would take off without a companion.
        modes = {FlightMode.MISSION} if starts is None else {*_STARTING, starts}
        about_to = telemetry.armed and telemetry.mode in modes
        return about_to and controller.state in {State.READY, State.DONE}
