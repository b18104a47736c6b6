"""What goes wrong in flights of the real programs: one row per fault, the times by chance.

The faults, and what can happen, are those of `sitl.rehearsal.faults`; a flight is shorter here.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from sitl.rehearsal import (
    BATTERY,
    BRIEF_S,
    CLAIMS,
    ITEM,
    LANDED,
    MODE,
    POSITION,
    SATELLITES,
    SENDERS,
    Course,
    Draw,
    Fault,
    Row,
    Scene,
    Schedule,
    choice,
    one,
    placed,
    steps,
    uniform,
)
from sitl.rehearsal.fakes import StreamFault

FLIGHT_S: Final = 80.0
"""About so long after arming such a flight is over; things happen at any time of it."""

STREAMS: Final[Mapping[Fault, tuple[str, ...]]] = MappingProxyType(
    {
        Fault.LOST_POSITION: ("LOCAL_POSITION_NED", *POSITION),
        Fault.LOST_BATTERY: (*BATTERY, "BATTERY_STATUS"),
        Fault.LOST_FIX: SATELLITES,
        Fault.LOST_LANDED: LANDED,
        Fault.LOST_ITEM: (*ITEM, "MISSION_ITEM_REACHED"),
        Fault.LOST_MODE: MODE,
    }
)
"""MAVLink messages of each stream."""

_LASTS: Final = choice(BRIEF_S, 30.0, 1e6)
_STREAM_FAULT: Final = choice(
    StreamFault.LOST, StreamFault.LOST, StreamFault.FROZEN, StreamFault.LATE
)
_AT_ANY_TIME: Final = uniform(0.5, FLIGHT_S)
_LONG_BEFORE_ITS_END: Final = uniform(8.0, FLIGHT_S - 20.0)
_STALLS: Final = choice(0.5, 2.0, 5.0, 20.0, 60.0)

MEETINGS: Final = frozenset({"COMM", "EXPL"})
"""States that only a flight of some length with robots comes to."""

_DEAFENING: Final = frozenset({"silent", "stream", "stall"})
_COMM_S: Final = 1.5
"""A meeting lasts about two seconds: all is gathered and given by then."""

_STATES: Final = ("HOLD", "COMM", "SEARCH", "HOME", "LAND", "INIT", "EXPL")
_CHOSEN: Final = ("AUTO_LOITER", "AUTO_RTL", "AUTO_LAND", "POSCTL", "ALTCTL")
_FLOWN_IN: Final = {
    **dict.fromkeys(("HOLD", "COMM", "SEARCH"), "AUTO_LOITER"),
    "LAND": "AUTO_LAND",
}
"""Modes that a flight chooses itself in a state: a pilot who chooses them changes nothing."""

_MEETING: Final = (1.0, "request", "seek io", "INIT")
INTRUSIONS: Final = ("noise", "old boot", "other vehicle", "truncated", "flood")
"""What strangers send; see `stations.intrusion`."""


def _stream(names: tuple[str, ...], kind: Draw = _STREAM_FAULT) -> Course:
    """One stream, in one of these ways, for a while; without names all of them."""

    def course(rng: random.Random) -> Iterator[Row]:
        value = (names, kind(rng), _LASTS(rng))
        yield _AT_ANY_TIME(rng), "stream", value

    return course


def _silence(rng: random.Random) -> Iterator[Row]:
    lasts_s, at_s = _STALLS(rng), _AT_ANY_TIME(rng)
    yield at_s, "silent", True
    yield at_s + lasts_s, "silent"


def _takeover(seed: int, rng: random.Random) -> Iterator[Row]:
    """In every state by turns, and there by every mode."""
    turn, number = divmod(seed, len(_STATES))
    state = _STATES[number]
    modes = [mode for mode in _CHOSEN if mode != _FLOWN_IN.get(state)]
    taken_s = rng.uniform(0.1, _COMM_S if state == "COMM" else 6.0)
    if state == "HOLD":
        yield rng.uniform(2.0, 8.0), "request", "hold", "INIT"
    elif state in MEETINGS:
        yield _MEETING
    yield taken_s, "pilot", modes[turn % len(modes)], state


def _hand_back(rng: random.Random) -> Iterator[Row]:
    back_s = rng.uniform(3.0, 10.0)
    yield 0.0, "pilot", rng.choice(("AUTO_RTL", "AUTO_LAND", "POSCTL"))
    yield back_s, "pilot", "AUTO_LOITER"
    yield from ((back_s + 2.0 + 2.0 * again, "resume") for again in range(8))


def _replaced(rng: random.Random) -> Iterator[Row]:
    if rng.randrange(2):
        yield _MEETING
        yield rng.uniform(0.1, _COMM_S), "plan", "other", "COMM"
    else:
        yield 0.0, "plan", "other"


def _two_stations(rng: random.Random) -> Iterator[Row]:
    first, second = rng.sample(_CHOSEN[:4], 2)
    yield 0.0, "pilot", first
    yield rng.uniform(0.0, 1.5), "second station", second


def _bursts(rng: random.Random) -> Iterator[Row]:
    at_s = 0.0
    while at_s < FLIGHT_S:
        at_s += rng.expovariate(1 / 8.0)
        yield at_s, "silent", True
        yield at_s + rng.uniform(0.3, 3.0), "silent"
        at_s += 3.0


def _landed(rng: random.Random) -> Iterator[Row]:
    """Held, requested to land there, and on if that is refused."""
    yield 0.0, "request", "hold"
    yield 8.0, "request", "land"
    yield 12.0 + rng.uniform(0.0, 3.0), "request", "resume"


def _requested(rng: random.Random) -> Iterator[Row]:
    """Everything that needs no place, one after the other."""
    verbs = ["hold", "seek io", "explore", "resume", "land", "reload", "home"]
    rng.shuffle(verbs)
    yield from ((6.0 * turn, "request", verb) for turn, verb in enumerate(verbs))


def _claim(rng: random.Random) -> tuple[str, tuple[int, int]]:
    """A false message, and in whose name."""
    return rng.choice(CLAIMS), rng.choice(SENDERS)


class WireKind(NamedTuple):
    """How one fault comes in flights of the real programs.

    Attributes:
        flights: How many of it a whole rehearsal has.
        course: What happens.
        begins_s: So many seconds after its phase began; None: the course has its times.
        phase: As in `ScheduledFault`.
    """

    flights: int
    course: Course = steps()
    begins_s: Draw | None = None
    phase: str = "armed"


WIRE: Final[Mapping[Fault, WireKind]] = MappingProxyType(
    {
        Fault.NONE: WireKind(6),
        Fault.GUSTS: WireKind(8),
        Fault.LOSS_1: WireKind(6),
        Fault.LOSS_5: WireKind(8),
        Fault.LOSS_20: WireKind(8),
        Fault.BURSTS: WireKind(10, _bursts),
        Fault.SILENCE: WireKind(12, _silence),
        Fault.OLD: WireKind(8, _stream((), lambda _: StreamFault.LATE)),
        **{fault: WireKind(12, _stream(names)) for fault, names in STREAMS.items()},
        Fault.PILOT: WireKind(35),  # see `WireScene.schedule`
        Fault.HAND_BACK: WireKind(16, _hand_back, uniform(12.0, 60.0)),
        Fault.STICKS: WireKind(12, one("sticks", uniform(2.0, 8.0)), _AT_ANY_TIME),
        Fault.TWO_STATIONS: WireKind(12, _two_stations, uniform(8.0, FLIGHT_S)),
        Fault.FENCE_DELETED: WireKind(8, one("fence"), _LONG_BEFORE_ITS_END),
        Fault.PLAN_REPLACED: WireKind(8, _replaced, _LONG_BEFORE_ITS_END),
        Fault.SAME_PLAN: WireKind(
            *(8, steps((0.0, "plan", "same"), *((4.0 + 3 * n, "resume") for n in range(4)))),
            _LONG_BEFORE_ITS_END,
        ),
        Fault.HOME_MOVED: WireKind(10, one("home", choice(-25, 15)), _AT_ANY_TIME),
        Fault.SPEED: WireKind(8, one("speed", 12.0), uniform(12.0, 50.0)),
        Fault.DISARMED: WireKind(6, one("disarm", value=False), uniform(0.0, 0.8)),
        Fault.KILLED_IN_AIR: WireKind(10, one("disarm", value=True), uniform(4.0, 75.0)),
        Fault.STOPPED: WireKind(14, one("stall", _STALLS), _AT_ANY_TIME),
        Fault.RESTART: WireKind(
            *(12, steps((0.0, "kill"), (uniform(2.0, 30.0), "restart"))),
            uniform(12.0, FLIGHT_S - 20.0),
        ),
        Fault.KILL: WireKind(6, one("kill"), uniform(12.0, 60.0)),
        Fault.REBOOT: WireKind(6, one("reboot"), _AT_ANY_TIME),
        Fault.MOVED_LINK: WireKind(6, one("move link"), _AT_ANY_TIME),
        Fault.BATTERY: WireKind(10, one("battery", uniform(60.0, 400.0)), _AT_ANY_TIME),
        Fault.HOSTILE: WireKind(
            *(10, steps(*[(_AT_ANY_TIME, "intrude", choice(*INTRUSIONS))] * 12)),
        ),
        Fault.RELOAD: WireKind(10, one("reload"), uniform(1.0, 30.0), "INIT"),
        Fault.TWO_VEHICLES: WireKind(4, one("second vehicle")),
        # Classes of errors: docs/evidence/rehearsal.md.
        Fault.MAP_FILES: WireKind(4),
        Fault.LOCAL_METRES: WireKind(2),
        Fault.CLAIMS: WireKind(
            *(8, steps(*[(_AT_ANY_TIME, "claim", _claim)] * 30)),
        ),
        Fault.RESUMED_AMONG: WireKind(
            *(4, steps((0.0, "kill"), (1.0, "draw"), (uniform(3.0, 8.0), "restart"))),
            uniform(12.0, 40.0),
            "INIT",
        ),
        Fault.FILE_CHANGED: WireKind(*(4, one("change", "speed_m_s")), uniform(2.0, 15.0), "INIT"),
        Fault.LANDED_AT: WireKind(4, _landed, uniform(4.0, 12.0), "INIT"),
        Fault.SECOND_UAV: WireKind(4, _landed, uniform(4.0, 12.0), "INIT"),
        Fault.ASKED_EVERYWHERE: WireKind(8, _requested, uniform(1.0, 4.0), "INIT"),
    }
)
"""About three hundred and forty flights."""


class WireScene(Scene):
    """One flight of the real programs; everything that is drawn follows from fault and seed."""

    def schedule(self) -> Schedule:
        """What happens when."""
        kind, rng = WIRE[self.fault], self.chance("when")
        later_s = 0.0 if kind.begins_s is None else kind.begins_s(rng)
        taken = self.fault is Fault.PILOT
        rows = _takeover(self.seed, rng) if taken else kind.course(rng)
        return placed(rows, kind.phase, later_s)

    @property
    def meets(self) -> bool:
        """Whether something is done in a meeting with a robot."""
        return any(each.phase in MEETINGS for each in self.schedule())

    @property
    def deafens(self) -> bool:
        """Whether the companion receives nothing, or nothing new, for a while."""
        return any(each.what in _DEAFENING for each in self.schedule())

    @property
    def judged(self) -> frozenset[str]:
        """The row of what is accepted: nothing need come of a stream that is gone for a moment."""
        brief = self.fault in STREAMS and self.schedule()[0].value[-1] <= BRIEF_S
        return frozenset({"BRIEF_STREAM" if brief else self.fault.name})


def wire_scenes(share: float = 1.0) -> list[WireScene]:
    """The flights of a rehearsal with the real programs; `share` of each fault's, at least one."""
    return [
        WireScene(fault, seed)
        for fault, kind in WIRE.items()
        for seed in range(max(1, round(kind.flights * share)))
    ]
