"""The flight shell of a rehearsal: the real controller over a link that fails, without sockets.

It does what `air_router.flight`, `motions` and `px4_motions` do, against the simulated autopilot's
methods in place of MAVLink: commands take their time, may be lost, and are believed when they show.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from air_router.actions import (
    FlyToNode,
    FlyToPoint,
    HoldHere,
    LandHere,
    RenewPlan,
    StateChanged,
)
from air_router.behaviour import State
from air_router.controller import Controller
from air_router.events import CommandConfirmed, CommandFailed, PlanRenewed
from air_router.flight_plan import FlightPlan
from air_router.px4_commands import CONFIRM_S, SAME_M, SETTLED_S, Choices
from air_router.px4_mode import flight_mode
from air_router.px4_motions import ATTEMPTS, STOPS_M
from air_router.vehicle import FlightMode, LinkSilent, Telemetry
from sitl.mission_items import MissionType
from sitl.px4_modes import FlightMode as Px4Mode

if TYPE_CHECKING:
    import random

    from air_router.actions import Action, Motion
    from air_router.events import Event
    from air_router.flight_plan import PlanItem
    from air_router.mission import Mission
    from air_router.router import Router
    from geo.frame import Point
    from sitl.autopilot import Autopilot

DELAYED_S: Final = 2.0
"""How long what the vehicle says keeps coming so late."""

SILENT_S: Final = 3.0
_Work = Generator[None, None, None]


class NotShownError(Exception):
    """A command did not show in time."""


@dataclass(slots=True)
class _Sent:
    """A command that left, and whether its acknowledgement came."""

    first_s: float
    acknowledged: bool = False


class Link:
    """What lies between companion and vehicle.

    Attributes:
        loss: Share of messages that are lost, either way.
        late_s: Commands take up to so much longer, one behind the other.
        old_s: What the vehicle says takes up to so long; nobody can tell from a slower clock.
        silent: Nothing passes.
        busy: The vehicle drops jumps: somebody downloads its plan.
    """

    def __init__(
        self, chance: random.Random, loss: float, late_s: float = 0.0, old_s: float = 0.0
    ) -> None:
        self._chance = chance
        self.loss = loss
        self.late_s = late_s
        self.old_s = old_s
        self._now_s = self._arrives_s = self._heard_s = 0.0
        self._delay_s = self._other_delay_s = 0.0
        self.silent = self.busy = False
        self._under_way: list[tuple[float, Callable[[], object]]] = []
        self._said: deque[tuple[float, Telemetry]] = deque()

    def passes(self) -> bool:
        """Whether a message gets through."""
        return not self.silent and self._chance.random() >= self.loss

    def said(self, telemetry: Telemetry) -> list[Telemetry]:
        """The vehicle says this, if it is not lost; what is heard of it now, in order."""
        if self._now_s >= self._other_delay_s:
            self._delay_s = self._chance.uniform(0.0, self.old_s) if self.old_s > 0.0 else 0.0
            self._other_delay_s = self._now_s + DELAYED_S
        if self.passes():
            self._heard_s = max(self._heard_s, self._now_s + self._delay_s)
            self._said.append((self._heard_s, telemetry))
        heard = []
        while self._said and self._said[0][0] <= self._now_s:
            heard.append(self._said.popleft()[1])
        return heard

    def send(self, command: Callable[[], object]) -> None:
        """Carried out a moment later, if it is not lost."""
        if self.passes():
            takes_s = self._chance.uniform(0.01, 0.12)
            if self.late_s > 0.0:
                takes_s += self._chance.uniform(0.0, self.late_s)
            self._arrives_s = max(self._arrives_s, self._now_s + takes_s)
            self._under_way.append((self._arrives_s, command))

    def transfer_s(self) -> float:
        """How long a plan takes to get on board; packets that are lost are asked for again."""
        return self._chance.uniform(0.3, 2.0) * (1.0 + 20.0 * self.loss)

    def deliver(self, now_s: float) -> None:
        """What arrives at the vehicle now."""
        self._now_s = now_s
        due = [command for at_s, command in self._under_way if at_s <= now_s]
        self._under_way = [entry for entry in self._under_way if entry[0] > now_s]
        for command in due:
            command()


class Companion:
    """One life of a companion computer.

    Args:
        mission: To be flown, and its plan as it is on board.
        autopilot: Whom it commands through `link`.
        board: Puts a part of a plan on board.
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
        board: Callable[[MissionType, tuple[PlanItem, ...]], None],
    ) -> None:
        self.controller = Controller(mission, plan, router, seek)
        self._mission = mission
        self._plan = plan
        self._autopilot = autopilot
        self._link = link
        self._north_east = north_east
        self._board = board
        self._now_s = 0.0
        self._heard_s = -math.inf
        self._behind_s = 0.0
        self._told_silent_s = 0.0
        self.seen: Telemetry | None = None
        self._waiting: Motion | None = None
        self._sending: tuple[Motion, _Work] | None = None
        self._boards_s = math.inf
        self._late: Point | None = None
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
                case RenewPlan():
                    self._boards_s = self._now_s + self._link.transfer_s()
                case StateChanged(target=State.PASSIVE):
                    self._waiting = self._sending = None

    def listen(self, heard: list[Telemetry], now_s: float) -> None:
        """The vehicle was heard: its clock is ours, however late that came."""
        for telemetry in heard:
            self._behind_s = now_s - telemetry.time_s
            self._now_s = max(self._now_s, telemetry.time_s)
            self.hear(telemetry)

    def step(self, now_s: float) -> None:
        """Time passes: commands go out, one at a time, and are waited for."""
        now_s = self._now_s = max(self._now_s, now_s - self._behind_s)
        if now_s >= self._boards_s:
            self._boards_s = math.inf
            self._renew()
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

    def _renew(self) -> None:
        """The changed plan is on board, or is not: a transfer that was lost is given up."""
        if self._link.silent:
            self.hear(PlanRenewed("the transfer did not end within 30 s"))
            return
        plan = FlightPlan.of(self.controller.mission)
        if plan.items != self._plan.items:
            self._plan = plan
            self._board(MissionType.MISSION, plan.items)
        self._board(MissionType.FENCE, plan.fence)
        self.hear(PlanRenewed())

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
                yield from self._jump(motion, self._plan.item_of(node))
            case FlyToPoint(position=position, altitude_m=altitude_m):
                yield from self._reposition(position, altitude_m)
            case HoldHere() if self._mode is FlightMode.HOLD:
                yield from self._stop_here()
            case HoldHere():
                yield from self._choose(Px4Mode.AUTO_LOITER, ATTEMPTS)
                yield from self._stop_if_late()
            case LandHere():
                yield from self._choose(Px4Mode.AUTO_LAND, ATTEMPTS)

    @property
    def _mode(self) -> FlightMode:
        return FlightMode.OTHER if self.seen is None else self.seen.mode

    def _jump(self, motion: Motion, item: int) -> _Work:
        before = self._mode

        def set_current() -> None:
            if not self._link.busy:
                self._autopilot.plan.set_current(item)

        self._link.send(set_current)
        yield from self._until(lambda: self.seen is not None and self.seen.item == item)
        if self._mode is not FlightMode.MISSION:
            if self._mode is not FlightMode.HOLD or before is not FlightMode.HOLD:
                raise NotShownError(f"somebody chose {self._mode.value} mode")
            why = self.controller.objection(motion, self._now_s)
            if why is not None:
                raise NotShownError(why)
            yield from self._choose(Px4Mode.AUTO_MISSION)
            self._set_speed()
        self._late = None

    def _reposition(self, point: Point, altitude_m: float) -> _Work:
        assert self.seen is not None  # noqa: S101 - nothing is commanded before it was heard
        situation = self._autopilot.situation
        amsl_m = situation.altitude_m + altitude_m - self.seen.altitude_m
        place, before = self._north_east(point), self._target
        self._late = point

        def go() -> None:
            if self._autopilot.request_mode(Px4Mode.AUTO_LOITER):
                self._autopilot.reposition(place, amsl_m, None, self._mission.speed_m_s)

        def shown(sent: _Sent) -> bool:
            new = _near(self._target, point) and not _near(before, point)
            return self._mode is FlightMode.HOLD and (sent.acknowledged or new)

        yield from self._tell(go, FlightMode.HOLD, shown)
        self._late = None

    def _stop_if_late(self) -> _Work:
        """It may be in Hold by an order from before to fly to a point."""
        late, self._late = self._late, None
        if late is not None and _near(self._target, late):
            yield from self._stop_here()

    def _stop_here(self) -> _Work:
        before = self._target

        def shown(sent: _Sent) -> bool:
            target = self._target
            if self.seen is None or target is None or before is None or _near(target, before):
                return sent.acknowledged
            return sent.acknowledged or math.dist(target, self.seen.position) <= STOPS_M

        yield from self._tell(
            lambda: self._autopilot.reposition(None, None), FlightMode.HOLD, shown, ATTEMPTS
        )

    def _choose(self, mode: Px4Mode, attempts: int = 1) -> _Work:
        wanted = flight_mode(mode.custom_mode)
        yield from self._tell(
            lambda: self._autopilot.request_mode(mode, forced=mode is Px4Mode.AUTO_LAND),
            wanted,
            lambda sent: self._mode is wanted and self._heard_s > sent.first_s,
            attempts,
        )

    def _tell(
        self,
        command: Callable[[], object],
        leads_to: FlightMode,
        shown: Callable[[_Sent], bool],
        attempts: int = 1,
    ) -> _Work:
        """Send once; again only if the vehicle says later that nobody has chosen anything."""
        assert self.seen is not None  # noqa: S101 - nothing is commanded before it was heard
        sent, before = _Sent(self._now_s), Choices.of(self.seen)

        def carry_out() -> None:
            command()
            sent.acknowledged |= self._link.passes()

        for left in reversed(range(attempts)):
            sent_s = self._now_s
            self._link.send(carry_out)
            while not shown(sent):
                if self._now_s >= sent_s + CONFIRM_S or self._mode not in {before.mode, leads_to}:
                    raise NotShownError("it does not show")
                settled = left and self._heard_s >= sent_s + SETTLED_S
                if settled and before.same(Choices.of(self.seen)):
                    break
                yield
            else:
                return

    @property
    def _target(self) -> Point | None:
        return None if self.seen is None else self.seen.target

    def _until(self, shown: Callable[[], bool]) -> _Work:
        end_s = self._now_s + CONFIRM_S
        while not shown():
            if self._now_s >= end_s:
                raise NotShownError("it does not show")
            yield

    def _set_speed(self) -> None:
        def slow() -> None:
            self._autopilot.situation.speed_m_s = self._mission.speed_m_s

        self._link.send(slow)


def _near(place: Point | None, other: Point) -> bool:
    return place is not None and math.dist(place, other) <= SAME_M
