"""Whether a seek policy keeps its contract, for the tests of another package.

    import pytest
    from air_router.seek_policies.testing import SCENES, check
    from my_policy import Nearest

    @pytest.mark.parametrize("scene", SCENES, ids=str)
    def test_contract(scene):
        check(Nearest, scene)

`check` also returns the ranking, so a test can check more of a scene. A policy that passes may
still be a poor one; `sitl experiment` compares policies.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Final

from air_router.seek_policies import Point, Policy, SearchPlace, SeekContext, TargetList
from mocha_link.links import Direction

_SPEED_M_S: Final = 5.0
_ROUND_S: Final = 95.0
_UNSEEN: Final = Point(-150.0, 220.0)


@dataclass(frozen=True, slots=True)
class Scene:
    """A moment of a flight in which a policy is to rank the robots.

    Attributes:
        name: What is special about it.
        robots: How many there are.
        received: Share of the robots that the UAV has received poses of.
        paths: Whether these have published paths.
        lost: Robots that were last received half an hour ago.
        taken: Robots that another UAV seeks.
        walled: Places further east than this cannot be reached, in metres.
    """

    name: str
    robots: int = 5
    received: float = 1.0
    paths: bool = False
    lost: int = 0
    taken: int = 0
    walled: float = math.inf

    def __str__(self) -> str:
        """Its name, as pytest shows it."""
        return self.name

    @property
    def now_s(self) -> float:
        """The time on the vehicle's clock."""
        return 2400.0

    def targets(self) -> TargetList:
        """The robots, and what is known of each; a new list with every call."""
        rng = random.Random(self.name)  # noqa: S311 - the same scene each time
        targets = TargetList(tuple(f"robot{number + 1:02d}" for number in range(self.robots)))
        for number, track in enumerate(targets.tracks.values()):
            if number >= self.received * self.robots:
                continue
            at_s = self.now_s - (1800.0 if number < self.lost else rng.uniform(5.0, 400.0))
            place = Point(rng.uniform(-300.0, 300.0), rng.uniform(-300.0, 300.0))
            stamp_s = 1e9 + at_s  # no robot's clock is the vehicle's
            track.pose_received(place, stamp_s, at_s)
            if self.paths:
                ahead = [Point(place.east_m + 40.0 * n, place.north_m + 25.0 * n) for n in (1, 2)]
                track.path_received(tuple(ahead), stamp_s, at_s)
            for direction in (Direction.IN, Direction.OUT)[: rng.randrange(3)]:
                track.synced(direction, at_s)
        for number in range(self.taken):
            targets.sought_by_other(f"uav{number + 2:02d}", targets.names[-1 - number], self.now_s)
        return targets

    def context(self) -> SeekContext:
        """What the policy can see beside the robots: the vehicle is at the origin."""

        def straight_s(place: Point) -> float:
            return math.hypot(*place) / _SPEED_M_S

        def flight_s(place: Point) -> float:
            return math.inf if place.east_m > self.walled else 1.2 * straight_s(place)

        return SeekContext(
            now_s=self.now_s,
            began_s=60.0,
            flight_s=flight_s,
            leg_s=lambda a, b: math.dist(a, b) / _SPEED_M_S,
            straight_s=straight_s,
            unseen=_UNSEEN,
            round_s=_ROUND_S,
        )


SCENES: Final = (
    Scene("one robot", robots=1),
    Scene("no robot was received", received=0.0),
    Scene("some were never received", received=0.5),
    Scene("poses"),
    Scene("paths", paths=True),
    Scene("lost robots", robots=6, lost=2, paths=True),
    Scene("robots of another UAV", robots=6, taken=2),
    Scene("lost ones and robots of another UAV", robots=8, lost=2, taken=2, paths=True),
    Scene("no way to some", robots=6, walled=50.0, paths=True),
    Scene("no way to any", walled=-math.inf, paths=True),
    Scene("many robots", robots=40, received=0.8, paths=True),
)
"""What happens in flights and is easily forgotten."""


def check(make: Callable[[], Policy], scene: Scene) -> list[SearchPlace]:
    """Have a policy rank the robots of a scene; its ranking.

    Args:
        make: The policy's class: it is made without arguments.
        scene: One of `SCENES`, or one of your own.

    Raises:
        AssertionError: it does not keep its contract; the text has what, and where.
    """
    policy, targets, context = make(), scene.targets(), scene.context()
    _claim(isinstance(policy, Policy), f"{policy!r} has no foresees, order() and place()")
    _claim(isinstance(policy.foresees, bool), f"foresees is {policy.foresees!r}, not True or False")
    before = deepcopy(targets)
    ranking = list(policy.order(targets, context))
    for place in ranking:
        _check_place(place, targets)
    names = [place.robot for place in ranking]
    _claim(
        sorted(names) == sorted(targets.names),
        f"order() returned {', '.join(names) or 'nothing'}; it has to return every robot once",
    )
    group = {name: n for n, own in enumerate(before.groups(scene.now_s)) for name in own}
    numbers = [group[name] for name in names]
    _claim(
        numbers == sorted(numbers),
        f"order() returned {', '.join(names)}; robots that are lost come behind the others, those "
        f"that another UAV seeks come last: rank each group of targets.groups(context.now_s)",
    )
    for name in targets.names:
        found = policy.place(name, targets, context)
        _check_place(found, targets)
        _claim(found.robot == name, f"place('{name}') returned the place of '{found.robot}'")
    _claim(targets == before, "order() or place() has changed targets, which is to be read only")
    for other, what in ((policy, "the same policy"), (make(), "another object of its class")):
        again = list(other.order(scene.targets(), context))
        _claim(
            again == ranking,
            f"{what} ranks the same robots otherwise; keep nothing between calls, and use no "
            "clock and no random numbers: a replay of the flight has to decide alike",
        )
    return ranking


def _check_place(place: object, targets: TargetList) -> None:
    _claim(isinstance(place, SearchPlace), f"{place!r:.60} is no SearchPlace")
    if isinstance(place, SearchPlace):
        _claim(place.robot in targets.names, f"'{place.robot}' is no robot that is sought")
        points: list[object] = [*place.along, *filter(None, [place.position])]
        finite = all(isinstance(p, Point) and all(map(math.isfinite, p)) for p in points)
        _claim(finite, f"a place of '{place.robot}' is no finite Point")
        over = set(place.over)
        _claim(over <= set(targets.names), f"'{place.robot}' is over robots that are not sought")
        _claim(
            place.robot not in over and len(over) == len(place.over),
            f"over of '{place.robot}' names a robot twice, or the robot itself",
        )


def _claim(holds: bool, text: str) -> None:
    if not holds:
        raise AssertionError(text)
