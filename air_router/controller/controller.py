"""The mission controller: takes events with the vehicle's time, returns actions.

Pure: no sockets, no clocks, no files. The same controller flies a real PX4, the simulated PX4, and
the discrete-event world. A recorded flight replays to the same decisions.

Each telemetry update is handled by its most severe finding. Who commands the vehicle comes first: a
pilot or a failsafe that has taken it or is taking it. Then come the faults of the flight, and last
the mission. `states.table.STATES` decides when the mission explores, searches and exchanges data.
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
    Anomaly,
    AnyRequest,
    CommandConfirmed,
    CommandFailed,
    CompanionLagged,
    Event,
    Finish,
    FlightSetup,
    FlownBefore,
    FlyToNode,
    MissionContext,
    MissionWaits,
    Motion,
    PeerFault,
    PlanOwner,
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
        setup: The mission to fly, and how.
        router: Plans routes over the mission's graph; None: a new one.
        plan: The plan on board, for the autopilot's item numbers; None: a new one.
        policy: Chooses the next robot; None: the mission's policy.
        waypoints: Waypoints to explore, in this order; None: the mission's waypoints, once.
        ground: The vehicle's map, for seek policies; its owner updates it.

    Other rooms use the methods only; the attributes are for this room's tests.

    Attributes:
        context: State of the flight.
        gate: Sends motions, and keeps the last one sent.
        navigator: Flies the vehicle to one goal at a time.
        exploration: Chooses the next waypoint.
        search: Chooses the next robot and where to seek it.
        states: The handler of each state.
        returns: Decides when the vehicle comes home.
        airspace_update: Changes zones in flight.
    """

    def __init__(  # noqa: PLR0913 - optional parts of a flight
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
        plan = plan if plan is not None else FlightPlan.of(mission)
        self._plan = plan  # knows the nodes of the autopilot's items
        self._transitions = transitions(explores=explore)  # the next state by signal
        self._left = State.READY  # the state before this one
        self._announced_sought: str | None = None  # the robot in the last `Seeking`
        self._recorded_wait: Interlock | None = None  # the row in the last `MissionWaits`
        # The state of the flight, and the parts that act on it.
        task = Task(spec=STATES[State.READY])
        context = self.context = MissionContext(mission, router, self._signal, task=task)
        gate = self.gate = CommandGate(context, plan)  # every motion passes it
        navigator = self.navigator = Navigator(context, gate)
        # A resumed flight may have skipped some waypoints already.
        explored = mission.waypoints if waypoints is None else waypoints
        exploration = self.exploration = Exploration(explored, mission.skipped)
        self.search = Search(context, navigator, setup, exploration, policy, ground=ground)
        states = self.states = StateHandlers(context, gate, navigator, self.search)
        # Monitors, in the order in which they run.
        self._phase = FlightPhase(context, gate)  # why the flight has ended, too
        home = HomeWatch(context)
        monitor = SafetyMonitor(context, gate, plan)
        envelope = Envelope(context, gate, home)
        self.returns = ReturnMonitor(context, states.reachability)
        standstill = Standstill(context)
        lag = LagMonitor(context)
        deviations = Deviations(context, gate, self.returns, lag, envelope)
        authority = ControlAuthority(context, gate, navigator, monitor)
        self._authority = authority  # releases the vehicle, and ends a silence
        self.airspace_update = AirspaceUpdate(context, gate, navigator, exploration, self.returns)
        commands = CommandHandler(
            context,
            self.returns,
            authority,
            GotoValidator(context, navigator, gate),
            states,
            self.airspace_update,
            standstill,
        )
        self._commands = commands  # handles requests; keeps the deferred one
        # Displays must not change the flight, so they use a separate monitor.
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
        self._vehicle = vehicle  # stores telemetry, and responds to it
        # The handler of each event; other events (links between peers, metrics) are only recorded.
        self._reactions: dict[type, Callable[[Any], Wanted | None]] = {
            Telemetry: vehicle.received,
            ItemReached: self._item_reached,
            LinkSilent: authority.link_silent,
            CommandConfirmed: self._confirmed,
            CommandFailed: self._failed,
            RobotPose: states.search.pose_received,
            RobotPath: states.search.path_received,
            RobotSought: states.search.sought_by_other,
            ContactBegan: states.search.radio_received,
            ContactEnded: states.search.radio_received,
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
            **dict.fromkeys(get_args(AnyRequest), commands.handle),
        }

    def handle(self, event: Event, now_s: float) -> list[Action]:
        """Handle one event at vehicle time `now_s`; return the actions, in order."""
        context = self.context
        context.begin(now_s)
        self._commands.expire_deferred()
        if isinstance(event, Telemetry):
            event = self._vehicle.store(event)
        if context.silent_s > 0.0 and not self._authority.link_restored(event):
            return context.actions
        reaction = self._reactions.get(type(event))
        wanted = None if reaction is None else reaction(event)
        if wanted is not None:
            self.navigator.follow(wanted)
        context.actions.extend(context.alarms.due(context.now_s))
        sought = context.task.robot if context.task.spec.seeks else None
        if sought != self._announced_sought:
            self._announced_sought = sought
            context.actions.append(Seeking(sought))
        self._record_waiting()
        return context.actions

    def _record_waiting(self) -> None:
        """Record which row of `INTERLOCKS` blocks the mission, when that changes."""
        blocked = self.gate.waits_for()
        row = None if blocked is None else blocked.by
        if row is self._recorded_wait:
            return
        self._recorded_wait = row
        self.context.actions.append(self._waiting() or MissionWaits(None))

    def _waiting(self) -> MissionWaits | None:
        """The interlock that blocks the mission, as data; None: none does."""
        blocked = self.gate.waits_for()
        if blocked is None:
            return None
        return MissionWaits(blocked.by.name, blocked.why(self.context), blocked.since_s)

    # Outcomes of commands.

    def _item_reached(self, event: ItemReached) -> None:
        """Handle PX4's report of a reached item, which may be the end of the current leg."""
        context = self.context
        waits = context.airspace.change is not None or context.interlocks.is_raised(*Anomaly)
        if context.telemetry is None or not context.in_charge or waits:
            return
        if isinstance(self.gate.pending, FlyToNode):
            return  # the jump is not confirmed, so this may be the previous node
        node = self._plan.node_of(event.item)
        self.navigator.advance(self.navigator.update(context.telemetry, reached_node=node))

    def _confirmed(self, event: CommandConfirmed) -> None:
        """Handle a confirmed command; a confirmed hold may complete a release."""
        self.gate.confirmed(event)
        self._authority.check()

    def _failed(self, event: CommandFailed) -> None:
        """Handle a command without effect, perhaps because a pilot chose another mode."""
        telemetry = self.context.telemetry
        ours = event.action is self.gate.pending and self.context.in_charge
        if event.taken is None or telemetry is None or not ours:
            self.gate.failed(event)
        else:
            taken = replace(telemetry, mode=event.taken)
            self._authority.taken(taken, crossed=event.sent)

    # State transitions.

    def _signal(self, signal: Signal) -> None:
        """Enter the next state for a signal; a state may follow itself."""
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
            self._stop_commanding()
        self.navigator.follow(handler.begin())

    def _flown_before(self, event: FlownBefore) -> None:
        self.context.task.fly_since(event.airborne_s)
        self.exploration.restore(event.visited, event.left_out)

    def _stop_commanding(self) -> None:
        """Hands off, or the end of the flight."""
        context = self.context
        done = context.task.state is State.DONE
        context.authority.clear_pending()
        context.alarms.end_all()
        if done:
            self.gate.stop()
        self._commands.handle_deferred()
        if not done:
            context.authority.end_stop()
            self.gate.forget_commands()
            return
        landed_by_us = self._left is State.LAND
        why = self._phase.ending(landed_by_us=landed_by_us)
        other = self._left is State.READY and context.authority.wrong_vehicle is not None
        refused = (
            other or context.authority.stopped_why is not None
        ) and self._phase.killed is None
        context.actions.append(Finish(landed_by_us, why, context.authority.taken_by, refused))

    # What other rooms read.

    @property
    def seek_fault(self) -> str | None:
        """The fault of a seek policy from another package; None: no fault."""
        return self.search.fault

    @property
    def flown(self) -> FlownBefore | None:
        """The data that `--resume` needs; None before take-off and after the flight."""
        airborne_s = self.context.task.airborne_s
        if airborne_s is None or self.state is State.DONE:
            return None
        visited, _ = self.exploration.mark()
        return FlownBefore(airborne_s, visited, tuple(self.exploration.left_out))

    @property
    def state(self) -> State:
        """The state of the mission."""
        return self.context.task.state

    @property
    def mission(self) -> Mission:
        """The mission with the current zones and fences."""
        return self.context.airspace.mission

    @property
    def router(self) -> Router:
        """Plans routes among the current zones and fences."""
        return self.context.airspace.router

    @property
    def telemetry(self) -> Telemetry | None:
        """The latest telemetry; None before the first."""
        return self.context.telemetry

    @property
    def links(self) -> Sequence[LinkSample]:
        """The links measured in this flight."""
        return self.search.links.samples

    @property
    def in_charge(self) -> bool:
        """Whether this program commands the vehicle in the air."""
        return self.context.in_charge

    @property
    def may_be_taken(self) -> bool:
        """Whether the flight mode has been missing for so long that a pilot may have taken over."""
        return self.context.silent_s > VEHICLE_SILENT_S or self.context.inputs.silent

    @property
    def ending_why(self) -> str | None:
        """Why the vehicle comes home or lands; None if it does neither."""
        return self.context.ending_why

    def status(self) -> FlightStatus:
        """The current status of the flight, without the node's links. Changes nothing."""
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
            points_left=goto.left if goes_to and goto is not None else 0,
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

    # For the flight loop, which executes the actions.

    @property
    def pending(self) -> Motion | None:
        """The motion that is commanded but not confirmed yet."""
        return self.gate.pending

    @property
    def our_modes(self) -> frozenset[FlightMode]:
        """The flight modes that our commands lead to."""
        return self.gate.modes

    @property
    def ended_modes(self) -> frozenset[FlightMode]:
        """The flight modes that the pending motion may end; a pilot has chosen any other."""
        return self.gate.ends

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion decided earlier must not be sent anymore; None if it may."""
        return self.navigator.objection(motion, now_s)

    def why_not_started(self, before: Telemetry, *, armed: bool) -> str | None:
        """Why take-off must not be commanded (a pilot or ground station intervened), or None."""
        return self.states.ready.why_not_started(before, armed=armed)

    @property
    def reaction_s(self) -> float:
        """The longest delay of a command to the vehicle, on its clock."""
        return self.gate.reaction_s

    def reacts_within(self, reaction_s: float) -> None:
        """Set the longest delay of a command to the vehicle, on its clock."""
        self.gate.reacts_within(reaction_s)

    def home_by(self, now_s: float) -> None:
        """Come home at this time on the vehicle's clock: other zones may apply later."""
        self.context.task.come_home_by(now_s)

    @property
    def plan_on_board(self) -> PlanOwner:
        """The owner of the plan on board, as far as known."""
        return self.context.authority.on_board

    def why_zones_stay(self) -> str | None:
        """Why changed zones are not applied now; None: they are."""
        return self.airspace_update.refusal

    def why_no_upload(self) -> str | None:
        """Why nothing may be uploaded anymore; None if it may."""
        return self.airspace_update.objection()

    @property
    def all_zones(self) -> bool:
        """Whether all zones apply at every altitude, because the altitude is in doubt."""
        return self.airspace_update.all_zones

    @property
    def replans(self) -> bool:
        """Whether the controller waits for a router with the zones that apply now."""
        return self.airspace_update.replans

    def prepare(self, router: Router) -> None:
        """Use this router, made elsewhere, for the next zones, if it was made for them."""
        self.airspace_update.prepare(router)
