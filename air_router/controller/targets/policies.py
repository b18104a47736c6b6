"""The seek policies that a mission can choose."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from air_router.controller.targets.seeking import Freshest, Policy, Rendezvous, RoundRobin
from air_router.controller.targets.tour import Tour
from air_router.files import SeekPolicy

POLICIES: Final[Mapping[SeekPolicy, Policy]] = MappingProxyType(
    {
        "round_robin": RoundRobin(),
        "freshest": Freshest(),
        "rendezvous": Rendezvous(),
        "tour": Tour(),
    }
)
"""By the name that a mission file has for each."""
