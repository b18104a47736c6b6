"""What can go wrong in a rehearsed flight."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Final, NamedTuple


class Fault(Enum):
    """One kind of misfortune; the value is its line in the table."""

    NONE = "nothing"
    GUSTS = "wind to 10 m/s with gusts"
    JUMPS = "position estimate jumps by up to 4 m, and back"
    LOSS_1 = "1 % of all packets and acknowledgements lost"
    LOSS_5 = "5 % of all packets and acknowledgements lost"
    LOSS_20 = "20 % of all packets and acknowledgements lost"
    LATE = "commands arrive up to 4 s late"
    OLD = "what the vehicle says comes up to 2 s late"
    SILENCE = "vehicle silent for 0.5 to 60 s"
    NO_FIX = "GPS without a fix for 2 to 20 s"
    UPLOAD = "uploads rejected"
    BUSY = "jumps dropped while somebody downloads the plan"
    PILOT = "pilot takes over"
    HAND_BACK = "pilot takes over and hands back"
    PAUSE = "pilot pauses or diverts it in our own mode"
    RESTART = "companion killed and restarted"
    KILL = "companion killed for good"
    BATTERY = "battery falls fast"
    VANISH = "robots vanish"
    ZONE = "a zone is added on board in flight"
    RELOAD = "no-fly zones added by reload in flight"
    WALL = "walled in by reload in flight"
    REQUESTS = "requests at random moments"
    TWO = "two of these at once"


FLIGHTS: Final = MappingProxyType(
    {
        Fault.NONE: 6,
        Fault.GUSTS: 20,
        Fault.JUMPS: 20,
        Fault.LOSS_1: 8,
        Fault.LOSS_5: 10,
        Fault.LOSS_20: 16,
        Fault.LATE: 12,
        Fault.OLD: 12,
        Fault.SILENCE: 20,
        Fault.NO_FIX: 10,
        Fault.UPLOAD: 6,
        Fault.BUSY: 8,
        Fault.PILOT: 14,
        Fault.HAND_BACK: 14,
        Fault.PAUSE: 12,
        Fault.RESTART: 16,
        Fault.KILL: 8,
        Fault.BATTERY: 16,
        Fault.VANISH: 10,
        Fault.ZONE: 14,
        Fault.RELOAD: 16,
        Fault.WALL: 12,
        Fault.REQUESTS: 16,
        Fault.TWO: 24,
    }
)
"""How many flights each fault gets in a whole rehearsal."""

_LOSS: Final = MappingProxyType({Fault.LOSS_1: 0.01, Fault.LOSS_5: 0.05, Fault.LOSS_20: 0.2})
_SINGLE: Final = tuple(f for f in Fault if f not in {Fault.NONE, Fault.TWO, Fault.UPLOAD})


class Misfortune(NamedTuple):
    """Something that happens, `at_s` seconds after the vehicle is ready; `value` as it needs."""

    at_s: float
    what: str
    value: float = 0.0


_Course = Callable[[random.Random, float], list[Misfortune]]


def _jumps(dice: random.Random, _at_s: float) -> list[Misfortune]:
    happen = []
    for _ in range(4):
        at_s = dice.uniform(25.0, 170.0)
        happen.append(Misfortune(at_s, "jump", dice.uniform(0.0, 2 * math.pi)))
        happen.append(Misfortune(at_s + dice.uniform(3.0, 15.0), "jump back"))
    return happen


def _busy(dice: random.Random, _at_s: float) -> list[Misfortune]:
    happen = []
    for _ in range(5):
        at_s = dice.uniform(25.0, 160.0)
        happen.append(Misfortune(at_s, "busy", 1.0))
        happen.append(Misfortune(at_s + dice.uniform(1.0, 8.0), "busy"))
    return happen


def _walls(dice: random.Random, at_s: float) -> list[Misfortune]:
    """Walls on all sides; in half of the flights one of them is taken away again."""
    happen = [Misfortune(at_s, "battery", dice.uniform(250.0, 500.0))]
    happen += [Misfortune(at_s + 6.0 * again, "wall", again) for again in range(4)]
    if dice.randrange(2):
        happen.append(Misfortune(at_s + dice.uniform(40.0, 120.0), "open"))
    return happen


_COURSES: Final[Mapping[Fault, _Course]] = MappingProxyType(
    {
        Fault.JUMPS: _jumps,
        Fault.BUSY: _busy,
        Fault.SILENCE: lambda dice, at_s: [
            Misfortune(at_s, "silent", 1.0),
            Misfortune(at_s + dice.choice((0.5, 2.0, 5.0, 20.0, 60.0)), "silent"),
        ],
        Fault.NO_FIX: lambda dice, at_s: [
            Misfortune(at_s, "fix"),
            Misfortune(at_s + dice.uniform(2.0, 20.0), "fix", 1.0),
        ],
        Fault.PILOT: lambda dice, at_s: [Misfortune(at_s, "pilot", dice.randrange(4))],
        Fault.HAND_BACK: lambda dice, at_s: [
            Misfortune(at_s, "pilot", dice.randrange(3)),
            Misfortune(at_s + dice.uniform(3.0, 10.0), "hand back"),
        ],
        Fault.PAUSE: lambda dice, at_s: [  # until it flies in Hold by our command
            Misfortune(at_s + again, "pause", dice.randrange(8) == 0) for again in range(100)
        ],
        Fault.RESTART: lambda dice, at_s: [
            Misfortune(at_s, "kill"),
            Misfortune(at_s + dice.uniform(2.0, 40.0), "restart"),
        ],
        Fault.KILL: lambda _dice, at_s: [Misfortune(at_s, "kill")],
        Fault.BATTERY: lambda dice, at_s: [Misfortune(at_s, "battery", dice.uniform(60.0, 400.0))],
        Fault.VANISH: lambda _dice, at_s: [Misfortune(at_s / 2, "vanish")],
        Fault.RELOAD: lambda dice, at_s: [
            Misfortune(at_s + 40.0 * again, "reload", dice.uniform(-5.0, 40.0))
            for again in range(dice.randrange(1, 4))
        ],
        Fault.WALL: _walls,
        Fault.REQUESTS: lambda dice, _at_s: [
            Misfortune(dice.uniform(5.0, 170.0), "request", dice.random()) for _ in range(25)
        ],
        Fault.ZONE: lambda dice, at_s: [Misfortune(at_s, "zone", dice.uniform(10.0, 40.0))],
    }
)


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
    def late_s(self) -> float:
        """How much longer than usual commands take, at most."""
        return 4.0 if Fault.LATE in self.faults else 0.0

    @property
    def old_s(self) -> float:
        """How old the news of the vehicle are, at most."""
        return 2.0 if Fault.OLD in self.faults else 0.0

    @property
    def loss(self) -> float:
        """Share of packets that are lost."""
        return max((_LOSS.get(fault, 0.0) for fault in self.faults), default=0.0)

    def misfortunes(self) -> list[Misfortune]:
        """What happens when, in order."""
        dice = self.chance("when")
        happen = [
            misfortune
            for fault in sorted(self.faults, key=lambda fault: fault.name)
            if fault in _COURSES
            for misfortune in _COURSES[fault](dice, dice.uniform(30.0, 150.0))
        ]
        return sorted(happen, key=lambda misfortune: misfortune.at_s)

    def chance(self, what: str) -> random.Random:
        """Dice of their own for everything that is drawn."""
        return random.Random(f"{self.fault.name} {self.seed} {what}")  # noqa: S311 - rehearsal

    def __str__(self) -> str:
        both = f" ({', '.join(sorted(f.name for f in self.faults))})"
        return f"{self.fault.name}-{self.seed}{both if self.fault is Fault.TWO else ''}"


def scenes(share: float = 1.0) -> list[Scene]:
    """The flights of a rehearsal; `share` of each fault's, but at least one."""
    return [
        Scene(fault, seed)
        for fault, number in FLIGHTS.items()
        for seed in range(max(1, round(number * share)))
    ]
