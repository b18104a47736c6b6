"""The mission controller: what happened and the vehicle's time in, what to do out.

Pure: no sockets, no clocks, no files. The same object flies a real PX4, the simulated one, and
the discrete-event world, and a recorded flight replays to the same decisions.

When it explores, searches and talks stands in one table, `states.table.STATES`; what each event
leads to, and in which order, in `mission_loop`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.command_handler import CommandHandler
from air_router.controller.control_authority import ControlAuthority, SilenceReminder
from air_router.controller.deviations import Deviations, ReturnMonitor
from air_router.controller.mission_loop import MissionLoop
from air_router.controller.model.actions import Motion
from air_router.controller.model.events import (
    AirspaceChanged,
    CommandConfirmed,
    CommandFailed,
    FlownBefore,
    PeerFault,
    PlanRenewed,
    RobotPath,
    RobotPose,
    RobotSought,
)
from air_router.controller.model.mission_context import MissionContext, StateHandler
from air_router.controller.model.requests import AnyRequest
from air_router.controller.model.states import State
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.initial_climb import ClimbWatch, InitialClimb
from air_router.controller.motion.navigator import Navigator
from air_router.controller.safety_monitor import FlightPhase, HomeWatch, SafetyMonitor
from air_router.controller.states.explore_state import Exploration, ExploreState
from air_router.controller.states.goto_state import GotoState, GotoTask, GotoValidator, HoldState
from air_router.controller.states.return_state import (
    HandsOffState,
    HomeReachability,
    LandState,
    ReturnState,
)
from air_router.controller.states.search_points import Search
from air_router.controller.states.search_state import CommState, SearchState
from air_router.controller.states.table import STATES, transitions
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from air_router.vehicle.vehicle import (
    ItemReached,
    LinkSilent,
    PlanCompared,
    PlanReplaced,
    Telemetry,
)
from mocha_link.links.metrics import ContactBegan, ContactEnded, SyncEnded, SyncStarted


class Controller(MissionLoop):
    """Flies one mission: its parts put together, and what others ask it.

    Args:
        mission: What to fly.
        plan: The plan on board, for the autopilot's item numbers.
        router: Routes over the mission's graph.
        seek: Names of the robots to seek, in order.
        pilot_arms: The pilot arms: if it is disarmed again on the ground, wait on.
        explore: Explore between two searches; otherwise only search.
        name: The UAV's name in the team: of two that seek the same robot, the lower name keeps it.

    Attributes:
        search: Whom to seek, and where.
    """

    def __init__(  # noqa: PLR0913 - what a flight is decided with
        self,
        mission: Mission,
        plan: FlightPlan,
        router: Router,
        seek: tuple[str, ...],
        *,
        pilot_arms: bool = False,
        explore: bool = True,
        name: str = "",
    ) -> None:
        self._plan, self._pilot_arms = plan, pilot_arms
        self._transitions = transitions(explores=explore)
        # What is known and kept.
        context = self.context = MissionContext(
            mission, router, self._signal, spec=STATES[State.READY]
        )
        gate = self.gate = CommandGate(context, plan)  # all motions pass it
        navigator = self.navigator = Navigator(context, gate)
        climb = self._climb = InitialClimb(context, gate)
        gate.climb_first = climb.first
        # Of a flight that is gone on with some waypoints may be skipped already.
        exploration = self.exploration = Exploration(mission.waypoints, mission.skipped)
        self.search = Search(context, navigator, seek, exploration, explore=explore)
        reachability = self._reachability = HomeReachability(context)
        # What is flown.
        to_explore = exploration if explore else None
        search = SearchState(context, gate, navigator, self.search, to_explore, name)
        comm = CommState(context, gate, search)
        goto = self._goto_state = GotoState(context, navigator)
        hold = HoldState(context, gate, goto, search)
        land = LandState(context, gate)
        handlers: tuple[StateHandler, ...] = (
            StateHandler(),
            ExploreState(context, gate, navigator, exploration, reachability),
            search,
            comm,
            goto,
            hold,
            ReturnState(context, gate, navigator),
            land,
            HandsOffState(self._let_go),
        )
        of_class = {type(handler): handler for handler in handlers}
        self._handlers = {state: of_class[spec.handler] for state, spec in STATES.items()}
        # What is watched, in this order.
        self._phase = FlightPhase(context)
        self._home = HomeWatch(context)
        self._rise = ClimbWatch()
        self._silence = SilenceReminder()
        self._monitor = SafetyMonitor(context, gate, plan)
        self._deviations = Deviations(context, gate, self._home)
        self._returns = ReturnMonitor(context, reachability)
        authority = self._authority = ControlAuthority(context, gate, climb, self._monitor)
        self.airspace_update = AirspaceUpdate(context, gate, navigator, exploration)
        commands = self._commands = CommandHandler(
            context,
            self._returns,
            authority,
            GotoValidator(context, navigator),
            to_explore,
            search,
            goto,
            hold,
            land,
            self.airspace_update,
        )
        # Who takes which event in; others (links of others, metrics) only concern the record.
        self._reactions = {
            Telemetry: self._vehicle_heard,
            ItemReached: self._item_reached,
            LinkSilent: self._nothing_heard,
            CommandConfirmed: self._confirmed,
            CommandFailed: gate.failed,
            RobotPose: search.pose_heard,
            RobotPath: search.path_heard,
            RobotSought: search.sought_by_other,
            ContactBegan: search.radio_heard,
            ContactEnded: search.radio_heard,
            SyncStarted: comm.sync_started,
            SyncEnded: comm.sync_ended,
            AirspaceChanged: self.airspace_update.airspace_changed,
            PlanRenewed: self.airspace_update.plan_renewed,
            FlownBefore: self._flown_before,
            PeerFault: lambda event: context.say(event.words),
            PlanReplaced: authority.plan_replaced,
            PlanCompared: authority.plan_compared,
            **dict.fromkeys(get_args(AnyRequest), commands.asked),
        }

    # What others ask, and read.

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion that was decided a moment ago must not be commanded now; None if it may."""
        return self.navigator.objection(motion, now_s)

    def prepare(self, router: Router) -> None:
        """The router among changed zones, made elsewhere because it takes a while.

        The same is made here if there is none when the change comes.
        """
        self.airspace_update.prepared = router

    @property
    def mission(self) -> Mission:
        """The mission, with the zones and fences of now."""
        return self.context.mission

    @property
    def router(self) -> Router:
        """Plans among the zones and fences of now."""
        return self.context.router

    @property
    def telemetry(self) -> Telemetry | None:
        """What the vehicle said last."""
        return self.context.telemetry

    @property
    def flown(self) -> FlownBefore | None:
        """What another companion has to know to go on with this flight; None if there is none."""
        airborne_s = self.context.airborne_s
        if airborne_s is None or self.state is State.DONE:
            return None
        visited, _ = self.exploration.mark()
        return FlownBefore(airborne_s, visited, tuple(self.exploration.left_out))

    @property
    def state(self) -> State:
        """What the mission is doing."""
        return self.context.state

    @property
    def time_left_s(self) -> float | None:
        """Seconds until the state's timer, None while it does not run."""
        return self.context.left_s

    @property
    def robot(self) -> str | None:
        """Who is sought or hovered over, or was when the vehicle was given away."""
        return self.context.robot

    @property
    def goto_task(self) -> GotoTask | None:
        """The points that it was sent to on request."""
        return self._goto_state.goto_task

    @property
    def came_home_why(self) -> str | None:
        """Why the vehicle comes home, once it does."""
        return None if self.context.ending is None else self.context.ending.why

    @property
    def need_home(self) -> float | None:
        """The charge that flying home from here takes; None when unknown, or on the way already."""
        return self._returns.need_home

    @property
    def no_way_home(self) -> bool:
        """Whether zones that were drawn in flight leave no clear way home from here."""
        return self._reachability.walls is not None

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        return self.context.in_charge


@dataclass(frozen=True, slots=True)
class FlightSetup:
    """One flight's mission and how it is flown.

    Attributes:
        mission: What to fly, as it was judged: with the zones that applied at that time.
        seek: The robots to seek, in order.
        pilot_arms: The pilot arms.
        explore: False: it only searches.
        name: The UAV's name in the team.
    """

    mission: Mission
    seek: tuple[str, ...] = ()
    pilot_arms: bool = False
    explore: bool = True
    name: str = ""

    def controller(
        self, router: Router | None = None, plan: FlightPlan | None = None
    ) -> Controller:
        """A fresh controller, and with it a router and a plan if there are none yet."""
        return Controller(
            self.mission,
            plan if plan is not None else FlightPlan.of(self.mission),
            router if router is not None else Router(WaypointGraph(self.mission)),
            self.seek,
            pilot_arms=self.pilot_arms,
            explore=self.explore,
            name=self.name,
        )
