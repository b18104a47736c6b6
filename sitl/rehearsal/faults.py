"""What can go wrong in a rehearsed flight, and when: every fault a row, every flight a seed."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from sitl.rehearsal.stand_ins.link import StreamFault


class Misfortune(NamedTuple):
    """Something that happens.

    Attributes:
        at_s: Seconds after its phase of the flight began.
        what: Which; a method of `Script`.
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

_AT_ONCE: Final = frozenset({"ready", "armed"})
FLIGHT_S: Final = 260.0
BRIEF_S, SECONDS = 3.0, (30.0, math.inf)
"""How long a stream's fault lasts."""

_POSITION: Final = ("GLOBAL_POSITION_INT",)
_BATTERY: Final = ("SYS_STATUS",)
_SATELLITES: Final = ("GPS_RAW_INT",)
_LANDED: Final = ("EXTENDED_SYS_STATE",)
_ITEM: Final = ("MISSION_CURRENT",)
_MODE: Final = ("HEARTBEAT", "CURRENT_MODE")
_STREAMS: Final = (_POSITION, _BATTERY, _SATELLITES, _LANDED, _ITEM, _MODE)

_ON_MODE: Final = ("AUTO_LOITER", "AUTO_RTL", "ORBIT", "AUTO_LAND", "POSCTL", "ALTCTL")
_HELD: Final = ("AUTO_LOITER", "AUTO_RTL", "ORBIT", "POSCTL")
_SURE: Final = ("AUTO_LOITER", "AUTO_RTL", "AUTO_LAND", "POSCTL")
"""Modes that no PX4 refuses; in the first a restarted companion may take it back."""

Happen = list[Misfortune]
Course = Callable[[random.Random], Happen]


def _stream(*names: str) -> Course:
    """One stream, in one of the ways."""

    def course(dice: random.Random) -> Happen:
        kind = dice.choice(tuple(StreamFault))
        return [Misfortune(0.0, "stream", (names, kind, dice.choice(SECONDS)))]

    return course


def _brief(dice: random.Random) -> Happen:
    names, kind = dice.choice(_STREAMS), dice.choice(tuple(StreamFault))
    return [Misfortune(0.0, "stream", (names, kind, BRIEF_S))]


def _one(what: str, draw: Callable[[random.Random], Any]) -> Course:
    return lambda dice: [Misfortune(0.0, what, draw(dice))]


def _span(what: str, on: object, off: object, seconds: Callable[[random.Random], float]) -> Course:
    return lambda dice: [Misfortune(0.0, what, on), Misfortune(seconds(dice), what, off)]


def _often(
    what: str, times: int, every: tuple[float, float], value: Callable[[random.Random], Any]
) -> Course:
    """Again and again, each a while after the one before."""

    def course(dice: random.Random) -> Happen:
        at_s, happen = 0.0, []
        for _ in range(times):
            happen.append(Misfortune(at_s, what, value(dice)))
            at_s += dice.uniform(*every)
        return happen

    return course


def _jumps(dice: random.Random) -> Happen:
    happen = []
    for _ in range(4):
        at_s = dice.uniform(0.0, 150.0)
        happen.append(Misfortune(at_s, "jump", dice.uniform(0.0, 2 * math.pi)))
        happen.append(Misfortune(at_s + dice.uniform(3.0, 15.0), "jump back"))
    return happen


def _height(dice: random.Random) -> Happen:
    off_m = dice.choice((-1.0, 1.0)) * dice.uniform(3.0, 8.0)
    back_s = dice.choice((5.0, 20.0, math.inf))
    return [Misfortune(0.0, "off", (0.0, off_m)), Misfortune(back_s, "off", (0.0, -off_m))]


def _drift(sideways: float, up: float) -> Course:
    def course(dice: random.Random) -> Happen:
        angle_rad, sign = dice.uniform(0.0, 2 * math.pi), dice.choice((-1.0, 1.0))
        off = (sideways, angle_rad, sign * up)
        return [Misfortune(float(s), "drift", off) for s in range(dice.choice((15, 30)))]

    return course


def _busy(dice: random.Random) -> Happen:
    happen = []
    for _ in range(6):
        at_s = dice.uniform(0.0, 160.0)
        happen.append(Misfortune(at_s, "busy", True))
        happen.append(Misfortune(at_s + dice.uniform(1.0, 8.0), "busy", False))
    return happen


def _hand_back(dice: random.Random) -> Happen:
    return [
        Misfortune(0.0, "pilot", dice.choice(_HELD)),
        Misfortune(2.5, "too early"),
        Misfortune(dice.uniform(3.0, 10.0), "hand back"),
    ]


def _taken_in_haste(dice: random.Random) -> Happen:
    """Commands of ours are lost or wait behind one that was, and the pilot chooses."""
    at_s = dice.uniform(2.0, 5.0)
    happen = [Misfortune(0.0, "send", at_s - 1.5), Misfortune(at_s - 1.6, "deaf", True)]
    if dice.randrange(2):
        happen.append(Misfortune(at_s - 0.8, "send again"))
    else:
        happen.append(Misfortune(at_s - 0.8, "hold"))
    happen.append(Misfortune(at_s, "pilot", dice.choice(_SURE)))
    return [*happen, Misfortune(at_s + dice.choice((0.05, 0.5)), "deaf", False)]


def _zone_in_haste(dice: random.Random) -> Happen:
    """A zone is drawn over the vehicle while the way through it waits behind a lost command."""
    at_s = dice.uniform(4.0, 6.0)
    return [
        Misfortune(0.0, "send", at_s),
        Misfortune(at_s - 0.1, "deaf", True),
        Misfortune(at_s + 0.4, "send again"),
        Misfortune(at_s + 1.0, "zone over", dice.uniform(1.0, 3.0)),
        Misfortune(at_s + 1.5, "deaf", False),
    ]


def _restart_taken(dice: random.Random) -> Happen:
    """The pilot takes the vehicle from a companion that is dead, and it is started again."""
    taken_s = dice.uniform(0.5, 4.0)
    return [
        Misfortune(0.0, "kill"),
        Misfortune(taken_s, "pilot", dice.choice(_SURE[1:])),
        Misfortune(taken_s + dice.uniform(1.0, 10.0), "restart"),
    ]


def _lie(dice: random.Random) -> Happen:
    """The battery says that it is fuller than it is, while it empties fast."""
    share = dice.choice((0.2, 0.5, 1.0))
    return [
        Misfortune(0.0, "battery", dice.uniform(150.0, 400.0)),
        Misfortune(0.0, "fuller", share),
    ]


def _walls(dice: random.Random) -> Happen:
    """Walls on all sides; in half of the flights one of them is taken away again."""
    happen = [Misfortune(0.0, "battery", dice.uniform(250.0, 500.0))]
    happen += [Misfortune(6.0 * again, "wall", again) for again in range(4)]
    if dice.randrange(2):
        happen.append(Misfortune(dice.uniform(40.0, 120.0), "open"))
    return happen


def _on_board(what: str, value: Callable[[random.Random], Any], *, back: float = 0.5) -> Course:
    """A station changes what is on board; perhaps the operator puts our plan there again."""

    def course(dice: random.Random) -> Happen:
        happen = [Misfortune(0.0, what, value(dice))]
        if dice.random() < back:
            happen.append(Misfortune(dice.uniform(4.0, 15.0), "take back"))
        return happen

    return course


def _two_stations(dice: random.Random) -> Happen:
    first, second = dice.sample(("AUTO_RTL", "AUTO_LOITER", "AUTO_MISSION", "POSCTL"), 2)
    later_s = dice.choice((0.0, 0.1, 0.5, 2.0))
    return [Misfortune(0.0, "pilot", first), Misfortune(later_s, "second station", second)]


class Kind(NamedTuple):
    """A row of the table of faults.

    Attributes:
        words: Its line in the report.
        flights: How many of it a whole rehearsal has.
        course: What happens.
        phase: Where it begins, if that is not to be drawn.
    """

    words: str
    flights: int
    course: Course = lambda _: []
    phase: str = ""


class Fault(Enum):
    """One kind of misfortune."""

    NONE = Kind("nothing", 6)
    GUSTS = Kind("wind to 10 m/s with gusts", 20)
    STORM = Kind("wind of 12 to 25 m/s with gusts", 12)
    JUMPS = Kind("position estimate jumps by up to 4 m, and back", 20, _jumps, "INIT")
    DRIFT = Kind("position estimate drifts by 0.3 m/s", 12, _drift(0.3, 0.0))
    ALTITUDE_JUMPS = Kind("altitude estimate jumps by 3 to 8 m", 16, _height)
    BAROMETER = Kind("altitude estimate drifts by 0.3 m/s", 12, _drift(0.0, 0.3))
    LOSS_1 = Kind("1 % of all packets lost", 8)
    LOSS_5 = Kind("5 % of all packets lost", 10)
    LOSS_20 = Kind("20 % of all packets lost", 16)
    BURSTS = Kind("bursts of loss: all packets for 0.5 to 5 s, again and again", 16)
    LATE = Kind("commands arrive up to 4 s late", 12)
    OLD = Kind("what the vehicle says comes up to 2 s late", 12)
    SILENCE = Kind(
        "vehicle silent for 0.5 to 60 s",
        20,
        _span("silent", on=True, off=False, seconds=lambda d: d.choice((0.5, 2, 5, 20, 60))),
    )
    BRIEF_STREAM = Kind("one stream lost, frozen, late or wrong for 3 s", 30, _brief)
    LOST_POSITION = Kind("position lost, frozen, late or wrong", 24, _stream(*_POSITION))
    LOST_BATTERY = Kind("battery lost, frozen, late or wrong", 24, _stream(*_BATTERY))
    LOST_FIX = Kind("satellites lost, frozen, late or wrong", 24, _stream(*_SATELLITES))
    LOST_LANDED = Kind("landed state lost, frozen, late or wrong", 24, _stream(*_LANDED))
    LOST_ITEM = Kind("current item lost, frozen, late or wrong", 24, _stream(*_ITEM))
    LOST_MODE = Kind("mode lost, frozen, late or wrong", 24, _stream(*_MODE))
    NO_FIX = Kind(
        "GPS without a fix for 2 to 20 s",
        12,
        _span("satellites", on=0, off=12, seconds=lambda d: d.uniform(2.0, 20.0)),
    )
    UPLOAD = Kind("uploads rejected", 6, _one("reject", lambda d: d.randrange(2)), "ready")
    BUSY = Kind("jumps dropped while a station downloads the plan", 8, _busy, "INIT")
    PILOT = Kind("pilot takes over", 48, _one("pilot", lambda d: d.choice(_ON_MODE)))
    STICKS = Kind("pilot moves the sticks", 16, _one("sticks", lambda _: True))
    STICKS_ONLY = Kind(
        "pilot moves the sticks without COM_RC_OVERRIDE", 8, _one("sticks", lambda _: False)
    )
    HAND_BACK = Kind("pilot takes over and hands back", 20, _hand_back)
    TAKEN_IN_HASTE = Kind("pilot takes over while commands of ours wait", 16, _taken_in_haste)
    PAUSE = Kind(
        "pilot pauses or diverts it in our own mode",
        12,
        _often("pause", 60, (1.0, 3.0), lambda d: d.randrange(8) == 0),
    )
    TWO_STATIONS = Kind("two stations command at once", 16, _two_stations)
    DISARMED = Kind(
        "disarmed by a station right after the arming",
        8,
        lambda d: [Misfortune(d.choice((0.0, 0.2, 1.0)), "disarm", False)],
        "armed",
    )
    KILLED_IN_AIR = Kind("disarmed by force in the air", 12, _one("disarm", lambda _: True))
    HOME_MOVED = Kind(
        "home moved by a station: 25 m down, or 30 m sideways and 15 m up",
        20,
        _one("home", lambda d: d.choice(((0.0, -25.0), (30.0, 15.0)))),
    )
    SPEED = Kind(
        "another speed by a station", 6, _one("speed", lambda d: d.choice((2.0, 8.0, 12.0)))
    )
    PLAN_REPLACED = Kind("another mission put on board", 14, _on_board("plan", lambda _: "other"))
    SAME_PLAN = Kind("the same plan put on board again", 14, _on_board("plan", lambda _: "same"))
    PLAN_DELETED = Kind("mission deleted by a station", 8, _on_board("plan", lambda _: "none"))
    FENCE_DELETED = Kind(
        "fence deleted by a station", 10, _on_board("fence", lambda _: None, back=1.0)
    )
    ZONE = Kind(
        "a zone is added on board in flight",
        14,
        _on_board("fence", lambda d: d.uniform(10, 40), back=1.0),
    )
    REBOOT = Kind(
        "autopilot's link and clock start anew", 10, _one("reboot", lambda d: d.uniform(1, 6))
    )
    STOPPED = Kind(
        "companion stalled for 0.5 to 60 s",
        20,
        _one("stall", lambda d: d.choice((0.5, 2.0, 5.0, 15.0, 60.0))),
    )
    RESTART = Kind(
        "companion killed and restarted",
        20,
        lambda d: [Misfortune(0.0, "kill"), Misfortune(d.uniform(2.0, 40.0), "restart")],
    )
    RESTART_TAKEN = Kind("pilot takes over while the companion is down", 16, _restart_taken)
    KILL = Kind("companion killed for good", 12, _one("kill", lambda _: None))
    BATTERY = Kind("battery falls fast", 16, _one("battery", lambda d: d.uniform(60.0, 400.0)))
    BATTERY_LIES = Kind("battery falls fast and says otherwise", 12, _lie)
    VANISH = Kind("robots vanish", 10, _one("vanish", lambda _: None))
    ONE_DEAD = Kind(
        "another UAV seeks the same robots, and dies",
        8,
        _one("other uav", lambda d: d.uniform(5, 60)),
        "climb",
    )
    MAD_ROBOTS = Kind(
        "robots tell nonsense: future, NaN, jumps, zones",
        20,
        _one("mad", lambda d: d.choice(("future", "nan", "jump", "zone", "far", "stamp"))),
        "climb",
    )
    RELOAD = Kind(
        "no-fly zones added by reload in flight",
        16,
        lambda d: [
            Misfortune(40.0 * again, "reload", d.uniform(-5.0, 40.0))
            for again in range(d.randrange(1, 4))
        ],
    )
    WALL = Kind("walled in by reload in flight", 12, _walls)
    ZONE_ACROSS = Kind(
        "a zone is drawn across the leg under way",
        12,
        _often("zone across", 3, (25.0, 50.0), lambda d: d.uniform(0.0, 6.0)),
    )
    ZONE_IN_HASTE = Kind("a zone is drawn over a way that waits", 12, _zone_in_haste, "SEARCH")
    CORNERS = Kind(
        "sent around a corner that it does not stop at",
        12,
        _often("corner", 4, (20.0, 35.0), lambda d: d.randrange(2) == 0),
        "INIT",
    )
    REQUESTS = Kind(
        "requests at random moments",
        16,
        _often("request", 25, (1.0, 12.0), lambda d: d.random()),
        "climb",
    )
    TWO = Kind("two of these at once", 40)

    def __reduce_ex__(self, _: object) -> tuple[object, ...]:
        """By its name: courses do not go from process to process."""
        return getattr, (Fault, self.name)

    @property
    def words(self) -> str:
        """Its line in the report."""
        return self.value.words


FLIGHTS: Final = MappingProxyType({fault: fault.value.flights for fault in Fault})
"""How many flights each fault gets in a whole rehearsal."""

LOSS: Final[Mapping[Fault, float]] = MappingProxyType(
    {Fault.LOSS_1: 0.01, Fault.LOSS_5: 0.05, Fault.LOSS_20: 0.2}
)
DRAWN: Final = frozenset({Fault.RELOAD, Fault.WALL, Fault.ZONE_ACROSS, Fault.ZONE_IN_HASTE})
"""Zones are drawn into the mission file."""

_HASTE: Final = frozenset(
    {
        Fault.TAKEN_IN_HASTE,
        Fault.RESTART_TAKEN,
        Fault.ZONE_ACROSS,
        Fault.ZONE_IN_HASTE,
        Fault.CORNERS,
    }
)
"""Two things at once already."""

_ALONE: Final = _HASTE | {Fault.NONE, Fault.TWO, Fault.UPLOAD}
_SINGLE: Final = tuple(f for f in Fault if f not in _ALONE)


@dataclass(frozen=True, slots=True)
class Scene:
    """One flight to be rehearsed; everything in it follows from fault and seed."""

    fault: Fault
    seed: int

    @property
    def faults(self) -> frozenset[Fault]:
        """What goes wrong in it."""
        if self.fault is not Fault.TWO:
            return frozenset({self.fault})
        return frozenset(self.chance("two").sample(_SINGLE, 2))

    @property
    def loss(self) -> float:
        """Share of packets that are lost."""
        return max((LOSS.get(fault, 0.0) for fault in self.faults), default=0.0)

    def misfortunes(self) -> Happen:
        """What happens when."""
        happen: Happen = []
        for fault in sorted(self.faults, key=lambda fault: fault.name):
            dice = self.chance(f"when {fault.name}")
            phase, later_s = self._begin(fault, dice)
            happen += [
                m if m.phase else m._replace(at_s=m.at_s + later_s, phase=phase)
                for m in fault.value.course(dice)
            ]
        return happen

    def _begin(self, fault: Fault, dice: random.Random) -> tuple[str, float]:
        """Its phase, by turns so that each gets its share, and how long after its beginning."""
        if fault.value.phase:
            at_once = fault.value.phase in _AT_ONCE
            return fault.value.phase, 0.0 if at_once else dice.uniform(0.0, 10.0)
        turn = self.seed % (len(PHASES) * 3 // 2)
        if turn >= len(PHASES):
            return "armed", dice.uniform(0.0, FLIGHT_S)
        return PHASES[turn], dice.choice((0.0, dice.uniform(0.0, 8.0)))

    def chance(self, what: str) -> random.Random:
        """Dice of their own for everything that is drawn."""
        return random.Random(f"{self.fault.name} {self.seed} {what}")  # noqa: S311 - rehearsal

    def __str__(self) -> str:
        both = f" ({', '.join(sorted(f.name for f in self.faults))})"
        return f"{self.fault.name}-{self.seed}{both if self.fault is Fault.TWO else ''}"


def scenes(share: float = 1.0, seed: int | None = None) -> list[Scene]:
    """The flights of a rehearsal.

    Args:
        share: Of each fault's, but at least one.
        seed: Only this one of each, whether a whole rehearsal has it or not.
    """
    return [
        Scene(fault, number)
        for fault, flights in FLIGHTS.items()
        for number in (range(max(1, round(flights * share))) if seed is None else (seed,))
    ]
