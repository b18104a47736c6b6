"""Public API for seek policies of other packages, which choose the next robot and the place.

A policy is a class that can be made without arguments, with `foresees`, `order` and `place`
(`Policy`), registered as an entry point of the group `air_router.seek_policies`, or named by the
mission as `package.module:Class`. `python -m air_router.seek_policies` prints one to begin with
(`template.py`); `testing` has the contract as checks for its tests; docs/seeking.md says what a
policy may see, and CONTRIBUTING.md has the recipe.

Places are metres east and north of the mission's origin, times seconds of the vehicle's clock. A
policy decides in milliseconds, by its arguments alone: no clock, file or random number.
"""

from air_router.controller.targets import (
    Freshest,
    LinkSample,
    Policy,
    PredictedPath,
    Rendezvous,
    SearchPlace,
    SeekContext,
    SeekPolicyError,
    Sighting,
    TargetList,
    TargetTrack,
    Tour,
    TourStop,
    policy_of,
)
from geo.frame import Point

__all__ = [
    "Freshest",
    "LinkSample",
    "Point",
    "Policy",
    "PredictedPath",
    "Rendezvous",
    "SearchPlace",
    "SeekContext",
    "SeekPolicyError",
    "Sighting",
    "TargetList",
    "TargetTrack",
    "Tour",
    "TourStop",
    "policy_of",
]
