"""One flight, from connecting to the vehicle to the final report.

It passes events of the vehicle, the gossip node and the operator to the controller, carries out the
controller's actions, and decides nothing itself.
"""

from __future__ import annotations

import asyncio
import dataclasses
import math
import os
import signal
from collections.abc import Callable
from functools import partial

from air_router.control import ControlServer
from air_router.controller import Controller
from air_router.controller.model import Announce, Event, FlightSetup, GoOn, State
from air_router.errors import AirRouterError, ExitCode, NoVehicleError, RefusedError
from air_router.flight.flight_line import flight_line
from air_router.flight.flight_loop import CommandService, FlightLoop, NoPage, Page
from air_router.flight.flight_stats import FlightResult, FlightStats
from air_router.flight.flight_view import FlightView
from air_router.flight.lag_watch import watch_lag
from air_router.flight.limits import VEHICLE_LOST_S, VEHICLE_RESTART_S
from air_router.flight.resumption import flown_before, recognised
from air_router.flight.status_source import StatusSource
from air_router.flight.terminal import StatusLine, listening
from air_router.gossip import Gossip, Mapper, receive_patches
from air_router.mission import FlightPlan, Mission
from air_router.preflight import Card, PreflightRefusedError, PreflightSurvey
from air_router.record import Recorder
from air_router.routing import Router, WaypointGraph
from air_router.vehicle import (
    SEPARATE_TWINS,
    SET_UP,
    TAKE_FROM_HERE,
    TAKE_OVER,
    FlightMode,
    Instruction,
    LinkSilent,
    MavlinkSpoofed,
    PlanCompared,
    PlanReplaced,
    PlanTried,
    Severity,
    Telemetry,
    Vehicle,
    VehicleClock,
    VehicleEvent,
    VehicleInfo,
    WrongVehicle,
)

_EarlyEvent = PlanReplaced | PlanTried | PlanCompared | MavlinkSpoofed
"""Events received before the vehicle is admitted; they are checked then."""


class Flight:
    """Flies a mission once.

    Args:
        mission: The mission to fly.
        vehicle: A vehicle that is not yet connected.
        clock: The vehicle's clock, set by its messages.
        gossip: The UAV's node, not yet started.
        mapper: Makes the map that `gossip` publishes.
        seek: The robots to seek, in order.
        recorder: Records every event and action.
        status: The operator's status line.
        camera: Endpoint of the camera's patches, None without a camera.
        control: Endpoint for requests of other programs; None: no such requests.
        arm: Whether to arm and take off; False: wait for the pilot.
        survey: The pre-flight checks; None: a survey of mission and router only.
        resume: Whether to resume a flight in progress instead of starting one.

    Attributes:
        router: Plans the mission's routes.
        controller: Decides; see `Controller`.
        status: Returns the flight's status, for displays.
        stats: Statistics for the flight result.
        loop: Passes events to the controller, and carries out its actions.
        commands: Handles requests.
    """

    def __init__(  # noqa: PLR0913 - the parts of a flight
        self,
        mission: Mission,
        vehicle: Vehicle,
        *,
        clock: VehicleClock,
        gossip: Gossip,
        mapper: Mapper,
        seek: tuple[str, ...],
        recorder: Recorder,
        status: StatusLine,
        camera: str | None = None,
        control: str | None = None,
        arm: bool = False,
        survey: Callable[[Router], PreflightSurvey] | None = None,
        resume: bool = False,
    ) -> None:
        self._mission = mission
        self._vehicle = vehicle
        self._clock = clock
        self._gossip = gossip
        self._mapper = mapper
        self._recorder = recorder
        self._status = status
        self._camera = camera
        self._arm = arm
        self._resume = resume
        self._plan = FlightPlan.of(mission)  # the plan to upload
        self.router = Router(WaypointGraph(mission))
        self._survey = (survey or partial(PreflightSurvey, mission))(self.router)
        setup = FlightSetup(
            mission,
            seek,
            pilot_arms=not (arm or resume),
            explore=mission.explore,
            name=mission.uav or "",
        )
        recorder.begin(setup, arm=arm, resume=resume, camera=camera)
        self.controller = Controller(setup, self.router, self._plan, ground=mapper.grid)
        self.stats = FlightStats.of(mission, mapper, seek)
        self.loop = FlightLoop(
            self.controller,
            self.stats,
            plan=self._plan,
            vehicle=vehicle,
            clock=clock,
            gossip=gossip,
            recorder=recorder,
            status=status,
        )
        self.status = StatusSource(self.controller, gossip.links, clock.boot_s).status
        view = FlightView(mission, self.status, lambda: self.controller.router, self.stats)
        self.commands = CommandService(
            mission.frame,
            self.status,
            self.loop.decide,
            lambda: self.loop.reloader.report,
            view.fields_for,
        )
        self._control = (
            None if control is None else ControlServer(control, self.commands.execute, gossip.node)
        )
        self._first: asyncio.Future[Telemetry]  # set by the first telemetry
        self._newest: Telemetry  # latest before admission
        self._early: list[_EarlyEvent] = []  # events before admission
        self._starts: FlightMode | None = None  # mode before the take-off command
        self._interrupted = False  # by a signal of the operating system
        self._admitted = False  # the vehicle may be flown, and decisions start
        self._vehicle_s = -math.inf  # latest telemetry; inf: the vehicle restarted

    async def run(self, page: Page | None = None) -> FlightResult:
        """Fly.

        Args:
            page: Receives every event, and is served during the flight.

        Raises:
            NoVehicleError, PlanRefusedError, ArmingRefusedError, RefusedError: before take-off.
        """
        running = asyncio.get_running_loop()
        ended = self.loop.begin(page or NoPage())
        self._first = running.create_future()
        self._recorder.report_to(
            lambda text: running.call_soon_threadsafe(self._status.print_line, text)
        )
        for number in (signal.SIGINT, signal.SIGTERM):
            running.add_signal_handler(number, self._on_interrupt)
        print_line = self._status.print_line
        try:
            async with self.loop.page.serving(print_line):
                with listening(partial(self.commands.from_terminal, print_line), print_line):
                    self.loop.start(self._begin())
                    outcome, exit_code = await ended
        finally:
            await self._release()
            for number in (signal.SIGINT, signal.SIGTERM):
                running.remove_signal_handler(number)
        return self._result(outcome, exit_code)

    async def _begin(self) -> None:
        await self._prepare()
        self.loop.start(self.loop.motions.run())
        if self._clock.most_ahead_s == math.inf:  # else the simulation waits for this program
            self.loop.start(watch_lag(self.loop.on_event))
        if self._camera is not None:
            self.loop.start(receive_patches(self._camera, self._paint))
        if self._resume:
            self._go_on()
            return
        await self.loop.reloader.finished()
        if self._arm:
            self._check_still()
            await self._vehicle.arm()
            self._check_still(armed=True)
            self._starts = self._first.result().mode
            await self._vehicle.start()
            self._status.print_line("armed and taking off; type 'home' to end, Ctrl-C to hold")
        else:
            self._status.print_line("ready: waiting for the pilot to arm and choose Mission mode")

    async def _prepare(self) -> None:
        info = await self._vehicle.connect()
        self._status.print_line(f"{info.autopilot} {info.version}, system {info.system_id}")
        self._recorder.note("Vehicle", 0.0, dataclasses.asdict(info))
        if self._recorder.path is not None:
            self._status.print_line(f"recording {self._recorder.path}")
        self._vehicle.subscribe(self._on_vehicle)
        try:
            # asyncio.wait_for of Python 3.11 may swallow a cancellation
            async with asyncio.timeout(VEHICLE_LOST_S):
                telemetry = await self._first
        except TimeoutError:
            raise NoVehicleError(
                f"it answered, but sent no position in {VEHICLE_LOST_S:.0f} s"
            ) from None
        if telemetry.in_air:
            if (why_not := info.airframe.why_not_flown) is not None:
                raise RefusedError(f"{why_not}; it is flying, and nothing is sent to it: {SET_UP}")
            await self._find_flight(info, telemetry)
            return
        if self._resume:
            raise RefusedError("nothing to resume: the vehicle is on the ground")
        self._take_card(await self._survey.card(self._vehicle, info, telemetry))
        self._admit()
        await self._vehicle.upload(self._plan)
        self._status.print_line(f"on board and read back: {self._plan.size}")
        self.loop.reloader.plan_on_board()

    def _admit(self, *first: Event) -> None:
        """Decide on these events, on those of the pre-flight, and on all later ones."""
        self._admitted = True
        self._gossip.start(self.loop.on_event)
        if self._control is not None:
            self._control.open()
            self.loop.start(self._control.run())
            self._status.print_line(f"requests are accepted at {self._control.endpoint}")
        for event in (*first, *self._early):
            self.loop.on_event(event)

    async def _find_flight(self, info: VehicleInfo, telemetry: Telemetry) -> None:
        """Handle a vehicle found in the air, perhaps flying this mission without a companion."""
        found = await recognised(self._vehicle, self._plan, telemetry, resume=self._resume)
        self._status.print_line(found)
        self._take_card(await self._survey.card_in_the_air(self._vehicle, info), in_air=True)
        record, rate = self._recorder, self._clock.rate
        find = partial(flown_before, folder=record.folder, own=record.path, rate=rate)
        found_out = await asyncio.to_thread(find, self._mission, info, self._newest)
        self._status.print_line(found_out.words)
        if found_out.home_amsl_m is not None:
            self._vehicle.count_heights_from(found_out.home_amsl_m)
        self.loop.reloader.plan_on_board()
        self._admit(found_out.flown, self._newest)

    def _go_on(self) -> None:
        if self.controller.state is not State.READY:
            return  # in Mission mode the flight already continues
        ack = self.commands.submit(GoOn())
        if not ack.accepted:
            raise RefusedError(
                f"the flight is not resumed, and nothing is sent to the vehicle: {ack.why}"
            )

    def _take_card(self, card: Card, *, in_air: bool = False) -> None:
        """Print the card; refuse an unsafe flight, unless it is already in the air."""
        self._recorder.note(Recorder.PREFLIGHT, self._clock.boot_s(), card.as_json())
        if not (card.ready or in_air):
            raise PreflightRefusedError(card)
        self._status.print_line(f"{'in flight' if in_air else 'pre-flight'}: {card.summary}")
        for line in card.lines(all_of_them=False):
            self._status.print_line(line)

    def _check_still(self, *, armed: bool = False) -> None:
        """Refuse to start if the pilot has intervened since the first telemetry."""
        why = self.controller.why_not_started(self._first.result(), armed=armed)
        if why is not None:
            raise RefusedError(f"{why}; it is left to the pilot")

    # Events in, actions out.

    def _on_vehicle(self, event: VehicleEvent) -> None:
        if self.loop.released:
            return  # late messages of a closing link
        if isinstance(event, Telemetry) and self._restarted(event):
            self.loop.end("ended: the vehicle restarted", ExitCode.ENDED_OTHERWISE)
            return
        if not self._admitted:
            self._before_admission(event)
            return
        if isinstance(event, LinkSilent) and event.silent_s > VEHICLE_LOST_S and not event.over:
            self.loop.end("lost: the vehicle is silent", ExitCode.ENDED_OTHERWISE)
        if isinstance(event, Telemetry) and self._too_late(event):
            return
        self.loop.on_event(event)
        if isinstance(event, Telemetry):
            self._gossip.publish_telemetry(event)
            self._recorder.map(self._mapper, event.time_s)
            self._recorder.status(self.status, event.time_s)
            self._recorder.links(self._gossip.links, self._gossip.held, event.time_s)
            self._status.show(lambda: flight_line(self.status()))

    def _before_admission(self, event: VehicleEvent) -> None:
        """Store the events of a vehicle that may still be refused."""
        if isinstance(event, Telemetry):
            self._newest = event
            if not self._first.done():
                self._first.set_result(event)
        elif isinstance(event, _EarlyEvent):
            self._early.append(event)
        elif isinstance(event, WrongVehicle) and event.why_not is not None:
            do = SEPARATE_TWINS if event.twins else SET_UP
            self.loop.end(f"refused: {event.why_not}; {do}", ExitCode.REFUSED)

    def _too_late(self, telemetry: Telemetry) -> bool:
        """Whether it is too late to take off, given the zones' hours; then ends the flight."""
        waits = self.controller.state is State.READY and not telemetry.armed
        latest = self.controller.mission.latest_start if waits else None
        if latest is None or self._clock.now_s() <= latest.timestamp():
            return False
        self.loop.end(
            f"refused: it had not taken off by {latest:%H:%M} UTC, and some zones apply only at "
            "certain times; start it again",
            ExitCode.REFUSED,
        )
        return True

    def _restarted(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle's clock restarted, which invalidates timers and verified plan."""
        restarted = telemetry.time_s < self._vehicle_s - VEHICLE_RESTART_S
        self._vehicle_s = math.inf if restarted else telemetry.time_s  # inf: for good
        return restarted

    def _paint(self, patch: bytes) -> None:
        if self._mapper.paint(patch):
            self._recorder.patch(patch, self._clock.boot_s())

    # End of the flight.

    def _on_interrupt(self) -> None:
        """First signal: hold, if the companion has control, and end. Second: exit at once."""
        if self._interrupted:
            self._recorder.close()
            os._exit(ExitCode.INTERRUPTED)
        self._interrupted = True
        self._status.print_line("interrupted; interrupt again to leave at once")
        self.loop.end("interrupted", ExitCode.INTERRUPTED)

    async def _release(self) -> None:
        await self.loop.stop()
        ours = self.loop.flies_by_us(starts=self._starts) and self._vehicle_s < math.inf
        self.loop.release()
        self._recorder.note("LetGo", self._clock.boot_s(), {})
        try:
            if ours and self.loop.may_be_taken():
                await self._final_announcement(
                    "the companion stops without a hold: the flight mode was not received",
                    TAKE_OVER,
                )
            elif ours:
                await self._vehicle.hold(out_of=self.controller.our_modes)
                await self._final_announcement(
                    "the companion stops; the vehicle holds", TAKE_FROM_HERE
                )
        except AirRouterError as error:
            await self._final_announcement(
                f"the companion stops; the vehicle did not confirm the hold command: {error}",
                TAKE_OVER,
            )
        finally:
            self._status.end()
            if self._control is not None:
                self._control.close()  # before the node, which it serves
            self._gossip.close()
            await self._vehicle.close()

    async def _final_announcement(self, text: str, instruction: Instruction) -> None:
        await self.loop.announce(Announce(text, Severity.ALARM, instruction))

    def _result(self, outcome: str, exit_code: ExitCode) -> FlightResult:
        report = self.stats.report(outcome, self._clock.now_s(), self._gossip.newest_stamps())
        report["came_home_because"] = self.controller.ending_why
        self._recorder.note("Report", self._clock.boot_s(), report)
        track, meetings = self.stats.flown.points, self.stats.meetings
        return FlightResult(outcome, exit_code, report, tuple(track), tuple(meetings))
