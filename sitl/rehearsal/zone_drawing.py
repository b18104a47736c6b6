"""The operator of a rehearsed flight draws zones into the mission file, and has it read again.

Some are drawn at the worst moment: they wait for it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Final

from geo.frame import Point
from sitl.px4sim import FlightMode
from sitl.rehearsal.faults import Fault
from sitl.rehearsal.judge import SceneEventKind
from sitl.rehearsal.mission_file import SIDES
from sitl.rehearsal.operator import FAST_M_S, Operator
from sitl.rehearsal.scenario import Scenario

_READ_S: Final = 4.0
"""What reading a changed file may take."""

_ABOVE_M, _BELOW_M, _CLIMBS_M_S = 8.0, 8.0, 0.5
_HOMEWARD_M, _FAR_M = 9.0, 55.0
"""Zones begin, or end, so far above or below a vehicle that climbs or lands."""

_LANDING_M: Final = 15.0
"""Lower than this a landing is nearly over."""

_STOPS_M: Final = 13.0
"""A vehicle of 5 m/s stops within it."""


class ZoneDrawing:
    """Draws zones of a flight, one change at a time; what is not taken is taken out again.

    Args:
        flight: Where.
        operator: Who draws, requests a reload, and waits for moments.
        rng: Of the flight; drawings at the worst moment have a generator of their own.
    """

    def __init__(self, flight: Scenario, operator: Operator, rng: random.Random) -> None:
        self._flight, self._operator = flight, operator
        self._rng, self._haste = rng, operator.haste
        self._reading: tuple[float, object] | None = None  # until when; zones before

    def step(self, now_s: float) -> None:
        """Whether the changed file was taken; what was not is taken out of it again."""
        if self._reading is None:
            return
        until_s, zones = self._reading
        known, file = self._zones_flown_by, self._flight.file
        if known is not None and known != zones:
            self._flight.happened(SceneEventKind.MISSION_FILE, file.text)
        elif known is not None and now_s < until_s:
            return
        else:
            self._flight.happened(SceneEventKind.FILE_LEFT, (until_s - _READ_S, file.text))
            file.undo()
        self._reading = None

    def do_reload(self, ahead_m: float) -> None:
        """The operator draws a zone near the vehicle, or over it, and has the file read again."""
        east_m_s, north_m_s = self._operator.velocity_m_s
        course_rad = math.atan2(east_m_s, north_m_s) + self._rng.uniform(-0.5, 0.5)
        place = self._flight.place
        east_m = place.east_m + ahead_m * math.sin(course_rad)
        north_m = place.north_m + ahead_m * math.cos(course_rad)
        self._draw_circle(Point(east_m, north_m), self._rng.uniform(4.0, 12.0))

    def do_zone_across(self, spare_m: float) -> None:
        """Draw a zone across its way, so far beyond where it can stop."""

        def draw() -> bool:
            east_m_s, north_m_s = self._operator.velocity_m_s
            speed_m_s = math.hypot(east_m_s, north_m_s)
            if speed_m_s < FAST_M_S or not self._operator.ours:
                return False
            radius_m = self._haste.uniform(5.0, 10.0)
            ahead_m = _STOPS_M + self._operator.space.mission.clearance_m + spare_m + radius_m
            here, share = self._operator.here, ahead_m / speed_m_s
            centre = (here[0] + share * east_m_s, here[1] + share * north_m_s)
            self._draw_circle(self._operator.point(centre), radius_m)
            return True

        self._operator.wait_for(draw)

    def do_zone_over(self, deep_m: float) -> None:
        """Draw a zone over it, and over the way to where it was sent last."""
        if self._operator.sent is None:
            return
        here, sent, radius_m = self._operator.here, self._operator.sent, 10.0
        share = (radius_m - deep_m) / math.dist(here, sent)
        east_m, north_m = (a + share * (b - a) for a, b in zip(here, sent, strict=True))
        self._draw_circle(self._operator.point((east_m, north_m)), radius_m)

    def do_zone_below(self, radius_m: float) -> None:
        """Draw a zone below it as it lands where requested."""

        def draw() -> bool:
            below_m = self._above_m - _BELOW_M
            lands = self._flight.autopilot.mode is FlightMode.AUTO_LAND and self._operator.ours
            if not lands or below_m < _BELOW_M:
                return False
            self._draw_circle(self._flight.place, radius_m, upper_m=below_m)
            return True

        self._operator.wait_for(draw)

    def do_zone_above(self, radius_m: float) -> None:
        """Draw a zone above it as it climbs where it was given back low."""

        def draw() -> bool:
            above_m = self._above_m + _ABOVE_M
            level_m = self._flight.mission.altitude_above_home_m
            climbs = self._flight.autopilot.situation.velocity_m_s[2] > _CLIMBS_M_S
            if not (climbs and self._operator.ours) or above_m > level_m - _ABOVE_M:
                return False
            self._draw_circle(self._flight.place, radius_m, lower_m=above_m)
            return True

        self._operator.wait_for(draw)

    def do_zone_at(self, what: tuple[str, str]) -> None:
        """Draw a zone over it at a moment: below it, above it, around its height, or at any."""
        moment, kind = what

        def draw() -> bool:
            if not self._operator.ours or not self._is_at(moment):
                return False
            above_m = self._above_m
            limits_m = {
                "below": {"upper_m": above_m - _BELOW_M},
                "above": {"lower_m": above_m + _ABOVE_M},
                "around": {"lower_m": above_m - _BELOW_M, "upper_m": above_m + _ABOVE_M},
                "across": {},
            }
            radius_m = self._operator.haste.uniform(9.0, 13.0)
            self._draw_circle(self._flight.place, radius_m, **limits_m[kind])
            return True

        self._operator.wait_for(draw)

    def _is_at(self, moment: str) -> bool:
        """Whether the vehicle does what a moment is named by."""
        above_m, autopilot = self._above_m, self._flight.autopilot
        speed_m_s = math.hypot(*self._operator.velocity_m_s)
        level_m = self._flight.mission.altitude_above_home_m
        match moment:
            case "climb":
                climbs = autopilot.situation.velocity_m_s[2] > _CLIMBS_M_S
                return climbs and above_m < level_m - 2 * _ABOVE_M
            case "hold":
                return speed_m_s < _CLIMBS_M_S
            case "descent" | "landing":
                low_m = _LANDING_M if moment == "landing" else level_m - _BELOW_M
                return autopilot.mode is FlightMode.AUTO_LAND and above_m < low_m
        return speed_m_s > FAST_M_S

    def do_zone_beyond(self, away_m: float) -> None:
        """Draw a zone so far away that applies just above where it cruises."""
        place, above_m = self._flight.place, self._flight.mission.altitude_above_home_m + _ABOVE_M
        self._draw_circle(Point(place.east_m, place.north_m + away_m), 5.0, lower_m=above_m)

    def do_zone_homeward(self, kind: str) -> None:
        """Draw a zone halfway home that ends below where it cruises, or begins above."""

        def draw() -> bool:
            here, level_m = self._operator.here, self._flight.mission.altitude_above_home_m
            if math.hypot(*here) < 4 * _HOMEWARD_M:
                return False
            above = {"lower_m": level_m + _ABOVE_M}
            limits_m = above if kind == "above" else {"upper_m": level_m - _BELOW_M}
            centre = self._operator.point((here[0] / 2, here[1] / 2))
            self._draw_circle(centre, _HOMEWARD_M, **limits_m)
            return True

        self._operator.wait_for(draw)

    def do_wall(self, *sides: int) -> None:
        """The operator walls the vehicle in, zone by zone."""
        file, place = self._flight.file, self._flight.place
        self.change(lambda: file.wall(place, sides))

    def do_enclose(self, _: None) -> None:
        """Draw all four walls at once."""
        self.do_wall(*SIDES)

    def do_enclose_above(self, _: None) -> None:
        """Draw all four walls at once, which begin above where it cruises, and have it hold."""
        file, above_m = self._flight.file, self._flight.mission.altitude_above_home_m + _ABOVE_M

        def draw() -> bool:
            if math.hypot(*self._operator.here) < _FAR_M or self._reading is not None:
                return False
            self.change(lambda: file.wall(self._flight.place, SIDES, lower_m=above_m))
            self._operator.do_request("hold")
            return True

        self._operator.wait_for(draw)

    def do_open(self, _: None) -> None:
        """Take the last wall away."""
        self.change(self._flight.file.open)

    def _draw_circle(self, centre: Point, radius_m: float, **limits_m: float) -> None:
        self.change(lambda: self._flight.file.circle(centre, radius_m, **limits_m))

    def counts(self) -> None:
        """What is in the file now is what is to be flown by: it is read when it is next begun."""
        self._flight.happened(SceneEventKind.MISSION_FILE, self._flight.file.text)

    def change(self, draw: Callable[[], bool]) -> None:
        """Draw into the file, and have it read again; one change at a time."""
        zones = self._zones_flown_by
        waits = self._flight.scene.fault is Fault.BY_HAND and not self._flight.autopilot.armed
        if zones is None or not (self._operator.flies or waits) or self._reading is not None:
            return
        if draw():
            self._reading = (self._flight.now_s + _READ_S, zones)
            self._operator.do_request("reload")

    @property
    def _zones_flown_by(self) -> object:
        """The fences and zones that the companion knows; None: there is no companion."""
        companion = self._flight.companion
        if companion is None:
            return None
        mission = companion.flight.controller.mission
        return mission.fences, mission.zones

    @property
    def _above_m(self) -> float:
        """How high it is above home."""
        autopilot = self._flight.autopilot
        amsl_m = autopilot.place.altitude_m + autopilot.airframe.up_m
        return float(amsl_m - autopilot.situation.home_altitude_m)
