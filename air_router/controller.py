"""The mission controller: what happened and the vehicle's time in, what to do out.

Pure: no sockets, no clocks, no files. The same object flies a real PX4, the simulated one, and
the discrete-event world, and a recorded flight replays to the same decisions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from air_router.actions import (
    Action,
    Announce,
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
from air_router.custody import Custody
from air_router.events import CommandConfirmed, CommandFailed, Event, Request, RobotPath, RobotPose
from air_router.exchange import Exchange
from air_router.exploration import Exploration
from air_router.flight_plan import HOME_NODE
from air_router.launch import Launch
from air_router.milestones import Silence, TakeOff, reason_to_return, take_off
from air_router.navigator import Goal, Navigator, Progress
from air_router.schedule import Schedule
from air_router.search import Search
from air_router.vehicle import FlightMode, ItemReached, LinkSilent, PlanReplaced, Telemetry
from mocha_link.metrics import SyncEnded, SyncStarted

if TYPE_CHECKING:
    from air_router.flight_plan import FlightPlan
    from air_router.mission import Mission
    from air_router.router import Router

FOLLOW_M: Final = 8.0
"""A robot that has moved so far from where we hover (or search) is followed."""

RETRY_S: Final = 3.0
"""Pause before something that could not be done is tried again."""

SEEK_AGAIN_S: Final = 10.0
"""Pause before the robots are gone through again when none of them could be sought."""


class Controller:
    """Flies one mission.

    Args:
        mission: What to fly.
        plan: The plan on board, for the autopilot's item numbers.
        router: Routes over the mission's graph.
        seek: Names of the robots to seek, in order.
    """

    def __init__(
        self, mission: Mission, plan: FlightPlan, router: Router, seek: tuple[str, ...]
    ) -> None:
        self._mission = mission
        self._plan = plan
        self.navigator = Navigator(mission, router)
        self.state = State.READY
        self._left = State.READY
        self.robot: str | None = None
        self.telemetry: Telemetry | None = None
        self.exploration = Exploration(mission.waypoints)
        self.search = Search(mission, seek, self.exploration)
        self.custody = Custody()
        self._schedule = Schedule(mission.timers)
        self._launch = Launch()
        self._taken_by: Taker | None = None
        self._silence = Silence()
        self._exchange = Exchange()
        self._come_home_why: str | None = None
        self._actions: list[Action] = []

    # What others read.

    @property
    def time_left_s(self) -> float | None:
        """Seconds until the state's timer, None while it does not run."""
        return self._schedule.left_s

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        if self.state is State.READY:
            return self._launch.handed_over
        return self.state not in {State.PASSIVE, State.DONE}

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion that was decided a moment ago must not be commanded now; None if it may."""
        if motion is not self.custody.pending or self.telemetry is None:
            return "it was called off"
        return self.navigator.objection(motion, self.telemetry, now_s)

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
            self._signal(Signal.GROUNDED)
            return
        if self.in_charge and self.custody.taken(telemetry):
            who = Taker.FAILSAFE if telemetry.failsafe else Taker.PILOT
            self._taken_over(who, f"{who.value} chose {telemetry.mode.value} mode")
            return
        if self.state is State.READY:
            self._watch_takeoff(telemetry)
        elif self.in_charge:
            self.exploration.passing(telemetry.position, self._schedule.now_s)
            self._check_end(telemetry)
            self._check_timer()
            self._advance(self.navigator.update(telemetry))
            self._check_retry(telemetry)

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

    def _on_failed(self, event: CommandFailed) -> None:
        if self.custody.failed(event.action):
            self._say(f"the vehicle did not follow: {event.reason}")
            self._schedule.retry_in(RETRY_S)

    def _on_request(self, request: Request) -> None:
        if request is Request.COME_HOME:
            self._come_home("the operator's word")

    def _on_plan_replaced(self, _event: PlanReplaced) -> None:
        why = "the plan on board was replaced"
        if self.state is State.READY and self.telemetry is not None and not self.telemetry.armed:
            self._launch.stayed_why = why
            self._signal(Signal.GROUNDED)
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

    def _no_target(self) -> None:
        self.robot = None
        self.navigator.stop()
        if self.exploration.remaining:
            self._signal(Signal.NO_TARGET)
        else:
            self._hold("no robot can be sought from here")
            self._schedule.retry_in(SEEK_AGAIN_S)

    def _enter_comm(self) -> None:
        self._exchange = Exchange(self.robot)
        self._actions.append(PublishMap())
        self._say(f"COMM {self.robot}: found")
        self._follow(force=True)

    def _enter_home(self) -> None:
        self.robot = None
        self._say(f"coming home: {self._come_home_why}")
        self._go_home()

    def _enter_land(self) -> None:
        self._command(LandHere())

    def _enter_passive(self) -> None:
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

    def _taken_over(self, who: Taker, why: str) -> None:
        if knows(self.state, Signal.TAKEN_OVER):
            self._taken_by = who
            self._say(f"hands off: {why}")
            self._signal(Signal.TAKEN_OVER)

    def _check_end(self, telemetry: Telemetry) -> None:
        since_s = self._launch.since_s(self._schedule.now_s)
        why = reason_to_return(self._mission, telemetry, since_s)
        if why is not None:
            self._come_home(why)

    def _come_home(self, why: str) -> None:
        if not knows(self.state, Signal.COME_HOME):
            return
        self._come_home_why = why
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

    # Flying.

    def _advance(self, motion: Motion | None) -> None:
        """Command the next motion, and act on where the journey stands."""
        if motion is not None:
            self._command(motion)
        progress = self.navigator.progress
        if progress is Progress.ARRIVED:
            self._arrived()
        elif progress is Progress.STRANDED:
            self._stranded()

    def _arrived(self) -> None:
        goal = self.navigator.goal
        if self.state in EXPLORING:
            self.exploration.visited()
            self._explore()
        elif self.state is State.SEARCH and not self._schedule.running:
            self._schedule.start()
            self._say(f"at the search position of {self.robot}")
        elif self.state is State.HOME and goal is not None and goal.node == HOME_NODE:
            self._signal(Signal.ARRIVED)

    def _stranded(self) -> None:
        refusal = self._refusal()
        if self.state in EXPLORING:
            self._say(f"waypoint {self.exploration.leave_out()} left out: {refusal}")
            self._explore()
        elif self.state is State.SEARCH:
            self._say(f"no way to {self.robot}: {refusal}")
            self._no_target()
        elif not self._schedule.retrying:
            self._hold(refusal)
            self._schedule.retry_in(RETRY_S)

    def _explore(self) -> None:
        """Fly to the waypoint whose turn it is, or say that none is left."""
        exploration, refusals = self.exploration, []
        mark = exploration.mark()
        while exploration.remaining:
            motion = self._plan_to(exploration.goal)
            if self.navigator.progress is Progress.FLYING:
                break
            if self.navigator.progress is Progress.STRANDED:
                refusals.append(f"waypoint {exploration.leave_out()} left out: {self._refusal()}")
            else:
                exploration.visited()
                mark = exploration.mark()
        if refusals and not exploration.remaining:
            # All can be reached from home, or the mission would not fly: it is this place.
            exploration.back_to(mark)
            self.navigator.stop()
            self._hold(f"no waypoint can be reached from here: {self._refusal()}")
            self._schedule.retry_in(RETRY_S)
            return
        for refusal in refusals:
            self._say(refusal)
        if exploration.remaining:
            self._advance(motion)
        else:
            self._signal(Signal.EXPLORED)

    def _follow(self, *, force: bool = False) -> None:
        """Hover over (or search at) the robot's newest position once it has moved away."""
        over = None if self.robot is None else self.search.over(self.robot)
        if over is None:
            return
        (hover, beside_m), goal = over, self.navigator.goal
        if not force and goal is not None and math.dist(goal.position, hover.position) < FOLLOW_M:
            return
        if beside_m > 0:
            self._say(f"no hovering over {self.robot}: waiting {beside_m:.0f} m beside it")
        self._advance(self._plan_to(hover))

    def _go_home(self) -> None:
        self._advance(self._plan_to(Goal(self._mission.home, HOME_NODE)))

    def _plan_to(self, goal: Goal) -> Motion | None:
        assert self.telemetry is not None  # noqa: S101 - in the air there was telemetry
        return self.navigator.go(goal, self.telemetry)

    def _hold(self, why: str) -> None:
        """Stop, unless that is what the vehicle was told last."""
        if not isinstance(self.custody.last, HoldHere):
            self._command(HoldHere(why))

    def _command(self, motion: Motion) -> None:
        self.custody.commanded(motion)
        self._actions.append(motion)

    def _refusal(self) -> str:
        refusal = self.navigator.refusal
        return refusal.reason if refusal is not None else "no clear way"

    def _say(self, text: str) -> None:
        self._actions.append(Announce(text))
