"""What goes wrong in flights of the real programs: one line per class, the times by chance."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

FLIGHT_S: Final = 80.0
"""About so long after arming such a flight is over; things happen at any time of it."""

STREAMS: Final[Mapping[str, frozenset[int]]] = MappingProxyType(
    {
        "LOST_POSITION": frozenset({32, 33}),
        "LOST_BATTERY": frozenset({1, 147}),
        "LOST_FIX": frozenset({24}),
        "LOST_LANDED": frozenset({245}),
        "LOST_ITEM": frozenset({42, 46}),
        "LOST_MODE": frozenset({0, 436}),
    }
)
"""MAVLink messages of each stream."""

_BRIEF_S: Final = 3.0
_LASTS_S: Final = (_BRIEF_S, 30.0, 1e6)
MEETINGS: Final = frozenset({"COMM", "EXPL"})
"""States that only a flight of some length with robots comes to."""

_DEAFENING: Final = frozenset({"silence", "lose", "freeze", "delay", "stop"})

_COMM_S: Final = 1.5
"""A meeting lasts about two seconds: all is gathered and given by then."""

_STATES: Final = ("HOLD", "COMM", "SEARCH", "HOME", "LAND", "INIT", "EXPL")


class Act(NamedTuple):
    """Something that is done in a flight.

    Attributes:
        at_s: Simulated seconds after arming; or after what `when` says.
        what: A method of `flight.RealFlight` without its `do_`.
        value: As it needs.
        when: A state: not before the companion says that it entered it.
    """

    at_s: float
    what: str
    value: object = None
    when: str = ""


_Script = Callable[[random.Random], list[Act]]
_MEETING: Final = (Act(1.0, "ask", "seek io", "INIT"),)


def _any(dice: random.Random) -> float:
    return dice.uniform(0.5, FLIGHT_S)


def _spell(dice: random.Random, what: str, value: object, lasts_s: float) -> list[Act]:
    at_s = _any(dice)
    return [Act(at_s, what, value), Act(at_s + lasts_s, what)]


def _stream(name: str) -> _Script:
    return lambda dice: _spell(
        dice,
        dice.choice(("lose", "lose", "freeze", "delay")),
        name,
        dice.choice(_LASTS_S),
    )


def _takeover(seed: int, dice: random.Random) -> list[Act]:
    """In every state by turns, and there by every mode."""
    turn, number = divmod(seed, len(_STATES))
    state = _STATES[number]
    mine = "HOLD" if state in {"COMM", "SEARCH"} else state  # which a flight chooses there itself
    modes = [m for m in ("HOLD", "RETURN", "LAND", "POSCTL", "ALTCTL") if m != mine]
    soon_s = _COMM_S if state == "COMM" else 6.0
    act = Act(dice.uniform(0.1, soon_s), "mode", modes[turn % len(modes)], state)
    if state == "HOLD":
        return [Act(dice.uniform(2.0, 8.0), "ask", "hold", "INIT"), act]
    return [*_MEETING, act] if state in MEETINGS else [act]


def _hand_back(dice: random.Random) -> list[Act]:
    at_s = dice.uniform(12.0, 60.0)
    back_s = at_s + dice.uniform(3.0, 10.0)
    acts = [Act(at_s, "mode", dice.choice(("RETURN", "LAND", "POSCTL")))]
    acts += [Act(back_s, "mode", "HOLD")]
    return acts + [Act(back_s + 2.0 + 2.0 * again, "resume") for again in range(8)]


def _replaced(dice: random.Random) -> list[Act]:
    at_s = dice.uniform(8.0, FLIGHT_S - 20.0)
    if dice.randrange(2):
        return [*_MEETING, Act(dice.uniform(0.1, _COMM_S), "replan", "reversed", "COMM")]
    return [Act(at_s, "replan", "reversed")]


def _same_plan(dice: random.Random) -> list[Act]:
    at_s = dice.uniform(8.0, FLIGHT_S - 20.0)
    return [Act(at_s, "replan", "same"), *(Act(at_s + 4.0 + n, "resume") for n in range(0, 12, 3))]


def _two_stations(dice: random.Random) -> list[Act]:
    at_s = dice.uniform(8.0, FLIGHT_S)
    first, second = dice.sample(("HOLD", "RETURN", "LAND", "POSCTL"), 2)
    return [Act(at_s, "mode", first), Act(at_s + dice.uniform(0.0, 1.5), "other mode", second)]


def _stopped(dice: random.Random) -> list[Act]:
    at_s = _any(dice)
    return [Act(at_s, "stop"), Act(at_s + dice.choice((0.5, 2.0, 5.0, 20.0, 60.0)), "go on")]


def _restart(dice: random.Random) -> list[Act]:
    at_s = dice.uniform(12.0, FLIGHT_S - 20.0)
    return [Act(at_s, "kill"), Act(at_s + dice.uniform(2.0, 30.0), "restart")]


def _bursts(dice: random.Random) -> list[Act]:
    acts = []
    at_s = 0.0
    while at_s < FLIGHT_S:
        at_s += dice.expovariate(1 / 8.0)
        acts += [Act(at_s, "silence", True), Act(at_s + dice.uniform(0.3, 3.0), "silence", False)]
        at_s += 3.0
    return acts


def _hostile(dice: random.Random) -> list[Act]:
    kinds = ("noise", "old boot", "other vehicle", "truncated", "flood")
    return [Act(dice.uniform(0.5, FLIGHT_S), "intrude", dice.choice(kinds)) for _ in range(12)]


class Class(NamedTuple):
    """One class of scenes: how many flights, and what is done in them."""

    flights: int
    script: _Script


CLASSES: Final[Mapping[str, Class]] = MappingProxyType(
    {
        "NONE": Class(6, lambda _dice: []),
        "GUSTS": Class(8, lambda _dice: []),
        "LOSS_1": Class(6, lambda _dice: []),
        "LOSS_5": Class(8, lambda _dice: []),
        "LOSS_20": Class(8, lambda _dice: []),
        "BURSTS": Class(10, _bursts),
        "SILENCE": Class(
            12, lambda dice: _spell(dice, "silence", True, dice.choice((0.5, 2.0, 5.0, 20.0, 60.0)))
        ),
        "OLD": Class(8, lambda dice: _spell(dice, "delay", "", dice.choice(_LASTS_S))),
        **{name: Class(12, _stream(name)) for name in STREAMS},
        "PILOT": Class(35, lambda dice: _takeover(0, dice)),
        "HAND_BACK": Class(16, _hand_back),
        "STICKS": Class(12, lambda dice: [Act(_any(dice), "sticks", dice.uniform(2.0, 8.0))]),
        "TWO_STATIONS": Class(12, _two_stations),
        "FENCE_DELETED": Class(8, lambda dice: [Act(dice.uniform(8, FLIGHT_S - 20), "delete", 1)]),
        "PLAN_REPLACED": Class(8, _replaced),
        "SAME_PLAN": Class(8, _same_plan),
        "HOME_MOVED": Class(10, lambda dice: [Act(_any(dice), "home", dice.choice((-25, 15)))]),
        "SPEED": Class(8, lambda dice: [Act(dice.uniform(12, 50), "speed", 12.0)]),
        "DISARMED": Class(6, lambda dice: [Act(dice.uniform(0.0, 0.8), "disarm", False)]),
        "KILLED_IN_AIR": Class(10, lambda dice: [Act(dice.uniform(4, 75), "disarm", True)]),
        "STOPPED": Class(14, _stopped),
        "RESTART": Class(12, _restart),
        "KILL": Class(6, lambda dice: [Act(dice.uniform(12.0, 60.0), "kill")]),
        "REBOOT": Class(6, lambda dice: [Act(_any(dice), "reboot")]),
        "MOVED_LINK": Class(6, lambda dice: [Act(_any(dice), "move link")]),
        "BATTERY": Class(10, lambda dice: [Act(_any(dice), "battery", dice.uniform(60.0, 400.0))]),
        "HOSTILE": Class(10, _hostile),
        "RELOAD": Class(10, lambda dice: [Act(dice.uniform(1, 30), "reload", None, "INIT")]),
        "TWO_VEHICLES": Class(4, lambda _dice: [Act(0.0, "second vehicle")]),
    }
)
"""About three hundred flights."""

_LOSS: Final = {"LOSS_1": 0.01, "LOSS_5": 0.05, "LOSS_20": 0.2}


@dataclass(frozen=True, slots=True)
class WireScene:
    """One flight of the real programs; everything that is drawn follows from class and seed."""

    fault: str
    seed: int

    @property
    def loss(self) -> float:
        """Share of datagrams that are lost, each way."""
        return _LOSS.get(self.fault, 0.0)

    def acts(self) -> list[Act]:
        """What is done, one after the other."""
        dice = self.chance("when")
        if self.fault == "PILOT":
            return _takeover(self.seed, dice)
        acts = CLASSES[self.fault].script(dice)
        in_order = any(act.when for act in acts)
        return acts if in_order else sorted(acts, key=lambda act: act.at_s)

    @property
    def meets(self) -> bool:
        """Whether something is done in a meeting with a robot."""
        return any(act.when in MEETINGS for act in self.acts())

    @property
    def deafens(self) -> bool:
        """Whether the companion hears nothing, or nothing new, for a while."""
        return any(act.what in _DEAFENING for act in self.acts())

    @property
    def judged(self) -> str:
        """The row of what is accepted: nothing need come of a stream that is gone for a moment."""
        begins, *ends = self.acts() or [Act(0.0, "")]
        brief = self.fault in STREAMS and ends[0].at_s - begins.at_s <= _BRIEF_S
        return "BRIEF_STREAM" if brief else self.fault

    def chance(self, what: str) -> random.Random:
        """Dice of their own for everything that is drawn."""
        return random.Random(f"{self.fault} {self.seed} {what}")  # noqa: S311 - rehearsal

    def __str__(self) -> str:
        return f"{self.fault}-{self.seed}"


def wire_scenes(share: float = 1.0) -> list[WireScene]:
    """The flights of a rehearsal with the real programs; `share` of each class's, at least one."""
    return [
        WireScene(fault, seed)
        for fault, many in CLASSES.items()
        for seed in range(max(1, round(many.flights * share)))
    ]
