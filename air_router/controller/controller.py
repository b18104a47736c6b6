"""The mission controller: what happened and the vehicle's time in, what to do out.

Pure: no sockets, no clocks, no files. The same object flies a real PX4, the simulated one, and
the discrete-event world, and a recorded flight replays to the same decisions.

It is put together from parts (`crew`), each with a state of its own. Here stands, as tables beside
the transitions of `behaviour`, when each is asked: what is flown in a state, what is done when one
is entered, who takes an event in, and what may veto a motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, get_args

from air_router.controller.assembly import Crew
from air_router.controller.model.actions import Action, Finish, Motion, Seeking, StateChanged
from air_router.controller.model.behaviour import Signal, State, next_state
from air_router.controller.model.events import (
    AirspaceChanged,
    CommandConfirmed,
    CommandFailed,
    Event,
    FlownBefore,
    PlanRenewed,
    RobotPath,
    RobotPose,
    RobotSought,
)
from air_router.controller.model.requests import AnyRequest
from air_router.controller.model.state_handler import NO_JOURNEY, Journey
from air_router.controller.motion.command_gate import Guard
from air_router.controller.states.goto_task import Errand
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.vehicle.vehicle import (
    ItemReached,
    LinkSilent,
    PlanCompared,
    PlanReplaced,
    Telemetry,
)
from mocha_link.links.metrics import ContactBegan, ContactEnded, SyncEnded, SyncStarted

_NOBODY_SOUGHT: Final = frozenset({State.INIT, State.EXPL, State.GOTO, State.HOLD, State.HOME})
"""States that forget who was sought; while others fly it is remembered."""


class Controller:
    """Flies one mission.

    Args:
        mission: What to fly.
        plan: The plan on board, for the autopilot's item numbers.
        router: Routes over the mission's graph.
        seek: Names of the robots to seek, in order.
        patient: Somebody else arms: if it is disarmed again on the ground, wait on.
        explore: Explore between two searches; otherwise only search.
        name: The UAV's name in the team: of two that seek the same robot, the lower name keeps it.

    Attributes:
        navigator: Takes the vehicle to one goal at a time.
        custody: Who has the vehicle, and what it was told last.
        exploration: Which waypoint is next.
        search: Whom to seek, and where.
    """

    def __init__(  # noqa: PLR0913 - what a flight is decided with
        self,
        mission: Mission,
        plan: FlightPlan,
        router: Router,
        seek: tuple[str, ...],
        *,
        patient: bool = False,
        explore: bool = True,
        name: str = "",
    ) -> None:
        crew = self._crew = Crew(
            mission,
            plan,
            router,
            seek,
            patient=patient,
            explore=explore,
            name=name,
            signal=self._signal,
        )
        self._cockpit = crew.cockpit
        self.navigator = crew.helm.navigator
        self.custody = crew.helm.custody
        self.exploration = crew.exploration
        self.search = crew.search
        self._explores = explore
        self._left = State.READY
        self._told_sought: str | None = None
        self._journeys = self._table_of_journeys()
        self._entries = self._table_of_entries()
        self._reactions = self._table_of_reactions()
        crew.helm.guards = self._table_of_guards()

    # The tables.

    def _table_of_guards(self) -> tuple[Guard, ...]:
        """Who may veto a motion, or replace it, in this order; a hold passes all of them."""
        crew = self._crew
        return (
            crew.watchkeeper.wait_for_inputs,  # where is it, or whose?
            crew.helm.stop_if_doubtful,  # which of several orders would it follow? Hold first
            crew.handing.only_hold,  # hands are off in a moment
            crew.renewal.only_hold,  # zones are being changed
            crew.levelling.first,  # it is lower than legs are checked for
        )

    def _table_of_journeys(self) -> Mapping[State, Journey]:
        """What is flown in each state."""
        crew = self._crew
        return {
            State.READY: NO_JOURNEY,
            State.INIT: crew.exploring,
            State.EXPL: crew.exploring,
            State.SEARCH: crew.pursuit,
            State.COMM: crew.meeting,
            State.GOTO: crew.errands,
            State.HOLD: crew.hovering,
            State.HOME: crew.homecoming,
            State.LAND: crew.landing,
            State.PASSIVE: NO_JOURNEY,
            State.DONE: NO_JOURNEY,
        }

    def _table_of_entries(self) -> Mapping[State, Callable[[], None]]:
        """What is done when a state is entered; nothing leads back to READY."""
        crew = self._crew
        return {
            State.INIT: crew.exploring.begin,
            State.EXPL: crew.exploring.begin,
            State.SEARCH: crew.pursuit.begin,
            State.COMM: crew.meeting.begin,
            State.GOTO: crew.errands.begin,
            State.HOLD: crew.hovering.begin,
            State.HOME: crew.homecoming.begin,
            State.LAND: crew.landing.begin,
            State.PASSIVE: self._let_go,
            State.DONE: self._finish,
        }

    def _table_of_reactions(self) -> Mapping[type, Callable[[Any], None]]:
        """Who takes which event in; others (links of others, metrics) only concern the record."""
        crew = self._crew
        return {
            Telemetry: crew.watchkeeper.vehicle_heard,
            ItemReached: crew.watchkeeper.item_reached,
            LinkSilent: crew.watchkeeper.nothing_heard,
            CommandConfirmed: crew.watchkeeper.confirmed,
            CommandFailed: crew.helm.failed,
            RobotPose: crew.pursuit.pose_heard,
            RobotPath: crew.pursuit.path_heard,
            RobotSought: crew.pursuit.sought_by_other,
            ContactBegan: crew.pursuit.radio_heard,
            ContactEnded: crew.pursuit.radio_heard,
            SyncStarted: crew.meeting.sync_started,
            SyncEnded: crew.meeting.sync_ended,
            AirspaceChanged: crew.renewal.airspace_changed,
            PlanRenewed: crew.renewal.plan_renewed,
            FlownBefore: self._flown_before,
            PlanReplaced: crew.handing.plan_replaced,
            PlanCompared: crew.handing.plan_compared,
            **dict.fromkeys(get_args(AnyRequest), crew.answering.asked),
        }

    # From state to state.

    def _signal(self, signal: Signal) -> None:
        """Something has happened to the mission: another state is entered, or the same anew."""
        left = self._left = self.state
        target = next_state(left, signal, explores=self._explores)
        self._cockpit.enter(target, self._journeys[target])
        self._cockpit.do(StateChanged(left, signal, target, self.robot))
        if target in _NOBODY_SOUGHT:
            self._crew.pursuit.forget()
        self._entries[target]()

    def _flown_before(self, event: FlownBefore) -> None:
        self._crew.launch.airborne_s = event.airborne_s
        self.exploration.go_on(event.visited, event.left_out)

    def _let_go(self) -> None:
        self._crew.handing.settled()
        self._crew.answering.now_what_waited()
        self._crew.helm.let_go()

    def _finish(self) -> None:
        self._crew.handing.settled()
        self.navigator.stop()
        self._crew.answering.now_what_waited()
        landed_by_us = self._left is State.LAND
        why = self._crew.launch.ending(landed_by_us=landed_by_us)
        self._cockpit.do(Finish(landed_by_us, why, self._crew.handing.taken_by))

    # What others do.

    def handle(self, event: Event, now_s: float) -> list[Action]:
        """Take one event in at vehicle time `now_s`; returns what to do about it, in order."""
        self._cockpit.begin(now_s)
        reaction = self._reactions.get(type(event))
        if reaction is not None:
            reaction(event)
        if self.sought != self._told_sought:
            self._told_sought = self.sought
            self._cockpit.do(Seeking(self.sought))
        return self._cockpit.actions

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion that was decided a moment ago must not be commanded now; None if it may."""
        return self._crew.helm.objection(motion, now_s)

    def prepare(self, router: Router) -> None:
        """The router among changed zones, made elsewhere because it takes a while.

        The same is made here if there is none when the change comes.
        """
        self._crew.renewal.prepare(router)

    # What others read.

    @property
    def mission(self) -> Mission:
        """The mission, with the zones and fences of now."""
        return self._cockpit.mission

    @property
    def router(self) -> Router:
        """Plans among the zones and fences of now."""
        return self._cockpit.router

    @property
    def telemetry(self) -> Telemetry | None:
        """What the vehicle said last."""
        return self._cockpit.telemetry

    @property
    def flown(self) -> FlownBefore | None:
        """What another companion has to know to go on with this flight; None if there is none."""
        airborne_s = self._crew.launch.airborne_s
        if airborne_s is None or self.state is State.DONE:
            return None
        visited, _ = self.exploration.mark()
        return FlownBefore(airborne_s, visited, tuple(self.exploration.left_out))

    @property
    def state(self) -> State:
        """What the mission is doing."""
        return self._cockpit.state

    @property
    def time_left_s(self) -> float | None:
        """Seconds until the state's timer, None while it does not run."""
        return self._cockpit.schedule.left_s

    @property
    def robot(self) -> str | None:
        """Who is sought or hovered over, or was when the vehicle was given away."""
        return self._crew.pursuit.robot

    @property
    def sought(self) -> str | None:
        """The robot that is sought or hovered over now; None while it does something else."""
        return self._crew.pursuit.sought

    @property
    def errand(self) -> Errand | None:
        """The points that somebody has sent it to."""
        return self._crew.errands.errand

    @property
    def came_home_why(self) -> str | None:
        """Why the vehicle comes home, once it does."""
        return self._crew.homecoming.why

    @property
    def need_home(self) -> float | None:
        """The charge that flying home from here takes; None when unknown, or on the way already."""
        return self._crew.homecoming.need_home

    @property
    def walled_in(self) -> bool:
        """Whether zones that were drawn in flight leave no clear way home from here."""
        return self._crew.enclosure.walled_in

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        return self._crew.handing.in_charge
