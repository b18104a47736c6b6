"""The flight shell of a rehearsal: the real controller over a link that fails, without sockets.

It does what `air_router.flight`, `motions` and `px4` do, against the simulated autopilot's methods
in place of MAVLink: commands take their time, may be lost, and are believed when they show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Final

from air_router.actions import FlyToNode, FlyToPoint, HoldHere, LandHere, StateChanged
from air_router.behaviour import State
from air_router.controller import Controller
from air_router.events import CommandConfirmed, CommandFailed
from air_router.px4_mode import flight_mode
from air_router.vehicle import FlightMode, LinkSilent, Telemetry
from sitl.px4_modes import FlightMode as Px4Mode

if TYPE_CHECKING:
    import random

    from air_router.actions import Action, Motion
    from air_router.events import Event
    from air_router.flight_plan import FlightPlan
    from air_router.mission import Mission
    from air_router.router import Router
    from geo.frame import Point
    from sitl.autopilot import Autopilot

CONFIRM_S: Final = 3.0
REPEAT_S: Final = 0.5
SILENT_S: Final = 3.0
_Work = Generator[None, None, None]


class NotShownError(Exception):
    """A command did not show in time."""


class Link:
    """What lies between companion and vehicle.

    Attributes:
        loss: Share of messages that are lost, either way.
        silent: Nothing passes.
        busy: The vehicle drops jumps: somebody downloads its plan.
    """

    def __init__(self, chance: random.Random, loss: float) -> None:
        self._chance = chance
        self.loss = loss
        self.silent = self.busy = False
        self._under_way: list[tuple[float, Callable[[], object]]] = []

    def passes(self) -> bool:
        """Whether a message gets through."""
        return not self.silent and self._chance.random() >= self.loss

    def send(self, command: Callable[[], object], now_s: float) -> None:
        """Carried out a moment later, if it is not lost."""
        if self.passes():
            self._under_way.append((now_s + self._chance.uniform(0.01, 0.12), command))

    def deliver(self, now_s: float) -> None:
        """What arrives at the vehicle now."""
        due = [command for at_s, command in self._under_way if at_s <= now_s]
        self._under_way = [entry for entry in self._under_way if entry[0] > now_s]
        for command in due:
            command()


class Companion:
    """One life of a companion computer.

    Args:
        mission: To be flown, and its plan as it is on board.
        autopilot: Whom it commands through `link`.
        degrees: The autopilot's own (north, east) of a place in the mission's frame.
    """

    def __init__(  # noqa: PLR0913 - what a flight is put together from
        self,
        mission: Mission,
        plan: FlightPlan,
        router: Router,
        autopilot: Autopilot,
        link: Link,
        *,
        seek: tuple[str, ...],
        north_east: Callable[[Point], tuple[float, float]],
    ) -> None:
        self.controller = Controller(mission, plan, router, seek)
        self._mission = mission
        self._plan = plan
        self._autopilot = autopilot
        self._link = link
        self._north_east = north_east
        self._now_s = 0.0
        self._heard_s = -math.inf
        self._told_silent_s = 0.0
        self.seen: Telemetry | None = None
        self._waiting: Motion | None = None
        self._sending: tuple[Motion, _Work] | None = None
        self.actions: list[Action] = []

    def hear(self, event: Event) -> None:
        """Something happened; decisions are acted on."""
        if isinstance(event, Telemetry):
            self.seen = event
            self._heard_s = event.time_s
        for action in self.controller.handle(event, self._now_s):
            self.actions.append(action)
            match action:
                case FlyToNode() | FlyToPoint() | HoldHere() | LandHere():
                    self._waiting = action
                case StateChanged(target=State.PASSIVE):
                    self._waiting = self._sending = None

    def step(self, now_s: float) -> None:
        """Time passes: commands go out, one at a time, and are waited for."""
        self._now_s = now_s
        silent_s = now_s - self._heard_s
        if math.isfinite(silent_s) and silent_s > SILENT_S and now_s - self._told_silent_s >= 1.0:
            self._told_silent_s = now_s
            self.hear(LinkSilent(self._heard_s, silent_s))
        if self._sending is None and self._waiting is not None:
            motion, self._waiting = self._waiting, None
            objection = self.controller.objection(motion, now_s)
            if objection is not None:
                self.hear(CommandFailed(motion, objection))
                return
            self._sending = (motion, self._work(motion))
        if self._sending is not None:
            self._go_on(*self._sending)

    def _go_on(self, motion: Motion, work: _Work) -> None:
        try:
            next(work)
        except StopIteration:
            self._sending = None
            self.hear(CommandConfirmed(motion))
        except NotShownError as error:
            self._sending = None
            self.hear(CommandFailed(motion, str(error)))

    def _work(self, motion: Motion) -> _Work:
        match motion:
            case FlyToNode(node=node):
                yield from self._jump(self._plan.item_of(node))
            case FlyToPoint(position=position, altitude_m=altitude_m):
                yield from self._reposition(position, altitude_m)
            case HoldHere() if self._mode is FlightMode.HOLD:
                yield from self._ask(
                    lambda: self._autopilot.reposition(None, None),
                    lambda: self._mode is FlightMode.HOLD,
                )
            case HoldHere():
                yield from self._choose(Px4Mode.AUTO_LOITER)
            case LandHere():
                yield from self._choose(Px4Mode.AUTO_LAND)

    @property
    def _mode(self) -> FlightMode:
        return FlightMode.OTHER if self.seen is None else self.seen.mode

    def _jump(self, item: int) -> _Work:
        before = self._mode

        def set_current() -> None:
            if not self._link.busy:
                self._autopilot.plan.set_current(item)

        self._link.send(set_current, self._now_s)
        yield from self._until(lambda: self.seen is not None and self.seen.item == item)
        if self._mode is not FlightMode.MISSION:
            if self._mode is not FlightMode.HOLD or before is not FlightMode.HOLD:
                raise NotShownError(f"somebody chose {self._mode.value} mode")
            yield from self._choose(Px4Mode.AUTO_MISSION)
            self._set_speed()

    def _reposition(self, point: Point, altitude_m: float) -> _Work:
        assert self.seen is not None  # noqa: S101 - nothing is commanded before it was heard
        situation = self._autopilot.situation
        amsl_m = situation.altitude_m + altitude_m - self.seen.altitude_m
        place = self._north_east(point)

        def go() -> None:
            if self._autopilot.request_mode(Px4Mode.AUTO_LOITER):
                self._autopilot.reposition(place, amsl_m)

        yield from self._ask(go, lambda: self._mode is FlightMode.HOLD)
        self._set_speed()

    def _choose(self, mode: Px4Mode) -> _Work:
        shown = flight_mode(mode.custom_mode)
        before = self._mode
        yield from self._ask(
            lambda: self._autopilot.request_mode(mode, forced=mode is Px4Mode.AUTO_LAND),
            lambda: self._mode is shown,
            lambda: self._mode is not before,
        )

    def _ask(
        self,
        command: Callable[[], object],
        shown: Callable[[], bool],
        denied: Callable[[], bool] = lambda: False,
    ) -> _Work:
        """Send until it was carried out (MAVSDK repeats commands) and then shows."""
        arrived: list[bool] = []

        def carry_out() -> None:
            if not arrived:
                command()
            arrived.append(True)

        end_s, next_s = self._now_s + CONFIRM_S, self._now_s
        while not (arrived and shown()):
            if self._now_s >= end_s or (arrived and denied() and not shown()):
                raise NotShownError("it does not show")
            if self._now_s >= next_s and not arrived:
                self._link.send(carry_out, self._now_s)
                next_s = self._now_s + REPEAT_S
            yield

    def _until(self, shown: Callable[[], bool]) -> _Work:
        end_s = self._now_s + CONFIRM_S
        while not shown():
            if self._now_s >= end_s:
                raise NotShownError("it does not show")
            yield

    def _set_speed(self) -> None:
        def slow() -> None:
            self._autopilot.situation.speed_m_s = self._mission.speed_m_s

        self._link.send(slow, self._now_s)
