"""The robots that explore a town in one run: the same in experiments and in worlds of missions."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass

from sitl.world.explorers.explorer import GroundRobot, Visit
from sitl.world.explorers.published_errors import with_published_errors
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.towns import Town, drawn_starts


@dataclass(frozen=True, slots=True)
class Exploration:
    """Who explores which town.

    Attributes:
        town: With the goals of this run.
        names: The robots'.
        seed: Makes all that is random.
        settings: How they drive and decide.
        drawn_starts: They start where the seed has it; else at the first places of the town, over
            again if there are too few.
    """

    town: Town
    names: tuple[str, ...]
    seed: int
    settings: ExplorerSettings
    drawn_starts: bool

    def robots(self) -> dict[str, GroundRobot]:
        """The robots, by name, where they start. Raises ValueError: the town has no starts."""
        town, names = self.town, self.names
        if names and not town.starts:
            raise ValueError(f"{town.name} has no place where a ground robot could start")
        starts = [town.starts[number % len(town.starts)] for number in range(len(names))]
        if self.drawn_starts:
            starts = list(drawn_starts(town, self.seed, len(names)))
        settings = with_published_errors(self.settings, self.seed)
        own = (random.Random(f"{self.seed} {name}").getrandbits(62) for name in names)  # noqa: S311
        robots = {
            name: GroundRobot(name, town, its_seed, start, settings)
            for name, its_seed, start in zip(names, own, starts, strict=True)
        }
        chance = random.Random(f"{self.seed} maps")  # noqa: S311 - repeatable on purpose
        recall = settings.recall
        unmapped = [goal.position for goal in town.goals if chance.random() >= recall]
        for robot in robots.values():
            robot.unmapped, robot.team = unmapped, tuple(sorted(robots))
        return robots


def first_visits(robots: Iterable[GroundRobot]) -> list[Visit]:
    """Each goal that any of them has reached, when first, in order of time."""
    visits = [visit for robot in robots for visit in robot.visited]
    first: dict[str, Visit] = {}
    for visit in sorted(visits, key=lambda visit: (visit.time_s, visit.goal)):
        first.setdefault(visit.goal, visit)
    return list(first.values())
