"""The seek policy that a mission chooses: loaded, checked, and guarded in flight."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache

from air_router.controller.targets.seeking import Policy, RoundRobin, SeekContext
from air_router.controller.targets.target_list import SearchPlace, TargetList
from air_router.errors import AirRouterError, ExitCode
from air_router.files import SEEK_POLICIES, entry_point_of
from geo.frame import Point
from mocha_link.sanitize import sanitize

_LONGEST = 120  # letters of an error's words


class SeekPolicyError(AirRouterError):
    """A seek policy cannot be loaded, or is none; the message names its package."""

    exit_code = ExitCode.INVALID_FILE


def policy_of(name: str) -> Policy:
    """The policy of a name that an entry point has, or of `package.module:Class`.

    Policies of other packages are guarded: one that fails in flight leaves the seeking to round
    robin.

    Raises:
        SeekPolicyError: there is none, or it cannot be made.
    """
    loaded = _load(name)
    return loaded if name in SEEK_POLICIES else GuardedPolicy(name, loaded)


@lru_cache(maxsize=32)
def _class_of(name: str) -> object:
    entry = entry_point_of(name)
    if entry is None:
        raise SeekPolicyError(f"no seek policy is called '{sanitize(name)}'")
    try:
        return entry.load()
    except (Exception, SystemExit) as error:  # noqa: BLE001 - code of others
        package = "" if entry.dist is None else f" of the package '{entry.dist.name}'"
        raise SeekPolicyError(
            f"the seek policy '{sanitize(name)}'{package} cannot be loaded: {_words(error)}"
        ) from None


def _load(name: str) -> Policy:
    made = _class_of(name)
    if isinstance(made, type):
        try:
            made = made()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - code of others
            raise SeekPolicyError(
                f"the seek policy '{sanitize(name)}' cannot be made: {_words(error)}"
            ) from None
    if not isinstance(made, Policy):
        raise SeekPolicyError(
            f"'{sanitize(name)}' is no seek policy: it needs order(), place() and foresees "
            "(air_router.seek_policies)"
        )
    return made


class GuardedPolicy:
    """A policy of another package: its faults end neither the search nor the flight.

    Once it has raised an error, or returned what is no ranking of the robots, robots take turns
    for the rest of the flight; the announcement of each search gives the reason.

    Args:
        name: As the mission has it.
        policy: What is guarded.

    Attributes:
        fault: What went wrong; None: nothing did.
    """

    def __init__(self, name: str, policy: Policy) -> None:
        self._name = sanitize(name)
        self._policy = policy
        self._spare = RoundRobin()
        self.fault: str | None = None

    @property
    def foresees(self) -> bool:
        """As `Policy.foresees`."""
        try:
            return self.fault is None and bool(self._policy.foresees)
        except Exception as error:  # noqa: BLE001 - code of others
            self.fault = _words(error)
            return False

    @property
    def hovers(self) -> bool:
        """As `Policy` has it."""
        try:
            return self.fault is None and bool(getattr(self._policy, "hovers", False))
        except Exception as error:  # noqa: BLE001 - code of others
            self.fault = _words(error)
            return False

    def order(self, targets: TargetList, context: SeekContext) -> Iterable[SearchPlace]:
        """As `Policy.order`."""
        if self.fault is None:
            try:
                places = tuple(self._policy.order(targets, context))
                _check(places, targets)
            except Exception as error:  # noqa: BLE001 - code of others
                self.fault = _words(error)
            else:
                return places
        return tuple(map(self._explained, self._spare.order(targets, context)))

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """As `Policy.place`."""
        if self.fault is None:
            try:
                found = self._policy.place(robot, targets, context)
                _check_place(found, targets, robot)
            except Exception as error:  # noqa: BLE001 - code of others
                self.fault = _words(error)
            else:
                return found
        return self._explained(self._spare.place(robot, targets, context))

    def _explained(self, place: SearchPlace) -> SearchPlace:
        reason = f"seek policy '{self._name}' failed ({self.fault}), in turn; {place.reason}"
        return SearchPlace(place.robot, place.position, reason)


def _check(places: tuple[SearchPlace, ...], targets: TargetList) -> None:
    """Raises ValueError: it is no ranking of the robots."""
    for place in places:
        _check_place(place, targets)
    if sorted(place.robot for place in places) != sorted(targets.names):
        raise ValueError("order() does not return every robot once")


def _check_place(place: object, targets: TargetList, robot: str | None = None) -> None:
    """Raises ValueError: it is no place, another robot's, or over a robot that is not sought."""
    if not isinstance(place, SearchPlace):
        raise ValueError(f"{place!r:.40} is no SearchPlace")  # noqa: TRY004 - one kind of fault
    if robot is not None and place.robot != robot:
        raise ValueError(f"place() returns the place of '{place.robot}', not of '{robot}'")
    if not set(place.over) <= set(targets.names):
        raise ValueError(f"the way to '{place.robot}' is over robots that are not sought")
    for point in (*(() if place.position is None else (place.position,)), *place.along):
        if not (isinstance(point, Point) and all(map(math.isfinite, point))):
            raise ValueError(f"a place of '{place.robot}' is no finite Point")


def _words(error: BaseException) -> str:
    text = sanitize(" ".join(str(error).split())[:_LONGEST])
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
