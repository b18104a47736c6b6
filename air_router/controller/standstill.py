"""Watchdog for a vehicle that does not move although it should: it raises an alarm.

Many conditions hold a vehicle: a change of zones, a plan check, no clear way, a missing input, a
fault of this program. The battery runs down meanwhile. So this watchdog checks only the effect: the
vehicle is in a zone, or should be elsewhere, and has not moved for some time. `WATCHES` has the
checks, most severe first; `CAUSES` the possible causes, in order of precedence. The alarm names the
cause and the pilot's action, and repeats while the condition lasts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from air_router.controller.limits import (
    MOVED_M,
    SETS_OUT_S,
    STANDS_FOR_PLAN_S,
    STANDS_IN_ZONE_S,
    STANDS_S,
    STANDSTILL_CHECK_S,
)
from air_router.controller.model import Anomaly, MissionContext, Progress, State, ZoneChange
from air_router.controller.motion import raised
from air_router.routing import names_of
from air_router.vehicle import (
    FLY_OUT,
    HOME_OR_TAKE_OVER,
    LAND_BY_HAND,
    TAKE_OVER,
    Instruction,
    Telemetry,
)
from geo.frame import Point

STANDSTILL: Final = "the vehicle does not move as it should"
"""Subject of the alarm."""


Cause = Callable[[MissionContext], str | None]
"""Returns what keeps the vehicle from moving, as text; None: this cause does not apply."""


def _if(what: str, holds: Callable[[MissionContext], object]) -> Cause:
    return lambda context: what if holds(context) else None


def _zones(context: MissionContext) -> str | None:
    return None if context.airspace.change is None else context.airspace.change.value


def _releasing(context: MissionContext) -> str | None:
    why = context.authority.releasing
    return None if why is None else f"hands off in a moment: {why}"


def _plan_check(context: MissionContext) -> str | None:
    what = context.authority.plan_check
    return None if what is None else f"{what}, and is being compared"


def _refusal(context: MissionContext) -> str | None:
    return None if context.task.way.refusal is None else context.task.way.refusal.reason


CAUSES: Final[tuple[Cause, ...]] = (
    lambda context: None if context.authority.held is None else context.authority.held.why,
    _if("nothing is received from it", lambda context: context.silent_s > 0.0),
    lambda context: next(iter(context.inputs.stopped), None),
    lambda context: context.interlocks.first_raised(*Anomaly),
    _releasing,
    _plan_check,
    _zones,
    _refusal,
)
"""The first that applies is announced."""

UNKNOWN: Final = "it does not follow commands"


def cause_of(context: MissionContext) -> str:
    """Why the vehicle does not move, as text."""
    found = (cause(context) for cause in CAUSES)
    return next((text for text in found if text), UNKNOWN)


class Watch(NamedTuple):
    """A condition in which a vehicle must not stay without moving.

    Attributes:
        words: The condition, as text.
        holds: Checks the condition: details as text, perhaps empty; None: not true.
        after_s: Longest time without moving.
        instruction: The pilot's action.
    """

    words: str
    holds: Callable[[MissionContext, Telemetry], str | None]
    after_s: float
    instruction: Instruction


def _in_zone(context: MissionContext, telemetry: Telemetry) -> str | None:
    if not telemetry.fix:
        return None  # the position drifts
    zones = context.airspace.mission.airspace_at(telemetry.altitude_m).zones_at(telemetry.position)
    return names_of(zones) if zones else None


def _at_reserve(context: MissionContext, telemetry: Telemetry) -> str | None:
    charge = telemetry.battery
    return f"{charge:.0%}" if context.airspace.mission.at_reserve(charge) else None


def _waits_for_plan(context: MissionContext, telemetry: Telemetry) -> str | None:
    """A plan is being uploaded or compared, which has its own timeout."""
    del telemetry
    waits = context.airspace.change is ZoneChange.UPLOADING or context.authority.plan_check
    return "" if waits else None


def _in(state: State) -> Callable[[MissionContext, Telemetry], str | None]:
    def holds(context: MissionContext, telemetry: Telemetry) -> str | None:
        waits = _waits_for_plan(context, telemetry) is not None
        return "" if context.task.state is state and not waits else None

    return holds


def _elsewhere(context: MissionContext, telemetry: Telemetry) -> str | None:
    """The mission requires a motion; hovering over a robot or on request is none."""
    rests = {State.HOLD, State.COMM} | ({State.READY} if context.authority.held else set())
    if context.task.state in rests or _waits_for_plan(context, telemetry) is not None:
        return None
    flies = context.task.way.progress in {Progress.FLYING, Progress.NO_ROUTE}
    waits = context.task.spec.explores and context.task.retry_at_s is not None
    return "" if flies or waits or context.airspace.change is not None else None


WATCHES: Final = (
    Watch("the vehicle is in a zone", _in_zone, STANDS_IN_ZONE_S, FLY_OUT),
    Watch("the vehicle is at its battery reserve", _at_reserve, STANDS_IN_ZONE_S, LAND_BY_HAND),
    Watch("the vehicle should come home", _in(State.HOME), STANDS_S, LAND_BY_HAND),
    Watch("the vehicle should land", _in(State.LAND), STANDS_S, LAND_BY_HAND),
    Watch("the vehicle should continue its mission", _elsewhere, STANDS_S, HOME_OR_TAKE_OVER),
    Watch("the vehicle waits for its plan", _waits_for_plan, STANDS_FOR_PLAN_S, TAKE_OVER),
)
"""The first that lasts long enough raises the alarm."""


class _Anchor(NamedTuple):
    """Where the vehicle was when it last moved, or was first required to move."""

    time_s: float
    position: Point
    altitude_m: float

    def left_by(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle has moved since."""
        up_m = telemetry.altitude_m - self.altitude_m
        return math.hypot(math.dist(self.position, telemetry.position), up_m) > MOVED_M


@dataclass(slots=True, eq=False)
class Standstill:
    """Monitors one flight.

    Args:
        context: State of the flight; receives the alarm.
    """

    _context: MissionContext
    _anchor: _Anchor | None = None
    _checked_s: float = -math.inf  # last check, vehicle's clock
    _announced: Watch | None = None  # the condition announced now
    _was_blocked: bool = False  # an interlock blocked it at the last check
    _moves_by_s: float = -math.inf  # grace period after an interlock cleared

    def update(self, telemetry: Telemetry, *, ours: bool) -> None:
        """Check a telemetry update, after all decisions on it.

        Args:
            telemetry: The current telemetry.
            ours: This program commands the vehicle in the air.
        """
        now_s, anchor = telemetry.time_s, self._anchor
        if not ours:
            self._anchor = None
            self._over()
            return
        if (
            anchor is not None
            and not anchor.left_by(telemetry)
            and now_s < self._checked_s + STANDSTILL_CHECK_S
        ):
            return
        self._checked_s = now_s
        here = _Anchor(now_s, telemetry.position, telemetry.altitude_m)
        if anchor is None or anchor.left_by(telemetry):
            self._anchor = here
            self._over("it moves again")
            return
        found = {watch: watch.holds(self._context, telemetry) for watch in WATCHES}
        lasts = [(watch, more) for watch, more in found.items() if more is not None]
        if not lasts:
            self._anchor = here  # it is where it should be
            self._over()
        stands_s = now_s - anchor.time_s
        due = [(watch, more) for watch, more in lasts if stands_s >= watch.after_s]
        was_blocked, self._was_blocked = self._was_blocked, bool(raised(self._context))
        if was_blocked and not self._was_blocked and self._moves_by_s < anchor.time_s:
            self._moves_by_s = now_s + SETS_OUT_S  # once, until it has moved
        if due and now_s >= self._moves_by_s:
            self._alarm(*due[0], anchor.time_s)

    def _alarm(self, watch: Watch, more: str, since_s: float) -> None:
        """Raise the alarm until it is over, unless another alarm is already up."""
        context = self._context
        if watch is not self._announced:
            self._over()
            self._announced = watch
        if set(context.alarms.shown) - {STANDSTILL}:
            return
        what = f"{watch.words} ({more})" if more else watch.words
        stands = f"{what} and has not moved"
        context.alarm_until_over(
            STANDSTILL,
            f"{stands} for {self._checked_s - since_s:.0f} s: {cause_of(context)}",
            watch.instruction,
            lasting=stands,
            since_s=since_s,
        )

    def _over(self, words: str = "") -> None:
        self._announced = None
        self._context.over(STANDSTILL, words)

    @property
    def why(self) -> str | None:
        """Why the vehicle does not move, with the pilot's action; None: no alarm lasts."""
        if self._announced is None:
            return None
        return f"{cause_of(self._context)}; {self._announced.instruction}"
