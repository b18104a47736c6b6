"""The mission controller: what happened and the vehicle's time in, what to do out.

Pure: no sockets, no clocks, no files. The same object flies a real PX4, the simulated one, and
the discrete-event world, and a recorded flight replays to the same decisions.

Of each telemetry message the gravest matter counts first. Who has the vehicle comes before
everything else: a pilot, a failsafe, or one who is about to get it. Then what is wrong with the
flight, and only then the mission. When that explores, searches and talks stands in one table,
`states.table.STATES`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, get_args

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.command_handler import CommandHandler
from air_router.controller.control_authority import ControlAuthority
from air_router.controller.deviations import Deviations
from air_router.controller.envelope import Envelope, ReturnMonitor
from air_router.controller.flight_status import AirspaceStatus, FlightStatus, TargetStatus
from air_router.controller.lag_monitor import LagMonitor
from air_router.controller.limits import VEHICLE_SILENT_S
from air_router.controller.model import (
    Action,
    AirspaceChanged,
    AnyRequest,
    CommandConfirmed,
    CommandFailed,
    CompanionLagged,
    Doubt,
    Event,
    Finish,
    FlightSetup,
    FlownBefore,
    FlyToNode,
    MissionContext,
    MissionWaits,
    Motion,
    OnBoard,
    PeerFault,
    PlanRenewed,
    RobotPath,
    RobotPose,
    RobotSought,
    Seeking,
    Signal,
    State,
    StateChanged,
    Task,
    Wanted,
)
from air_router.controller.motion import CommandGate, Interlock, Navigator, raised
from air_router.controller.safety_monitor import FlightPhase, HomeWatch, SafetyMonitor
from air_router.controller.standstill import Standstill
from air_router.controller.states import (
    STATES,
    Exploration,
    GotoValidator,
    Search,
    StateHandlers,
    transitions,
)
from air_router.controller.targets import LinkSample, Policy, TargetTrack
from air_router.controller.telemetry_handler import TelemetryHandler
from air_router.mission import FlightPlan, Mission, Waypoint
from air_router.routing import Router, WaypointGraph
from air_router.vehicle import (
    CHECK_PEER,
    FlightMode,
    ItemReached,
    LinkSilent,
    MavlinkSpoofed,
    PlanCompared,
    PlanReplaced,
    PlanTried,
    Telemetry,
    WrongVehicle,
)
from geo.grid import SemanticGrid
from mocha_link.links import ContactBegan, ContactEnded, SyncEnded, SyncStarted


class Controller:
    """Flies one mission: events in, actions out.

    Args:
        setup: What to fly, and how.
        router: Routes over the mission's graph; None: made here.
        plan: The plan on board, for the autopilot's item numbers; None: made here.
        policy: How the next robot is chosen; None: as the mission says.
        waypoints: What is explored, in this order; None: the mission's waypoints, once.
        ground: What the vehicle maps as it flies, painted by others; for seek policies.

    Other rooms use its methods; the parts below are for the tests of this room.

    Attributes:
        context: What is known now.
        gate: What was commanded to the vehicle.
        navigator: Takes the vehicle to one goal at a time.
        exploration: Which waypoint is next.
        search: Whom to seek, and where.
        states: What is flown in each state.
        returns: When the mission ends, and whether a way leads home.
        airspace_update: Zones that change.
    """

    def __init__(  # noqa: PLR0913 - what a flight may be given
        self,
        setup: FlightSetup,
        router: Router | None = None,
        plan: FlightPlan | None = None,
        *,
        policy: Policy | None = None,
        waypoints: tuple[Waypoint, ...] | None = None,
        ground: SemanticGrid | None = None,
    ) -> None:
        mission, explore = setup.mission, setup.explore
        router = router if router is not None else Router(WaypointGraph(mission))
        plan = self._plan = plan if plan is not None else FlightPlan.of(mission)
        self._transitions = transitions(explores=explore)
        self._left = State.READY  # the state before this one
        self._told_sought: str | None = None  # the robot in the last `Seeking`
        self._told_waits: Interlock | None = None  # the row in the last `MissionWaits`
        # What is known and kept.
        task = Task(spec=STATES[State.READY])
        context = self.context = MissionContext(mission, router, self._signal, task=task)
        gate = self.gate = CommandGate(context, plan)  # all motions pass it
        navigator = self.navigator = Navigator(context, gate)
        # Of a flight that is gone on with some waypoints may be skipped already.
        explored = mission.waypoints if waypoints is None else waypoints
        exploration = self.exploration = Exploration(explored, mission.skipped)
        self.search = Search(context, navigator, setup, exploration, policy, ground=ground)
        states = self.states = StateHandlers(context, gate, navigator, self.search)
        # What is watched, in this order.
        self._phase = FlightPhase(context, gate)
        home = HomeWatch(context)
        monitor = SafetyMonitor(context, gate, plan)
        envelope = Envelope(context, gate, home)
        self.returns = ReturnMonitor(context, states.reachability)
        standstill = Standstill(context)
        lag = LagMonitor(context)
        deviations = Deviations(context, gate, self.returns, lag, envelope)
        authority = self._authority = ControlAuthority(context, gate, navigator, monitor)
        self.airspace_update = AirspaceUpdate(context, gate, navigator, exploration, self.returns)
        commands = self._commands = CommandHandler(
            context,
            self.returns,
            authority,
            GotoValidator(context, navigator, gate),
            states,
            self.airspace_update,
            standstill,
        )
        # What pages show must change nothing: the way home that is planned for them is their own.
        shown = ReturnMonitor(context, states.reachability)
        self._shown_commands = replace(commands, _returns=shown)
        vehicle = TelemetryHandler(
            context,
            gate,
            navigator,
            exploration,
            states,
            self._phase,
            home,
            monitor,
            self.returns,
            lag,
            deviations,
            authority,
            self.airspace_update,
            commands,
            standstill,
            setup.pilot_arms,
        )
        # Who takes which event in; others (links of others, metrics) only concern the record.
        self._reactions: dict[type, Callable[[Any], Wanted | None]] = {
            Telemetry: vehicle.received,
            ItemReached: self._item_reached,
            LinkSilent: authority.nothing_heard,
            CommandConfirmed: self._confirmed,
            CommandFailed: self._failed,
            RobotPose: states.search.pose_heard,
            RobotPath: states.search.path_heard,
            RobotSought: states.search.sought_by_other,
            ContactBegan: states.search.radio_heard,
            ContactEnded: states.search.radio_heard,
            SyncStarted: states.comm.sync_started,
            SyncEnded: states.comm.sync_ended,
            AirspaceChanged: self.airspace_update.airspace_changed,
            PlanRenewed: self.airspace_update.plan_renewed,
            FlownBefore: self._flown_before,
            CompanionLagged: lag.lagged,
            PeerFault: lambda event: context.warn(event.words, CHECK_PEER),
            PlanReplaced: authority.plan_replaced,
            PlanTried: authority.plan_tried,
            PlanCompared: authority.plan_compared,
            WrongVehicle: authority.another_vehicle,
            MavlinkSpoofed: authority.spoofed,
            **dict.fromkeys(get_args(AnyRequest), commands.asked),
        }

    def handle(self, event: Event, now_s: float) -> list[Action]:
        """Take one event in at vehicle time `now_s`; returns what to do about it, in order."""
        context = self.context
        context.begin(now_s)
        if context.silent_s > 0.0 and not self._authority.heard_again(event):
            return context.actions
        reaction = self._reactions.get(type(event))
        wanted = None if reaction is None else reaction(event)
        if wanted is not None:
            self.navigator.follow(wanted)
        context.actions.extend(context.alarms.due(context.now_s))
        sought = context.task.robot if context.task.spec.seeks else None
        if sought != self._told_sought:
            self._told_sought = sought
            context.actions.append(Seeking(sought))
        self._tell_waiting()
        return context.actions

    def _tell_waiting(self) -> None:
        """Record which row of `INTERLOCKS` keeps the mission waiting, once it is another."""
        blocked = self.gate.waits_for()
        row = None if blocked is None else blocked.by
        if row is self._told_waits:
            return
        self._told_waits = row
        self.context.actions.append(self._waiting() or MissionWaits(None))

    def _waiting(self) -> MissionWaits | None:
        """What keeps the mission from what it wants now; None: nothing does."""
        blocked = self.gate.waits_for()
        if blocked is None:
            return None
        return MissionWaits(blocked.by.name, blocked.why(self.context), blocked.since_s)

    # What becomes of what was commanded.

    def _item_reached(self, event: ItemReached) -> None:
        """The vehicle says that it is at a plan item: perhaps at the end of its leg."""
        context = self.context
        waits = context.airspace.change is not None or context.interlocks.up(*Doubt)
        if context.telemetry is None or not context.in_charge or waits:
            return
        if isinstance(self.gate.pending, FlyToNode):
            return  # the report may be of the node before; the vehicle has not confirmed the jump
        node = self._plan.node_of(event.item)
        self.navigator.advance(self.navigator.update(context.telemetry, reached_node=node))

    def _confirmed(self, event: CommandConfirmed) -> None:
        """It follows; if that was the hold before hands are off, it is let go."""
        self.gate.confirmed(event)
        self._authority.check()

    def _failed(self, event: CommandFailed) -> None:
        """It does not follow; perhaps because a pilot chose another mode before."""
        telemetry = self.context.telemetry
        ours = event.action is self.gate.pending and self.context.in_charge
        if event.taken is None or telemetry is None or not ours:
            self.gate.failed(event)
        else:
            taken = replace(telemetry, mode=event.taken)
            self._authority.taken(taken, crossed=event.sent)

    # From state to state.

    def _signal(self, signal: Signal) -> None:
        """Something has happened to the mission: another state is entered, or the same anew."""
        context, left = self.context, self.context.task.state
        target = self._transitions[left].get(signal)
        if target is None:
            return
        self._left = left
        spec, handler = STATES[target], self.states.of[target]
        self.gate.mission_goes_on()
        own_s = None if spec.timer is None else getattr(context.airspace.mission.timers, spec.timer)
        context.task.enter(target, spec, handler, own_s, context.now_s)
        context.actions.append(StateChanged(left, signal, target, context.task.robot))
        if not spec.keeps_target:
            context.task.seek(None)
        if not spec.ours:
            self._let_go()
        self.navigator.follow(handler.begin())

    def _flown_before(self, event: FlownBefore) -> None:
        self.context.task.fly_since(event.airborne_s)
        self.exploration.go_on(event.visited, event.left_out)

    def _let_go(self) -> None:
        """Hands are off, or the flight is over."""
        context = self.context
        done = context.task.state is State.DONE
        context.authority.let_go()
        context.alarms.end_all()
        if done:
            self.gate.stop()
        self._commands.now_what_waited()
        if not done:
            context.authority.goes_on()
            self.gate.let_go()
            return
        landed_by_us = self._left is State.LAND
        why = self._phase.ending(landed_by_us=landed_by_us)
        other = self._left is State.READY and context.authority.wrong_vehicle is not None
        refused = (
            other or context.authority.stopped_why is not None
        ) and self._phase.killed is None
        context.actions.append(Finish(landed_by_us, why, context.authority.taken_by, refused))

    # What others read.

    @property
    def flown(self) -> FlownBefore | None:
        """What another companion has to know to go on with this flight; None if there is none."""
        airborne_s = self.context.task.airborne_s
        if airborne_s is None or self.state is State.DONE:
            return None
        visited, _ = self.exploration.mark()
        return FlownBefore(airborne_s, visited, tuple(self.exploration.left_out))

    @property
    def state(self) -> State:
        """What the mission is doing."""
        return self.context.task.state

    @property
    def mission(self) -> Mission:
        """With the zones and fences of now."""
        return self.context.airspace.mission

    @property
    def router(self) -> Router:
        """Plans among these."""
        return self.context.airspace.router

    @property
    def telemetry(self) -> Telemetry | None:
        """What the vehicle reported last; None: nothing was received yet."""
        return self.context.telemetry

    @property
    def links(self) -> Sequence[LinkSample]:
        """The links of this flight that were measured."""
        return self.search.links.samples

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        return self.context.in_charge

    @property
    def may_be_taken(self) -> bool:
        """Whether its mode was not received for so long that a pilot may have the vehicle."""
        return self.context.silent_s > VEHICLE_SILENT_S or self.context.inputs.silent

    @property
    def ending_why(self) -> str | None:
        """Why the vehicle comes home or lands, once it does."""
        return self.context.ending_why

    def status(self) -> FlightStatus:
        """The flight as of now, without the links: those the node knows. Changes nothing."""
        context, goto = self.context, self.states.goto.goto_task
        airspace, targets = context.airspace, self.search.targets
        goes_to = context.task.state is State.GOTO and goto is not None
        return FlightStatus(
            time_s=context.now_s,
            state=context.task.state,
            robot=context.task.robot,
            targets={robot: self._target(targets.tracks[robot]) for robot in targets.names},
            left_s=context.left_s,
            goal=context.task.way.goal,
            legs=context.task.way.ahead,
            points_left=len(goto.stops) - goto.done if goes_to and goto is not None else 0,
            waypoints_left=self.exploration.remaining,
            no_way_home=self.states.reachability.no_way_home,
            interlocks=tuple([row.name for row in raised(context)]),
            waiting=self._waiting(),
            refusals=self._shown_commands.refusals(),
            alarms=context.alarms.shown,
            need_home=self.returns.need_home,
            in_charge=context.in_charge,
            plan_owner=context.authority.on_board,
            airspace=AirspaceStatus(
                airspace.revision,
                len(airspace.mission.zones) - len(airspace.mission.idle_zones),
                airspace.change,
            ),
            silent_s=context.silent_s,
            missing_inputs=tuple(context.inputs.stopped),
            telemetry=context.telemetry,
        )

    def _target(self, track: TargetTrack) -> TargetStatus:
        if track.pose is None:
            return TargetStatus()
        age_s = self.context.now_s - track.ours_s(track.pose.stamp_s)
        return TargetStatus(track.pose.position, max(age_s, 0.0))

    # What carries its decisions out asks, and tells, in between.

    @property
    def pending(self) -> Motion | None:
        """What was commanded and is not confirmed yet."""
        return self.gate.pending

    @property
    def our_modes(self) -> frozenset[FlightMode]:
        """In which flight modes the vehicle is by our commands."""
        return self.gate.modes

    @property
    def ended_modes(self) -> frozenset[FlightMode]:
        """The flight modes that the pending motion may end: no others, a pilot has chosen them."""
        return self.gate.ends

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion decided a moment ago must not be commanded any more; None: it may."""
        return self.navigator.objection(motion, now_s)

    def why_not_started(self, before: Telemetry, *, armed: bool) -> str | None:
        """What a pilot or ground station has done with a vehicle that we were to start."""
        return self.states.ready.why_not_started(before, armed=armed)

    @property
    def reaction_s(self) -> float:
        """How long a command takes to the vehicle at most, on its clock."""
        return self.gate.reaction_s

    def reacts_within(self, reaction_s: float) -> None:
        """A command takes at most so long to the vehicle, on its clock, from now on."""
        self.gate.reacts_within(reaction_s)

    def home_by(self, now_s: float) -> None:
        """Come home at this time on the vehicle's clock: the zones may be others later."""
        self.context.task.come_home_by(now_s)

    @property
    def plan_is_ours(self) -> bool:
        """Whether the plan on board is this mission's, as far as is known."""
        return self.context.authority.on_board is OnBoard.OURS

    def why_no_upload(self) -> str | None:
        """Why nothing may be put on board any more; None: it may."""
        return self.airspace_update.objection()

    @property
    def all_zones(self) -> bool:
        """Whether every zone is to count whatever its height: the altitude is in doubt."""
        return self.airspace_update.all_zones

    @property
    def replans(self) -> bool:
        """Whether a router among the zones as they count now is waited for."""
        return self.airspace_update.replans

    def prepare(self, router: Router) -> None:
        """Use this router, made elsewhere, for the zones that come next, if it is among them."""
        self.airspace_update.prepare(router)
