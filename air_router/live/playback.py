"""Shows a recorded flight on the live page by replaying its decisions at any speed.

Recorded events go to a new controller at their times, as in a replay. Its decisions, states, timers
and routes are shown.
"""

import asyncio
import dataclasses
import math
from collections.abc import AsyncIterator, Collection, Iterable, Mapping
from contextlib import asynccontextmanager
from typing import Any, Final, Protocol

from air_router.control import CommandRequest
from air_router.controller import Controller, FlightStatus
from air_router.controller.model import Action, Announce, Event, FlightSetup, PublishMap
from air_router.errors import RefusedError
from air_router.gossip import MAP_INTERVAL_S, Mapper
from air_router.live.scene import LiveScene
from air_router.live.server import TICK_S, LivePage
from air_router.record import RecordedStep, RecordEntry, Replayer, steps_of
from air_router.routing import Router
from air_router.vehicle import Telemetry
from air_router.web import Say, Web
from mocha_link.errors import RequestError
from mocha_link.links import LinkMetrics

MOST_SPEED: Final = 100.0
_STEPS: Final = 400
"""Entries processed before browsers are served again."""


class RecordConsumer(Protocol):
    """Receives what happens in a recorded flight while it is played."""

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """An event, what was decided on it, and when."""


class _FinishedFlight:
    """The command service of a finished flight."""

    def execute(self, command: CommandRequest, by: str) -> dict[str, Any]:
        """Refuse every request."""
        del command, by
        raise RequestError("this flight is over: it is shown from its record")


class RecordedFlight:
    """A recorded flight, up to the playback time.

    Attributes:
        mapper: The map at that time.
        now_s: Playback time, on the vehicle's clock, between `begin_s` and `end_s`.
        name: The vehicle's name.

    Raises:
        RefusedError: The record has no setup or no event.
    """

    def __init__(self, entries: Iterable[RecordEntry]) -> None:
        kept = [entry for entry in entries if entry.kind not in {"about", "file"}]
        times = [entry.t for entry in kept if entry.kind == "event"]
        setups = [entry.value for entry in kept if entry.kind == "setup"]
        if not setups or not times:
            raise RefusedError("there is no flight in the record that could be shown")
        self._steps = list(steps_of(kept))
        self._setup: FlightSetup = setups[0]  # a flight has one
        self.name = self._setup.name
        self.begin_s, self.end_s = times[0], max(times)
        self.rewind()

    def status(self) -> FlightStatus:
        """The status at the playback time, with the recorded links."""
        return dataclasses.replace(self._controller.status(), links=self._links)

    def router(self) -> Router:
        """The router for the zones in force."""
        return self._controller.router

    def rewind(self) -> None:
        """Return to the beginning."""
        self._controller = Controller(self._setup)
        self._replayer = Replayer(self._controller)
        self.mapper = Mapper(self._setup.mission)
        self._links: Mapping[str, LinkMetrics] = {}
        self.now_s = self.begin_s
        self._next = 0  # index in the steps
        self._published_s = -math.inf

    def plotted(self) -> dict[str, Any]:
        """The timeline of the whole flight; rewinds afterward."""
        scene = LiveScene(self._setup.mission, self.status, self.router, self.name)
        while not self.go_on(self.end_s, scene):
            pass
        self.rewind()
        return {"type": "record", "rows": scene.rows.since(), "marks": scene.log.since()}

    def go_on(self, until_s: float, page: RecordConsumer, most: int = _STEPS) -> bool:
        """Play the record up to a time; False if another call is needed."""
        for _ in range(most):
            if self._next >= len(self._steps) or self._steps[self._next].t > until_s:
                self.now_s = min(max(self.now_s, until_s), self.end_s)
                return True
            step = self._steps[self._next]
            self._next += 1
            if math.isfinite(step.t):
                self.now_s = min(max(self.now_s, step.t), self.end_s)
            if isinstance(step, RecordedStep):
                self._decide(step, page)
            elif step.kind == "link":
                self._links = {**self._links, step.value.peer: step.value}
            elif step.kind == "patch":
                self.mapper.paint(step.value)
            else:
                self._replayer.prepare(step)
        return False

    def _decide(self, step: RecordedStep, page: RecordConsumer) -> None:
        try:
            decided = self._replayer.decide(step)
        except Exception as error:  # noqa: BLE001 - a flight that ended so does it again
            decided = [Announce(f"no decision: {type(error).__name__}: {error}")]
        page.step(step.event, decided, step.t)
        due = isinstance(step.event, Telemetry) and step.t - self._published_s >= MAP_INTERVAL_S
        if due or any(isinstance(action, PublishMap) for action in decided):
            self._published_s = step.t
            self.mapper.publish(step.t)


class Playback:
    """Plays a recorded flight on a page; viewers may pause, jump, and change the speed."""

    def __init__(self, recorded: RecordedFlight, web: Web, *, speed: float = 1.0) -> None:
        self._recorded = recorded
        self._speed = speed
        self._paused = False  # paused by a viewer
        self._wanted_s: float | None = None  # requested by a viewer
        record = recorded.plotted()
        self._page = LivePage(
            recorded.status,
            recorded.router,
            _FinishedFlight(),
            mapper=recorded.mapper,
            web=web,
            name=recorded.name or "UAV",
        )
        self._page.steer = self._steer
        self._page.record = record

    @asynccontextmanager
    async def serving(self, say: Say) -> AsyncIterator[str]:
        """Play while in the context; yield and print the page's address.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """
        async with self._page.serving(say) as address, asyncio.TaskGroup() as tasks:
            playing = tasks.create_task(self._play())
            try:
                yield address
            finally:
                playing.cancel()

    async def _play(self) -> None:
        recorded, page = self._recorded, self._page
        while True:
            if self._wanted_s is not None and self._wanted_s < recorded.now_s:
                recorded.rewind()
                page.restart(recorded.mapper)
            step_s = 0.0 if self._paused else TICK_S * self._speed
            until_s = recorded.now_s + step_s if self._wanted_s is None else self._wanted_s
            if recorded.go_on(until_s, page):
                self._wanted_s = None
                self._publish()
                await asyncio.sleep(TICK_S)
            await asyncio.sleep(0)

    def _publish(self) -> None:
        recorded = self._recorded
        self._page.publish(
            "playback",
            {
                "begin_s": round(recorded.begin_s, 1),
                "end_s": round(recorded.end_s, 1),
                "now_s": round(recorded.now_s, 1),
                "speed": self._speed,
                "paused": self._paused,
            },
        )

    def _steer(self, values: dict[str, Any]) -> dict[str, Any]:
        match values:
            case {"ask": "pause", "paused": bool(paused)}:
                self._paused = paused
            case {"ask": "speed", "speed": int() | float() as speed} if 0 < speed <= MOST_SPEED:
                self._speed = float(speed)
            case {"ask": "go", "to_s": int() | float() as to_s} if to_s == to_s:  # noqa: PLR0124 - NaN
                self._wanted_s = min(max(to_s, self._recorded.begin_s), self._recorded.end_s)
            case _:
                raise RequestError("unknown request; reload the page")
        return {}
