"""Courses in which everything is looked at: past all areas, in all states, whoever speaks."""

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

SAID: Final = (
    *("return", "land", "disarmed", "emergency", "mode", "elsewhere", "empty", "no fix"),
    *("landed", "item", "home", "target"),
)
"""What strangers say of the vehicle, falsely."""

VERBS: Final = ("hold", "seek", "explore", "home", "land", "goto", "altitude", "reload", "resume")
_STATES: Final = ("climb", "INIT", "SEARCH", "COMM", "EXPL", "HOME", "LAND")
_IN_CLIMB: Final = ("hold", "seek", "explore", "home", "land", "goto", "altitude", "reload")
_GOING_ON: Final = ("resume", "explore", "seek")


def past_all(dice: random.Random) -> Iterator[Row]:
    """It is sent along both sides of every zone and fence, and to places too near to them."""
    yield 0.0, "vanish"
    for turn in range(18):
        yield 2.0 + 20.0 * turn, "pass", (turn, dice.random())


def stale(dice: random.Random) -> Iterator[Row]:
    """It is sent around corners while its position has not come for some time."""
    for turn in range(4):
        yield (
            2.0 + dice.uniform(26.0, 30.0) * turn,
            "stale corner",
            dice.choice((0.5, 0.6, 0.8, 1.2, 1.8)),
        )


def altered_lists(dice: random.Random) -> Iterator[Row]:
    """A corner of the fence, a rally point, or an item arrives in another place than was sent."""
    kind = dice.choice((FENCE, FENCE, RALLY, MISSION))
    number = dice.randrange(5) if kind == RALLY else dice.randrange(2, 16)
    yield 0.0, "alter", (number, dice.choice((6.0, float("inf"))), kind)


def fence_moved(dice: random.Random) -> Iterator[Row]:
    """A station stores a fence of as many points in other places; perhaps ours is wanted again."""
    yield 0.0, "move fence", dice.uniform(2.0, 4.5)
    if dice.randrange(2):
        yield dice.uniform(6.0, 15.0), "take back"


def zone_moved(dice: random.Random) -> Iterator[Row]:
    """The operator moves a zone about: as many corners each time, elsewhere."""
    for turn in range(4):
        yield 35.0 * turn + dice.uniform(0.0, 10.0), "move zone"


def resumed_among(dice: random.Random) -> Iterator[Row]:
    """The companion is killed, a zone is drawn, and the companion is started again."""
    kill_s = dice.uniform(8.0, 60.0)
    yield kill_s, "kill"
    yield kill_s + 1.0, "draw alone", dice.randrange(4) == 0
    yield kill_s + dice.uniform(2.0, 8.0), "restart"


def without_record(dice: random.Random) -> Iterator[Row]:
    """Killed on its way to a waypoint far on where a robot may be; the next one has no record.

    Robots are heard in some of these, so that a search may have ended by then.
    """
    if dice.randrange(3):
        yield 0.0, "vanish"
    kill_s = dice.uniform(1.0, 30.0)
    yield kill_s, "kill"
    yield kill_s + dice.uniform(2.0, 25.0), "restart"


def file_changed(dice: random.Random) -> Iterator[Row]:
    """The operator changes other keys, alone and with a zone, and then the fence."""
    keys = list(_MORE)
    dice.shuffle(keys)
    for turn, key in enumerate(keys[:3]):
        yield 10.0 + 22.0 * turn, "change", (key, turn != 1)
    yield 85.0, "shrink", dice.uniform(0.02, 0.05)
    yield 110.0, "change", ("rally", True)
    yield 132.0, "change", ("acceptance", False)


def landed_at(dice: random.Random) -> Iterator[Row]:
    """Asked to land wherever it holds, at other altitudes, over what ends below them."""
    for turn in range(5):
        at_s = 6.0 + 34.0 * turn
        yield at_s, "over low", None
        yield at_s + 12.0, "ask", "hold"
        yield at_s + 17.0, "ask", "land"
        yield at_s + 19.0, "ask", f"altitude {dice.uniform(30.0, 60.0):.0f}"
        yield at_s + 31.0, "ask", "land"


def of_two(dice: random.Random) -> Iterator[Row]:
    """The second of two UAVs: sent about, also over the other's home, and asked to land there."""
    yield 4.0, "ask", "hold"
    yield 9.0, "ask", "land"
    yield 12.0, "to other home"
    yield 40.0, "ask", "hold"
    yield 45.0, "ask", "land"
    yield 48.0, "tour", (dice.choice((2, 3)), 3.0)
    yield 85.0, "ask", "hold"
    yield 91.0, "ask", "land"
    yield 95.0, "ask", "resume"


def of_two_redrawn(dice: random.Random) -> Iterator[Row]:
    """Zones are moved about while it flies among the corridors of another UAV."""
    for turn in range(2):
        yield 30.0 * turn + dice.uniform(2.0, 20.0), "move zone"


def asked_everywhere(dice: random.Random) -> Iterator[Row]:
    """Everything is asked for in every state, by turns; then it goes on."""
    for state in _STATES:
        later_s = 0.3 if state in {"COMM", "LAND"} else dice.uniform(2.0, 6.0)
        first, second = dice.choice(VERBS), dice.choice(VERBS)
        if state == "climb":  # held there it would sink, as it may
            first, second = dice.choice(_IN_CLIMB), dice.choice(_IN_CLIMB)
        if state in {"INIT", "EXPL"} and dice.randrange(2):
            yield later_s, "move zone", None, state
            later_s += dice.uniform(1.2, 4.0)
        if state in {"INIT", "SEARCH", "EXPL"} and dice.randrange(2):
            first = dice.choice(("hold", "goto"))
        if state == "COMM" and dice.randrange(2):
            first, second = "goto", "resume"
        if state == "EXPL" and dice.randrange(2):  # the last of them: it ends the mission
            first, second = "hold", "home"
        yield later_s, "ask for", first, state
        yield later_s + dice.uniform(1.5, 9.0), "ask for", second, state
        if state not in {"climb", "HOME", "LAND"}:
            yield later_s + 16.0, "ask for", dice.choice(_GOING_ON), state


def asked_in_idle(dice: random.Random) -> Iterator[Row]:
    """With nothing left to explore, and no robot due, it is asked for this and that."""
    verbs = ["goto", "seek", "hold"]
    dice.shuffle(verbs)
    for turn, verb in enumerate(verbs):
        at_s = 3.0 + 26.0 * turn
        yield at_s, "ask for", verb, "IDLE"
        yield at_s + 12.0, "ask for", "resume", "IDLE"
    yield 85.0, "ask for", "home", "IDLE"


def claims(dice: random.Random) -> Iterator[Row]:
    """Other systems and components say this and that, as the vehicle's autopilot would."""
    words, at_s = list(SAID), 0.0
    dice.shuffle(words)
    for turn in range(36):
        at_s += dice.uniform(1.0, 6.0)
        yield at_s, "claim", (words[turn % len(words)], dice.choice(SENDERS))


def carried(dice: random.Random) -> Iterator[Row]:
    """Robots drive away by turns, are heard from near only, and tell where others are."""
    yield 0.0, "hard to hear", 25.0
    yield 0.0, "carry"
    for turn in range(9):
        yield 16.0 * turn + dice.uniform(4.0, 12.0), "drive away", (turn, dice.random())


def forged(dice: random.Random) -> Iterator[Row]:
    """Robots hand over what others said, and what they did not."""
    yield 70.0, "hard to hear", 8.0
    for turn in range(7):
        yield 11.0 * turn, "forge", dice.choice(("new", "new", "old", "own", "unknown"))
