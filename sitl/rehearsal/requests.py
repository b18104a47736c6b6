"""What operators type: requests drawn at random, and flights in which nothing else happens."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator
from typing import Final

from air_router.mission import Mission
from geo.frame import Point
from sitl.rehearsal.courses import BATTERY, ITEM, SATELLITES, Row, choice, often, uniform
from sitl.rehearsal.fakes import StreamFault

_ROBOTS: Final = ("callisto", "europa", "io", "phantom")
_VERBS: Final = ((0.2, "hold"), (0.4, "resume"), (0.55, "seek"), (0.65, "explore"), (0.69, "home"))
"""Up to which number each is chosen."""

_BESIDE_M: Final = 40.0


def goto(mission: Mission, points: Iterable[Point]) -> str:
    """The request to fly to points of the mission's frame."""
    degrees = map(mission.frame.to_geodetic, points)
    return " ".join(["goto", *(f"{place[0]:.8f},{place[1]:.8f}" for place in degrees)])


def request_of(
    choice: float, rng: random.Random, mission: Mission, here: Point
) -> tuple[str, float | None, bool]:
    """A request by a number from 0 to 1: all verbs, points near waypoints and the vehicle.

    With how long to hover at the last point, and whether it waits for its time.
    """
    verb = next((verb for limit, verb in _VERBS if choice < limit), "goto")
    if verb != "goto":
        return f"seek {rng.choice(_ROBOTS)}" if verb == "seek" else verb, None, False
    count, waits = rng.choice((1, 1, 2, 5)), rng.random() < 0.2
    points = [_place(rng, mission, here) for _ in range(count)]
    return goto(mission, points), rng.choice((None, 0.0, 5.0)), waits


def _place(rng: random.Random, mission: Mission, here: Point) -> Point:
    beside = (rng.uniform(-_BESIDE_M, _BESIDE_M), rng.uniform(-_BESIDE_M, _BESIDE_M))
    east_m, north_m = rng.choice((here, rng.choice(mission.waypoints).position))
    return Point(east_m + beside[0], north_m + beside[1])


# Courses.

corners: Final = often("corner", 4, uniform(20.0, 35.0), choice(None, 0.0, 0.6, 0.7))
"""Around a corner at once, or so long after the hold."""

at_random: Final = often("random request", 25, uniform(1.0, 12.0), lambda d: d.random())


def sent(rng: random.Random) -> Iterator[Row]:
    """To several points, held on the way or at the last, and on; then a robot or exploring.

    Robots carry each other's poses meanwhile: those move a search, and end none.
    """
    yield 0.0, "carry"
    yield 0.0, "tour", (rng.choice((2, 3, 4)), rng.choice((None, 5.0, 12.0)))
    held_s = rng.choice((6.0, 20.0, 50.0, 500.0))
    yield held_s, "request", "hold"
    yield held_s + rng.uniform(3.0, 8.0), "request", "resume"
    yield 100.0, "random request", rng.choice((0.5, 0.6))
    yield 104.0, "request", "hold"
    yield 110.0, "request", "resume"


def explored(rng: random.Random) -> Iterator[Row]:
    """No robot, few waypoints; the companion may be killed, and started with --resume."""
    yield 0.0, "vanish"
    if rng.randrange(5):
        kill_s = rng.uniform(25.0, 90.0)
        yield kill_s, "kill"
        yield kill_s + rng.choice((0.5, 1.0, rng.uniform(2.0, 15.0))), "restart"


def landed_here(rng: random.Random) -> Iterator[Row]:
    """Requests to hold, and to land: at first while it still moves, then while it hovers."""
    at_s = rng.uniform(4.0, 60.0)
    yield at_s, "request", "hold"
    for later_s in (0.3, rng.uniform(0.5, 1.2), 8.0, 11.0):
        yield at_s + later_s, "request", "land"


def landed_on(rng: random.Random) -> Iterator[Row]:
    """Requests to hold, and to land; a zone is drawn below it, and the pilot takes it at last."""
    at_s = rng.uniform(4.0, 60.0)
    yield at_s, "request", "hold"
    yield at_s + 8.0, "request", "land"
    yield at_s + rng.uniform(14.0, 22.0), "zone below", rng.uniform(8.0, 12.0)
    yield at_s + 52.0, "pilot", "AUTO_RTL"


def altitudes(rng: random.Random) -> Iterator[Row]:
    """Held, and sent up and down: as it may be, out of that, again before it is there, and on.

    Held on its way down, too.
    """
    at_s = rng.uniform(4.0, 60.0)
    yield at_s, "request", "hold"
    for altitude_m in (rng.uniform(30.0, 60.0), 70.0, rng.uniform(30.0, 60.0), 25.0, 58.0):
        at_s += rng.uniform(6.0, 30.0)
        yield at_s, "request", f"altitude {altitude_m}"
    yield at_s + 25.0, "request", "altitude 32"
    yield at_s + 31.0, "request", "hold"  # on its way down
    yield at_s + 45.0, "request", "resume"


def home_for_good(rng: random.Random) -> Iterator[Row]:
    """Something ends the mission, and the operator sends other requests on the way home."""
    names, ends_s = rng.choice(((BATTERY, 30.0), (SATELLITES, 30.0), (ITEM, 60.0), ((), 25.0)))
    if names:
        yield 0.0, "stream", (names, StreamFault.LOST, 600.0)
    else:
        yield from ((float(second), "drift", (0.0, 0.0, 0.3)) for second in range(30))
    for again in range(12):
        drawn = rng.choice((0.1, 0.3, 0.5, 0.6, 0.8, 0.9))
        yield ends_s + 2.0 + 2.5 * again, "random request", drawn
