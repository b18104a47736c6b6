"""A run as an environment of PettingZoo: the API, the observations, and what the returns are."""

import numpy as np
import pytest

from sitl.experiment.campaign.running import settings_of
from sitl.experiment.engine import Run
from sitl.experiment.plan_file import load_experiment
from sitl.experiment.settings import RunSettings

pettingzoo = pytest.importorskip("pettingzoo")
from pettingzoo.test import parallel_api_test  # noqa: E402

from sitl.experiment.learning import SeekEnvironment, environment_of  # noqa: E402

SHORT = {"duration_s": 500.0, "goals": "seed", "starts": "seed", "protocol": "ours"}


def settings(**own):
    experiment, _ = load_experiment("searches")
    task = experiment.task(experiment.rows[0], 0)
    return RunSettings(**{**settings_of(task).model_dump(), **SHORT, **own})


def played(environment, seed, choose):
    """Rewards, times of decisions and the last infos of an episode."""
    seen, infos = environment.reset(seed=seed)
    rewards, times_s = [], []
    while environment.agents:
        actions = {agent: choose(seen[agent]) for agent in environment.agents}
        times_s.append(next(iter(infos.values()))["time_s"])
        seen, reward, _, truncations, infos = environment.step(actions)
        rewards.append(next(iter(reward.values())))
    assert all(truncations.values())
    return rewards, times_s, infos


@pytest.mark.parametrize("uavs", [1, 2])
@pytest.mark.filterwarnings("ignore::UserWarning")  # of the test itself, about spaces
def test_the_api(uavs):
    environment = SeekEnvironment(settings(uavs=uavs))
    parallel_api_test(environment, num_cycles=12)
    environment.close()


def test_the_return_is_the_column_of_the_results():
    for reward, column, unit in (
        ("goals", "goal_rate_area_percent", 100.0),
        ("service", "service_age_mean_s", -1.0),
    ):
        environment = SeekEnvironment(settings(), reward=reward)
        rewards, _, infos = played(environment, 5, lambda _seen: 0)
        measures = infos["uav01"]["measures"]
        assert sum(rewards) * unit == pytest.approx(measures[column], rel=1e-6)


def test_the_same_seed_and_actions_make_the_same_run():
    environment = SeekEnvironment(settings(uavs=2))
    rng = np.random.default_rng(1)
    actions = [int(each) for each in rng.integers(5, size=200)]

    def run(seed):
        rest = iter(actions)
        _, times_s, infos = played(environment, seed, lambda _seen: next(rest))
        return times_s, infos["uav02"]["measures"]["transmissions"]

    first = run(7)
    assert run(7) == first
    assert run(8) != first


def test_choosing_as_a_policy_flies_as_that_policy():
    """Round robin by hand: the same searches as the policy makes, and so the same run."""
    own = settings(policy="round_robin")
    reference = Run(own, 11)
    reference.finish()
    environment = SeekEnvironment(own, where="round_robin")
    turn = iter(range(1000))
    _, times_s, infos = played(environment, 11, lambda _seen: next(turn) % own.ugvs)
    searches = [at_s for at_s, state in reference.uavs[0].states if state == "SEARCH"]
    assert times_s == searches
    flown_m = reference.travelled_m[reference.fleet.kinds.index("uav")]
    assert infos["uav01"]["measures"]["flown_km"] == flown_m / 1e3


def test_an_observation_shows_whose_action_counts_and_where_robots_are():
    environment = SeekEnvironment(settings(uavs=2))
    seen, infos = environment.reset(seed=3)
    deciding = [agent for agent, info in infos.items() if info["decides"]]
    assert len(deciding) == 1
    assert [agent for agent, own in seen.items() if own[0] == 1.0] == deciding
    for agent, own in seen.items():
        assert environment.observation_space(agent).contains(own)
    robots = seen[deciding[0]][3:].reshape(-1, 8)
    flown_s = np.hypot(robots[:, 0], robots[:, 1]) * 1000.0 / 5.0
    assert np.all(robots[:, 2] * 600.0 >= flown_s - 4.0)  # near enough, it need not fly
    assert set(robots[:, 6:].ravel()) <= {0.0, 1.0}
    environment.close()
    environment.close()


def test_a_shipped_row_by_its_name():
    environment = environment_of("searches", "sparse radios, tour")
    assert environment.possible_agents == ["uav01"]
    assert environment.action_space("uav01").n == 5
    with pytest.raises(ValueError, match="no UAV takes part"):
        SeekEnvironment(settings(uavs=0))
