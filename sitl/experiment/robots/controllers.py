"""What decides for the UAVs of a run: the mission over its town, seek policies, controllers.

All runs of a process share towns, missions over them, and the routes of these.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache, partial
from itertools import cycle, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Final

from air_router.controller import Controller
from air_router.controller.model import FlightSetup
from air_router.controller.targets import Policy, Rendezvous, Tour
from air_router.files import Timers
from air_router.mission import FlightPlan, Mission, checked, read_placed
from air_router.routing import Router, WaypointGraph
from geo.grid import SemanticGrid
from sitl.experiment import OFF_BOARD, RunSettings
from sitl.experiment.robots.ablations import TourOfOne, TourWithoutAges, TourWithoutPaths
from sitl.experiment.robots.baselines import Orienteering, PlannedRendezvous
from sitl.experiment.robots.ferry import Ferry
from sitl.experiment.robots.node import Fleet
from sitl.experiment.robots.turns import Nearest, ThreeInTurn
from sitl.world.towns import Town, load_town, mission_over

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
    *("town", "mission", "blocks", "vehicles_per_block", "timers", "passive", "policy"),
    *("uav_speed_m_s", "uav_altitude_m"),
)
"""The settings that make a difference to it."""

STARTS_PER_BLOCK: Final = 40
"""Places where robots may start in a new town, all over it: every street has some."""


def scenery_of(settings: RunSettings, seed: int) -> Scenery:
    """The scenery of a run, made once per process.

    Raises:
        AirRouterError: the files of town and mission are not what they should be.
        ValueError: no town can be made as the settings have it.
    """
    matters = RunSettings(**{name: getattr(settings, name) for name in _MATTERS})
    return _scenery(matters, None if settings.blocks is None else seed)


@lru_cache(maxsize=2)
def _new_town(seed: int, blocks: tuple[int, int], vehicles_per_block: float) -> Town:
    from sitl.world.towns import generate  # noqa: PLC0415 - loads networkx

    count = math.prod(blocks)
    vehicles, starts = round(vehicles_per_block * count), STARTS_PER_BLOCK * count
    return generate(seed, *blocks, goals=vehicles, starts=starts)


@lru_cache(maxsize=8)
def _scenery(settings: RunSettings, seed: int | None) -> Scenery:
    speed_m_s, altitude_m = settings.uav_speed_m_s, settings.uav_altitude_m
    if seed is None or settings.blocks is None:
        town, has_mission = load_town(settings.town), settings.mission is not None
    else:
        town = _new_town(seed, settings.blocks, settings.vehicles_per_block)
        has_mission = False
    if settings.mission is None or not has_mission:
        mission = mission_over(town, altitude_m=altitude_m, speed_m_s=speed_m_s)
    else:
        mission = _mission(settings.mission, speed_m_s=speed_m_s, altitude_m=altitude_m)
    # As the paper's UAV, which seeks robots without a pause once everything is explored.
    timers = Timers(**settings.timers.model_dump(), revisit_s=0.0)
    mission = dataclasses.replace(
        mission,
        timers=dataclasses.replace(timers, init_s=math.inf) if settings.passive else timers,
        seek_policy=_seek_policy(settings),
        duration_s=None,
    )
    return Scenery(town, mission, FlightPlan.of(mission), Router(WaypointGraph(mission)))


def _seek_policy(settings: RunSettings) -> str:
    """The mission's policy; policies that do not fly take its place later."""
    return "rendezvous" if settings.policy in OFF_BOARD else settings.policy


def _mission(path: Path, *, speed_m_s: float, altitude_m: float) -> Mission:
    """A mission at another speed and altitude, on a day that is always the same."""
    placed, findings = read_placed(path)
    placed = placed.with_settings(speed_m_s=speed_m_s, altitude_m=altitude_m)
    waypoints = tuple(dataclasses.replace(spot, altitude_m=None) for spot in placed.waypoints)
    placed = dataclasses.replace(placed, waypoints=waypoints)
    return checked(placed, findings, start=_DAY)


NO_POLICIES: Final[Mapping[str, Policy]] = MappingProxyType({})
NO_MAPS: Final[Mapping[str, SemanticGrid]] = MappingProxyType({})


def controllers_of(
    fleet: Fleet,
    settings: RunSettings,
    scenery: Scenery,
    own: Mapping[str, Policy] = NO_POLICIES,
    maps: Mapping[str, SemanticGrid] = NO_MAPS,
) -> dict[str, Controller]:
    """The controllers of a run's UAVs: the first explores and searches, the others only search.

    Args:
        fleet: Who takes part.
        settings: Of the run.
        scenery: Where it flies.
        own: Policies of UAVs, by name, in the place of that of the settings.
        maps: What each UAV maps, by name; painted as it flies.
    """
    base = () if fleet.base is None else (fleet.base,)
    seek = () if settings.passive else (*fleet.ugvs, *base)
    setups = [
        FlightSetup(scenery.mission, seek, explore=number == 0 or settings.passive, name=name)
        for number, name in enumerate(fleet.uavs)
    ]
    values = dict(zip(fleet.ugvs, cycle(settings.values or (1.0,)), strict=False))
    policies: dict[str, Callable[[], Policy]] = {
        "oracle": partial(Rendezvous, values),
        "oracle_tour": partial(Tour, values),
        "orienteering": partial(Orienteering, scenery.mission.speed_m_s, values),
        "milp": PlannedRendezvous,
        "nearest": Nearest,
        "three_in_turn": ThreeInTurn,
        "ferry": partial(Ferry, reach_m=_reach_m(settings)),
        "tour_one_robot": TourOfOne,
        "tour_no_ages": TourWithoutAges,
        "tour_no_paths": TourWithoutPaths,
    }
    made = policies.get(settings.policy, lambda: None)
    waypoints = scenery.mission.waypoints
    if settings.passive:
        waypoints *= _rounds(scenery.mission, settings.duration_s)
    return {
        setup.name: Controller(
            setup,
            scenery.router,
            scenery.plan,
            policy=own[setup.name] if setup.name in own else made(),  # each UAV has its own
            waypoints=waypoints,
            ground=maps.get(setup.name),
        )
        for setup in setups
    }


PATH_LOSS_REACH_M: Final = 30.0
"""How far radios of the path loss model are taken to reach, by a policy that plans with it."""


def _reach_m(settings: RunSettings) -> float:
    """Horizontal distance within which a UAV expects contact."""
    return settings.radius_m if settings.channel == "paper" else PATH_LOSS_REACH_M


def _rounds(mission: Mission, duration_s: float) -> int:
    """How often a vehicle can go round the waypoints in a run, and once more."""
    places = [waypoint.position for waypoint in mission.waypoints]
    round_m = sum(math.dist(a, b) for a, b in pairwise([*places, places[0]]))
    return 2 + int(duration_s * mission.speed_m_s / max(round_m, 1.0))
