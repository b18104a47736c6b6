"""What decides for the UAVs of a run: the mission over its town, seek policies, controllers.

All runs of a process share towns, missions over them, and the routes of these.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from itertools import cycle, pairwise, permutations
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from air_router.controller.controller import Controller
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.targets.seeking import Freshest, Policy, Rendezvous, SeekContext
from air_router.controller.targets.target_list import SearchPlace, TargetList
from air_router.files.settings import SeekPolicy, Timers
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import checked, read_draft
from air_router.mission.mission import Mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from geo.frame import Point
from sitl.experiment.robots.node import Fleet
from sitl.experiment.settings import RunSettings
from sitl.world.towns.town import Town
from sitl.world.towns.town_file import load_town, mission_over

_DAY: Final = datetime(2026, 6, 1, 12, tzinfo=UTC)
"""When missions are flown: zones that apply at certain times are the same in every run."""


@dataclass(frozen=True, slots=True, eq=False)
class Scenery:
    """A town and how UAVs fly over it. Nothing in it changes during a run.

    Attributes:
        town: What stands where.
        mission: Without a duration: a run ends by its own time.
        plan: What is on board of every UAV.
        router: Its answers depend on the question only.
    """

    town: Town
    mission: Mission
    plan: FlightPlan
    router: Router


_MATTERS: Final = (
    *("town", "mission", "timers", "passive", "policy"),
    *("uav_speed_m_s", "uav_altitude_m"),
)
"""The settings that make a difference to it."""


def scenery_of(settings: RunSettings) -> Scenery:
    """The scenery of a run, made once per process.

    Raises:
        AirRouterError: the files of town and mission are not what they should be.
    """
    return _scenery(RunSettings(**{name: getattr(settings, name) for name in _MATTERS}))


@lru_cache(maxsize=8)
def _scenery(settings: RunSettings) -> Scenery:
    speed_m_s, altitude_m = settings.uav_speed_m_s, settings.uav_altitude_m
    town = load_town(settings.town)
    if settings.mission is None:
        mission = mission_over(town, altitude_m=altitude_m, speed_m_s=speed_m_s)
    else:
        mission = _mission(settings.mission, speed_m_s=speed_m_s, altitude_m=altitude_m)
    timers = Timers(**settings.timers.model_dump())
    mission = dataclasses.replace(
        mission,
        timers=dataclasses.replace(timers, init_s=math.inf) if settings.passive else timers,
        seek_policy=_seek_policy(settings),
        duration_s=None,
    )
    return Scenery(town, mission, FlightPlan.of(mission), Router(WaypointGraph(mission)))


def _seek_policy(settings: RunSettings) -> SeekPolicy:
    """What the mission says; policies that do not fly are put in its place later."""
    policy = settings.policy
    if policy == "oracle":
        return "rendezvous"
    return "freshest" if policy == "orienteering" else policy


def _mission(path: Path, *, speed_m_s: float, altitude_m: float) -> Mission:
    """A mission at another speed and altitude, on a day that is always the same."""
    draft = read_draft(path)
    draft.start = _DAY
    draft.speed_m_s, draft.altitude_m = speed_m_s, altitude_m
    draft.waypoints = [dataclasses.replace(spot, altitude_m=None) for spot in draft.waypoints]
    return checked(draft)


STOPS: Final = 3
"""So many robots ahead `Orienteering` looks."""


class _Stop(NamedTuple):
    """A robot that may be visited, and what a visit at once would be worth.

    Attributes:
        place: Where it is believed to be.
        ages_s: Of what it and the UAV hold of each other, together.
        chance: That it is found there, times its value.
        flight_s: To it from where the UAV is.
    """

    robot: str
    place: Point
    ages_s: float
    chance: float
    flight_s: float


class Orienteering(Freshest):
    """Seeks the first robot of the best tour of `STOPS` robots, and plans anew at each search.

    It is for comparison: no mission can choose it. `Freshest` takes the robot whose visit is
    expected to remove most age per second. This takes the tour that does, from robot to robot. Ages
    as they are now, places where robots are believed to be and the chances to find them there are
    those of `Freshest`.

    Args:
        speed_m_s: At which the UAV flies from robot to robot, straight.
        values: How much a robot's age counts, by its name; 1 if it is not named.
    """

    def __init__(
        self, speed_m_s: float, values: Mapping[str, float] = MappingProxyType({})
    ) -> None:
        super().__init__(values)
        self._speed_m_s = speed_m_s

    def order(self, targets: TargetList, context: SeekContext) -> tuple[SearchPlace, ...]:
        """As `Freshest.order`, but for the first."""
        ranked = super().order(targets, context)
        free, *_ = targets.groups(context.now_s)
        stops = [self._stop(robot, targets, context) for robot in free]
        stops = [stop for stop in stops if math.isfinite(stop.flight_s)]
        if not stops:
            return ranked
        tours = permutations(stops, min(STOPS, len(stops)))
        first, *_ = max(tours, key=lambda tour: self._rate(tour, context.round_s))
        return tuple(sorted(ranked, key=lambda place: place.robot != first.robot))

    def _stop(self, robot: str, targets: TargetList, context: SeekContext) -> _Stop:
        found = self._prospect(robot, targets, context)
        course = targets.course(robot)
        over_s = context.began_s if course is None else course.end_s
        doubt_s = max(context.now_s + found.flight_s - over_s, 0.0)
        tries = targets.tracks[robot].tries
        chance = self._values.get(robot, 1.0) / (1 + doubt_s / context.round_s) / (1 + tries)
        ages_s = found.benefit * (found.flight_s + context.round_s) / chance if chance else 0.0
        return _Stop(robot, found.place.position or context.unseen, ages_s, chance, found.flight_s)

    def _rate(self, tour: Sequence[_Stop], round_s: float) -> float:
        """The age that is expected to be removed, per second of the tour."""
        time_s = removed_s = 0.0
        for before, stop in zip((None, *tour), tour, strict=False):
            way_m = 0.0 if before is None else math.dist(before.place, stop.place)
            time_s += stop.flight_s if before is None else way_m / self._speed_m_s
            time_s += round_s
            removed_s += stop.chance * stop.ages_s
        return removed_s / time_s


def controllers_of(fleet: Fleet, settings: RunSettings, scenery: Scenery) -> dict[str, Controller]:
    """The controllers of a run's UAVs: the first explores and searches, the others only search."""
    base = () if fleet.base is None else (fleet.base,)
    seek = () if settings.passive else (*fleet.ugvs, *base)
    setups = [
        FlightSetup(scenery.mission, seek, explore=number == 0 or settings.passive, name=name)
        for number, name in enumerate(fleet.uavs)
    ]
    controllers = {setup.name: Controller(setup, scenery.router, scenery.plan) for setup in setups}
    values = dict(zip(fleet.ugvs, cycle(settings.values or (1.0,)), strict=False))
    policies: dict[str, Policy] = {
        "oracle": Rendezvous(values),
        "orienteering": Orienteering(scenery.mission.speed_m_s, values),
    }
    for controller in controllers.values():
        controller.search.policy = policies.get(settings.policy, controller.search.policy)
    if settings.passive:
        waypoints = scenery.mission.waypoints * _rounds(scenery.mission, settings.duration_s)
        for controller in controllers.values():
            controller.exploration.waypoints = waypoints
    return controllers


def _rounds(mission: Mission, duration_s: float) -> int:
    """How often a vehicle can go round the waypoints in a run, and once more."""
    places = [waypoint.position for waypoint in mission.waypoints]
    round_m = sum(math.dist(a, b) for a, b in pairwise([*places, places[0]]))
    return 2 + int(duration_s * mission.speed_m_s / max(round_m, 1.0))
