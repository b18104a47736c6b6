"""The operator of a rehearsed flight: asks for things, and draws into the mission file."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Final

from air_router.controller.model.requests import (
    AnyRequest,
    ComeHome,
    ExploreNow,
    GoOn,
    GoTo,
    HoldNow,
    Reload,
    SeekNow,
)
from air_router.mission.mission import Mission
from geo.frame import Point
from sitl.rehearsal.judge.evidence import SceneEventKind
from sitl.rehearsal.scenario import Scenario

_RESUME_S: Final = 2.0
"""So often an operator asks for what was refused."""

_PATIENCE_S: Final = 60.0
_READ_S: Final = 4.0
"""What reading a changed file may take."""

_VERBS: Final = {
    "GoOn": "resume",
    "HoldNow": "hold",
    "ComeHome": "home",
    "SeekNow": "seek",
    "ExploreNow": "explore",
    "GoTo": "goto",
    "Reload": "reload",
}

_ROBOTS: Final = ("callisto", "europa", "io", "phantom")
_HOLD, _GO_ON, _SEEK, _EXPLORE, _HOME = 0.2, 0.4, 0.55, 0.65, 0.69
_BESIDE_M: Final = 40.0


class Operator:
    """Asks the companion of a scenario.

    Args:
        scenario: Where.
        dice: Of the script.

    Attributes:
        pilot: Whether a pilot or station has taken the vehicle, which is left to them.
    """

    def __init__(self, scenario: Scenario, dice: random.Random) -> None:
        self._scenario = scenario
        self._dice = dice
        self._resumes_s = self._resumes_until_s = math.inf  # asked next, given up at
        self._upload = False  # our plan is wanted on board, too
        self._reading: tuple[float, int] | None = None  # patience's end; how many zones before
        self.pilot = False

    @property
    def asks_on(self) -> bool:
        """Whether it goes on asking for the vehicle."""
        return self._resumes_s < math.inf

    @property
    def flies(self) -> bool:
        """Whether the vehicle is in the air, and in no failsafe."""
        autopilot = self._scenario.autopilot
        return not autopilot.situation.landed and not autopilot.failsafe.acting

    def step(self, now_s: float) -> None:
        """Ask again, and look whether a changed file was taken."""
        self._go_on_asking(now_s)
        self._look_after_reading(now_s)

    def resume(self, after_s: float, *, upload: bool = False) -> None:
        """Ask for the vehicle from then on until it is ours, with our plan if that is wanted."""
        self._upload = self._upload or upload
        self._resumes_s = self._scenario.now_s + after_s
        self._resumes_until_s = self._scenario.now_s + _PATIENCE_S

    def ask(self, request: AnyRequest) -> None:
        """Ask the companion for something, if there is one."""
        companion = self._scenario.companion
        if companion is not None:
            self._scenario.happened(
                SceneEventKind.REQUEST, _VERBS.get(type(request).__name__, "another")
            )
            self._scenario.call(lambda: companion.ask(request))

    def request(self, choice: float) -> None:
        """An operator asks for something, but never for the pilot's vehicle."""
        if not self.pilot:
            self.ask(request_of(choice, self._dice, self._scenario.mission, self._scenario.place))

    def reload(self, ahead_m: float) -> None:
        """The operator draws a zone near the vehicle, or over it, and has the file read again."""
        airframe = self._scenario.autopilot.airframe
        course_rad = math.atan2(airframe.velocity_east_m_s, airframe.velocity_north_m_s)
        course_rad += self._dice.uniform(-0.5, 0.5)
        place = self._scenario.place
        centre = Point(
            place.east_m + ahead_m * math.sin(course_rad),
            place.north_m + ahead_m * math.cos(course_rad),
        )
        radius_m = self._dice.uniform(4.0, 12.0)
        self.change(
            lambda: self._scenario.file.circle(centre, radius_m, self._scenario.mission.home)
        )

    def wall(self, side: int) -> None:
        """The operator walls the vehicle in, zone by zone."""
        home, place = self._scenario.mission.home, self._scenario.place
        self.change(lambda: self._scenario.file.wall(place, side, home))

    def enclose(self) -> None:
        """Draw all four walls at once."""
        home, place = self._scenario.mission.home, self._scenario.place
        self.change(lambda: self._scenario.file.enclose(place, home))

    def open(self) -> None:
        """Take the last wall away."""
        self.change(lambda: "" if self._scenario.file.open() else None)

    def change(self, draw: Callable[[], str | None]) -> None:
        """Draw into the file, and have it read again; one change at a time."""
        companion = self._scenario.companion
        if companion is None or not self.flies or self._reading is not None:
            return
        zones = len(companion.flight.controller.mission.zones)
        if draw() is not None:
            self._reading = (self._scenario.now_s + _READ_S, zones)
            self.ask(Reload())

    def _look_after_reading(self, now_s: float) -> None:
        """Whether the changed file was taken; what was not is taken out of it again."""
        if self._reading is None:
            return
        until_s, zones = self._reading
        companion = self._scenario.companion
        if companion is not None and len(companion.flight.controller.mission.zones) != zones:
            self._scenario.happened(SceneEventKind.MISSION_FILE, self._scenario.file.text)
        elif companion is not None and now_s < until_s:
            return
        else:
            left = (until_s - _READ_S, self._scenario.file.text)
            self._scenario.happened(SceneEventKind.FILE_LEFT, left)
            self._scenario.file.undo()
        self._reading = None

    def _go_on_asking(self, now_s: float) -> None:
        """The operator asks until it is ours again: it may still be too low, or in a zone."""
        companion = self._scenario.companion
        if now_s < self._resumes_s:
            return
        if companion is not None and companion.in_charge:
            self.pilot, self._resumes_s = False, math.inf
        elif now_s > self._resumes_until_s:
            self._resumes_s = math.inf  # it cannot be: the pilot keeps it
        else:
            self._resumes_s = now_s + _RESUME_S
            self.ask(GoOn(upload=self._upload))


def request_of(choice: float, dice: random.Random, mission: Mission, here: Point) -> AnyRequest:
    """A request by a number from 0 to 1: all verbs, points near waypoints and the vehicle."""
    if choice < _HOLD:
        return HoldNow()
    if choice < _GO_ON:
        return GoOn()
    if choice < _SEEK:
        return SeekNow(dice.choice(_ROBOTS))
    if choice < _EXPLORE:
        return ExploreNow()
    if choice < _HOME:
        return ComeHome()
    count, waits = dice.choice((1, 1, 2, 5)), dice.random() < 0.2
    points = tuple(_place(dice, mission, here) for _ in range(count))
    return GoTo(points, dice.choice((None, 0.0, 5.0)), waits)


def _place(dice: random.Random, mission: Mission, here: Point) -> Point:
    beside = (dice.uniform(-_BESIDE_M, _BESIDE_M), dice.uniform(-_BESIDE_M, _BESIDE_M))
    east_m, north_m = dice.choice((here, dice.choice(mission.waypoints).position))
    return Point(east_m + beside[0], north_m + beside[1])
