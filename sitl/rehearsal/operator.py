"""The operator of a rehearsed flight: sends requests, and draws into the mission file.

Some act at the worst moment: they wait for it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from air_router.control import parse_command
from air_router.controller.model import GoTo
from geo.frame import Point
from sitl.rehearsal.fakes import StreamFault, Way
from sitl.rehearsal.judge import Pair, SceneEventKind
from sitl.rehearsal.mission_file import FlyableSpace
from sitl.rehearsal.requests import goto, request_of
from sitl.rehearsal.scenario import Scenario

_RESUME_S: Final = 2.0
"""So often an operator repeats a refused request."""

_PATIENCE_S: Final = 60.0

_COMMANDS: Final = ("COMMAND_LONG", "COMMAND_INT", "MISSION_SET_CURRENT")

FAST_M_S, _SLOW_M_S = 3.5, 2.0
_LOOKS_S: Final = 60.0
"""For so long a moment is waited for."""

_STANDS_S: Final = 4.0
_AT_M: Final = 1.0

Moment = Callable[[], bool]
"""Does something if its moment has come; whether it had."""


class Operator:
    """Sends requests to the companion of a flight.

    Args:
        flight: Where.
        rng: Of the flight; requests at the worst moment have a generator of their own.

    Attributes:
        haste: Generator of requests and drawings at the worst moment.
        sent: Where it was sent last, east and north; None: nowhere.
        pilot: Whether a pilot or station has taken the vehicle, which is left to them.
    """

    def __init__(self, flight: Scenario, rng: random.Random) -> None:
        self._flight = flight
        self._rng, self.haste = rng, flight.scene.chance("haste")
        self._resumes_s = self._resumes_until_s = math.inf  # requested next, given up at
        self._upload = False  # our plan is wanted on board, too
        self._waiting: list[tuple[float, Moment]] = []  # until when, and what to do
        self.sent: Pair | None = None
        self.pilot = False

    @property
    def keeps_requesting(self) -> bool:
        """Whether it still requests the vehicle."""
        return self._resumes_s < math.inf

    @property
    def flies(self) -> bool:
        """Whether the vehicle is in the air, and in no failsafe."""
        autopilot = self._flight.autopilot
        return not autopilot.situation.landed and not autopilot.failsafe.acting

    def step(self, now_s: float) -> None:
        """Do what waits for its moment, and repeat requests."""
        waiting, self._waiting = self._waiting, []
        self._waiting += [
            (until_s, moment) for until_s, moment in waiting if now_s < until_s and not moment()
        ]
        self._request_again(now_s)

    # Requests

    def do_request(self, text: str, hold_s: float | None = None, *, waits: bool = False) -> None:
        """Type a request to the companion, if there is one.

        Args:
            text: As an operator does.
            hold_s: Of points: how long to hover at the last, as programs may request.
            waits: Of points: it waits for its time instead of being refused.
        """
        companion = self._flight.companion
        request = parse_command(text).for_mission(self._flight.mission.frame)
        if companion is None or request is None:
            return
        if isinstance(request, GoTo):
            request = replace(request, hold_s=hold_s, waits=waits)
        typed = text if hold_s is None else f"{text} hold_s={hold_s}"
        self._flight.happened(SceneEventKind.REQUEST, typed)
        self._flight.call(lambda: companion.flight.commands.submit(request))

    def do_random_request(self, choice: float) -> None:
        """Send a random request, but none for a vehicle that the pilot has."""
        if not self.pilot:
            mission, here = self._flight.mission, self._flight.place
            text, hold_s, waits = request_of(choice, self._rng, mission, here)
            self.do_request(text, hold_s, waits=waits)

    def do_tour(self, tour: tuple[int, float | None]) -> None:
        """Send it to so many points, each in sight of the one before; how long to hover there."""
        (count, hold_s), places = tour, [self.here]
        for _ in range(count):
            place = self.space.in_sight(places[-1], self.haste)
            places += [] if place is None else [place]
        if len(places) > 1:
            self.do_request(goto(self._flight.mission, map(self.point, places[1:])), hold_s)

    def do_send(self, seconds: float) -> None:
        """Send it somewhere that it sees, some seconds after a hold."""
        self.do_request("hold")
        self.later(seconds, self._send)

    def do_send_again(self, _: None) -> None:
        """Send it somewhere else that it sees, unless it is the pilot's."""
        if not self.pilot:
            self._send()

    def do_corner(self, brakes_s: float | None) -> None:
        """Send it somewhere, and on its way around a corner; so long after it began to brake."""
        self.do_request("hold")
        self.later(_STANDS_S, lambda: self._set_out(brakes_s))

    def do_deaf(self, on: bool) -> None:
        """No command reaches the vehicle."""
        until_s = math.inf if on else self._flight.now_s
        for name in _COMMANDS:
            self._flight.link.trouble(Way.UP, name, StreamFault.LOST, until_s)

    def resume(self, after_s: float, *, upload: bool = False) -> None:
        """Request the vehicle from then on until it is ours, with our plan if that is wanted."""
        self._upload = self._upload or upload
        self._resumes_s = self._flight.now_s + after_s
        self._resumes_until_s = self._flight.now_s + _PATIENCE_S

    def _request_again(self, now_s: float) -> None:
        """The operator repeats it until the vehicle is ours: it may be too low, or in a zone."""
        companion = self._flight.companion
        if now_s < self._resumes_s:
            return
        if companion is not None and companion.in_charge:
            self.pilot, self._resumes_s = False, math.inf
        elif now_s > self._resumes_until_s:
            self._resumes_s = math.inf  # it cannot be: the pilot keeps it
        else:
            self._resumes_s = now_s + _RESUME_S
            self.do_request("resume upload" if self._upload else "resume")

    def _send(self) -> bool:
        place = self.space.in_sight(self.here, self.haste)
        if place is not None:
            self.sent = place
            self._go_to(place)
        return True

    def _set_out(self, brakes_s: float | None) -> bool:
        space = self.space
        turn = space.turn(self.here, space.mission.speed_m_s, brakes_s or 0.0, self.haste)
        if turn is None:
            return True
        self._go_to(turn.towards)

        def turn_off() -> bool:
            speed_m_s = math.hypot(*self.velocity_m_s)
            if math.dist(self.here, turn.at) > _AT_M or speed_m_s < FAST_M_S or not self.ours:
                return False
            if brakes_s is not None:
                self.do_request("hold")
            if brakes_s:
                self.later(brakes_s, self._around)
            else:
                self._go_to(turn.off_to)
            return True

        self.wait_for(turn_off)
        return True

    def _around(self) -> bool:
        """Send it around a corner while it brakes; what it was sent to before is forgotten."""
        velocity_m_s = self.velocity_m_s
        off_to = self.space.around_a_corner(self.here, velocity_m_s, self.haste)
        if off_to is not None:
            self._go_to(off_to)
        return off_to is not None or math.hypot(*velocity_m_s) < _SLOW_M_S

    # What it knows, and waits for; places in the judge's metres, east and north

    @property
    def ours(self) -> bool:
        """Whether the companion has the vehicle for its own."""
        companion = self._flight.companion
        return companion is not None and companion.in_charge

    @property
    def space(self) -> FlyableSpace:
        """Where it may fly, by the mission file as it is now."""
        return self._flight.file.space

    @property
    def here(self) -> Pair:
        """Where the vehicle really is: metres east and north in the mission's frame."""
        degrees = self._flight.mission.frame.to_geodetic(self._flight.place)
        east, north = self.space.mission.frame.metres(*degrees)
        return float(east), float(north)

    @property
    def velocity_m_s(self) -> Pair:
        """How fast the vehicle really is: east and north."""
        airframe = self._flight.autopilot.airframe
        return airframe.velocity_east_m_s, airframe.velocity_north_m_s

    def point(self, place: Pair) -> Point:
        """A place in the frame of the mission that is flown."""
        return self._flight.mission.frame.to_local(*self.space.mission.frame.degrees(*place))

    def _go_to(self, place: Pair) -> None:
        self.do_request(goto(self._flight.mission, [self.point(place)]))

    def later(self, seconds: float, what: Moment) -> None:
        """Do something after so long, again and again until it is done."""
        at_s = self._flight.now_s + seconds
        self._waiting.append((math.inf, lambda: self._flight.now_s >= at_s and what()))

    def wait_for(self, moment: Moment) -> None:
        """Do something in its moment, if that comes soon."""
        self._waiting.append((self._flight.now_s + _LOOKS_S, moment))
