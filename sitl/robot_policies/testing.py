"""Whether a ground robot's policy keeps its contract, for the tests of another package.

    from sitl.robot_policies.testing import check
    from my_robots import ComesBack

    def test_contract():
        check(ComesBack)

`check` also returns what was chosen, so a test can check more.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType
from typing import Final

from air_router.messages import MAP_TOPIC, POSE_TOPIC
from geo.frame import Geodetic, LocalFrame, Point
from sitl.robot_policies import Drive, Received, RobotPolicy, RobotView
from sitl.world.explorers import check_choice

_STEP_S: Final = 5.0
_FRAME: Final = LocalFrame(Geodetic(38.5, -98.5))
_GOALS: Final = (Point(40.0, 10.0), Point(-60.0, 80.0), Point(200.0, -150.0))


def views(began_s: float = 0.0, steps: int = 240) -> list[RobotView]:
    """Twenty minutes of a robot: it drives about, goals come and go, messages arrive.

    For the first minutes nothing is received, then maps and poses are, and then nothing again.

    Args:
        began_s: When it set off: 0 in experiments, Unix time in `sitl team`.
        steps: How many decisions.
    """
    found = []
    received: dict[tuple[str, str], Received] = {}
    for number in range(steps):
        now_s = began_s + _STEP_S * number
        if steps // 4 <= number < steps // 2 and number % 6 == 0:
            received["uav01", MAP_TOPIC] = Received(b"a map", now_s)
            received["uav01", POSE_TOPIC] = Received(b"a pose", now_s)
        position = Point(100.0 * math.sin(number / 20), 60.0 * math.cos(number / 30))
        goals = _GOALS[: number // 10 % 4]
        goal = goals[0] if goals and number % 3 else None
        found.append(
            RobotView(
                *("ugv01", ("ugv01", "ugv02", "ugv03"), now_s, began_s),
                *(position, Point(0.0, 60.0), Point(5.0, 5.0)),
                speed_m_s=0.3,
                frame=_FRAME,
                goal=goal,
                goals=tuple(each for each in goals if each != goal),
                way_m=_way_from(position, blocked=number % 7 == 0),
                received=MappingProxyType(dict(received)),
            )
        )
    return found


def _way_from(position: Point, *, blocked: bool) -> Callable[[Point], float]:
    def way_m(place: Point) -> float:
        return math.inf if blocked else 1.3 * math.dist(position, place)

    return way_m


def check(make: Callable[[], RobotPolicy]) -> list[Drive | None]:
    """Have a policy decide for a robot for twenty minutes; what it chose.

    Args:
        make: The policy's class: it is made without arguments.

    Raises:
        AssertionError: it does not keep its contract; the text has what.
    """
    policy = make()
    if not isinstance(policy, RobotPolicy):
        raise AssertionError(f"{policy!r:.60} has no choose()")  # noqa: TRY004 - a test's
    chosen = [_chosen(policy, view) for view in views()]
    other = make()
    if [_chosen(other, view) for view in views()] != chosen:
        raise AssertionError(
            "another object chooses otherwise by the same views; use no clock and no random "
            "numbers, and keep nothing outside of the object: a seed has to make the same run"
        )
    later = make()
    for view in views(began_s=1.8e9):
        _chosen(later, view)
    return chosen


def _chosen(policy: RobotPolicy, view: RobotView) -> Drive | None:
    found = policy.choose(view)
    try:
        check_choice(found, getattr(policy, "message", None))
    except ValueError as error:
        raise AssertionError(str(error)) from None
    return found
