"""What happens in a flight is decided on, noted and done; requests are handed in here as well.

Requests come from the terminal, from programs and from the map page. All come this way, so all are
recorded, checked and answered alike. Only the flight's own event loop may use it.
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
"""Modes of a vehicle that was commanded to take off, if no pilot has chosen another."""


class Page(Served, Protocol):
    """Shows a flight while it lasts."""

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """Take in what happened, and what was decided on it."""


class NoPage:
    """The page of a flight that is not shown."""

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """No page is open."""

    def serving(self, print_line: Say) -> AbstractAsyncContextManager[object]:
        """Nothing is served."""
        del print_line
        return nullcontext()


def _for_pilot(announcement: Announce) -> str:
    """An announcement as ground stations show it: who speaks, before what."""
    return f"air_router: {announcement.words}"


class CommandService:
    """Hands requests to the flight, and its answers back.

    Args:
        frame: The mission's.
        status: Gives the flight's status.
        decide: Has a request decided as every event is; returns what was decided.
        reading: Tells what became of the latest reading of the mission file.
        view: Tells what a program asks that shows the flight, besides its situation.
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
        self._number = 0  # of the latest request without an id

    def submit(self, request: AnyRequest) -> CommandAck:
        """Submit a request, in the mission's metres; the reply says whether it is done."""
        self._number += 1
        number = request.request_id or str(self._number)
        decided = self._decide(dataclasses.replace(request, request_id=number))
        for ack in decided:
            # A station numbers its goals itself: those that wait may be answered now, too.
            if isinstance(ack, CommandAck) and (ack.request_id, ack.by) == (number, request.by):
                return ack
        return CommandAck(number, request.by, False, "the flight is over", Refusal.FLIGHT_OVER)

    def from_terminal(self, print_line: Callable[[str], None], command: CommandRequest) -> None:
        """The operator has typed something; its answer is shown as every answer is."""
        try:
            reply = self.execute(command, OPERATOR)
        except RequestError as error:
            print_line(str(error))
        else:
            if "accepted" not in reply:
                print_line(json.dumps(reply))

    def execute(self, command: CommandRequest, by: str) -> dict[str, Any]:
        """Request something, in degrees; returns what a program is answered, in JSON's values.

        Raises:
            RequestError: a place has no coordinates in the mission's frame.
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
        controller: Decides.
        stats: Counts for the flight result.
        plan: What goes on board.
        vehicle: Flies what is decided.
        clock: The vehicle's.
        gossip: The UAV's node.
        recorder: Where every event and decision goes.
        status: What the operator sees.

    Attributes:
        page: Receives every event; from `begin` on.
        motions: Brings the controller's motions to the vehicle.
        reloader: Reads the mission file again, and puts changed zones on board.
        leaving: The vehicle is let go: what still comes is not decided on.
    """

    page: Page
    _finish: asyncio.Future[tuple[str, ExitCode]]  # how the flight ends; from `begin` on

    def __init__(  # noqa: PLR0913 - all that an action can reach
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
        self._repeats = Repeats[str]()  # of the lines on the terminal
        self.motions = MotionSender(
            vehicle,
            plan,
            lambda motion: controller.objection(motion, clock.boot_s()),
            lambda: controller.ended_modes,
            self.on_event,
        )
        self.reloader = MissionReloader(controller, vehicle, self.on_event, status.print_line)
        self.leaving = False
        # what happened, what was decided on it and when, to be noted and carried out in order
        self._decided: deque[tuple[Event, list[Action], float]] = deque()
        self._tasks: set[asyncio.Task[None]] = set()  # kept from the garbage collector

    def begin(self, page: Page) -> asyncio.Future[tuple[str, ExitCode]]:
        """Get ready in the running event loop; the outcome of the flight, once it has one.

        Args:
            page: Shows the flight.
        """
        self.page = page
        running = asyncio.get_running_loop()
        running.set_exception_handler(self._on_loop_error)
        self._finish = running.create_future()
        return self._finish

    def on_event(self, event: Event) -> None:
        """Something happened: decide on it, and do what was decided."""
        try:
            self.decide(event)
        finally:
            self._carry_out()

    def decide(self, event: Event) -> list[Action]:
        """Decide on what happened; that is carried out in the loop's next turn, if not before."""
        asyncio.get_running_loop().call_soon(self._carry_out)
        now_s, actions = self._clock.boot_s(), list[Action]()
        self._decided.append((event, actions, now_s))  # also what leads to a fault is recorded
        if not self.leaving:  # once the vehicle is let go nothing is decided any more
            actions += self._controller.handle(event, now_s)
        return actions

    def _carry_out(self) -> None:
        """Note what was decided, and have it done; all of it before what follows from that."""
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
        # Each change is printed: with their times they are the flight's history.
        words = f"{change.source.name} -> {change.target.name}"
        self._status.print_line(f"{now_s:8.1f} s  {words}", Severity.INFO)
        if change.target is State.PASSIVE:
            self.motions.call_off()
        if change.source is State.READY:
            self._reckon_with_time(now_s)

    def _reckon_with_time(self, now_s: float) -> None:
        """What a command takes on its way is our time; in a fast simulation the vehicle's flies.

        And until when zones with hours are the right ones is counted by the wall clock.
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

    def let_go(self) -> None:
        """The vehicle is let go: what still comes is not decided on."""
        self.leaving = True

    async def announce(self, announcement: Announce) -> None:
        """Inform the operator, here, and the pilot, by the ground station."""
        self._show(announcement, self._clock.boot_s())
        await self._vehicle.announce(_for_pilot(announcement), announcement.severity)

    def _show(self, announcement: Announce, now_s: float) -> None:
        label = "" if announcement.severity is Severity.INFO else f"{announcement.severity.name}: "
        self._print(f"{label}{announcement.words}", announcement.severity, now_s)

    def _print(self, text: str, severity: Severity, now_s: float, *, alone: bool = False) -> None:
        """Print a line that stays; one that repeats is counted.

        Args:
            text: The line.
            severity: Only an info is counted.
            now_s: The vehicle's time.
            alone: Nor is this line.
        """
        if alone or severity is Severity.ALARM:
            self._print_repeats(now_s, last=True)
            self._repeats.clear()
        elif severity is Severity.INFO and self._repeats.again(text, now_s):
            return  # a warning is never late
        self._status.print_line(f"{now_s:8.1f} s  {text}", severity)

    def _print_repeats(self, now_s: float, *, last: bool = False) -> None:
        """Print how often lines repeated, once that is due; `last`: or is not due any more."""
        for text, count in self._repeats.due(math.inf if last else now_s):
            self._status.print_line(f"{now_s:8.1f} s  {times(count)}: {text}", Severity.INFO)

    def end(self, outcome: str, exit_code: ExitCode) -> None:
        """The flight is over; the first outcome counts."""
        if not self._finish.done():
            self._finish.set_result((outcome, exit_code))

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Run something beside the flight; an error in it ends the flight."""
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._on_task_done)

    async def stop(self) -> None:
        """Cancel what runs beside the flight, and carry out what was decided."""
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
        """An error in a callback, and so in a decision, ends the flight as one in a task does."""
        error = context.get("exception")
        if isinstance(error, Exception) and "handle" in context and not self._finish.done():
            self._finish.set_exception(error)
        else:
            loop.default_exception_handler(context)

    def may_be_taken(self) -> bool:
        """Whether its mode has not been received for so long that a pilot may have it."""
        return self._controller.may_be_taken

    def flies_by_us(self, *, starts: FlightMode | None) -> bool:
        """Whether the vehicle flies, or is about to, by our command.

        Args:
            starts: The mode from before it was commanded to take off, which may not show yet.
        """
        controller, telemetry = self._controller, self._controller.telemetry
        if telemetry is None or telemetry.in_air:
            return telemetry is not None and controller.in_charge
        # Armed in Mission mode on the ground it is about to take off, with no companion.
        modes = {FlightMode.MISSION} if starts is None else {*_STARTING, starts}
        about_to = telemetry.armed and telemetry.mode in modes
        return about_to and controller.state in {State.READY, State.DONE}
