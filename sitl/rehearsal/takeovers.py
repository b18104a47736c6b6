"""Courses in which a pilot or a ground station takes the vehicle, or what it flies by."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Final

from sitl.rehearsal.courses import Course, Row, chain, choice, often, steps, uniform
from sitl.rehearsal.fakes import StreamFault

ON_MODE: Final = ("AUTO_LOITER", "AUTO_RTL", "ORBIT", "AUTO_LAND", "POSCTL", "ALTCTL")
_HELD: Final = ("AUTO_LOITER", "AUTO_RTL", "ORBIT", "POSCTL")
SURE: Final = ("AUTO_LOITER", "AUTO_RTL", "AUTO_LAND", "POSCTL")
"""Modes that no PX4 refuses; in the first a restarted companion may take it back."""

NO_MULTICOPTERS: Final = (1, 4, 10, 20, 22)
"""MAV_TYPE: a fixed wing, a helicopter, a rover, and two VTOLs."""

NO_PX4: Final = (0, 3)
"""MAV_AUTOPILOT: a generic one, and ArduPilot."""

hand_back: Final = steps(
    (0.0, "pilot", choice(*_HELD)), (2.5, "too early"), (uniform(3.0, 10.0), "hand back")
)
"""The pilot takes over; the operator requests it too early, then in time."""

ZONES_TAKEN: Final[tuple[Course, ...]] = (
    chain(
        (uniform(5.0, 30.0), "reload", 25.0),
        (uniform(2.2, 6.0), "pilot", "AUTO_LOITER"),
        (10.0, "hand back"),
    ),
    chain(
        (uniform(5.0, 30.0), "pilot", "AUTO_LOITER"),
        (4.0, "reload", 25.0),
        (8.0, "hand back"),
    ),
)
"""A pilot takes it while a changed fence goes on board, or a zone is drawn while a pilot has it; it
is handed back, and what is drawn goes on board then."""

zone_over_taken: Final = chain(
    (uniform(15.0, 40.0), "pilot", "AUTO_LOITER"),
    (uniform(4.0, 7.0), "reload", uniform(0.0, 3.0)),
)
"""A zone is drawn over a vehicle that hovers for a pilot."""

hand_back_low: Final = steps((0.0, "pilot", "AUTO_LAND"), (uniform(5.0, 24.0), "hand back"))
"""The pilot has it land, stops that some way or well below its altitude, and hands it back."""

paused: Final = often("pause", 60, uniform(1.0, 3.0), lambda d: d.randrange(8) == 0)
disarmed: Final = steps((choice(0.0, 0.2, 1.0), "disarm", False))
plan_at_start: Final = steps((choice(0.0, 1.0, 2.0, 4.0), "plan", choice("same", "other")))
plan_in_renewal: Final = steps((0.0, "reload", 25.0), (uniform(2.5, 8.0), "plan", "other"))
"""A station puts its plan on board while ours is being put there anew."""

CHOSEN_BACK: Final[tuple[Course, ...]] = (
    steps((0.0, "request", "hold"), (6.0, "choose back"), (6.1, "request", "resume")),
    steps((0.0, "choose back"), (0.1, "request", "hold")),
    steps((0.0, "choose back"), (0.1, "random request", 0.8)),
    steps((0.0, "request", "hold"), (8.0, "choose back"), (8.1, "request", "land")),
)
"""The pilot chooses the mode of before as soon as a jump, a hold, a go-to or a landing of ours has
begun, and before any message shows it."""

LISTS_AMONG_OURS: Final[tuple[Course, ...]] = (
    *(
        steps((0.0, "list after", (ours, theirs), "ready"))
        for ours, theirs in (
            *(("fence", "fence"), ("rally", "fence"), ("rally", "rally")),
            *(("mission", "mission"), ("mission", "fence")),
        )
    ),
    *(
        steps((0.0, "list after", ("fence", theirs), "INIT"), (1.0, "reload", 25.0, "INIT"))
        for theirs in ("mission", "fence")
    ),
)
"""A station stores one of its lists as soon as one of ours is stored, and before the vehicle has
reported that: while we get ready, and while a changed fence is put on board."""

diverted_waiting: Final = steps(
    *((0.0, "request", "hold"), (6.0, "deaf", True), (6.1, "send again"), (6.3, "send again")),
    *((uniform(6.5, 7.3), "divert now", uniform(20.0, 38.0)), (uniform(7.8, 8.3), "deaf", False)),
)
"""A station sends it elsewhere in Hold while orders of ours wait for an answer of the vehicle."""

restart_taken: Final = chain(
    (0.0, "kill"),
    (uniform(0.5, 4.0), "pilot", choice(*SURE[1:])),
    (uniform(1.0, 10.0), "restart"),
)
"""The pilot takes the vehicle from a companion that is dead, and it is started again."""

replaced_alone: Final = chain(
    (0.0, "kill"), (uniform(1.0, 5.0), "plan", "other"), (uniform(2.0, 10.0), "restart")
)
"""A station puts another plan on board while no companion is there."""

zone_above: Final = steps(
    (0.0, "pilot", "AUTO_LAND"),
    (uniform(14.0, 20.0), "hand back"),
    (16.0, "zone above", uniform(10.0, 15.0)),
)
"""The pilot hands it back low, and a zone is drawn above it as it climbs."""

hand_back_moving: Final = steps(
    (0.0, "pilot", "AUTO_LAND"),
    (uniform(9.0, 14.0), "low away", uniform(35.0, 60.0)),
    (18.0, "resume on the way"),
    (30.0, "hand back"),
)
"""The pilot has it low, flies it elsewhere, and the operator requests it while it moves."""

ZONE_KINDS: Final = ("below", "above", "around", "across")
"""Where a zone applies, by the height of the vehicle that it is drawn over: everywhere the last."""

_ZONE_AT: Final[dict[str, tuple[Row, ...]]] = {
    "climb": ((0.0, "pilot", "AUTO_LAND"), (uniform(14.0, 20.0), "hand back")),
    "cruise": (),
    "hold": ((0.0, "request", "hold"),),
    "home": ((0.0, "request", "home"),),
    "descent": ((0.0, "request", "hold"), (8.0, "request", "land")),
    "landing": ((0.0, "request", "hold"), (8.0, "request", "land")),
}
"""What a vehicle does when a zone is drawn over it, and what has it do that."""


def _zone_at(moment: str, kind: str) -> Course:
    """A zone is drawn at such a moment; the pilot takes what hovers over a landing place."""
    lands = moment in {"descent", "landing"}
    ends: tuple[Row, ...] = ((50.0, "pilot", "AUTO_RTL"),) if lands else ()
    drawn = (16.0 if moment == "climb" else 9.0, "zone at", (moment, kind))
    return steps(*_ZONE_AT[moment], drawn, *ends)


ZONES_AT: Final = tuple(_zone_at(moment, kind) for moment in _ZONE_AT for kind in ZONE_KINDS)
"""A zone below, above, around or across the vehicle, in each part of a flight."""

hand_back_high: Final = steps(
    (0.0, "pilot", "AUTO_RTL"),
    (1.0, "pilot", "AUTO_LOITER"),
    (2.0, "climb", 26.0),
    (28.0, "hand back"),
    (uniform(40.0, 46.0), "climb", 12.0),
)


def wrong_vehicle(rng: random.Random) -> Iterator[Row]:
    """It is no multicopter from the start, or from just before it is armed."""
    yield rng.choice((0.0, 0.0, 6.0)), "airframe", rng.choice(NO_MULTICOPTERS)


def other_autopilot(rng: random.Random) -> Iterator[Row]:
    """Its HEARTBEATs name another autopilot, from the start or from just before it is armed."""
    yield rng.choice((0.0, 6.0)), "autopilot", rng.choice(NO_PX4)


def ready_taken(rng: random.Random) -> Iterator[Row]:
    """The pilot takes the vehicle on the ground, or arms it before it is looked at."""
    how, at_s = rng.choice(("POSCTL", "ALTCTL", "arm")), rng.uniform(2.5, 7.5)
    yield 0.5 if how == "arm" and rng.randrange(2) else at_s, "before us", how


def by_hand(rng: random.Random) -> Iterator[Row]:
    """A zone is drawn when all is ready; its fence is being refused as the pilot takes off."""
    yield 20.0, "stream", (("MISSION_COUNT",), StreamFault.LOST, 8.0)
    yield 20.0, "reject", 1
    yield 21.0, "reload", rng.uniform(25.0, 40.0)
    yield rng.uniform(22.5, 23.5), "before us", "AUTO_TAKEOFF"
    yield 110.0, "climb", 0.0


def misplaced(rng: random.Random) -> Iterator[Row]:
    """The pilot takes off, flies away low, and chooses Mission mode there.

    A station puts the same plan on board, or all is lost that would hold it until it is level.
    """
    yield 20.0, "before us", "AUTO_TAKEOFF"
    yield 30.0, "fly off", rng.uniform(7.0, 12.0)
    if rng.randrange(2):
        yield 48.0, "hand over"
        yield from ((at_s, "plan", "same") for at_s in (54.0, 68.0))
        yield 90.0, "pilot", "AUTO_LAND"
    else:
        yield 47.9, "deaf", True
        yield 48.0, "hand over"
        yield 85.0, "deaf", False
        yield 40.0, "battery", 100.0
        yield 85.0, "battery", rng.uniform(350.0, 450.0)


def silence_taken(rng: random.Random) -> Iterator[Row]:
    """The pilot chooses while nothing is received; perhaps the operator draws a zone meanwhile."""
    lasts_s = rng.choice((8.0, 20.0, 40.0))
    yield 0.0, "silent", True
    yield rng.uniform(0.5, lasts_s - 1.0), "pilot", rng.choice(SURE)
    if rng.randrange(2):
        yield rng.uniform(5.0, lasts_s - 1.0), "reload", rng.uniform(0.0, 30.0)
    yield lasts_s, "silent", False


SOCKETS_S: Final = (0.63, 20.0)
"""What a socket keeps by default of a PX4's messages, and what it can be set to keep."""


def stalled_taken(rng: random.Random) -> Iterator[Row]:
    """The companion stands still, the pilot chooses meanwhile, and an order of ours falls due."""
    lasts_s = rng.uniform(0.2, 2.0)
    taken_s = rng.uniform(0.0, max(0.0, lasts_s - 0.15))
    due_s = rng.uniform(0.0, taken_s)
    yield 0.0, "socket", rng.choice(SOCKETS_S)
    yield 0.0, "stall", lasts_s
    match rng.randrange(5):
        case 0:
            yield due_s, "fix", (1, 8.0)
        case 1:
            yield due_s, "reload", rng.uniform(-5.0, 25.0)
        case 2:
            yield due_s, "request", "hold"
        case 3:
            yield due_s, "request", "home"
        case _:
            yield due_s, "send again"
    yield taken_s, "pilot", rng.choice(SURE)


def diverted_close(rng: random.Random) -> Iterator[Row]:
    """It is sent here and there, and a station sends it towards a zone that it passes."""
    for again in range(8):
        yield 15.0 * again, "send again"
    yield from ((60.0 * again + rng.uniform(5.0, 20.0), "divert") for again in range(2))


def left_behind(rng: random.Random) -> Iterator[Row]:
    """A zone is drawn over it, and left; it comes home without its plan, and seems to be in it."""
    yield 0.0, "reload", 0.0
    yield rng.uniform(2.5, 3.5), "plan", "other"
    yield 18.0, "request", "home"
    yield 18.5, "mislead", 9.0
    yield 45.0, "pilot", "AUTO_RTL"


def doubted(rng: random.Random) -> Iterator[Row]:
    """Its altitude is in doubt, and the pilot takes it while zones go on board."""
    yield from ((float(second), "drift", (0.0, 0.0, -0.3)) for second in range(30))
    yield 1.0, "zone beyond", 60.0, "HOME"
    yield rng.uniform(2.0, 5.0), "pilot", rng.choice(("AUTO_LOITER", "POSCTL")), "HOME"


def doubted_among(rng: random.Random) -> Iterator[Row]:
    """Its altitude is in doubt, and zones below or above it lie around it and on its way home."""
    up_m_s = rng.choice((-0.3, 0.3))
    yield from ((float(second), "drift", (0.0, 0.0, up_m_s)) for second in range(30))
    yield 1.0, "zone homeward", rng.choice(("below", "above"))
    yield 9.0, "request", "hold"
    yield rng.uniform(13.0, 16.0), "zone at", ("hold", rng.choice(("below", "above")))


def doubted_walled(rng: random.Random) -> Iterator[Row]:
    """Its altitude is in doubt, and walls all around begin above it: no way is clear of those."""
    yield 0.0, "enclose above"
    yield from ((25.0 + second, "drift", (0.0, 0.0, -0.3)) for second in range(22))
    if rng.randrange(2):
        yield 85.0, "request", "home"
    else:
        yield 0.0, "battery", rng.uniform(500.0, 540.0)


def two_stations(rng: random.Random) -> Iterator[Row]:
    """Two stations choose different modes, shortly one after the other."""
    first, second = rng.sample(("AUTO_RTL", "AUTO_LOITER", "AUTO_MISSION", "POSCTL"), 2)
    yield 0.0, "pilot", first
    yield rng.choice((0.0, 0.1, 0.5, 2.0)), "second station", second


def taken_in_haste(rng: random.Random) -> Iterator[Row]:
    """Commands of ours are lost or wait behind one that was, and the pilot chooses."""
    at_s = rng.uniform(2.0, 5.0)
    yield 0.0, "send", at_s - 1.5
    yield at_s - 1.6, "deaf", True
    yield at_s - 0.8, *(("send again",) if rng.randrange(2) else ("request", "hold"))
    yield at_s, "pilot", rng.choice(SURE)
    yield at_s + rng.choice((0.05, 0.5)), "deaf", False


HELD_IN_HASTE: Final[tuple[Course, ...]] = (
    chain(
        (0.0, "send", 4.0),
        (7.9, "deaf", True),
        (0.1, "send again"),
        (1.3, "send again"),
        (0.3, "pilot", "AUTO_RTL"),
        (uniform(1.05, 1.2), "pilot", "AUTO_LOITER"),
        (4.0, "deaf", False),
    ),
    chain(
        (0.0, "deaf", True),
        (0.1, "request", "hold"),
        (0.6, "pilot", "AUTO_RTL"),
        (uniform(1.05, 1.2), "pilot", "AUTO_MISSION"),
        (6.0, "deaf", False),
    ),
)
"""The pilot takes over, and at once chooses the mode in which the vehicle was ours: a go-to waits
behind one that was lost, or a hold was lost and may leave again."""


def start_lost(rng: random.Random) -> Iterator[Row]:
    """Mission mode is lost on its way, and a station stores its plan before it may leave again."""
    stored_s = rng.uniform(1.4, 2.4)
    yield 0.0, "deaf", True
    yield stored_s, "plan", "other"
    yield stored_s + 0.1, "deaf", False


def diverted(rng: random.Random) -> Iterator[Row]:
    """It holds on the operator's request, and a station sends it elsewhere, or a pilot flies it."""
    at_s = rng.uniform(40.0, 140.0)
    later_s = [at_s + rng.uniform(6.0, 8.0) + 4.0 * again for again in range(3)]
    yield at_s, "request", "hold", "armed"
    if rng.randrange(2):
        yield later_s[0], "pilot", rng.choice(("POSCTL", "ALTCTL")), "armed"
    else:
        yield from ((each_s, "pause", True, "armed") for each_s in later_s)
