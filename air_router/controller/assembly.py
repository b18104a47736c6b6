"""The parts of the controller, and what each of them is given."""

from __future__ import annotations

from collections.abc import Callable

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.command_handler import CommandHandler
from air_router.controller.control_authority import ControlAuthority
from air_router.controller.model.behaviour import Signal
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.monitor.deviations import Deviations
from air_router.controller.monitor.flight_phase import FlightPhase
from air_router.controller.monitor.home_reachability import HomeReachability
from air_router.controller.monitor.levelling import Levelling
from air_router.controller.monitor.safety_monitor import SafetyMonitor
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Navigator
from air_router.controller.preconditions import Preconditions
from air_router.controller.states.comm_state import CommState
from air_router.controller.states.explore_state import ExploreState
from air_router.controller.states.goto_state import GotoState
from air_router.controller.states.goto_task import GotoValidator
from air_router.controller.states.hold_state import HoldState
from air_router.controller.states.return_state import LandState, ReturnState
from air_router.controller.states.search_state import SearchState
from air_router.controller.targets.exploration import Exploration
from air_router.controller.targets.search_points import Search
from air_router.controller.telemetry_handler import TelemetryHandler
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.vehicle.input_limits import InputWatch


class Assembly:
    """Puts the parts together; none of them knows more of another than what it is given here.

    Args:
        mission, plan, router, seek, patient, explore, name: As of the `Controller`.
        signal: Tells the state machine that something has happened to the mission.

    Attributes:
        context: What all of them read, and how they are heard.
        gate: The one way to command the vehicle.
        exploration: Which waypoint is next.
        search: Whom to seek, and where.
        flight_phase: What has been seen of take-off and landing.
        reachability: Whether zones leave a way home.
        explore_state, search_state, comm_state, goto_state: What is flown in these states.
        hold_state, return_state, land_state: The same.
        levelling: Climbs first, where a vehicle that was taken over is low.
        authority: Whose the vehicle is.
        airspace_update: Zones that change.
        command_handler: Requests of the pilot, the operator and other programs.
        telemetry_handler: What each word of the vehicle leads to.
    """

    def __init__(  # noqa: PLR0913 - what a flight is decided with
        self,
        mission: Mission,
        plan: FlightPlan,
        router: Router,
        seek: tuple[str, ...],
        *,
        patient: bool,
        explore: bool,
        name: str,
        signal: Callable[[Signal], None],
    ) -> None:
        # What is known and kept.
        context = self.context = MissionContext(mission, router, signal)
        gate = self.gate = CommandGate(context, Navigator(mission, router), plan)
        self.exploration = Exploration(mission.waypoints)
        self.exploration.bar(mission.barred)  # of a flight that is gone on with
        self.search = Search(mission, seek, self.exploration, router, explore=explore)
        self.flight_phase = FlightPhase()
        self.reachability = HomeReachability(mission, router)
        self._judge = GotoValidator(mission, router, self.search)
        self._monitor = SafetyMonitor(mission, plan)
        self._deviations = Deviations(mission)
        inputs = InputWatch()
        # What is flown.
        to_explore = self.exploration if explore else None
        self.explore_state = ExploreState(context, gate, self.exploration, self.reachability)
        self.search_state = SearchState(context, gate, self.search, to_explore, name=name)
        self.comm_state = CommState(context, gate, self.search_state)
        self.goto_state = GotoState(context, gate)
        self.hold_state = HoldState(context, gate)
        self.return_state = ReturnState(context, gate, self.flight_phase, self.reachability)
        self.land_state = LandState(context, gate)
        # What else is decided.
        self.levelling = Levelling(context, gate)
        self.authority = ControlAuthority(context, gate, self.flight_phase, self.levelling)
        self.airspace_update = AirspaceUpdate(
            context, gate, self.exploration, self.authority, self.return_state, apply=self._apply
        )
        self.command_handler = CommandHandler(
            context,
            Preconditions(context, inputs, self.return_state, self.authority),
            self._judge,
            self.search,
            to_explore,
            search_state=self.search_state,
            goto_state=self.goto_state,
            return_state=self.return_state,
            authority=self.authority,
            airspace_update=self.airspace_update,
        )
        self.telemetry_handler = TelemetryHandler(
            context,
            gate,
            plan,
            self.exploration,
            flight_phase=self.flight_phase,
            monitor=self._monitor,
            deviations=self._deviations,
            inputs=inputs,
            authority=self.authority,
            return_state=self.return_state,
            airspace_update=self.airspace_update,
            levelling=self.levelling,
            command_handler=self.command_handler,
            patient=patient,
        )

    def _apply(self, mission: Mission, router: Router) -> None:
        """Other zones and fences count from now on: for every part that plans or monitors."""
        self.context.mission, self.context.router = mission, router
        self.gate.navigator.renew(mission, router)
        self.search.renew(mission, router)
        self.reachability.renew(mission, router)
        self.return_state.renew(mission, router)
        self._judge.renew(mission, router)
        self._monitor.renew(mission)
        self._deviations.renew(mission)
