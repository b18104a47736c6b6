"""The conditions that block a leg or a landing, as one table. The first raised row decides.

A state requests a motion, and any raised row blocks it for now. Interlocks do not block a hold; see
`CommandGate.send`. The first raised row is reported. It decides whether a landing is commanded
again and whether the current leg is canceled. `why` gives the reason for the row's place.
`CommandGate.command` reads the table. The status line, the page, ROS 2, the record and the answer
to `status` show the deciding row. docs/state-machine.md prints the table.
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
        name: Its name in `status` and docs/state-machine.md.
        words: What blocks the motion, as text.
        raised: Whether it blocks now.
        while_up: What the program does meanwhile.
        clears: Condition that clears the row.
        then: What happens after that.
        otherwise: What happens if it does not clear.
        why: Why it comes after the rows above and before those below.
        scene: A fault of `sitl rehearse` in which the row decides.
        defers: A blocked motion is replanned as soon as the row clears.
        repeats_landing: A blocked landing is commanded again soon, because nothing else in LAND
            would command it.
        calls_off: Whether the current leg is canceled too, because it leads elsewhere than the
            requested motion.
        detail: What blocks the motion, more precisely than `words`.
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
        while_up="sends nothing, except a hold that the operator requests",
        clears="telemetry and the flight mode are received",
        then="it plans again",
        otherwise="an alarm after 10 s; after 20 s the pilot is instructed to fly by hand",
        why="the data of all rows below are old; a pilot may have taken over unnoticed",
        scene="SILENCE",
        defers=True,
    ),
    Interlock(
        "INPUT_MISSING",
        "an input is missing",
        _input_missing,
        while_up="holds; sends nothing while the flight mode is not received",
        clears="all inputs have been received for 3 s",
        then="it plans again",
        otherwise="without a fix, position or flight mode it keeps waiting; without the GPS status "
        "alone: home after 30 s",
        why="the rows below cannot be evaluated without the inputs",
        scene="LOST_FIX",
        detail=_missing,
    ),
    Interlock(
        "ALTITUDE_JUMP",
        "the altitude has jumped",
        lambda context: context.interlocks.is_raised(Anomaly.ALTITUDE_JUMP),
        while_up="holds",
        clears="the altitude has been plausible for 2 s",
        then="it plans again",
        otherwise="comes home after 30 s",
        why="the altitude decides which zones apply, and so every check of a leg",
        scene="ALTITUDE_JUMPS",
    ),
    Interlock(
        "CONDITIONS",
        "GPS accuracy or wind is worse than planned",
        lambda context: context.interlocks.is_raised(Anomaly.CONDITIONS),
        while_up="holds",
        clears="they have been as planned for 5 s",
        then="it plans again",
        otherwise="comes home after 30 s",
        why="any leg would be flown with less than the promised clearance",
        scene="POOR_FIX",
    ),
    Interlock(
        "FOREIGN_ORDER",
        "the vehicle seems to follow a foreign command",
        lambda context: context.interlocks.is_raised(Anomaly.FOREIGN_ORDER),
        while_up="sends nothing but a hold: on request, for a missing input, or in a breached zone",
        clears="telemetry shows our own command again",
        then="it plans again",
        otherwise="after 1.5 s without a break: SENT_ELSEWHERE, hands off at once, without a hold",
        why="it is inferred from telemetry, which the rows above ensure",
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
        otherwise="released after six hold commands",
        why="it ends the mission, so it comes after the rows that show who commands the vehicle",
        scene="PLAN_REPLACED",
        repeats_landing=False,
    ),
    Interlock(
        "PLAN_CHECK",
        "the plan on board is being compared",
        lambda context: context.authority.plan_check is not None,
        while_up="holds",
        clears="the plan is the mission's",
        then="it plans again",
        otherwise="releases the vehicle: at once if the plan differs, else after 60 s",
        why="no leg may use a plan that may be another station's",
        scene="SAME_PLAN",
        repeats_landing=False,
    ),
    Interlock(
        "ZONE_UPDATE",
        "zones are being changed",
        lambda context: context.airspace.change is not None,
        while_up="flies on if its leg stays clear, else holds; leaves a new zone",
        clears="the changed zones are on board",
        then="it plans again",
        otherwise="if the upload fails: a warning, and it comes home by DO_REPOSITION; "
        "if a pilot takes over: the transfer is completed, and all is uploaded again on resume",
        why="this program can end it, so everything that others or sensors decide comes first",
        scene="RELOAD",
        repeats_landing=False,
        calls_off=lambda context: context.airspace.change is not ZoneChange.LEAVING,
    ),
)
"""In order of precedence. If no row blocks a motion, `CommandGate` may still send another one
first: a hold, while it is unclear which command the vehicle follows, or the climb of a vehicle that
is too low.
"""


@dataclass(frozen=True, slots=True)
class Blocked:
    """The interlock that blocks the mission, as the gate stores it.

    `MissionWaits` is the same as plain data, for records and `FlightStatus`: there the reason is
    text.

    Attributes:
        by: The deciding row.
        since_s: Time since which it has blocked without a break, on the vehicle's clock.
    """

    by: Interlock
    since_s: float

    def why(self, context: MissionContext) -> str:
        """The reason, as precisely as it is known."""
        return self.by.words if self.by.detail is None else self.by.detail(context)


class MotionOutcome(Enum):
    """What became of a requested motion that no row blocked."""

    SENT = "it is commanded"
    INSTEAD = "something else is commanded first: a hold, or a climb"
    UNDER_WAY = "it was commanded already"
    MAY_BE_TAKEN = "its flight mode is not received, and a hold might end a pilot's"
    WAITS = "the vehicle hovers and plans another route soon"


def raised(context: MissionContext) -> tuple[Interlock, ...]:
    """The rows that block a motion now; the first decides."""
    return tuple([row for row in INTERLOCKS if row.raised(context)])
