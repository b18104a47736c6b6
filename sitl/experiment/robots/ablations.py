"""`tour` with one of its parts taken out: what each is worth. No mission can choose these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from air_router.controller.targets import (
    PredictedPath,
    SeekContext,
    TargetList,
    Tour,
    TourStop,
    rate,
)


class TourOfOne(Tour):
    """One robot in each search: ages, chances and paths count, other robots on the way do not."""

    def _best(self, stops: Sequence[TourStop], context: SeekContext) -> tuple[TourStop, ...]:
        worth = [stop for stop in stops if stop.gain_s > 0]
        best = max(worth, key=lambda stop: rate((stop,), context), default=None)
        return () if best is None else (best,)


class TourWithoutAges(Tour):
    """All robots weigh the same, however old their data are; the chances to find them count."""

    def _stops(self, targets: TargetList, context: SeekContext) -> list[TourStop]:
        found = []
        for stop in super()._stops(targets, context):
            weight = self.ages_s(stop.robot, targets, context) * self.value(stop.robot)
            chance = stop.gain_s / weight if weight > 0 else 0.0
            found.append(replace(stop, gain_s=chance))
        return found


class TourWithoutPaths(Tour):
    """Robots are looked for where they were last, whatever paths they published."""

    def _course(self, robot: str, targets: TargetList) -> PredictedPath | None:
        course = super()._course(robot, targets)
        if course is None:
            return None
        return PredictedPath(course.points[:1], course.start_s, course.speed_m_s)
