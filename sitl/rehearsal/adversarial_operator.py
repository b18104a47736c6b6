"""What a rehearsed operator does to a vehicle just when it matters: places and zones for it.

Worked out with the judge's reader of mission files, not with the code that flies.
"""

from __future__ import annotations

import functools
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from air_router.controller.model.requests import GoTo, HoldNow
from geo.frame import Point
from sitl.rehearsal.judge.mission_reader import Pair, RawMission, read_mission
from sitl.rehearsal.operator import Operator
from sitl.rehearsal.scenario import Scenario
from sitl.rehearsal.stand_ins.link import StreamFault, Way

BRAKING_M_S2, BRAKES_LATER_S = 3.0, 0.3
"""What a PX4 brakes with, and how much later: it builds that up with limited jerk."""

_MARGIN_M, _LEAVING_M = 1.7, 0.9
"""On top of the clearance: nearer places are refused; first legs nearer than the other are, too."""

_SHORT_M: Final = 1.3
"""So much less than the clearance a way keeps that the judge calls bad."""

_TRIES: Final = 120
_FAR_M: Final = 2000.0
FAST_M_S, SLOW_M_S = 3.5, 2.0
LOOKS_S: Final = 60.0
"""For so long a moment is waited for."""

STANDS_S: Final = 4.0
AT_M: Final = 1.0
STOPS_M: Final = 13.0
"""A vehicle of 5 m/s stops within it."""

_COMMANDS: Final = ("COMMAND_LONG", "COMMAND_INT", "MISSION_SET_CURRENT")

Moment = Callable[[], bool]
"""Does something if its moment has come; whether it had."""


class AdversarialOperator:
    """An operator who sends requests and draws zones at the worst moment.

    Args:
        scenario: Where.
        operator: Asks for it, and draws.
    """

    def __init__(self, scenario: Scenario, operator: Operator) -> None:
        self._scenario = scenario
        self._ask, self._change = operator.ask, operator.change
        self._dice = scenario.scene.chance("haste")
        self._waiting: list[tuple[float, Moment]] = []  # until when, and what to do
        self._sent: Pair | None = None  # where it was sent last, east and north

    def step(self, now_s: float) -> None:
        """Do what waits for a moment that has come."""
        waiting, self._waiting = self._waiting, []
        self._waiting += [
            (until_s, moment) for until_s, moment in waiting if now_s < until_s and not moment()
        ]

    def deaf(self, on: bool) -> None:
        """No command reaches the vehicle."""
        until_s = math.inf if on else self._scenario.now_s
        for name in _COMMANDS:
            self._scenario.link.trouble(Way.UP, name, StreamFault.LOST, until_s)

    def send(self, seconds: float) -> None:
        """Send it somewhere that it sees, some seconds after it was told to stop."""
        self._ask(HoldNow())
        self._at(seconds, self._send)

    def send_again(self, _: object = None) -> None:
        """Send it somewhere else that it sees."""
        self._send()

    def hold(self, _: object = None) -> None:
        """Have it hold."""
        self._ask(HoldNow())

    def across(self, spare_m: float) -> None:
        """Draw a zone across its way, so far beyond where it can stop."""

        def draw() -> bool:
            east_m_s, north_m_s = self._velocity_m_s
            speed_m_s = math.hypot(east_m_s, north_m_s)
            if speed_m_s < FAST_M_S or not self._ours:
                return False
            radius_m = self._dice.uniform(5.0, 10.0)
            ahead_m = STOPS_M + self._mission.clearance_m + spare_m + radius_m
            here = self._here
            share = ahead_m / speed_m_s
            self._draw((here[0] + share * east_m_s, here[1] + share * north_m_s), radius_m)
            return True

        self._wait_for(draw)

    def over(self, deep_m: float) -> None:
        """Draw a zone over it, and over the way to where it was sent last."""
        if self._sent is None:
            return
        here, radius_m = self._here, 10.0
        away_m = math.dist(here, self._sent)
        share = (radius_m - deep_m) / away_m
        east_m, north_m = (a + share * (b - a) for a, b in zip(here, self._sent, strict=True))
        self._draw((east_m, north_m), radius_m)

    def corner(self, brakes_s: float | None) -> None:
        """Send it somewhere, and on its way around a corner; so long after it began to brake."""
        self._ask(HoldNow())
        self._at(STANDS_S, lambda: self._set_out(brakes_s))

    def _set_out(self, brakes_s: float | None) -> bool:
        mission = self._mission
        turn = _sky(mission).turn(self._here, mission.speed_m_s, brakes_s or 0.0, self._dice)
        if turn is None:
            return True
        self._ask(GoTo((self._point(turn.towards),)))

        def turn_off() -> bool:
            speed_m_s = math.hypot(*self._velocity_m_s)
            if math.dist(self._here, turn.at) > AT_M or speed_m_s < FAST_M_S or not self._ours:
                return False
            if brakes_s is not None:
                self._ask(HoldNow())
            if brakes_s:
                self._at(brakes_s, self._around)
            else:
                self._ask(GoTo((self._point(turn.off_to),)))
            return True

        self._wait_for(turn_off)
        return True

    def _around(self) -> bool:
        """Send it around a corner while it brakes; what it was sent to before is forgotten."""
        velocity_m_s = self._velocity_m_s
        off_to = _sky(self._mission).around_a_corner(self._here, velocity_m_s, self._dice)
        if off_to is not None:
            self._ask(GoTo((self._point(off_to),)))
        return off_to is not None or math.hypot(*velocity_m_s) < SLOW_M_S

    def _send(self) -> bool:
        place = _sky(self._mission).in_sight(self._here, self._dice)
        if place is not None:
            self._sent = place
            self._ask(GoTo((self._point(place),)))
        return True

    # What it knows.

    @property
    def _ours(self) -> bool:
        companion = self._scenario.companion
        return companion is not None and companion.in_charge

    @property
    def _mission(self) -> RawMission:
        return _read(self._scenario.file.path, self._scenario.file.text)

    @property
    def _here(self) -> Pair:
        east, north = self._mission.frame.metres(
            *self._scenario.mission.frame.to_geodetic(self._scenario.place)
        )
        return float(east), float(north)

    @property
    def _velocity_m_s(self) -> Pair:
        airframe = self._scenario.autopilot.airframe
        return airframe.velocity_east_m_s, airframe.velocity_north_m_s

    def _point(self, place: Pair) -> Point:
        return self._scenario.mission.frame.to_local(*self._mission.frame.degrees(*place))

    def _draw(self, centre: Pair, radius_m: float) -> None:
        file, home, point = self._scenario.file, self._scenario.mission.home, self._point(centre)
        self._change(lambda: file.circle(point, radius_m, home))

    def _at(self, seconds: float, what: Moment) -> None:
        at_s = self._scenario.now_s + seconds
        self._waiting.append((math.inf, lambda: self._scenario.now_s >= at_s and what()))

    def _wait_for(self, moment: Moment) -> None:
        self._waiting.append((self._scenario.now_s + LOOKS_S, moment))


@functools.lru_cache(maxsize=4)
def _read(path: Path, text: str) -> RawMission:
    return read_mission(path, text, ground_amsl_m=0.0)


@functools.lru_cache(maxsize=4)
def _sky(mission: RawMission) -> FlyableSpace:
    return FlyableSpace(mission)


def rest(here: Pair, velocity_m_s: Pair) -> Pair:
    """Where a vehicle comes to rest that is told now to brake."""
    seconds = BRAKES_LATER_S + math.hypot(*velocity_m_s) / (2 * BRAKING_M_S2)
    return here[0] + velocity_m_s[0] * seconds, here[1] + velocity_m_s[1] * seconds


class Turn(NamedTuple):
    """A way to somewhere, a place on it, and where it is sent from there."""

    towards: Pair
    at: Pair
    off_to: Pair


class FlyableSpace:
    """Where ways may be flown, and where they are much too near: all zones count at any height."""

    def __init__(self, mission: RawMission) -> None:
        def kept(less_m: float) -> BaseGeometry:
            """What is left to fly in."""
            room = [f.polygon.buffer(less_m - f.clearance_m) for f in mission.fences]
            zones = [z.polygon.buffer(z.clearance_m - less_m) for z in mission.zones]
            everywhere = shapely.Point(0.0, 0.0).buffer(_FAR_M)
            return shapely.intersection_all([everywhere, *room]).difference(
                shapely.union_all(zones)
            )

        self._clear, self._leaving = kept(-_MARGIN_M), kept(-_LEAVING_M)  # of goals; of ways
        self._legal = kept(_SHORT_M)  # outside of it the judge calls a way bad
        shapely.prepare([self._clear, self._leaving, self._legal])

    def around_a_corner(self, here: Pair, velocity_m_s: Pair, dice: random.Random) -> Pair | None:
        """A place that is clear from here, and not from where it can stop; None: none found."""
        stands = rest(here, velocity_m_s)
        if not self._legal.covers(shapely.LineString([here, stands])):
            return None
        places = _around(here, dice, 6.0, 45.0)
        swept = shapely.polygons([[here, stands, place] for place in places])
        short = ~shapely.covers(self._legal, swept)
        return self._first(here, [p for p, is_short in zip(places, short, strict=True) if is_short])

    def turn(
        self, here: Pair, speed_m_s: float, brakes_s: float, dice: random.Random
    ) -> Turn | None:
        """A straight way, and a place on it where it is too fast for another; None: none found.

        Too fast, having braked for so long, with a jerk of 4 m/s3, since it was there.
        """
        left_m_s = speed_m_s - 2.0 * brakes_s**2
        for towards in _around(here, dice, 30.0, 70.0):
            if self._first(here, [towards]) is None:
                continue
            away_m = math.dist(here, towards)
            east, north = ((b - a) / away_m for a, b in zip(here, towards, strict=True))
            for along_m in range(12, int(away_m - 12.0), 4):
                at = here[0] + along_m * east, here[1] + along_m * north
                on_m = speed_m_s * brakes_s
                from_ = at[0] + on_m * east, at[1] + on_m * north
                off_to = self.around_a_corner(from_, (left_m_s * east, left_m_s * north), dice)
                if off_to is not None:
                    return Turn(towards, at, off_to)
        return None

    def in_sight(self, here: Pair, dice: random.Random) -> Pair | None:
        """A place that a straight way leads to; None: none found."""
        return self._first(here, _around(here, dice, 25.0, 60.0))

    def _first(self, here: Pair, places: list[Pair]) -> Pair | None:
        lines = (shapely.LineString([here, place]) for place in places)
        found = zip(places, lines, strict=True)
        clear, leaving = self._clear, self._leaving
        return next(
            (p for p, line in found if clear.covers(shapely.Point(p)) and leaving.covers(line)),
            None,
        )


def _around(here: Pair, dice: random.Random, least_m: float, most_m: float) -> list[Pair]:
    ways = [(dice.uniform(0.0, 2 * math.pi), dice.uniform(least_m, most_m)) for _ in range(_TRIES)]
    return [(here[0] + away * math.sin(a), here[1] + away * math.cos(a)) for a, away in ways]
