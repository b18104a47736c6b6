"""The names of seek policies: those that are installed as entry points, and `package.module:Class`.

Each is an entry point of the group `air_router.seek_policies`; those of air_router are such, too.
Here only names are known: `air_router.controller.targets` loads a policy.
"""

import re
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated, Final

from pydantic import AfterValidator
from pydantic_core import PydanticCustomError

GROUP: Final = "air_router.seek_policies"

SEEK_POLICIES: Final = ("round_robin", "freshest", "rendezvous", "tour")
"""Ours, which are always there."""

DEFAULT_SEEK_POLICY: Final = SEEK_POLICIES[0]

_CLASS: Final = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


@lru_cache(maxsize=1)
def installed() -> dict[str, EntryPoint]:
    """The policies of all packages, by name; no other package's takes the name of one of ours."""
    return {
        entry.name: entry
        for entry in sorted(entry_points(group=GROUP))
        if entry.name not in SEEK_POLICIES or _is_ours(entry)
    }


def _is_ours(entry: EntryPoint) -> bool:
    return entry.dist is not None and entry.dist.name.replace("_", "-").lower() == "air-router"


def entry_point_of(name: str) -> EntryPoint | None:
    """Where a policy is: of an installed package, or as `package.module:Class`; None: nowhere."""
    if _CLASS.fullmatch(name):
        return EntryPoint(name, name, GROUP)
    return installed().get(name)


def policy_names() -> list[str]:
    """The names of all installed policies, ours first."""
    return [*SEEK_POLICIES, *sorted(installed().keys() - {*SEEK_POLICIES})]


def known_policy(name: str) -> str:
    """The name, if there is such a policy.

    Raises:
        PydanticCustomError: there is none; it names those that are.
    """
    if name in SEEK_POLICIES or entry_point_of(name) is not None:
        return name
    expected = f"{', '.join(map(repr, policy_names()))} or 'package.module:Class'"
    raise PydanticCustomError("literal_error", "must be one of {expected}", {"expected": expected})


SeekPolicy = Annotated[str, AfterValidator(known_policy)]
"""How the robot that is sought next is chosen, and its place; see docs/seeking.md."""
