"""Runs that were not simulated, for tests of what stands around the engine."""

from types import SimpleNamespace

import numpy as np

from geo.frame import Point
from sitl.experiment.campaign.running import recorded, settings_of
from sitl.experiment.engine.ages import USES
from sitl.experiment.engine.exchange import ContactInterval, Transmission
from sitl.experiment.settings import RunSettings
from sitl.world.explorers.explorer import Visit
from sitl.world.towns.town import Goal


def made_up_run(settings: RunSettings, seed: int) -> SimpleNamespace:
    """More robots find more, and wait longer; nothing else about it is true."""
    chance = np.random.default_rng(seed)
    ugvs = [f"ugv{n + 1:02d}" for n in range(settings.ugvs)]
    base = ["base"] if settings.base_station else []
    robots = (*base, *(f"uav{n + 1:02d}" for n in range(settings.uavs)), *ugvs)
    kinds = tuple(name.rstrip("0123456789") for name in robots)
    team, duration_s = len(robots), settings.duration_s
    share = min(1.0, 0.2 + 0.05 * settings.ugvs + 0.004 * settings.radius_m)
    goals = [
        Visit(f"goal {n}", float(chance.uniform(60, duration_s)), f"ugv{1 + n % 3:02d}")
        for n in range(10)
        if chance.random() < share
    ]
    uav = SimpleNamespace(painter=SimpleNamespace(known_share=0.95))
    return SimpleNamespace(
        settings=settings,
        fleet=SimpleNamespace(names=robots, kinds=kinds, ugvs=ugvs),
        travelled_m=np.arange(team, dtype=float),
        town=SimpleNamespace(goals=[Goal(f"goal {n}", Point(15.0 * n, 5.0)) for n in range(10)]),
        goal_bound_share=1.0,
        map_known_share=0.6,
        goals=sorted(goals, key=lambda visit: visit.time_s),
        airtime=SimpleNamespace(
            transmissions=_transmissions(chance, settings, team),
            complete=40 * team,
            broken=team // 3,
        ),
        channel_sim=SimpleNamespace(open=1),
        link_scores=None,
        contacts=_contacts(chance, team, duration_s),
        uavs=[uav] * settings.uavs,
        held=_held(chance, robots, kinds, duration_s),
        faults={},
        log=SimpleNamespace(actions=99, digest=f"{seed:064x}"),
        wall_s=0.01 * team**2,
        cpu_s=0.01 * team**2,
    )


def _transmissions(chance, settings, team):
    count = 60 * team
    centres_s = chance.uniform(0, settings.duration_s, 1 + count // 40)
    ready_s = np.sort(chance.choice(centres_s, count) + chance.exponential(8, count))
    late = chance.random(count) < 0.5
    mean_s = 0.01 * team * settings.radius_m * settings.uavs
    start_s = ready_s + late * chance.exponential(mean_s, count) ** 1.3
    end_s = start_s + chance.exponential(0.13, count)
    answering = chance.integers(0, team, count)
    stages, sizes = chance.integers(0, 3, count), chance.integers(50, 40_000, count)
    complete = chance.random(count) < 0.98
    columns = (ready_s, start_s, end_s, (answering + 1) % team, answering, stages, 0 * stages)
    return [Transmission(*row) for row in zip(*columns, sizes, complete, strict=True)]


def _held(chance, robots, kinds, duration_s):
    times_s = [np.append(0.0, np.sort(chance.uniform(0, duration_s, 9))) for _ in range(100)]
    return {
        (name, a, b): np.stack([own, own - chance.exponential(20, 10) * (own > 0)], axis=1)
        for name, maker, user in USES.values()
        for a, b, own in zip(robots, robots[::-1], times_s, strict=False)
        if a != b and (a[:3], b[:3]) == (maker, user)
    }


def _contacts(chance, team, duration_s):
    count = 20 * team
    began_s = np.sort(chance.uniform(0, duration_s, count))
    ended_s = np.minimum(began_s + chance.exponential(20, count), duration_s)
    a = chance.integers(0, team, count)
    b = (a + chance.integers(1, team, count)) % team
    return [ContactInterval(*row) for row in zip(began_s, ended_s, a, b, strict=True)]


def work(task):
    """A run as the workers make it, but made up."""
    return recorded(task, made_up_run(settings_of(task), task.seed))


def failing_work(task):
    """One of the runs meets a fault of the program."""
    if task.number == 1:
        raise ZeroDivisionError("the model's own fault")
    return work(task)
