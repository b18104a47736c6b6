"""Who is aboard: the parts of the controller, and what each of them is given."""

from __future__ import annotations

from collections.abc import Callable

from air_router.controller.airspace_update import Renewal
from air_router.controller.command_handler import Answering
from air_router.controller.control_authority import Handing
from air_router.controller.model.behaviour import Signal
from air_router.controller.model.mission_context import Cockpit
from air_router.controller.monitor.deviations import Deviations
from air_router.controller.monitor.flight_phase import Launch
from air_router.controller.monitor.home_reachability import Enclosure
from air_router.controller.monitor.levelling import Levelling
from air_router.controller.monitor.safety_monitor import Watch
from air_router.controller.motion.command_gate import Helm
from air_router.controller.motion.navigator import Navigator
from air_router.controller.preconditions import Permission
from air_router.controller.states.comm_state import Meeting
from air_router.controller.states.explore_state import Exploring
from air_router.controller.states.goto_state import Errands
from air_router.controller.states.goto_task import Judge
from air_router.controller.states.hold_state import Hovering
from air_router.controller.states.return_state import Homecoming, Landing
from air_router.controller.states.search_state import Pursuit
from air_router.controller.targets.exploration import Exploration
from air_router.controller.targets.search_points import Search
from air_router.controller.telemetry_handler import Watchkeeper
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.vehicle.input_limits import InputWatch


class Crew:
    """Puts the parts together; none of them knows more of another than what it is given here.

    Args:
        mission, plan, router, seek, patient, explore, name: As of the `Controller`.
        signal: Tells the state machine that something has happened to the mission.

    Attributes:
        cockpit: What all of them read, and how they are heard.
        helm: The one way to command the vehicle.
        exploration: Which waypoint is next.
        search: Whom to seek, and where.
        launch: What has been seen of take-off and landing.
        enclosure: Whether zones leave a way home.
        exploring, pursuit, meeting, errands, hovering, homecoming, landing: What is flown.
        levelling: Climbs first, where a vehicle that was taken over is low.
        handing: Whose the vehicle is.
        renewal: Zones that change.
        answering: What somebody asks for.
        watchkeeper: What each word of the vehicle leads to.
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
        cockpit = self.cockpit = Cockpit(mission, router, signal)
        helm = self.helm = Helm(cockpit, Navigator(mission, router), plan)
        self.exploration = Exploration(mission.waypoints)
        self.exploration.bar(mission.barred)  # of a flight that is gone on with
        self.search = Search(mission, seek, self.exploration, router, explore=explore)
        self.launch = Launch()
        self.enclosure = Enclosure(mission, router)
        self._judge = Judge(mission, router, self.search)
        self._watch = Watch(mission, plan)
        self._deviations = Deviations(mission)
        inputs = InputWatch()
        # What is flown.
        to_explore = self.exploration if explore else None
        self.exploring = Exploring(cockpit, helm, self.exploration, self.enclosure)
        self.pursuit = Pursuit(cockpit, helm, self.search, to_explore, name=name)
        self.meeting = Meeting(cockpit, helm, self.pursuit)
        self.errands = Errands(cockpit, helm)
        self.hovering = Hovering(cockpit, helm)
        self.homecoming = Homecoming(cockpit, helm, self.launch, self.enclosure)
        self.landing = Landing(cockpit, helm)
        # What else is decided.
        self.levelling = Levelling(cockpit, helm)
        self.handing = Handing(cockpit, helm, self.launch, self.levelling)
        self.renewal = Renewal(
            cockpit, helm, self.exploration, self.handing, self.homecoming, heed=self._heed
        )
        self.answering = Answering(
            cockpit,
            Permission(cockpit, inputs, self.homecoming, self.handing),
            self._judge,
            self.search,
            to_explore,
            pursuit=self.pursuit,
            errands=self.errands,
            homecoming=self.homecoming,
            handing=self.handing,
            renewal=self.renewal,
        )
        self.watchkeeper = Watchkeeper(
            cockpit,
            helm,
            plan,
            self.exploration,
            launch=self.launch,
            watch=self._watch,
            deviations=self._deviations,
            inputs=inputs,
            handing=self.handing,
            homecoming=self.homecoming,
            renewal=self.renewal,
            levelling=self.levelling,
            answering=self.answering,
            patient=patient,
        )

    def _heed(self, mission: Mission, router: Router) -> None:
        """Other zones and fences count from now on: for everybody who plans or watches."""
        self.cockpit.mission, self.cockpit.router = mission, router
        self.helm.navigator.renew(mission, router)
        self.search.renew(mission, router)
        self.enclosure.renew(mission, router)
        self.homecoming.renew(mission, router)
        self._judge.renew(mission, router)
        self._watch.renew(mission)
        self._deviations.renew(mission)
