"""What decides for the UAVs of a run: the mission over its town, seek policies, controllers.

All runs of a process share towns, missions over them, and the routes of these.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from itertools import cycle, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Final

from air_router.controller import Controller
from air_router.controller.model import FlightSetup
from air_router.controller.targets import Policy, Rendezvous
from air_router.files import Timers
from air_router.mission import FlightPlan, Mission, checked, read_placed
from air_router.routing import Router, WaypointGraph
from sitl.experiment import RunSettings
from sitl.experiment.robots.baselines import Orienteering, PlannedRendezvous
from sitl.experiment.robots.node import Fleet
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
    """What the mission says; policies that do not fly are put in its place later."""
    policy = settings.policy
    if policy == "oracle" or policy == "milp":  # noqa: PLR1714 - mypy
        return "rendezvous"
    return "freshest" if policy == "orienteering" else policy


def _mission(path: Path, *, speed_m_s: float, altitude_m: float) -> Mission:
    """A mission at another speed and altitude, on a day that is always the same."""
    placed, findings = read_placed(path)
    placed = placed.with_settings(speed_m_s=speed_m_s, altitude_m=altitude_m)
    waypoints = tuple(dataclasses.replace(spot, altitude_m=None) for spot in placed.waypoints)
    placed = dataclasses.replace(placed, waypoints=waypoints)
    return checked(placed, findings, start=_DAY)


NO_POLICIES: Final[Mapping[str, Policy]] = MappingProxyType({})


def controllers_of(
    fleet: Fleet, settings: RunSettings, scenery: Scenery, own: Mapping[str, Policy] = NO_POLICIES
) -> dict[str, Controller]:
    """The controllers of a run's UAVs: the first explores and searches, the others only search.

    Args:
        fleet: Who takes part.
        settings: Of the run.
        scenery: Where it flies.
        own: Policies of UAVs, by name, in the place of that of the settings.
    """
    base = () if fleet.base is None else (fleet.base,)
    seek = () if settings.passive else (*fleet.ugvs, *base)
    setups = [
        FlightSetup(scenery.mission, seek, explore=number == 0 or settings.passive, name=name)
        for number, name in enumerate(fleet.uavs)
    ]
    values = dict(zip(fleet.ugvs, cycle(settings.values or (1.0,)), strict=False))
    policies: dict[str, Policy] = {
        "oracle": Rendezvous(values),
        "orienteering": Orienteering(scenery.mission.speed_m_s, values),
        "milp": PlannedRendezvous(),
    }
    waypoints = scenery.mission.waypoints
    if settings.passive:
        waypoints *= _rounds(scenery.mission, settings.duration_s)
    return {
        setup.name: Controller(
            setup,
            scenery.router,
            scenery.plan,
            policy=own.get(setup.name, policies.get(settings.policy)),
            waypoints=waypoints,
        )
        for setup in setups
    }


def _rounds(mission: Mission, duration_s: float) -> int:
    """How often a vehicle can go round the waypoints in a run, and once more."""
    places = [waypoint.position for waypoint in mission.waypoints]
    round_m = sum(math.dist(a, b) for a, b in pairwise([*places, places[0]]))
    return 2 + int(duration_s * mission.speed_m_s / max(round_m, 1.0))
