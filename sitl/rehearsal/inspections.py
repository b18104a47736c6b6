"""Courses of inspections: past all areas, in all states, whoever sends."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Final

from sitl.rehearsal.courses import FENCE, MISSION, Row

RALLY: Final = 2  # MAV_MISSION_TYPE
_MORE: Final = ("waypoints", "speed", "altitude", "timers", "margin", "reserve")
"""Keys that cannot be changed in flight."""

SENDERS: Final = ((1, 100), (1, 154), (1, 240), (2, 1), (42, 1), (2, 191), (1, 0), (0, 1))
"""System and component: camera, gimbal and radio of the vehicle, and other vehicles."""

CLAIMS: Final = (
    *("return", "land", "disarmed", "emergency", "mode", "elsewhere", "empty", "no fix"),
    *("landed", "item", "home", "target"),
)
"""What strangers claim about the vehicle, falsely."""

VERBS: Final = ("hold", "seek", "explore", "home", "land", "goto", "altitude", "reload", "resume")
_STATES: Final = ("climb", "INIT", "SEARCH", "COMM", "EXPL", "HOME", "LAND")
_IN_CLIMB: Final = ("hold", "seek", "explore", "home", "land", "goto", "altitude", "reload")
_GOING_ON: Final = ("resume", "explore", "seek")


def past_all(rng: random.Random) -> Iterator[Row]:
    """It is sent along both sides of every zone and fence, and to places too near to them."""
    yield 0.0, "vanish"
    for turn in range(18):
        yield 2.0 + 20.0 * turn, "pass", (turn, rng.random())


def stale(rng: random.Random) -> Iterator[Row]:
    """It is sent around corners while its position has not come for some time."""
    for turn in range(4):
        yield (
            2.0 + rng.uniform(26.0, 30.0) * turn,
            "stale corner",
            rng.choice((0.5, 0.6, 0.8, 1.2, 1.8)),
        )


def altered_lists(rng: random.Random) -> Iterator[Row]:
    """A corner of the fence, a rally point, or an item arrives in another place than was sent."""
    kind = rng.choice((FENCE, FENCE, RALLY, MISSION))
    number = rng.randrange(5) if kind == RALLY else rng.randrange(2, 16)
    yield 0.0, "alter", (number, rng.choice((6.0, float("inf"))), kind)


def fence_moved(rng: random.Random) -> Iterator[Row]:
    """A station stores a fence of as many points in other places; perhaps ours is wanted again."""
    yield 0.0, "move fence", rng.uniform(2.0, 4.5)
    if rng.randrange(2):
        yield rng.uniform(6.0, 15.0), "take back"


def zone_moved(rng: random.Random) -> Iterator[Row]:
    """The operator moves a zone about: as many corners each time, elsewhere."""
    for turn in range(4):
        yield 35.0 * turn + rng.uniform(0.0, 10.0), "move zone"


def resumed_among(rng: random.Random) -> Iterator[Row]:
    """The companion is killed, a zone is drawn, and the companion is started again."""
    kill_s = rng.uniform(8.0, 60.0)
    yield kill_s, "kill"
    yield kill_s + 1.0, "draw alone", rng.randrange(4) == 0
    yield kill_s + rng.uniform(2.0, 8.0), "restart"


def without_record(rng: random.Random) -> Iterator[Row]:
    """Killed on its way to a waypoint far on where a robot may be; the next one has no record.

    Robots come into contact in some of these, so that a search may have ended by then.
    """
    if rng.randrange(3):
        yield 0.0, "vanish"
    kill_s = rng.uniform(1.0, 30.0)
    yield kill_s, "kill"
    yield kill_s + rng.uniform(2.0, 25.0), "restart"


def file_changed(rng: random.Random) -> Iterator[Row]:
    """The operator changes other keys, alone and with a zone, and then the fence."""
    keys = list(_MORE)
    rng.shuffle(keys)
    for turn, key in enumerate(keys[:3]):
        yield 10.0 + 22.0 * turn, "change", (key, turn != 1)
    yield 85.0, "shrink", rng.uniform(0.02, 0.05)
    yield 110.0, "change", ("rally", True)
    yield 132.0, "change", ("acceptance", False)


def landed_at(rng: random.Random) -> Iterator[Row]:
    """Requested to land wherever it holds, at other altitudes, over zones that end below them."""
    for turn in range(5):
        at_s = 6.0 + 34.0 * turn
        yield at_s, "over low", None
        yield at_s + 12.0, "request", "hold"
        yield at_s + 17.0, "request", "land"
        yield at_s + 19.0, "request", f"altitude {rng.uniform(30.0, 60.0):.0f}"
        yield at_s + 31.0, "request", "land"


def of_two(rng: random.Random) -> Iterator[Row]:
    """The second of two UAVs: sent about, also over the other's home, with a landing there."""
    yield 4.0, "request", "hold"
    yield 9.0, "request", "land"
    yield 12.0, "to other home"
    yield 40.0, "request", "hold"
    yield 45.0, "request", "land"
    yield 48.0, "tour", (rng.choice((2, 3)), 3.0)
    yield 85.0, "request", "hold"
    yield 91.0, "request", "land"
    yield 95.0, "request", "resume"


def of_two_redrawn(rng: random.Random) -> Iterator[Row]:
    """Zones are moved about while it flies among the corridors of another UAV."""
    for turn in range(2):
        yield 30.0 * turn + rng.uniform(2.0, 20.0), "move zone"


def requested_everywhere(rng: random.Random) -> Iterator[Row]:
    """Every request in every state, by turns; then it goes on."""
    for state in _STATES:
        later_s = 0.3 if state in {"COMM", "LAND"} else rng.uniform(2.0, 6.0)
        first, second = rng.choice(VERBS), rng.choice(VERBS)
        if state == "climb":  # held there it would sink, as it may
            first, second = rng.choice(_IN_CLIMB), rng.choice(_IN_CLIMB)
        if state in {"INIT", "EXPL"} and rng.randrange(2):
            yield later_s, "move zone", None, state
            later_s += rng.uniform(1.2, 4.0)
        if state in {"INIT", "SEARCH", "EXPL"} and rng.randrange(2):
            first = rng.choice(("hold", "goto"))
        if state == "COMM" and rng.randrange(2):
            first, second = "goto", "resume"
        if state == "EXPL" and rng.randrange(2):  # the last of them: it ends the mission
            first, second = "hold", "home"
        yield later_s, "request verb", first, state
        yield later_s + rng.uniform(1.5, 9.0), "request verb", second, state
        if state not in {"climb", "HOME", "LAND"}:
            yield later_s + 16.0, "request verb", rng.choice(_GOING_ON), state


def requested_in_idle(rng: random.Random) -> Iterator[Row]:
    """With nothing left to explore, and no robot due, the operator sends this and that."""
    verbs = ["goto", "seek", "hold"]
    rng.shuffle(verbs)
    for turn, verb in enumerate(verbs):
        at_s = 3.0 + 26.0 * turn
        yield at_s, "request verb", verb, "IDLE"
        yield at_s + 12.0, "request verb", "resume", "IDLE"
    yield 85.0, "request verb", "home", "IDLE"


def claims(rng: random.Random) -> Iterator[Row]:
    """Other systems and components send false messages as the vehicle's autopilot."""
    claims, at_s = list(CLAIMS), 0.0
    rng.shuffle(claims)
    for turn in range(36):
        at_s += rng.uniform(1.0, 6.0)
        yield at_s, "claim", (claims[turn % len(claims)], rng.choice(SENDERS))


def carried(rng: random.Random) -> Iterator[Row]:
    """Robots drive away by turns, are received from near only, and send positions of others."""
    yield 0.0, "short range", 25.0
    yield 0.0, "carry"
    for turn in range(9):
        yield 16.0 * turn + rng.uniform(4.0, 12.0), "drive away", (turn, rng.random())


def forged(rng: random.Random) -> Iterator[Row]:
    """Robots hand over messages of others, true and forged."""
    yield 70.0, "short range", 8.0
    for turn in range(7):
        yield 11.0 * turn, "forge", rng.choice(("new", "new", "old", "own", "unknown"))
