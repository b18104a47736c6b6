"""Whether zones leave the vehicle a way home, and what is said where they leave none. Pure.

A mission is only flown where home can be reached from everywhere; zones that are drawn in flight
may change that. Nothing is flown through them then: the operator is told until one acts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from air_router.controller.model.mission_context import MissionContext
from air_router.mission.flight_plan import HOME_NODE
from air_router.mission.mission import Mission
from air_router.routing.departure import names_of
from air_router.routing.router import Route
from air_router.vehicle.vehicle import Telemetry
from geo.paths.regions import Regions

LOOK_S: Final = 5.0
"""How often it is looked whether there is a way; at once after zones have changed."""

TOLD_S: Final = 30.0
"""How often it is told again that there is none."""

_NAMED: Final = 3
"""So many walls are named; more would not be read in the air."""


@dataclass(slots=True, eq=False)
class HomeReachability:
    """Looks for the way home among the zones of now.

    Attributes:
        walls: The zones (and the fence) between the vehicle and home; None while a way is clear.
    """

    _context: MissionContext
    walls: tuple[str, ...] | None = None
    _among: Mission | None = None
    _look_at_s: float = -math.inf
    _tell_at_s: float = -math.inf
    _due: bool = False

    def look(self, telemetry: Telemetry, *, due: bool) -> str | None:
        """What to say now, if anything.

        Args:
            telemetry: where the vehicle is, in the air.
            due: it should be on its way home.
        """
        if self._among is not self._context.mission:
            self._among = self._context.mission
            self._look_at_s = self._tell_at_s = -math.inf
        if telemetry.time_s >= self._look_at_s:
            before = self.walls
            self._look(telemetry)
            if before is not None and self.walls is None:
                self._tell_at_s = -math.inf
                return "a clear way leads home again"
        if self.walls is None:
            return None
        if telemetry.time_s < self._tell_at_s and due == self._due:
            return None
        self._tell_at_s, self._due = telemetry.time_s + TOLD_S, due
        return self._words(telemetry, due=due)

    def _look(self, telemetry: Telemetry) -> None:
        mission, router = self._context.mission, self._context.router
        here, home = telemetry.position, mission.home
        if mission.airspace_at(telemetry.altitude_m).holders(here):
            return  # it leaves that first
        self._look_at_s = telemetry.time_s + LOOK_S
        paths = router.graph.paths
        place = paths.nearest(here)
        if place is not None and paths.connected(home, place):
            self.walls = None
        elif isinstance(router.route(here, HOME_NODE), Route):
            self.walls = None  # by a tight way out
        elif place is None:
            self.walls = ()
        else:
            airspace = mission.planning_airspace
            walls = Regions(airspace).separators(place, home)
            self.walls = walls or airspace.blockers(place, home)  # where home itself is not clear

    def _words(self, telemetry: Telemetry, *, due: bool) -> str:
        walls = self.walls or ()
        named = names_of(walls[::-1][:_NAMED]) or "zones"  # the newest are last
        more = f" and {len(walls) - _NAMED} more" if len(walls) > _NAMED else ""
        charge = "" if telemetry.battery is None else f" (battery at {telemetry.battery:.0%})"
        if not due:
            return (
                f"walled in{charge}: no clear way home past {named}{more}; take a zone away and "
                "reload, or fly it out by hand"
            )
        return (
            f"walled in{charge}: it should come home and cannot, for {named}{more}; it hovers "
            "until a zone is taken away, a pilot flies it out, or the autopilot's battery "
            "failsafe acts, which may fly through zones"
        )
