"""What can happen in a rehearsed flight, one after the other: the courses of its faults."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

from sitl.rehearsal.stand_ins.link import StreamFault


class ScheduledFault(NamedTuple):
    """Something that happens.

    Attributes:
        at_s: Seconds after its phase of the flight began.
        what: Which; a method of the flight, or of its operator, without its `do_`.
        value: As it needs.
        phase: A mission state, "climb" or "landing", counted from when it is entered first;
            "armed": from when the vehicle was armed; "ready": from when the companion starts;
            empty: the scene says.
    """

    at_s: float
    what: str
    value: Any = None
    phase: str = ""


PHASES: Final = ("climb", "INIT", "SEARCH", "COMM", "EXPL", "HOME", "LAND", "landing")
"""Where in a flight something can begin; a third of all begins at any time instead."""

BRIEF_S, SECONDS = 3.0, (30.0, math.inf)
"""How long a stream's fault lasts."""

POSITION: Final = ("GLOBAL_POSITION_INT",)
BATTERY: Final = ("SYS_STATUS",)
SATELLITES: Final = ("GPS_RAW_INT",)
LANDED: Final = ("EXTENDED_SYS_STATE",)
ITEM: Final = ("MISSION_CURRENT",)
MODE: Final = ("HEARTBEAT", "CURRENT_MODE")
_STREAMS: Final = (POSITION, BATTERY, SATELLITES, LANDED, ITEM, MODE)

WRONG_STREAMS: Final = {
    POSITION: "LOST_POSITION",
    BATTERY: "LOST_BATTERY",
    SATELLITES: "WRONG_FIX",
    LANDED: "LOST_LANDED",
    ITEM: "LOST_ITEM",
    MODE: "LOST_MODE",
}
"""The judge's row for a stream whose messages are believable, and not true."""

ON_MODE: Final = ("AUTO_LOITER", "AUTO_RTL", "ORBIT", "AUTO_LAND", "POSCTL", "ALTCTL")
_HELD: Final = ("AUTO_LOITER", "AUTO_RTL", "ORBIT", "POSCTL")
_SURE: Final = ("AUTO_LOITER", "AUTO_RTL", "AUTO_LAND", "POSCTL")
"""Modes that no PX4 refuses; in the first a restarted companion may take it back."""

Schedule = list[ScheduledFault]
Course = Callable[[random.Random], Schedule]


def placed(schedule: Schedule, phase: str, later_s: float) -> Schedule:
    """What does not say when in a flight it happens, so long after a phase began."""
    return [m if m.phase else m._replace(at_s=m.at_s + later_s, phase=phase) for m in schedule]


class Agenda:
    """What is still to happen in a flight, as its phases come.

    Args:
        schedule: All of it; what is never to happen is left out.

    Attributes:
        waiting: Whose phase has not come.
        due: When the others happen, simulated, in that order.
    """

    def __init__(self, schedule: Schedule) -> None:
        self.waiting = [each for each in schedule if math.isfinite(each.at_s)]
        self.due: list[tuple[float, ScheduledFault]] = []
        self._phases: set[str] = set()  # that the flight has come to

    @property
    def left(self) -> Schedule:
        """All that has not happened."""
        return [*self.waiting, *(each for _, each in self.due)]

    def enter(self, phase: str, now_s: float) -> None:
        """A phase of the flight begins, perhaps again; on the way home what never came comes."""
        if phase in self._phases:
            return
        self._phases.add(phase)
        if phase == "HOME":
            for missed in PHASES[: PHASES.index(phase)]:
                self.enter(missed, now_s)
        for each in [each for each in self.waiting if each.phase == phase]:
            self.waiting.remove(each)
            self.add(now_s + each.at_s, each)

    def add(self, at_s: float, what: ScheduledFault) -> None:
        """Something happens then."""
        self.due.append((at_s, what))
        self.due.sort(key=lambda entry: entry[0])

    def take(self, now_s: float) -> Iterator[ScheduledFault]:
        """What happens until now, one after the other."""
        while self.due and self.due[0][0] <= now_s:
            yield self.due.pop(0)[1]


def carry_out(scheduled: ScheduledFault, *doers: object) -> None:
    """Let it happen: the first of these that can do it does."""
    name = f"do_{scheduled.what.replace(' ', '_')}"
    doer = next(doer for doer in doers if hasattr(doer, name))
    getattr(doer, name)(scheduled.value)


def stream(*names: str) -> Course:
    """One stream, in one of the ways."""

    def course(dice: random.Random) -> Schedule:
        kind = dice.choice(tuple(StreamFault))
        return [ScheduledFault(0.0, "stream", (names, kind, dice.choice(SECONDS)))]

    return course


def brief(dice: random.Random) -> Schedule:
    """Any one stream, for a moment."""
    names, kind = dice.choice(_STREAMS), dice.choice(tuple(StreamFault))
    return [ScheduledFault(0.0, "stream", (names, kind, BRIEF_S))]


def one(what: str, draw: Callable[[random.Random], Any] = lambda _dice: None) -> Course:
    """One thing, with what is drawn for it."""
    return lambda dice: [ScheduledFault(0.0, what, draw(dice))]


def span(what: str, on: object, off: object, seconds: Callable[[random.Random], float]) -> Course:
    """Something that begins, and ends after so long."""
    return lambda dice: [ScheduledFault(0.0, what, on), ScheduledFault(seconds(dice), what, off)]


def often(
    what: str, times: int, every: tuple[float, float], value: Callable[[random.Random], Any]
) -> Course:
    """Again and again, each a while after the one before."""

    def course(dice: random.Random) -> Schedule:
        at_s, happen = 0.0, []
        for _ in range(times):
            happen.append(ScheduledFault(at_s, what, value(dice)))
            at_s += dice.uniform(*every)
        return happen

    return course


pushed: Final = often("push", 5, (15.0, 35.0), lambda dice: dice.uniform(22.0, 40.0))
"""Gusts of so many m/s, each as soon as something is near."""


altered: Final = one("alter", lambda dice: (dice.randrange(1, 40), dice.choice((6.0, math.inf))))
"""Which item, and for how long its place is altered on the way."""


def spells(
    times: int,
    within_s: float,
    begin: Callable[[random.Random], tuple[str, Any]],
    end: tuple[str, Any],
    lasts_s: tuple[float, float],
) -> Course:
    """Something that begins some times within so long, and each time ends after a while."""

    def course(dice: random.Random) -> Schedule:
        happen = []
        for _ in range(times):
            at_s = dice.uniform(0.0, within_s)
            happen.append(ScheduledFault(at_s, *begin(dice)))
            happen.append(ScheduledFault(at_s + dice.uniform(*lasts_s), *end))
        return happen

    return course


def height(dice: random.Random) -> Schedule:
    """The altitude estimate jumps, and perhaps comes back."""
    off_m = dice.choice((-1.0, 1.0)) * dice.uniform(3.0, 8.0)
    back_s = dice.choice((5.0, 20.0, math.inf))
    return [ScheduledFault(0.0, "off", off_m), ScheduledFault(back_s, "off", -off_m)]


def drift(sideways: float, up: float) -> Course:
    """The estimate drifts by so many metres a second."""

    def course(dice: random.Random) -> Schedule:
        angle_rad, sign = dice.uniform(0.0, 2 * math.pi), dice.choice((-1.0, 1.0))
        off = (sideways, angle_rad, sign * up)
        return [ScheduledFault(float(s), "drift", off) for s in range(dice.choice((15, 30)))]

    return course


def hand_back(dice: random.Random) -> Schedule:
    """The pilot takes over; the operator asks for it too early, then in time."""
    return [
        ScheduledFault(0.0, "pilot", dice.choice(_HELD)),
        ScheduledFault(2.5, "too early"),
        ScheduledFault(dice.uniform(3.0, 10.0), "hand back"),
    ]


def ready_taken(dice: random.Random) -> Schedule:
    """The pilot takes the vehicle on the ground, once it was looked at and before it is armed."""
    how = dice.choice(("POSCTL", "ALTCTL", "arm"))
    return [ScheduledFault(dice.uniform(2.5, 7.5), "before us", how)]


def hand_back_low(dice: random.Random) -> Schedule:
    """The pilot has it land, stops that well below its altitude, and hands it back."""
    return [
        ScheduledFault(0.0, "pilot", "AUTO_LAND"),
        ScheduledFault(dice.uniform(12.0, 24.0), "hand back"),
    ]


def blind_and_empty(dice: random.Random) -> Schedule:
    """No position comes any more, and the battery reaches its reserve meanwhile."""
    lost_s = dice.choice((90.0, math.inf))
    return [
        ScheduledFault(0.0, "stream", (POSITION, StreamFault.LOST, lost_s)),
        ScheduledFault(0.0, "battery", dice.uniform(22.0, 38.0)),
    ]


def restarted_on_another(dice: random.Random) -> Schedule:
    """A station puts another plan on board while no companion is there."""
    at_s = dice.uniform(1.0, 5.0)
    restart_s = at_s + dice.uniform(2.0, 10.0)
    return [
        ScheduledFault(0.0, "kill"),
        ScheduledFault(at_s, "plan", "other"),
        ScheduledFault(restart_s, "restart"),
    ]


def taken_in_haste(dice: random.Random) -> Schedule:
    """Commands of ours are lost or wait behind one that was, and the pilot chooses."""
    at_s = dice.uniform(2.0, 5.0)
    happen = [ScheduledFault(0.0, "send", at_s - 1.5), ScheduledFault(at_s - 1.6, "deaf", True)]
    if dice.randrange(2):
        happen.append(ScheduledFault(at_s - 0.8, "send again"))
    else:
        happen.append(ScheduledFault(at_s - 0.8, "hold"))
    happen.append(ScheduledFault(at_s, "pilot", dice.choice(_SURE)))
    return [*happen, ScheduledFault(at_s + dice.choice((0.05, 0.5)), "deaf", False)]


def diverted(dice: random.Random) -> Schedule:
    """It holds on the operator's request, and a station sends it elsewhere, or a pilot flies it."""
    at_s = dice.uniform(40.0, 140.0)
    later_s = [at_s + dice.uniform(6.0, 8.0) + 4.0 * again for again in range(3)]
    happen = [ScheduledFault(at_s, "hold", phase="armed")]
    if dice.randrange(2):
        mode = dice.choice(("POSCTL", "ALTCTL"))
        return [*happen, ScheduledFault(later_s[0], "pilot", mode, "armed")]
    return happen + [ScheduledFault(each_s, "pause", True, "armed") for each_s in later_s]


def zone_in_haste(dice: random.Random) -> Schedule:
    """A zone is drawn over the vehicle while the way through it waits behind a lost command."""
    at_s = dice.uniform(4.0, 6.0)
    return [
        ScheduledFault(0.0, "send", at_s),
        ScheduledFault(at_s - 0.1, "deaf", True),
        ScheduledFault(at_s + 0.4, "send again"),
        ScheduledFault(at_s + 1.0, "zone over", dice.uniform(1.0, 3.0)),
        ScheduledFault(at_s + 1.5, "deaf", False),
    ]


def restart_taken(dice: random.Random) -> Schedule:
    """The pilot takes the vehicle from a companion that is dead, and it is started again."""
    taken_s = dice.uniform(0.5, 4.0)
    return [
        ScheduledFault(0.0, "kill"),
        ScheduledFault(taken_s, "pilot", dice.choice(_SURE[1:])),
        ScheduledFault(taken_s + dice.uniform(1.0, 10.0), "restart"),
    ]


def lie(dice: random.Random) -> Schedule:
    """The battery says that it is fuller than it is, while it empties fast."""
    share = dice.choice((0.2, 0.5, 1.0))
    return [
        ScheduledFault(0.0, "battery", dice.uniform(150.0, 400.0)),
        ScheduledFault(0.0, "fuller", share),
    ]


def walls(dice: random.Random) -> Schedule:
    """Walls on all sides, one after the other or at once; perhaps one is taken away again."""
    happen = [ScheduledFault(0.0, "battery", dice.uniform(250.0, 500.0))]
    walls = [ScheduledFault(6.0 * again, "wall", again) for again in range(4)]
    opened = [ScheduledFault(dice.uniform(40.0, 120.0), "open")] if dice.randrange(2) else []
    enclosed = [ScheduledFault(0.0, "enclose")] if dice.randrange(2) else walls
    return happen + enclosed + opened


def on_board(what: str, value: Callable[[random.Random], Any], *, back: float = 0.5) -> Course:
    """A station changes what is on board; perhaps the operator puts our plan there again."""

    def course(dice: random.Random) -> Schedule:
        happen = [ScheduledFault(0.0, what, value(dice))]
        if dice.random() < back:
            happen.append(ScheduledFault(dice.uniform(4.0, 15.0), "take back"))
        return happen

    return course


def two_stations(dice: random.Random) -> Schedule:
    """Two stations choose different modes, shortly one after the other."""
    first, second = dice.sample(("AUTO_RTL", "AUTO_LOITER", "AUTO_MISSION", "POSCTL"), 2)
    later_s = dice.choice((0.0, 0.1, 0.5, 2.0))
    return [ScheduledFault(0.0, "pilot", first), ScheduledFault(later_s, "second station", second)]
