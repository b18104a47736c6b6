"""What a seek policy of another package is made of: which robot is sought next, and where.

A policy is a class that can be made without arguments, with `foresees`, `order` and `place`
(`Policy`), registered as an entry point of the group `air_router.seek_policies`, or named by the
mission as `package.module:Class`:

    class Nearest:
        foresees = False

        def order(self, targets: TargetList, context: SeekContext) -> list[SearchPlace]:
            ordered = []
            for group in targets.groups(context.now_s):
                places = [self.place(robot, targets, context) for robot in group]
                ordered += sorted(places, key=lambda place: self._flight_s(place, context))
            return ordered

        def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
            return targets.place(robot, context.now_s)

        def _flight_s(self, place: SearchPlace, context: SeekContext) -> float:
            return context.flight_s(place.position or context.unseen)

`targets` says what is known of each robot, `context` how long flights take, where radios were
received, and what is mapped; all are read only.
Places are metres east and north of the mission's origin, times seconds of the vehicle's clock.
`targets.groups` keeps robots that are lost, and those that another UAV seeks, behind the others;
the robot whose turn was last comes last in its group. `SearchPlace.over` names robots that are
flown over on the way. A policy decides in milliseconds, by its arguments alone: no clock, file or
random number. CONTRIBUTING.md has the recipe.
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
    Stop,
    TargetList,
    TargetTrack,
    Tour,
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
    "Stop",
    "TargetList",
    "TargetTrack",
    "Tour",
    "policy_of",
]
