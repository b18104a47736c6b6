"""What a controller is made of: enough to make the same one again from a record."""

from __future__ import annotations

from dataclasses import dataclass

from air_router.controller.controller import Controller
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router


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
