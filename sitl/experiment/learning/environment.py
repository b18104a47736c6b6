"""A run as a parallel environment of PettingZoo: UAVs are agents, a step is a decision.

    from pettingzoo.test import parallel_api_test
    from sitl.experiment.learning import environment_of

    env = environment_of("searches", "sparse radios, tour")
    parallel_api_test(env, num_cycles=50)

A step goes on to the next moment at which a UAV decides whom to seek. Its observation has 1 as its
first number; the action of the others does not count, since they are in the middle of a search or
an exploration, and they see what they saw when they decided last. With one UAV every step counts.

Observation (`Box(-10, 10)`), 3 numbers and then 8 for each robot, in the mission's order:

    decides     1: this agent's next action counts
    time        share of the run that is over, 0..1
    round       what a search costs beside the flight, in units of 600 s
    east, north of the place where the robot would be sought, from the UAV, in kilometres
    flight      to that place, in units of 600 s; 10: no way leads there
    held, given ages of what the UAV holds of the robot, and the other way round, of 1200 s
    tries       searches since it was last received, in units of 5
    known       1: the UAV knows something of it
    free        1: it is neither lost nor sought by another UAV

Action (`Discrete`): the robot that is sought next, by its number.

Reward, the same for all agents: with `goals`, what each goal that was found in the step adds to
`goal_rate_area_percent` / 100; with `service`, the seconds that the step adds to
`service_age_mean_s`, negative. So the return of an episode is that column of the results. When the
run is over all agents are truncated, and `infos` has its `measures`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from air_router.seek_policies import policy_of
from mocha_link.errors import needs_extra
from sitl.experiment import RunSettings, load_experiment
from sitl.experiment.campaign import settings_of
from sitl.experiment.engine import Run, measured, service_age_s
from sitl.experiment.learning.decisions import Decision, DecisionRun, robots_of

with needs_extra("an environment for learning", "learning", "air-router"):
    from gymnasium.spaces import Box, Discrete
    from pettingzoo import ParallelEnv

Reward = Literal["goals", "service"]
Observation = npt.NDArray[np.float32]

GLOBALS: Final = 3
PER_ROBOT: Final = 8
MOST: Final = 10.0
"""Observations lie between this and its negative."""

_FLIGHT_S, _AGE_S, _TRIES, _KM = 600.0, 1200.0, 5.0, 1000.0


class SeekEnvironment(ParallelEnv):  # type: ignore[misc]  # PettingZoo is typed in part
    """UAVs that choose whom to seek.

    Args:
        settings: Of the runs; their policy does not count.
        reward: What a step is worth.
        where: The seek policy that decides where a robot is sought.

    Attributes:
        possible_agents: The UAVs.
        agents: Those of the run; none when it is over.
        metadata: For PettingZoo.
    """

    metadata: Final = {"name": "air_router_seek_v0", "render_modes": []}
    render_mode = None

    def __init__(
        self, settings: RunSettings, *, reward: Reward = "goals", where: str = "rendezvous"
    ) -> None:
        if not settings.uavs:
            raise ValueError("no UAV takes part; set uavs")
        self._settings, self._reward, self._where = settings, reward, where
        self.possible_agents = [f"uav{number + 1:02d}" for number in range(settings.uavs)]
        self.agents: list[str] = []
        robots = settings.ugvs + settings.base_station
        # The same for each agent.
        self._observation_space = Box(-MOST, MOST, (GLOBALS + PER_ROBOT * robots,), np.float32)
        self._action_space = Discrete(robots)
        self._seeds = np.random.default_rng()  # of runs that are given no seed
        self._decisions: DecisionRun | None = None  # None: no run has begun, or it was closed
        self._decision: Decision | None = None  # that waits for an action; None: the run is over
        self._seen: dict[str, Observation] = {}  # by agent, at its last decision
        self._worth = 0.0  # of the run so far

    def observation_space(self, agent: str) -> Box:  # noqa: ARG002 - all alike
        """What an agent sees."""
        return self._observation_space

    def action_space(self, agent: str) -> Discrete:  # noqa: ARG002 - all alike
        """What an agent may do."""
        return self._action_space

    def reset(
        self,
        seed: int | None = None,
        options: Mapping[str, Any] | None = None,  # noqa: ARG002
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin a run with a seed, which makes all that is random in it."""
        self.close()
        if seed is None:
            seed = int(self._seeds.integers(2**62))
        self._decisions = DecisionRun(self._settings, seed, policy_of(self._where))
        self.agents = [*self.possible_agents]
        blank = np.zeros(self._observation_space.shape, np.float32)
        self._seen = dict.fromkeys(self.agents, blank)
        self._worth = 0.0
        self._take(self._decisions.next())
        return self._observations(), self._infos()

    def step(
        self, actions: Mapping[str, int]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Go on to the next decision."""
        if self._decisions is None or self._decision is None:
            return {}, {}, {}, {}, {}
        agents, run = self.agents, self._decisions.run
        chosen = robots_of(run)[int(actions[self._decision.uav])]
        self._take(self._decisions.next(chosen))
        before, self._worth = self._worth, self._worth_of(run)
        over = self._decision is None
        infos = self._infos()
        if over:
            for info in infos.values():
                info["measures"] = measured(run)
            self.agents = []
        return (
            self._observations(agents),
            dict.fromkeys(agents, self._worth - before),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, over),
            infos,
        )

    def close(self) -> None:
        """End a run that is not over."""
        if self._decisions is not None:
            self._decisions.close()
            self._decisions = self._decision = None

    def render(self) -> None:
        """Nothing is drawn; `sitl experiment` has figures."""

    def _take(self, decision: Decision | None) -> None:
        self._decision = decision
        for agent, seen in self._seen.items():
            self._seen[agent] = seen.copy()
            self._seen[agent][0] = 0.0
        if decision is not None:
            self._seen[decision.uav] = self._observation(decision)

    def _observations(self, agents: list[str] | None = None) -> dict[str, Observation]:
        return {agent: self._seen[agent] for agent in agents or self.agents}

    def _infos(self) -> dict[str, dict[str, Any]]:
        now_s = 0.0 if self._decisions is None else self._decisions.run.queue.now_s
        deciding = None if self._decision is None else self._decision.uav
        return {agent: {"decides": agent == deciding, "time_s": now_s} for agent in self.agents}

    def _worth_of(self, run: Run) -> float:
        """The return so far."""
        now_s, duration_s = run.queue.now_s, run.settings.duration_s
        if self._reward == "service":
            held = run.ages.held(run.fleet.names, run.fleet.kinds)
            age_s = service_age_s(run, held, now_s) if now_s else None
            return -(age_s or 0.0) * now_s / duration_s
        goals = max(len(run.town.goals), 1)
        return float(sum(1 - visit.time_s / duration_s for visit in run.goals)) / goals

    def _observation(self, decision: Decision) -> Observation:
        if self._decisions is None:
            raise AssertionError("a decision is of a run")
        targets, context, run = decision.targets, decision.context, self._decisions.run
        uav = next(each for each in run.uavs if each.name == decision.uav)
        where = policy_of(self._where)
        free = targets.groups(context.now_s)[0]
        numbers = [1.0, run.queue.now_s / self._settings.duration_s, context.round_s / _FLIGHT_S]
        for robot in robots_of(run):
            place, track = where.place(robot, targets, context), targets.tracks[robot]
            position = place.position or context.unseen
            flight_s = context.flight_s(position)
            held_s, given_s = (
                context.now_s - max(at for at in moments if at is not None)
                for moments in (
                    (context.began_s, track.newest_s, track.taken_s),
                    (context.began_s, track.given_s),
                )
            )
            numbers += [
                (position.east_m - uav.flyer.position.east_m) / _KM,
                (position.north_m - uav.flyer.position.north_m) / _KM,
                flight_s / _FLIGHT_S if math.isfinite(flight_s) else MOST,
                held_s / _AGE_S,
                given_s / _AGE_S,
                track.tries / _TRIES,
                float(targets.course(robot) is not None),
                float(robot in free),
            ]
        return np.clip(np.array(numbers, np.float32), -MOST, MOST)


def environment_of(
    experiment: str, row: str | None = None, *, reward: Reward = "goals", where: str = "rendezvous"
) -> SeekEnvironment:
    """The environment of a row of an experiment, by the name of a shipped one or by its file.

    Args:
        experiment: Its name or file.
        row: The label of the row; None: the first.
        reward: As of `SeekEnvironment`.
        where: Likewise.

    Raises:
        UsageError: there is no such experiment or row.
        DocumentError: its file is wrong.
    """
    found, _ = load_experiment(experiment)
    rows = found.rows if row is None else found.chosen([row])
    return SeekEnvironment(settings_of(found.task(rows[0], 0)), reward=reward, where=where)
