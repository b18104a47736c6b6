"""The mission controller: what happened and the vehicle's time in, what to do out.

Pure: no sockets, no clocks, no files. The same object flies a real PX4, the simulated one, and
the discrete-event world, and a recorded flight replays to the same decisions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from air_router.actions import (
    Action,
    Finish,
    FlyToNode,
    HoldHere,
    LandHere,
    Motion,
    PublishMap,
    StateChanged,
    Taker,
)
from air_router.behaviour import EXPLORING, Signal, State, knows, next_state
from air_router.events import CommandConfirmed, CommandFailed, Event, Request, RobotPath, RobotPose
from air_router.exchange import Exchange
from air_router.homeward import WayHome
from air_router.journeys import RETRY_S, Journeys
from air_router.launch import Launch
from air_router.milestones import Silence, TakeOff, reason_to_return, take_off
from air_router.navigator import Progress
from air_router.vehicle import FlightMode, ItemReached, LinkSilent, PlanReplaced, Telemetry
from air_router.watch import Sign, Watch, why_not_resumed
from mocha_link.metrics import SyncEnded, SyncStarted

if TYPE_CHECKING:
    from air_router.flight_plan import FlightPlan
    from air_router.mission import Mission
    from air_router.router import Router


class Controller(Journeys):
    """Flies one mission.

    Args:
        mission: What to fly.
        plan: The plan on board, for the autopilot's item numbers.
        router: Routes over the mission's graph.
        seek: Names of the robots to seek, in order.
        patient: Somebody else arms: if it is disarmed again on the ground, wait on.
    """

    def __init__(
        self,
        mission: Mission,
        plan: FlightPlan,
        router: Router,
        seek: tuple[str, ...],
        *,
        patient: bool = False,
    ) -> None:
        super().__init__(mission, router, seek)
        self._plan = plan
        self._left = State.READY
        self._launch = Launch()
        self._watch = Watch(mission, plan)
        self._patient = patient
        self._plan_is_ours = True
        self._giving_up: str | None = None
        self._taken_by: Taker | None = None
        self._silence = Silence()
        self._exchange = Exchange()
        self._way_home = WayHome(mission, router)
        self.came_home_why: str | None = None

    # What others read.

    @property
    def time_left_s(self) -> float | None:
        """Seconds until the state's timer, None while it does not run."""
        return self._schedule.left_s

    @property
    def need_home(self) -> float | None:
        """The charge that flying home from here takes; None when unknown, or on the way already."""
        return self._way_home.need_now if knows(self.state, Signal.COME_HOME) else None

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        if self.state is State.READY:
            return self._launch.handed_over
        return self.state not in {State.PASSIVE, State.DONE}

    # What happens.

    def handle(self, event: Event, now_s: float) -> list[Action]:
        """Take one event in at vehicle time `now_s`; returns what to do about it, in order."""
        self._actions = []
        self._schedule.tick(now_s)
        # Other events (links of others, metrics) are recorded and shown, not decided on.
        reaction = self._reactions.get(type(event))
        if reaction is not None:
            reaction(self, event)
        return self._actions

    def _on_telemetry(self, telemetry: Telemetry) -> None:
        self.telemetry = telemetry
        if self._launch.note(telemetry):
            self.custody.assume(FlightMode.MISSION)
        if self._launch.over(telemetry) and knows(self.state, Signal.GROUNDED):
            self._grounded()
            return
        if self.in_charge and self.custody.taken(telemetry):
            who = Taker.FAILSAFE if telemetry.failsafe else Taker.PILOT
            self._taken_over(who, f"{who.value} chose {telemetry.mode.value} mode")
            return
        if self.state is State.READY:
            self._watch_takeoff(telemetry)
        elif self.in_charge and self._fit(telemetry):
            self.exploration.passing(telemetry.position, self._schedule.now_s)
            self._check_end(telemetry)
            self._check_timer()
            self._advance(self.navigator.update(telemetry))
            self._check_retry(telemetry)

    def _fit(self, telemetry: Telemetry) -> bool:
        """Whether the mission may go on: no breach, nobody else's orders, and a position."""
        if self._giving_up is not None:
            return False
        finding = self._watch.look(telemetry, self.custody)
        match finding.sign:
            case Sign.STRANGER:
                self._taken_over(Taker.PILOT, finding.words)
            case Sign.BREACH:
                self._giving_up = f"{finding.words} is not resumed by itself"
                self._command(HoldHere(finding.words))
            case Sign.LOST:
                self._hold(finding.words)
                self._say(finding.words)
            case Sign.BLIND if self._schedule.take_retry():
                self._hold("GPS has no fix")  # unless that is what it does
            case Sign.BACK:
                self._say(finding.words)
                self._schedule.retry_in(0.0)
        return finding.sign in {Sign.GOOD, Sign.BACK}

    def _on_item(self, event: ItemReached) -> None:
        if self.telemetry is None or not self.in_charge:
            return
        node = self._plan.node_of(event.item)
        if isinstance(self.custody.pending, FlyToNode):
            return  # the report may be of the node before; the vehicle has not confirmed the jump
        self._advance(self.navigator.update(self.telemetry, reached_node=node))

    def _on_pose(self, event: RobotPose) -> None:
        if not self.search.roster.pose_heard(
            event.robot, event.position, event.stamp_s, self._schedule.now_s
        ):
            return
        if event.robot != self.robot:
            return
        if self.state is State.SEARCH and event.peer == event.robot:
            self._signal(Signal.FOUND)
        elif self.state in {State.SEARCH, State.COMM}:
            self._follow()

    def _on_path(self, event: RobotPath) -> None:
        self.search.roster.path_heard(
            event.robot, event.destination, event.stamp_s, self._schedule.now_s
        )

    def _on_sync_started(self, event: SyncStarted) -> None:
        self._exchange.started(event)

    def _on_sync_ended(self, event: SyncEnded) -> None:
        self._exchange.ended(event)
        if self.state is State.COMM and self._exchange.complete:
            self._signal(Signal.SYNCED)

    def _on_confirmed(self, event: CommandConfirmed) -> None:
        self.custody.confirmed(event.action)
        self._give_up()

    def _on_failed(self, event: CommandFailed) -> None:
        if self.custody.failed(event.action):
            self._give_up()
            self._say(f"the vehicle did not follow: {event.reason}")
            self._schedule.retry_in(RETRY_S)

    def _on_request(self, request: Request) -> None:
        if self._giving_up is not None:
            self._say(f"hands off in a moment: {self._giving_up}")
        elif request is Request.COME_HOME:
            self._come_home("the operator's word")
        elif self.state in {State.READY, State.PASSIVE}:
            self._resume()

    def _on_plan_replaced(self, event: PlanReplaced) -> None:
        why = f"the {'fence' if event.only_fence else 'plan'} on board was replaced"
        self._plan_is_ours = False
        if self.state is State.READY and self.telemetry is not None and not self.telemetry.armed:
            self._launch.stayed_why = why
            self._signal(Signal.GROUNDED)
        elif event.only_fence and self.in_charge and self._giving_up is None:
            self._giving_up = why  # the leg under way is ours, and leads where a zone may be now
            self._command(HoldHere(why))
        else:
            self._taken_over(Taker.PILOT, why)

    def _on_link_silent(self, event: LinkSilent) -> None:
        news = self._silence.news(event.silent_s)
        if news is not None:
            self._say(news)

    _reactions: Final[dict[type, Callable[[Controller, Any], None]]] = {
        Telemetry: _on_telemetry,
        ItemReached: _on_item,
        RobotPose: _on_pose,
        RobotPath: _on_path,
        SyncStarted: _on_sync_started,
        SyncEnded: _on_sync_ended,
        CommandConfirmed: _on_confirmed,
        CommandFailed: _on_failed,
        Request: _on_request,
        PlanReplaced: _on_plan_replaced,
        LinkSilent: _on_link_silent,
    }

    def _command(self, motion: Motion) -> None:
        """Only to hold, before hands are off and without a fix: whatever asks for more waits."""
        blind = self._watch.blind or (self.telemetry is not None and not self.telemetry.fix)
        if isinstance(motion, HoldHere) or not (blind or self._giving_up is not None):
            super()._command(motion)

    # Transitions.

    def _signal(self, signal: Signal) -> None:
        target = next_state(self.state, signal)
        self._left, self.state = self.state, target
        self._schedule.enter(target)
        self._actions.append(StateChanged(self._left, signal, target, self.robot))
        self._enter[self.state](self)

    def _enter_exploring(self) -> None:
        self.robot = None
        self._explore()

    def _enter_search(self) -> None:
        for aim in self.search.aims(self._schedule.now_s):
            motion = self._plan_to(aim.goal)
            if self.navigator.progress is not Progress.STRANDED:
                self.robot = aim.robot
                self.search.roster.sought(aim.robot)
                self._say(f"SEARCH {aim.robot}: {aim.reason}")
                self._advance(motion)
                return
            self._say(f"no way to {aim.robot}: {self._refusal()}")
        self._no_target()

    def _enter_comm(self) -> None:
        self._exchange = Exchange(self.robot)
        self._actions.append(PublishMap())
        self._say(f"COMM {self.robot}: found")
        self._follow(force=True)

    def _enter_home(self) -> None:
        self.robot = None
        self._say(f"coming home: {self.came_home_why}")
        self._go_home()

    def _enter_land(self) -> None:
        self._command(LandHere())

    def _enter_passive(self) -> None:
        self._giving_up = None
        self.navigator.stop()
        self.custody.release()

    def _enter_done(self) -> None:
        self.navigator.stop()
        landed_by_us = self._left is State.LAND
        why = self._launch.ending(landed_by_us=landed_by_us)
        self._actions.append(Finish(landed_by_us, why, self._taken_by))

    _enter: Final[dict[State, Callable[[Controller], None]]] = {
        State.INIT: _enter_exploring,
        State.EXPL: _enter_exploring,
        State.SEARCH: _enter_search,
        State.COMM: _enter_comm,
        State.HOME: _enter_home,
        State.LAND: _enter_land,
        State.PASSIVE: _enter_passive,
        State.DONE: _enter_done,
    }

    # Watching.

    def _watch_takeoff(self, telemetry: Telemetry) -> None:
        stage = take_off(self._mission, telemetry)
        if stage is TakeOff.COMPLETE:
            self.custody.assume(FlightMode.MISSION)
            self._launch.airborne_s = self._schedule.now_s
            self._signal(Signal.AIRBORNE)
        elif stage is TakeOff.MISPLACED and self.custody.pending is None:
            self._say("holding: Mission was chosen low and away from home; land, and start there")
            self._command(HoldHere(stage.value))
        elif self._launch.stuck(telemetry) and self.custody.pending is None:
            self._come_home("the climb does not go on")

    def _grounded(self) -> None:
        if self._patient and self.state is State.READY and self._launch.again():
            self._say("disarmed before take-off: waiting on")
        else:
            self._signal(Signal.GROUNDED)

    def _resume(self) -> None:
        """Go on with a flight that was given away, or that a companion before us has left."""
        telemetry = self.telemetry
        why = why_not_resumed(self._mission, telemetry)
        if why is None and not self._plan_is_ours:
            why = "another plan is on board: start the flight anew with --resume"
        if why is not None or telemetry is None:
            self._say(f"not resumed: {why}")
            return
        self._say("resumed: the mission goes on from here")
        self._launch.resumed(self._schedule.now_s)
        self._taken_by = None
        self.custody.assume(telemetry.mode)
        self._signal(Signal.AIRBORNE if self.state is State.READY else Signal.RESUMED)

    def _give_up(self) -> None:
        """Once it was told to hold after a breach: hands off."""
        if self._giving_up is not None and self.custody.pending is None:
            why, self._giving_up = self._giving_up, None
            self._taken_over(Taker.PILOT, why)

    def _taken_over(self, who: Taker, why: str) -> None:
        if knows(self.state, Signal.TAKEN_OVER):
            self._taken_by = who
            self._say(f"hands off: {why}")
            self._signal(Signal.TAKEN_OVER)

    def _check_end(self, telemetry: Telemetry) -> None:
        if not knows(self.state, Signal.COME_HOME):
            return
        since_s = self._launch.since_s(self._schedule.now_s)
        need = self._way_home.need(telemetry)
        why = reason_to_return(self._mission, telemetry, since_s, need)
        if why is not None:
            self._come_home(why)

    def _come_home(self, why: str) -> None:
        if not knows(self.state, Signal.COME_HOME):
            return
        self.came_home_why = why
        on_ground = self.telemetry is None or not self.telemetry.in_air
        if on_ground:
            self._launch.stayed_why = why
        self._signal(Signal.GROUNDED if on_ground else Signal.COME_HOME)

    def _check_timer(self) -> None:
        if self.time_left_s == 0.0:
            self._signal(Signal.TIMER)

    def _check_retry(self, telemetry: Telemetry) -> None:
        if self.custody.pending or not self._schedule.take_retry():
            return
        if self.state is State.SEARCH and self.robot is None:
            self._enter_search()
        elif self.state is State.HOME:
            self._go_home()
        elif self.state is State.LAND:
            self._enter_land()
        elif self.state is State.COMM:
            self._follow(force=True)
        elif self.state in EXPLORING and self.navigator.goal is None:
            self._explore()
        else:
            self._advance(self.navigator.again(telemetry))
