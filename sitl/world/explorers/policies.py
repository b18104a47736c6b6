"""Policies of exploring ground robots: where one drives instead of looking for goals.

Each is an entry point of the group `sitl.robot_policies`, or named as `package.module:Class`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated, Final, Protocol, runtime_checkable

from pydantic import AfterValidator
from pydantic_core import PydanticCustomError

from air_router.errors import AirRouterError, ExitCode
from geo.frame import LocalFrame, Point
from mocha_link.sanitize import sanitize

GROUP: Final = "sitl.robot_policies"

MOST_MESSAGE_BYTES: Final = 4096
"""The message of a policy to others is no longer than that."""

_CLASS: Final = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")
_LONGEST: Final = 120  # letters of an error's text


class RobotPolicyError(AirRouterError):
    """A robot's policy cannot be loaded, or is none."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class Received:
    """The newest message of a robot on a topic.

    Attributes:
        data: As it was published (`air_router.messages` decodes ours).
        at_s: When it arrived, on the robot's clock.
    """

    data: bytes
    at_s: float


@dataclass(frozen=True, slots=True)
class RobotView:
    """What a robot's policy may see; places are metres east and north of the town's origin.

    Attributes:
        name: The robot's.
        team: The names of all robots that explore, sorted; every robot has the team's file.
        now_s: The robot's clock.
        began_s: When it set off.
        position: Where it is.
        start: Where it set off.
        home: Where UAVs take off, and the base station stands.
        speed_m_s: What it makes on a road, stops included.
        frame: Converts degrees, which messages have, into such places: `frame.to_local`.
        goal: The goal that it is on its way to; None: it has none.
        goals: Goals that it knows and that no robot has claimed or visited, nearest first.
        way_m: How long its way to a place is over the ground that it knows; infinite: none leads
            there. The first call of a decision takes milliseconds.
        received: The newest message of each robot and topic, by both, whichever robot carried it.
    """

    name: str
    team: tuple[str, ...]
    now_s: float
    began_s: float
    position: Point
    start: Point
    home: Point
    speed_m_s: float
    frame: LocalFrame
    goal: Point | None
    goals: tuple[Point, ...]
    way_m: Callable[[Point], float]
    received: Mapping[tuple[str, str], Received]


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive to a place, and stay there as long as the policy keeps choosing it.

    A goal that no robot has claimed is claimed, and visited on arrival.
    """

    place: Point


@runtime_checkable
class RobotPolicy(Protocol):
    """Decides where one robot drives.

    It may also have an attribute `message`: bytes for the other robots' policies, or None. Whenever
    they have changed, they are published on `POLICY_TOPIC`, and others find them in
    `RobotView.received`.

    Each robot has an object of its own for the whole run, which may keep what it likes. It decides
    by what it has seen: no clock, file or random number, so that a seed makes the same run again.
    """

    def choose(self, view: RobotView) -> Drive | None:
        """Where to drive, called every `thinking_s`; None: it looks for goals, as without a policy.

        To choose something else than the goal that it is on its way to gives that goal back to the
        team.
        """


@lru_cache(maxsize=1)
def _installed() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP))}


def known_robot_policy(name: str) -> str:
    """The name, if there is such a policy.

    Raises:
        PydanticCustomError: there is none; it names those that are.
    """
    if _CLASS.fullmatch(name) or name in _installed():
        return name
    names = [*map(repr, sorted(_installed())), "'package.module:Class'"]
    expected = " or ".join(names)
    raise PydanticCustomError("literal_error", "must be {expected}", {"expected": expected})


RobotPolicyName = Annotated[str, AfterValidator(known_robot_policy)]
"""How a settings file names a policy."""


def robot_policy_of(name: str) -> GuardedRobotPolicy:
    """A new policy for one robot; one that fails leaves the robot to look for goals.

    Raises:
        RobotPolicyError: there is none, or it cannot be made.
    """
    try:
        made = _class_of(name)()
    except RobotPolicyError:
        raise
    except (Exception, SystemExit) as error:  # noqa: BLE001 - code of others
        text = f"the robot policy '{sanitize(name)}' cannot be made: {_text(error)}"
        raise RobotPolicyError(text) from None
    if not isinstance(made, RobotPolicy):
        raise RobotPolicyError(
            f"'{sanitize(name)}' is no robot policy: it needs choose() (sitl.robot_policies)"
        )
    return GuardedRobotPolicy(made)


@lru_cache(maxsize=32)
def _class_of(name: str) -> Callable[[], object]:
    entry = EntryPoint(name, name, GROUP) if _CLASS.fullmatch(name) else _installed().get(name)
    if entry is None:
        raise RobotPolicyError(f"no robot policy is called '{sanitize(name)}'")
    try:
        found = entry.load()
    except (Exception, SystemExit) as error:  # noqa: BLE001 - code of others
        raise RobotPolicyError(
            f"the robot policy '{sanitize(name)}' cannot be loaded: {_text(error)}"
        ) from None
    if not callable(found):
        raise RobotPolicyError(f"'{sanitize(name)}' is no class (sitl.robot_policies)")
    made: Callable[[], object] = found
    return made


class GuardedRobotPolicy:
    """A policy of another package: after its first fault it chooses nothing any more.

    Args:
        policy: What is guarded.

    Attributes:
        fault: What went wrong; None: nothing did.
        message: The policy's, when it chose last.
    """

    def __init__(self, policy: RobotPolicy) -> None:
        self._policy = policy
        self.fault: str | None = None
        self.message: bytes | None = None

    def choose(self, view: RobotView) -> Drive | None:
        """As `RobotPolicy.choose`."""
        if self.fault is not None:
            return None
        try:
            found = self._policy.choose(view)
            message = getattr(self._policy, "message", None)
            check_choice(found, message)
        except Exception as error:  # noqa: BLE001 - code of others
            self.fault = _text(error)
            return None
        self.message = message
        return found


def check_choice(found: object, message: object) -> None:
    """Whether a policy chose a place, and published a message, that are valid.

    Raises:
        ValueError: it is neither None nor a place to drive to; or not None nor bytes to publish.
    """
    if message is not None and not (
        isinstance(message, bytes) and len(message) <= MOST_MESSAGE_BYTES
    ):
        raise ValueError(
            f"message is {message!r:.60}, not at most {MOST_MESSAGE_BYTES} bytes or None"
        )
    if found is None:
        return
    if not isinstance(found, Drive):
        raise ValueError(f"choose() returned {found!r:.60}, not a Drive or None")  # noqa: TRY004
    place: object = found.place
    if not (isinstance(place, Point) and all(map(math.isfinite, place))):
        raise ValueError(f"choose() returned a Drive to {place!r:.60}, no finite Point")


def _text(error: BaseException) -> str:
    text = sanitize(" ".join(str(error).split())[:_LONGEST])
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
