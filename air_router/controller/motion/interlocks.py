"""What may keep a leg, or a landing, from being sent: one table; the first raised row decides.

The mission's states want a motion; these rows keep the vehicle from flying it now. They
keep no hold back: see `CommandGate.send`. Any raised row keeps a motion back. The first one is
reported, and decides whether a landing is commanded again and whether the leg under way is called
off; each row gives the reason for its place. `CommandGate.command` reads the table; the status
line, the page, ROS 2, the record and answers to `status` show the row that decides, and
docs/state-machine.md prints it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final

from air_router.controller.model import Anomaly, MissionContext, ZoneChange
from air_router.vehicle import NO_FIX


@dataclass(frozen=True, slots=True)
class Interlock:
    """One row.

    Attributes:
        name: By which `status` and docs/state-machine.md know it.
        words: What stands against the motion.
        raised: Whether it does now.
        while_up: What the vehicle does meanwhile.
        clears: What lifts it.
        then: What follows then.
        otherwise: What follows where it is not lifted.
        why: Why it comes after the rows above it and before those below.
        scene: A kind of scene of `sitl rehearse` in which it decides.
        defers: The motion that it keeps back is planned anew as soon as the row clears.
        repeats_landing: A landing that it keeps back is commanded again in a moment: in LAND
            nothing else would have the vehicle land.
        calls_off: The leg under way is called off, too: it leads elsewhere than what is wanted now.
        detail: What stands against the motion, more precisely than `words`.
    """

    name: str
    words: str
    raised: Callable[[MissionContext], bool]
    while_up: str
    clears: str
    then: str
    otherwise: str
    why: str
    scene: str
    defers: bool = False
    repeats_landing: bool = True
    calls_off: Callable[[MissionContext], bool] = lambda _context: False
    detail: Callable[[MissionContext], str] | None = None


def _input_missing(context: MissionContext) -> bool:
    no_fix = context.telemetry is not None and not context.telemetry.fix
    return no_fix or bool(context.inputs.stopped)


def _missing(context: MissionContext) -> str:
    return ", ".join(context.inputs.stopped) or NO_FIX


INTERLOCKS: Final = (
    Interlock(
        "LINK_SILENT",
        "nothing is received from the vehicle",
        lambda context: context.silent_s > 0.0,
        while_up="sends nothing, unless the operator asks for a hold",
        clears="telemetry and the flight mode are received",
        then="it plans again",
        otherwise="an alarm after 10 s; after 20 s it asks the pilot to fly by hand",
        why="all telemetry is old, so the rows below are unknown; a pilot may have taken over",
        scene="SILENCE",
        defers=True,
    ),
    Interlock(
        "INPUT_MISSING",
        "an input is missing",
        _input_missing,
        while_up="holds; sends nothing while the flight mode is not received",
        clears="all inputs have arrived for 3 s",
        then="it plans again",
        otherwise="no fix or flight mode: it waits; other inputs: home after 30 s",
        why="without its inputs the program cannot judge any row below",
        scene="LOST_FIX",
        detail=_missing,
    ),
    Interlock(
        "ALTITUDE_JUMP",
        "the altitude has jumped",
        lambda context: context.interlocks.is_raised(Anomaly.ALTITUDE_JUMP),
        while_up="holds",
        clears="the altitude has been normal for 2 s",
        then="it plans again",
        otherwise="comes home after 30 s",
        why="the altitude decides which zones apply, and so every check of a leg",
        scene="ALTITUDE_JUMPS",
    ),
    Interlock(
        "CONDITIONS",
        "satellites or wind are worse than planned for",
        lambda context: context.interlocks.is_raised(Anomaly.CONDITIONS),
        while_up="holds",
        clears="they have been as planned for 5 s",
        then="it plans again",
        otherwise="comes home after 30 s",
        why="every leg would have less clearance than planned",
        scene="POOR_FIX",
    ),
    Interlock(
        "FOREIGN_ORDER",
        "a foreign command is active",
        lambda context: context.interlocks.is_raised(Anomaly.FOREIGN_ORDER),
        while_up="sends nothing",
        clears="the companion's own command is reported",
        then="it plans again",
        otherwise="after 1.5 s without a break: SENT_ELSEWHERE, hands off without a hold",
        why="it needs the telemetry that the rows above require",
        scene="DIVERTED",
        defers=True,
    ),
    Interlock(
        "RELEASING",
        "the vehicle is being released",
        lambda context: context.authority.releasing is not None,
        while_up="holds",
        clears="the vehicle holds",
        then="released to the pilot",
        otherwise="released after six commands to hold",
        why="it ends the mission, but only once it is known who controls the vehicle",
        scene="PLAN_REPLACED",
        repeats_landing=False,
    ),
    Interlock(
        "PLAN_CHECK",
        "the plan on board is being compared",
        lambda context: context.authority.plan_check is not None,
        while_up="holds",
        clears="the plans match",
        then="it plans again",
        otherwise="releases the vehicle, at once if it differs, else after 60 s",
        why="no leg may rely on a plan that may be foreign",
        scene="SAME_PLAN",
        repeats_landing=False,
    ),
    Interlock(
        "ZONE_UPDATE",
        "zones are being changed",
        lambda context: context.airspace.change is not None,
        while_up="finishes a leg that stays clear, else holds; leaves a new zone",
        clears="the changed zones are on board",
        then="it plans again",
        otherwise="if the upload fails: a warning, and it comes home by DO_REPOSITION; if a pilot "
        "takes over: the current list is finished; resume uploads all lists again",
        why="the companion can end it itself; the rows above depend on others and on sensors",
        scene="RELOAD",
        repeats_landing=False,
        calls_off=lambda context: context.airspace.change is not ZoneChange.LEAVING,
    ),
)
"""In order of precedence. What leaves instead of a motion that no row keeps back (a hold where it
would not show which order is followed, the climb of a vehicle that is low) `CommandGate` decides.
"""


@dataclass(frozen=True, slots=True)
class Blocked:
    """What keeps the mission from what it wants, as the gate holds it.

    `MissionWaits` is the same as data, for records and `FlightStatus`: a record, a page
    or a program has the reason worked out from the row.

    Attributes:
        by: The row that decides.
        since_s: Since when, without a break, on the vehicle's clock.
    """

    by: Interlock
    since_s: float

    def why(self, context: MissionContext) -> str:
        """As precisely as is known."""
        return self.by.words if self.by.detail is None else self.by.detail(context)


class MotionOutcome(Enum):
    """What became of a motion that was wanted and that no row keeps back."""

    SENT = "it is commanded"
    INSTEAD = "something else is commanded first: a hold, or a climb"
    UNDER_WAY = "it is commanded already"
    MAY_BE_TAKEN = "its flight mode is not received, and a hold might end a pilot's"
    WAITS = "it hovers, and looks for another way in a moment"


def raised(context: MissionContext) -> tuple[Interlock, ...]:
    """The rows that stand against a motion now; the first decides."""
    return tuple([row for row in INTERLOCKS if row.raised(context)])
