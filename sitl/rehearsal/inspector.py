"""An operator who has the vehicle inspect everything, and a station that moves its fence."""

from __future__ import annotations

import math
from typing import Final

import shapely

from sitl.px4sim import FlightMode
from sitl.rehearsal.fakes import StreamFault, Way
from sitl.rehearsal.judge import Pair, RawMission, SceneEventKind, open_space
from sitl.rehearsal.operator import FAST_M_S, Operator
from sitl.rehearsal.requests import goto
from sitl.rehearsal.scenario import Scenario

_BESIDE_M: Final = 0.8
"""So much farther than routes keep from an area its corners are passed."""

_INSIDE_M: Final = 1.5
"""So much nearer than the clearance a place is that it may not hover at."""

_WITHIN_M: Final = 0.3
_TRIES: Final = 60
_HOLD_S: Final = 0.5
_STARTS_M: Final = 1.0


class Inspector:
    """Sends the vehicle of a flight where its ways would not lead.

    Args:
        flight: Where.
        operator: Who sends the requests.
    """

    def __init__(self, flight: Scenario, operator: Operator) -> None:
        self._flight, self._operator = flight, operator
        self._rng = flight.scene.chance("inspector")
        self._robots = ("callisto", "europa", "io")

    # Past everything

    def do_pass(self, what: tuple[int, float]) -> None:
        """Send it along one area: from one side, around it, to the other, or too near to it."""
        turn, share = what
        mission = self._mission
        areas = list(mission.cruised)
        area = areas[turn % len(areas)]
        open_m = open_space(mission.cruised, mission.tracking_margin_m + _BESIDE_M)
        kept_m = area.clearance_m + mission.tracking_margin_m + _BESIDE_M
        around = area.border.buffer(kept_m).boundary.intersection(open_m.buffer(0.05))
        if around.is_empty:
            return
        points = [shapely.Point(place) for place in shapely.get_coordinates(around)]
        points.sort(key=shapely.Point(self._operator.here).distance)
        first = points[int(share * len(points)) // 3]
        second = max(points, key=first.distance)
        # And a place that it may not hover at: within the margin, or nearer than the clearance.
        within_m = _WITHIN_M if turn % 3 else -_INSIDE_M
        line = shapely.shortest_line(area.border, first)
        places = [line.interpolate(max(area.clearance_m + within_m, 0.2)), first, second]
        self._send([(place.x, place.y) for place in places])

    def _send(self, places: list[Pair]) -> None:
        if self._operator.ours:
            points = map(self._operator.point, places)
            self._operator.do_request(goto(self._flight.mission, points), _HOLD_S)

    # Old positions

    def do_stale_corner(self, age_s: float) -> None:
        """Send it around a corner when its position has not come for so long."""
        self._operator.do_request("hold")
        operator, flight = self._operator, self._flight

        def set_out() -> bool:
            space = operator.space
            turn = space.turn(operator.here, space.mission.speed_m_s, 0.0, self._rng)
            if turn is None:
                return True
            self._send([turn.towards])
            speed_m_s = space.mission.speed_m_s

            def lose() -> bool:
                left_m = math.dist(operator.here, turn.at)
                fast = math.hypot(*operator.velocity_m_s) > FAST_M_S
                if left_m > speed_m_s * age_s + _STARTS_M or not (fast and operator.ours):
                    return False
                until_s = flight.now_s + age_s + 0.3
                flight.link.trouble(Way.DOWN, "GLOBAL_POSITION_INT", StreamFault.LOST, until_s)
                operator.later(age_s, lambda: self._turn(turn.off_to))
                return True

            operator.wait_for(lose)
            return True

        operator.later(4.0, set_out)

    def _turn(self, place: Pair) -> bool:
        self._send([place])
        return True

    # Heights

    def do_over_low(self, _: object) -> None:
        """Send it over a zone that ends below all that it flies at; or over any waypoint."""
        mission = self._mission
        low_m = mission.cruise_m[0]
        low = [zone for zone in mission.zones if zone.upper_m < low_m and zone.radius_m]
        if low:
            place = self._rng.choice(low).outline.centroid
            off_m = self._rng.choice((0.0, 0.0, 6.0, 14.0))
            self._send([(place.x + off_m, place.y)])

    def do_to_other_home(self, _: object) -> None:
        """Send it over the other UAV's home, or beside it."""
        if self._mission.others:
            place = self._mission.others[0][0]
            self._send([(place[0] + self._rng.choice((0.0, 8.0, 16.0)), place[1])])

    def do_low_away(self, on_m: float) -> None:
        """The pilot has it fly on to a place so far away, as low as it is."""
        autopilot, operator = self._flight.autopilot, self._operator
        if not (operator.pilot and operator.flies):
            return
        here, rng = operator.here, self._rng
        mission = self._mission
        low = (area for area in mission.areas if area.lower_m <= mission.cruise_m[1])
        clear = open_space(low, mission.tracking_margin_m + _BESIDE_M)
        for _ in range(_TRIES):
            turn = rng.uniform(0.0, 2 * math.pi)
            off = on_m * math.sin(turn), on_m * math.cos(turn)
            way = shapely.LineString([here, (here[0] + off[0], here[1] + off[1])])
            if clear.covers(way):
                situation = autopilot.situation
                self._flight.stations.first.choose(FlightMode.AUTO_LOITER)
                place = situation.north_m + off[1], situation.east_m + off[0]
                autopilot.reposition(place, None)
                return

    def do_resume_on_the_way(self, _: object) -> None:
        """Request it while it moves."""
        operator = self._operator

        def resume() -> bool:
            fast = math.hypot(*operator.velocity_m_s) > FAST_M_S
            if fast and operator.pilot and operator.flies:
                operator.resume(after_s=0.0)
                return True
            return False

        operator.wait_for(resume)

    # Requests

    def do_request_verb(self, verb: str) -> None:
        """Send a request of this verb, its parameters at random."""
        rng, operator = self._rng, self._operator
        if operator.pilot:
            return
        match verb:
            case "seek":
                operator.do_request(f"seek {rng.choice(self._robots)}")
            case "goto":
                place = operator.space.in_sight(operator.here, rng)
                if place is not None:
                    operator.do_request(goto(self._flight.mission, [operator.point(place)]), 3.0)
            case "altitude":
                operator.do_request(f"altitude {rng.uniform(35.0, 50.0):.1f}")
            case _:
                operator.do_request(verb)

    # What is on board

    def do_move_fence(self, off_m: float) -> None:
        """A station stores a fence of as many points: one area of it is elsewhere."""
        if not self._operator.flies:
            return
        self._flight.stations.move_fence(off_m, self._rng)
        self._flight.happened(SceneEventKind.FENCE_CHANGED, "moved")

    @property
    def _mission(self) -> RawMission:
        return self._operator.space.mission
