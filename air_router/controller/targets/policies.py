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

_LONGEST = 120  # letters of an error's text


class SeekPolicyError(AirRouterError):
    """A seek policy cannot be loaded or used; the message names its package."""

    exit_code = ExitCode.INVALID_FILE


def policy_of(name: str) -> Policy:
    """Load the policy with this entry point name, or `package.module:Class`.

    Policies of other packages are guarded: if one fails in flight, robots are sought in turn.

    Raises:
        SeekPolicyError: There is no such policy, or it cannot be created.
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
        remedy = ""
        if isinstance(error, ModuleNotFoundError):
            remedy = "; install it, or add its folder to PYTHONPATH"
        raise SeekPolicyError(
            f"the seek policy '{sanitize(name)}'{package} cannot be loaded: {_text_of(error)}"
            f"{remedy}"
        ) from None


def _load(name: str) -> Policy:
    made = _class_of(name)
    if isinstance(made, type):
        try:
            made = made()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - code of others
            raise SeekPolicyError(
                f"the seek policy '{sanitize(name)}' cannot be made: {_text_of(error)}"
            ) from None
    if not isinstance(made, Policy):
        raise SeekPolicyError(
            f"'{sanitize(name)}' is no seek policy: it needs order(), place() and foresees "
            "(air_router.seek_policies)"
        )
    return made


class GuardedPolicy:
    """Guards a policy of another package: its faults end neither the search nor the flight.

    After the policy raises an error or returns an invalid ranking, robots are sought in turn for
    the rest of the flight. The announcement of each search gives the reason.

    Args:
        name: Its name in the mission.
        policy: The guarded policy.

    Attributes:
        fault: The fault; None: none occurred.
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
            self.fault = _text_of(error)
            return False

    @property
    def hovers(self) -> bool:
        """As `Policy` has it."""
        try:
            return self.fault is None and bool(getattr(self._policy, "hovers", False))
        except Exception as error:  # noqa: BLE001 - code of others
            self.fault = _text_of(error)
            return False

    def order(self, targets: TargetList, context: SeekContext) -> Iterable[SearchPlace]:
        """As `Policy.order`."""
        if self.fault is None:
            try:
                places = tuple(self._policy.order(targets, context))
                _check(places, targets)
            except Exception as error:  # noqa: BLE001 - code of others
                self.fault = _text_of(error)
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
                self.fault = _text_of(error)
            else:
                return found
        return self._explained(self._spare.place(robot, targets, context))

    def _explained(self, place: SearchPlace) -> SearchPlace:
        reason = f"seek policy '{self._name}' failed ({self.fault}), in turn; {place.reason}"
        return SearchPlace(place.robot, place.position, reason)


def _check(places: tuple[SearchPlace, ...], targets: TargetList) -> None:
    """Raise ValueError if this is no ranking of the robots."""
    for place in places:
        _check_place(place, targets)
    if sorted(place.robot for place in places) != sorted(targets.names):
        raise ValueError("order() does not return every robot once")


def _check_place(place: object, targets: TargetList, robot: str | None = None) -> None:
    """Raise ValueError for an invalid place, another robot's, or one over unknown robots."""
    if not isinstance(place, SearchPlace):
        raise ValueError(f"{place!r:.40} is no SearchPlace")  # noqa: TRY004 - one kind of fault
    if robot is not None and place.robot != robot:
        raise ValueError(f"place() returns the place of '{place.robot}', not of '{robot}'")
    if not set(place.over) <= set(targets.names):
        raise ValueError(f"the way to '{place.robot}' is over robots that are not sought")
    for point in (*(() if place.position is None else (place.position,)), *place.along):
        if not (isinstance(point, Point) and all(map(math.isfinite, point))):
            raise ValueError(f"a place of '{place.robot}' is no finite Point")


def _text_of(error: BaseException) -> str:
    text = sanitize(" ".join(str(error).split())[:_LONGEST])
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
