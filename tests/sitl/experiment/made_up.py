"""Runs that were not simulated, for tests of what stands around the engine."""

import numpy as np

from geo.frame import Point
from sitl.experiment.campaign.running import recorded, run_settings
from sitl.experiment.engine.ages import USES
from sitl.experiment.engine.result import CONTACT, TRANSMISSION, GoalVisit, RunResult
from sitl.experiment.settings import RunSettings


def made_up_result(settings: RunSettings, seed: int) -> RunResult:
    """More robots find more, and wait longer; nothing else about it is true."""
    chance = np.random.default_rng(seed)
    robots = (
        *(["base"] if settings.base_station else []),
        *(f"uav{n + 1:02d}" for n in range(settings.uavs)),
        *(f"ugv{n + 1:02d}" for n in range(settings.ugvs)),
    )
    kinds = tuple(name.rstrip("0123456789") for name in robots)
    team, duration_s = len(robots), settings.duration_s
    share = min(1.0, 0.2 + 0.05 * settings.ugvs + 0.004 * settings.radius_m)
    goals = sorted(
        GoalVisit(f"goal {n}", float(chance.uniform(60, duration_s)), f"ugv{1 + n % 3:02d}")
        for n in range(10)
        if chance.random() < share
    )
    goals = tuple(sorted(goals, key=lambda visit: visit.time_s))
    times_s = np.arange(0, duration_s + 1, settings.sample_s)
    starts_m = chance.uniform(-100, 100, (1, team, 2))
    steps_m = chance.normal(0, 0.5, (len(times_s), team, 2)) * settings.sample_s
    steps_m += 1.5 * settings.sample_s * np.sin(times_s / 97)[:, None, None]
    return RunResult(
        seed=seed,
        robots=robots,
        kinds=kinds,
        travelled_m=tuple(float(n) for n in range(team)),
        values=(1.0,) * settings.ugvs,
        goals_total=10,
        goal_bound_share=1.0,
        goals=goals,
        goal_places=tuple((f"goal {n}", Point(15.0 * n, 5.0)) for n in range(10)),
        transmissions=_transmissions(chance, settings, team),
        contacts=_contacts(chance, team, duration_s),
        exchanges_complete=40 * team,
        exchanges_broken=team // 3,
        exchanges_open=1,
        sample_times_s=times_s,
        positions_m=(starts_m + np.cumsum(steps_m, axis=0) / 8).astype(np.float32),
        held=_held(chance, robots, kinds, duration_s),
        known_share=np.clip(times_s / duration_s * 1.4, 0, 0.95).astype(np.float32),
        states=(("uav01", 0.0, "INIT"), ("uav01", 150.0, "SEARCH"), ("uav01", 190.0, "COMM")),
        decisions=99,
        digest=f"{seed:064x}",
        wall_s=0.01 * team**2,
        cpu_s=0.01 * team**2,
    )


def _transmissions(chance, settings, team):
    count = 60 * team
    rows = np.zeros(count, TRANSMISSION)
    centres_s = chance.uniform(0, settings.duration_s, 1 + count // 40)
    times_s = np.sort(chance.choice(centres_s, count) + chance.exponential(8, count))
    rows["ready_s"] = times_s
    late = chance.random(count) < 0.5
    mean_s = 0.01 * team * settings.radius_m * settings.uavs
    rows["start_s"] = times_s + late * chance.exponential(mean_s, count) ** 1.3
    rows["end_s"] = rows["start_s"] + chance.exponential(0.13, count)
    rows["answering"] = chance.integers(0, team, count)
    rows["asking"] = (rows["answering"] + 1) % team
    rows["stage"] = chance.integers(0, 3, count)
    rows["bytes"] = chance.integers(50, 40_000, count)
    rows["complete"] = chance.random(count) < 0.98
    return rows


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
    rows = np.zeros(count, CONTACT)
    rows["began_s"] = np.sort(chance.uniform(0, duration_s, count))
    rows["ended_s"] = np.minimum(rows["began_s"] + chance.exponential(20, count), duration_s)
    rows["a"] = chance.integers(0, team, count)
    rows["b"] = (rows["a"] + chance.integers(1, team, count)) % team
    return rows


def work(task):
    """A run as the workers make it, but made up."""
    settings = run_settings(task)
    return recorded(task, settings, made_up_result(settings, task.seed))


def failing_work(task):
    """One of the runs meets a fault of the program."""
    if task.number == 1:
        raise ZeroDivisionError("the model's own fault")
    return work(task)
