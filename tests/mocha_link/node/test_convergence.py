"""Clocks that are set, robots that restart, contacts that break: the newest message still wins."""

import itertools
import random

import pytest

from benchmarks.fleet.network_sim import NAMES, NEAR_DBM, NetworkSim, team_of
from mocha_link.node.publisher import LEAP_MS
from mocha_link.store import Database, Storage, wire
from mocha_link.store.record import Record
from mocha_link.store.wire import FUTURE_MS, STAMPS_MS, UNSAFE_MS, WRAP_MS, Header, as_ms
from tests.mocha_link.conftest import TEAM
from tests.mocha_link.fuzz import EXPLORE

HISTORIES = TEAM.replace("priority: medium}", "priority: medium, history: 3}")
TEAMS = [team_of(TEAM), team_of(HISTORIES)]
DAY_S = 86_400.0
CLOCKS_S = (0.0, -1.0, 50.0, -3_600.0, 7_200.0, -40_000.0, -3 * DAY_S, 30 * DAY_S, -1.6e9)
CUTS = (None, 0, 1, 2, 5, 9, 20)  # so many pieces get through


class Life:
    """Three robots to which things happen.

    Attributes:
        published: the last data of each robot and topic since the robot was started.
    """

    def __init__(self, seed: int, *, datagrams: bool) -> None:
        self.random = random.Random(seed)
        delay_s = self.random.choice((0.0, 0.01, 0.1))
        self.net = NetworkSim(TEAMS[seed % 2], datagrams=datagrams, delay_s=delay_s)
        self.published: dict[tuple[str, str], bytes] = {}

    def publish(self, number: int) -> None:
        name = self.random.choice(NAMES)
        topic = self.random.choice(self.net.team.topics_of(name)).name
        data = f"{name}{topic} {number}".encode() * self.random.choice((1, 50, 3_000))
        node, now = self.net.nodes[name], self.net.at(name)
        node.publish(self.net.team.topic(name, topic), data, now, at_once=True)
        node.tick(now)
        self.published[name, topic] = data

    def restart(self) -> None:
        name = self.random.choice(NAMES)
        self.net.wait(0.01)  # no two processes publish within one millisecond
        self.net.restart(name)
        self.published = {
            (who, topic): data for (who, topic), data in self.published.items() if who != name
        }

    def meet(self) -> None:
        net, (a, b) = self.net, self.random.sample(NAMES, 2)
        net.left = self.random.choice((None, 3, 10))
        net.nodes[a].signal_received(b, NEAR_DBM, net.at(a))
        net.wait(self.random.choice((0.05, 1.0, 3.0)))
        net.left = None
        net.nodes[a].signal_received(b, None, net.at(a))

    def happen(self, number: int) -> None:
        what = self.random.random()
        if what < 0.4:
            self.publish(number)
        elif what < 0.6:
            self.net.pull(*self.random.sample(NAMES, 2), cut_after=self.random.choice(CUTS))
        elif what < 0.75:
            self.net.wait(self.random.choice((0.1, 1.0, 5.0, 20.0, 70.0)))
        elif what < 0.85:
            self.restart()
        elif what < 0.95:
            self.net.offset_s[self.random.choice(NAMES)] = self.random.choice(CLOCKS_S)
        else:
            self.meet()


@pytest.mark.parametrize("datagrams", [False, True])
@pytest.mark.parametrize("seed", range(2_000 if EXPLORE else 12))
def test_all_hold_in_the_end_what_each_has_published_last(seed, datagrams):
    life = Life(seed, datagrams=datagrams)
    for number in range(life.random.randint(5, 50)):
        life.happen(number)
    for _ in range(4):  # rounds in which nothing breaks
        life.net.wait(15.0)
        for client in NAMES:
            for server in NAMES:
                if client != server:
                    life.net.pull(client, server)
    held = [life.net.held(name) for name in NAMES]
    assert held[0] == held[1] == held[2]
    assert life.published.items() <= held[0].items()


@pytest.mark.parametrize("latest", [True, False])
@pytest.mark.parametrize("original", [True, False])
def test_a_robot_outlives_what_was_forged_in_its_name_for_the_far_future(team, original, latest):
    """Its own messages have to be later still, and the others must take them."""
    net = NetworkSim(team.with_robots({"callisto": {"original": original}}))
    net.publish("titan", "/map", b"true")
    robot_id, topic = net.nodes["titan"].me.robot_id, team.topic("titan", "/map")
    stamp_ms = STAMPS_MS - 2**44 - 1 if latest else as_ms(net.now.unix_s) + FUTURE_MS - 1
    stamp_ms += 2 * UNSAFE_MS if stamp_ms % WRAP_MS <= UNSAFE_MS else 0
    ids = (robot_id, topic.topic_id)
    body = wire.pack(topic.dtype, topic.priority, b"forged", stamp_ms=stamp_ms, ids=ids)
    forged = Record(Header.at(*ids, stamp_ms), topic.priority, body, stamp_ms, net.now.unix_s)
    assert net.nodes["callisto"].database.insert(forged, net.now.unix_s)
    net.pull("io", "callisto")
    net.pull("titan", "callisto")
    net.pull("titan", "io")
    net.publish("titan", "/map", b"truer")
    net.wait(LEAP_MS / 1000)
    net.publish("titan", "/map", b"truest")
    net.pull("io", "titan")
    assert net.held("io")["titan", "/map"] == b"truest"


YEARS_S = 200 * 365 * DAY_S


@pytest.mark.parametrize("wrong", [("titan",), ("titan", "io"), NAMES])
@pytest.mark.parametrize("original", [False, True])
@pytest.mark.parametrize("restarted", [False, True])
def test_clocks_that_were_200_years_ahead_heal_when_they_are_right_again(
    team, tmp_path, wrong, original, restarted
):
    """The next message of a topic arrives at all, and those of the wrong time are gone."""
    net = NetworkSim(team.with_robots({"callisto": {"original": original}}))
    if restarted:
        storage = Storage(tmp_path / "titan.db")
        net.restart("titan", database=Database(team.histories, storage))
    for name in wrong:
        net.offset_s[name] = YEARS_S
    for data in (b"1", b"2"):
        net.publish("titan", "/map", data)
        net.wait(0.01)
    for client, server in itertools.permutations(NAMES, 2):
        net.pull(client, server)
    net.offset_s.clear()
    if restarted:
        storage.close()
        storage = Storage(tmp_path / "titan.db")
        net.restart("titan", database=Database(team.histories, storage))
    net.publish("titan", "/map", b"right")
    for _ in range(2):
        net.wait(15.0)
        for client, server in itertools.permutations(NAMES, 2):
            net.pull(client, server)
    for name in NAMES:
        assert net.held(name)["titan", "/map"] == b"right"
        ages_s = [net.now.unix_s - record.stamp_s for record in net.nodes[name].database.kept()]
        assert all(0 <= age_s < 1000 for age_s in ages_s)
    if restarted:
        storage.close()
