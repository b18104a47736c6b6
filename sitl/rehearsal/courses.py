"""What can happen in a rehearsed flight, one after the other: the courses of its faults.

A course is a list of rows (at what time, what, a value, in which phase), or draws one at random.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NamedTuple

from sitl.rehearsal.fakes import StreamFault


class ScheduledFault(NamedTuple):
    """Something that happens.

    Attributes:
        at_s: Seconds after its phase of the flight began.
        what: Which; a method of the flight, or of its operator, without its `do_`.
        value: As it needs.
        phase: A mission state, "climb" or "landing", counted from when it is entered first;
            "armed": from when the vehicle was armed; "ready": from when the companion starts;
            empty: by the scene.
    """

    at_s: float
    what: str
    value: Any = None
    phase: str = ""


Schedule = list[ScheduledFault]
Draw = Callable[[random.Random], Any]
Row = tuple[Any, ...]
"""The values of a `ScheduledFault`; those that are `Draw`s are drawn."""

Course = Callable[[random.Random], Iterable[Row]]

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
MISSION, FENCE = 0, 1  # MAV_MISSION_TYPE

WRONG_STREAMS: Final = {
    POSITION: "LOST_POSITION",
    BATTERY: "LOST_BATTERY",
    SATELLITES: "WRONG_FIX",
    LANDED: "LOST_LANDED",
    ITEM: "LOST_ITEM",
    MODE: "LOST_MODE",
}
"""The judge's row for a stream whose messages are believable, and not true."""


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


def placed(rows: Iterable[Row], phase: str, later_s: float) -> Schedule:
    """A schedule; a row without a phase gets this one, and comes so much later."""
    schedule = itertools.starmap(ScheduledFault, rows)
    return [m if m.phase else m._replace(at_s=m.at_s + later_s, phase=phase) for m in schedule]


# Values that are drawn.


def uniform(low: float, high: float) -> Draw:
    """Any number between these."""
    return lambda rng: rng.uniform(low, high)


def choice(*options: object) -> Draw:
    """One of these."""
    return lambda rng: rng.choice(options)


def _drawn(row: Row, rng: random.Random) -> Row:
    return tuple(part(rng) if callable(part) else part for part in row)


# Courses of every kind.


def steps(*rows: Row) -> Course:
    """These, each so many seconds after the beginning."""
    return lambda rng: [_drawn(row, rng) for row in rows]


def chain(*rows: Row) -> Course:
    """These, each so many seconds after the one before."""

    def course(rng: random.Random) -> Iterator[Row]:
        at_s = 0.0
        for row in rows:
            delay_s, *what = _drawn(row, rng)
            at_s += delay_s
            yield at_s, *what

    return course


def one(what: str, value: object = None) -> Course:
    """One thing, at once."""
    return steps((0.0, what, value))


def often(what: str, times: int, every: Draw, value: Draw) -> Course:
    """Again and again, each a while after the one before."""

    def course(rng: random.Random) -> Iterator[Row]:
        at_s = 0.0
        for _ in range(times):
            yield at_s, what, value(rng)
            at_s += every(rng)

    return course


def intervals(times: int, within_s: float, begin: Row, end: Row, lasts_s: Draw) -> Course:
    """Something that begins some times within so long, and each time ends after a while."""

    def course(rng: random.Random) -> Iterator[Row]:
        for _ in range(times):
            at_s = rng.uniform(0.0, within_s)
            yield at_s, *_drawn(begin, rng)
            yield at_s + lasts_s(rng), *end

    return course


def stream(*names: str) -> Course:
    """One stream, in one of the ways."""
    kinds = tuple(StreamFault)
    return one("stream", lambda rng: (names, rng.choice(kinds), rng.choice(SECONDS)))


def on_board(what: str, value: object, *, back: float = 0.5) -> Course:
    """A station changes what is on board; perhaps the operator puts our plan there again."""

    def course(rng: random.Random) -> Iterator[Row]:
        yield _drawn((0.0, what, value), rng)
        if rng.random() < back:
            yield rng.uniform(4.0, 15.0), "take back"

    return course


def drift(sideways: float, up: float) -> Course:
    """The estimate drifts by so many metres a second."""

    def course(rng: random.Random) -> Iterator[Row]:
        angle_rad, sign = rng.uniform(0.0, 2 * math.pi), rng.choice((-1.0, 1.0))
        for second in range(rng.choice((15, 30))):
            yield float(second), "drift", (sideways, angle_rad, sign * up)

    return course


# Courses of one fault each.

pushed: Final = often("push", 5, uniform(15.0, 35.0), uniform(22.0, 40.0))
"""Gusts of so many m/s, each as soon as something is near."""

neared: Final = often("near", 4, uniform(25.0, 40.0), uniform(1.5, 3.0))
"""The estimate jumps until only so many metres are left to what is near."""

jumps: Final = intervals(
    4, 150.0, ("jump", uniform(0.0, 2 * math.pi)), ("jump back",), uniform(3.0, 15.0)
)
silence: Final = steps((0.0, "silent", True), (choice(0.5, 2, 5, 20, 55), "silent", False))
blind_and_empty: Final = steps(
    (0.0, "stream", lambda d: (POSITION, StreamFault.LOST, d.choice((90.0, math.inf)))),
    (0.0, "battery", uniform(22.0, 38.0)),
)
"""No position comes any more, and the battery reaches its reserve meanwhile."""

satellites_gone: Final = steps(
    (0.0, "satellites", 0),
    (uniform(7.0, 10.0), "stray", uniform(3.0, 20.0)),
    (uniform(11.0, 14.0), "home itself", uniform(15.0, 40.0)),
)
"""For good: PX4's failsafe lands, by a position that drifts, and home is set anew by PX4 itself."""

sticks_lost: Final = steps(
    (0.0, "transmitter", choice(2, 3)), (uniform(5.0, 15.0), "transmitter", 0)
)

altered: Final = one("alter", lambda d: (d.randrange(1, 40), d.choice((6.0, math.inf)), MISSION))
"""Which item, for how long its place is altered on the way, and of which list it is."""

busy: Final = intervals(6, 160.0, ("busy", True), ("busy", False), uniform(1.0, 8.0))
home_moved: Final = one("home", choice((0.0, -25.0), (30.0, 15.0)))
restart: Final = chain((0.0, "kill"), (uniform(2.0, 40.0), "restart"))
lie: Final = steps((0.0, "fuller", choice(0.2, 0.5, 1.0)), (0.0, "battery", uniform(150.0, 400.0)))
"""The battery reports more charge than it has, while it empties fast."""

glitches: Final = often("glitch", 4, uniform(12.0, 30.0), choice((0, 0.4), (0, 1.2), (20, 2.0)))
"""So many percent are reported as left, for so many seconds."""

mad_robots: Final = one("mad", choice("future", "nan", "jump", "zone", "far", "stamp"))
zones_across: Final = often("zone across", 3, uniform(25.0, 50.0), uniform(0.0, 6.0))


def brief(rng: random.Random) -> Iterator[Row]:
    """Any one stream, for a moment."""
    names, kind = rng.choice(tuple(WRONG_STREAMS)), rng.choice(tuple(StreamFault))
    yield 0.0, "stream", (names, kind, BRIEF_S)


def height(rng: random.Random) -> Iterator[Row]:
    """The altitude estimate jumps, and perhaps comes back."""
    off_m = rng.choice((-1.0, 1.0)) * rng.uniform(3.0, 8.0)
    yield 0.0, "off", off_m
    yield rng.choice((5.0, 20.0, math.inf)), "off", -off_m


def no_fix(rng: random.Random) -> Iterator[Row]:
    """Too few satellites, or a receiver that has none, or a fix that is reported as flat."""
    lasts_s, kind = rng.uniform(2.0, 20.0), rng.randrange(3)
    if kind:
        yield 0.0, "fix", (kind, lasts_s)
    else:
        yield from ((0.0, "satellites", 0), (lasts_s, "satellites", 12))


def no_fix_on_a_leg(rng: random.Random) -> Iterator[Row]:
    """The receiver reports no fix, or a flat one, as soon as a leg has begun."""
    yield rng.uniform(0.3, 1.0), "fix", (rng.choice((1, 2)), rng.uniform(20.0, 25.0))


def zone_in_haste(rng: random.Random) -> Iterator[Row]:
    """A zone is drawn over the vehicle while the way through it waits behind a lost command."""
    at_s = rng.uniform(4.0, 6.0)
    yield 0.0, "send", at_s
    yield at_s - 0.1, "deaf", True
    yield at_s + 0.4, "send again"
    yield at_s + 1.0, "zone over", rng.uniform(1.0, 3.0)
    yield at_s + 1.5, "deaf", False


def zones(rng: random.Random) -> Iterator[Row]:
    """Zones are drawn near the vehicle, or over it."""
    for again in range(rng.randrange(1, 4)):
        yield 40.0 * again, "reload", rng.uniform(-5.0, 40.0)


def walls(rng: random.Random) -> Iterator[Row]:
    """Walls on all sides, one after the other or at once; perhaps one is taken away again."""
    yield 0.0, "battery", rng.uniform(250.0, 500.0)
    if rng.randrange(2):
        yield rng.uniform(40.0, 120.0), "open"
    if rng.randrange(2):
        yield 0.0, "enclose"
    else:
        yield from ((6.0 * side, "wall", side) for side in range(4))


def refused(rng: random.Random) -> Iterator[Row]:
    """For a while or for good, and a zone is drawn near the vehicle."""
    for_good = rng.randrange(2)
    if rng.randrange(2):
        yield 0.0, "reject", for_good
    else:
        yield 0.0, "alter", (rng.randrange(12), math.inf if for_good else 6.0, FENCE)
    yield 1.0, "reload", rng.uniform(15.0, 40.0)
