"""A ground robot that searches for vehicles: where it drives, what it knows, what it publishes.

A pure object: time and messages come in, positions and messages come out. It goes to the nearest
goal that it knows, that no other robot has claimed and that a way over known ground leads to;
without one it returns to where it started and waits for messages, as the authors' robots do.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from functools import cache
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from air_router.messages import MAP_TOPIC
from geo.frame import Point
from geo.grid import Terrain
from sitl.world.explorers.knowledge import GoalBook, Knowledge, read_map
from sitl.world.explorers.messages import (
    CLAIMS_TOPIC,
    OBJECTS_TOPIC,
    REACHABILITY_TOPIC,
    ExplorerPost,
    read_claims,
    read_sightings,
)
from sitl.world.explorers.policies import (
    Drive,
    GuardedRobotPolicy,
    Received,
    RobotView,
    robot_policy_of,
)
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.towns import PASSABLE, REACHED_M, Cell, Town, Ways, length_m

_PACE: Final = np.full(len(Terrain), 0.5)
_PACE[[Terrain.ROAD, Terrain.GRAVEL, Terrain.GRASS]] = 1.0, 0.8, 0.8
"""Share of its mean speed on roads that a robot makes on each ground."""

_INSIDE_M: Final = 0.5
"""Ways to a goal end so far within the distance at which it counts as reached."""

NO_VEHICLE_M: Final = 8.0
"""A place that is farther than this from every vehicle is a false goal: visited, but not found."""


class Visit(NamedTuple):
    """A goal of the town that a robot has reached, and when, in seconds from the start."""

    goal: str
    time_s: float
    robot: str


class GroundRobot:
    """A robot that explores a town.

    Args:
        name: Its name in the team; of two robots that claim one goal, the first by name keeps it.
        town: What it drives in. It uses the town only through its eyes.
        seed: Makes its random choices.
        start: Where it stands at first: a place that robots can drive at.
        settings: How it drives and decides.

    Attributes:
        position: Where it is.
        heading_deg: Clockwise from north.
        driven_m: Metres driven so far.
        errand_s: For so long it drove where its policy had it, or waited there.
        sightings: Vehicles that it has recognised itself, in order.
        visited: Goals reached, in order; each id at most once per robot.
        unmapped: Vehicles that it does not recognise on maps.
        team: The names of all robots that explore, sorted.
        policy: What may have it drive elsewhere than to goals; None: nothing.
        knowledge: What it knows of the ground.
        book: What it knows of goals.
    """

    def __init__(
        self,
        name: str,
        town: Town,
        seed: int,
        start: Point,
        settings: ExplorerSettings,
    ) -> None:
        self.name = name
        self.town = town
        self.settings = settings
        self.position = start
        self.heading_deg = 0.0
        self.driven_m = self.errand_s = 0.0
        self.sightings: list[Point] = []
        self.unmapped: Sequence[Point] = ()
        self.team: tuple[str, ...] = (name,)
        self.policy = None if settings.policy is None else robot_policy_of(settings.policy)
        self.visited: list[Visit] = []
        self.knowledge = Knowledge(town.lattice, town.ground, settings.sight_m)
        self.book = GoalBook(name)
        self._post = ExplorerPost(town.frame)
        self._start = start
        self._chance = random.Random(seed)  # noqa: S311 - repeatable on purpose
        self._mean_speed_m_s = settings.speed_m_s * settings.progress  # on roads
        self._cell: Cell = -1  # where it is; -1: before the first step
        self._way: list[Cell] = []  # still to be driven
        self._deadline_s = math.inf  # simulated time at which the goal is given up
        self._now_s = -math.inf  # of the last step
        self._next_thought_s = self._chance.uniform(0, settings.thinking_s)
        self._decided_on: tuple[int, int] | None = None  # versions of book and knowledge
        self._errand: Drive | None = None  # what its policy has chosen
        self._message: bytes | None = None  # of its policy, published last
        self._received: dict[tuple[str, str], Received] = {}  # for its policy, by robot and topic
        self._began_s = 0.0  # the first step

    @property
    def policy_fault(self) -> str | None:
        """What went wrong in its policy; None: nothing did."""
        return None if self.policy is None else self.policy.fault

    def step(self, now_s: float) -> None:
        """Drive, observe and decide up to this time; the first call only observes.

        Times never run back.
        """
        if self._now_s == -math.inf:
            self._next_thought_s += now_s
            self._began_s = now_s
            self._enter(self.town.lattice.cell(self.position))
        else:
            self._drive(now_s - self._now_s, now_s)
            self.errand_s += (now_s - self._now_s) * (self._errand is not None)
        self._now_s = now_s
        if self.book.current is not None and now_s > self._deadline_s:
            self._leave(now_s, failed=True)
        if now_s >= self._next_thought_s:
            self._next_thought_s = now_s + self.settings.thinking_s
            if self.policy is None or not self._follows(self.policy, now_s):
                self._think()
            if self.policy is not None and self.policy.message != self._message:
                self._message = self._post.policy = self.policy.message

    def outbox(self) -> list[tuple[str, bytes]]:
        """Messages to publish since the last call: (topic, data), at most one per topic."""
        if self._now_s == -math.inf:
            return []
        return self._post.collect(self._now_s, self.position, self.heading_deg, self.knowledge)

    def take(self, robot: str, topic: str, data: bytes, now_s: float) -> None:
        """A gossiped message of another robot has arrived; topics that it does not use are left.

        Raises:
            MessageError, GridError, FrameError: the message is not of its topic's type.
        """
        if self.policy is not None:
            self._received[robot, topic] = Received(data, now_s)
        if topic in {MAP_TOPIC, REACHABILITY_TOPIC}:
            reading = read_map(data, self.town.lattice)
            self.knowledge.learn(reading.cells)
            self.book.learn(
                place
                for place in reading.vehicles
                if all(math.dist(place, other) > NO_VEHICLE_M for other in self.unmapped)
            )
        elif topic == CLAIMS_TOPIC and self.book.on_claims(
            robot, *read_claims(data, self.town.frame)
        ):
            self._leave(now_s, failed=False)
        elif topic == OBJECTS_TOPIC:
            self.book.learn(read_sightings(data, self.town.frame))

    def _drive(self, time_s: float, now_s: float) -> None:
        while time_s > 0 and self._way:
            target = self.town.lattice.centre(self._way[0])
            distance_m = math.dist(self.position, target)
            speed_m_s = self._mean_speed_m_s * float(_PACE[self.knowledge.cells[self._cell]])
            step_m = min(distance_m, speed_m_s * time_s)
            self.driven_m += step_m
            if step_m > 0:
                east_m, north_m = target[0] - self.position[0], target[1] - self.position[1]
                self.heading_deg = math.degrees(math.atan2(east_m, north_m)) % 360
                part = step_m / distance_m
                self.position = Point(
                    self.position[0] + part * east_m, self.position[1] + part * north_m
                )
            if step_m == distance_m:
                self.position = target
                time_s -= distance_m / speed_m_s
                self._enter(self._way.pop(0))
                self._arrive(now_s - time_s)
            else:
                time_s = 0.0

    def _enter(self, cell: Cell) -> None:
        """Observe from a new cell; a way that turns out to be blocked is planned again."""
        self._cell = cell
        contradicted = self.knowledge.see(cell)
        seen = [
            goal.position
            for goal in self.town.vehicles_seen_from(cell, self.settings.recognition_m)
            if goal.position not in self.sightings
        ]
        if seen:
            self.sightings += seen
            self.book.learn(seen)
            self._post.objects = self.sightings
        if contradicted and not PASSABLE[self.knowledge.cells[self._way]].all():
            self._replan()

    def _arrive(self, time_s: float) -> None:
        goal = self.book.current
        if goal is None or math.dist(self.position, goal) > REACHED_M:
            return
        self._way = []
        self.book.visit()
        self._post.claims = list(self.book.claims)
        if self._chance.random() >= self.settings.located:
            return
        near = min(self.town.goals, key=lambda other: math.dist(goal, other.position), default=None)
        if near is None or math.dist(goal, near.position) > NO_VEHICLE_M:
            return
        if not self._finds(near.position):
            return
        if all(near.id != visit.goal for visit in self.visited):
            self.visited.append(Visit(near.id, time_s, self.name))

    def _finds(self, vehicle: Point) -> bool:
        """Whether it recognises the vehicle of a goal from where it really is."""
        mean_m = self.settings.localisation_m
        if mean_m == 0:
            return True
        deviation_m = mean_m / math.sqrt(math.pi / 2)  # on each axis
        east_m, north_m = (place + self._chance.gauss(0, deviation_m) for place in self.position)
        return math.dist((east_m, north_m), vehicle) <= self.settings.recognition_m

    def _think(self) -> None:
        """Choose where to go, unless there is a goal, or nothing is new since the last time."""
        if self.book.current is not None:
            return
        versions = self.book.version, self.knowledge.version
        waits = self._at_start and not self.book.failed
        if versions == self._decided_on and (self._way or waits):
            return
        self._decided_on = versions
        ways = Ways(self.town.lattice, self.knowledge.cells, self._cell)
        for goal in self.book.free(self.position):
            way = self._way_to(goal, ways)
            if way is not None:
                self._claim(goal, way)
                return
        if self.settings.idle == "explore":
            if self._way:
                return
            edge = ways.nearest_edge(self.knowledge.cells)
            if edge is not None:
                self._follow(ways.to(edge))
                return
        if self._at_start:
            self.book.forgive()
        else:
            self._follow(self._way_to(self._start, ways) or [])

    def _follows(self, policy: GuardedRobotPolicy, now_s: float) -> bool:
        """Drive where its policy chooses; False: it chooses nothing, or no way leads there."""
        ways = cache(lambda: Ways(self.town.lattice, self.knowledge.cells, self._cell))

        def way_to(place: Point) -> list[Cell] | None:
            return self._way_to(place, ways())

        def way_m(place: Point) -> float:
            way = way_to(place)
            return math.inf if way is None else length_m(self.town.lattice, self.position, way)

        chosen = policy.choose(
            RobotView(
                *(self.name, self.team, now_s, self._began_s),
                *(self.position, self._start, self.town.home),
                speed_m_s=self._mean_speed_m_s,
                frame=self.town.frame,
                goal=self.book.current,
                goals=tuple(self.book.free(self.position)),
                way_m=way_m,
                received=MappingProxyType(self._received),
            )
        )
        if chosen is None:
            if self._errand is not None:
                self._errand = self._decided_on = None
                self._way = []
            return False
        place = chosen.place
        if self.book.current is not None:
            if math.dist(self.book.current, place) <= REACHED_M:
                return True
            self._leave(now_s, failed=False)
        if chosen == self._errand and (self._way or math.dist(self.position, place) <= REACHED_M):
            return True
        self._errand = None
        way = way_to(place)
        if way is None:
            return False
        goal = next((g for g in self.book.free(place) if math.dist(g, place) <= REACHED_M), None)
        if goal is not None:
            self._claim(goal, way)
        else:
            self._errand = chosen
            self._follow(way)
        return True

    @property
    def _at_start(self) -> bool:
        return math.dist(self.position, self._start) <= REACHED_M

    def _way_to(self, place: Point, ways: Ways) -> list[Cell] | None:
        """A way to where a place counts as reached; None: there is none over known ground."""
        cell = ways.nearest(place, REACHED_M - _INSIDE_M)
        return None if cell is None else ways.to(cell)

    def _claim(self, goal: Point, way: list[Cell]) -> None:
        self.book.claim(goal)
        self._post.claims = list(self.book.claims)
        way_m = length_m(self.town.lattice, self.position, way)
        self._deadline_s = self._now_s + self.settings.patience_s_m * way_m
        if way and self._chance.random() < self.settings.stuck:
            way = way[: 1 + self._chance.randrange(len(way))]
        self._follow(way)
        self._arrive(self._now_s)

    def _leave(self, now_s: float, *, failed: bool) -> None:
        """Give the current goal up; think of another one at the next step."""
        self.book.give_up(failed=failed)
        self._post.claims = list(self.book.claims)
        self._way = []
        self._next_thought_s = now_s

    def _replan(self) -> None:
        goal = self.book.current
        if goal is None:
            self._way = []
            return
        way = self._way_to(goal, Ways(self.town.lattice, self.knowledge.cells, self._cell))
        if way is None:
            self._leave(self._now_s, failed=True)
        else:
            self._follow(way)

    def _follow(self, way: list[Cell]) -> None:
        self._way = way
        centres = [self.position, *map(self.town.lattice.centre, way)]
        self._post.way = _corners(centres)


def _corners(places: list[Point]) -> list[Point]:
    """The places of a way at which it turns, and its end."""
    return [
        here
        for before, here, after in zip(places, places[1:], [*places[2:], None], strict=False)
        if after is None
        or (here[0] - before[0]) * (after[1] - here[1])
        != (here[1] - before[1]) * (after[0] - here[0])
    ]
