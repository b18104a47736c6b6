"""Whole nodes where everything goes wrong, at random but the same every time: nothing is lost."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest

from mocha_link.team.document import Document
from mocha_link.team.team import Team
from tests.mocha_link.conftest import TEAM
from tests.mocha_link.network_sim import NAMES, Carried, NetworkSim

BASE = Team.from_document(
    Document.from_text(
        TEAM.replace("priority: medium}", "priority: medium, history: 3}"), Path("team.yaml")
    )
)
TOPICS = {"titan": ("/map",), "callisto": ("/pose", "/path"), "io": ("/pose", "/path", "/cloud")}
SIZES = (10, 300, 3_000, 60_000)
ROUNDS = 60


class Weather:
    """A team, its network and what it should hold in the end, from one seed."""

    def __init__(self, seed: int, *, damage: bool) -> None:
        self.chance = chance = random.Random(seed)
        self.newest: dict[tuple[str, str], bytes] = {}
        self._number = 0
        team = BASE
        if chance.random() < 0.3 and not damage:  # nothing protects an original node's requests
            team = team.with_robots({chance.choice(NAMES): {"original": True}})
        if chance.random() < 0.3:
            budget = chance.choice((20_000, 400_000))
            team = replace(team, trigger=replace(team.trigger, budget_bytes=budget))
        self.net = NetworkSim(
            team,
            datagrams=chance.random() < 0.8,
            delay_s=chance.choice((0, 0.002, 0.02, 0.15)),
        )
        self._lost = {"udp": chance.choice((0, 0.05, 0.3)), "zmq": chance.choice((0, 0, 0.02))}
        self.net.lets_by = lambda piece: chance.random() >= self._lost[piece.path]
        self._damaged = chance.choice((0.01, 0.1)) if damage else 0.0
        self.net.alter = self._alter

    def _alter(self, piece: Carried) -> bytes:
        chance, data = self.chance, bytearray(piece.data)
        if chance.random() >= self._damaged or not data:
            return piece.data
        how = chance.random()
        if how < 0.6:
            data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        elif how < 0.8:
            del data[chance.randrange(len(data)) :]
        else:
            data += chance.randbytes(5)
        return bytes(data)

    def step(self) -> None:
        chance, net = self.chance, self.net
        what = chance.random()
        one, other = chance.sample(NAMES, 2)
        if what < 0.35:
            topic = chance.choice(TOPICS[one])
            self._number += 1
            data = b"%d " % self._number + chance.randbytes(chance.choice(SIZES))
            self.newest[one, topic] = data
            net.publish(one, topic, data)
        elif what < 0.65:
            net.nodes[one].sync(other, net.at(one))
            net.wait(chance.choice((0, 0.01, 0.1, 0.5, 3)))
        elif what < 0.75:
            net.blocked ^= {(chance.choice(("zmq", "udp")), one, other)}
        elif what < 0.82:
            net.silent ^= {one}
        elif what < 0.9:
            self.contact(one, other)
            net.wait(chance.choice((0, 0.1, 1)))
        else:
            net.wait(chance.choice((0.1, 1, 6, 14)))

    def contact(self, one: str, other: str) -> None:
        node, now = self.net.nodes[one], self.net.at(one)
        node.heard(other, None, now)
        node.heard(other, -50, now)

    def calm(self) -> None:
        """From now on nothing goes wrong."""
        net = self.net
        net.blocked.clear()
        net.silent.clear()
        net.lets_by = None
        net.alter = lambda piece: piece.data
        net.settle()
        net.wait(14)

    def meet(self) -> bool:
        """titan meets the others, who never meet; whether everybody has everything."""
        for one, other in (("titan", "callisto"), ("titan", "io"), ("callisto", "titan")):
            self.contact(one, other)
            self.net.settle()
        self.contact("io", "titan")
        self.net.settle()
        self.net.wait(5)
        return all(self.net.held(name) == self.newest for name in NAMES)


@pytest.mark.parametrize("damage", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_everybody_ends_with_everything(seed, damage):
    weather = Weather(seed, damage=damage)
    for _ in range(30):
        weather.step()
    weather.calm()
    assert any(weather.meet() for _ in range(ROUNDS))
    nodes = weather.net.nodes.values()
    links = [link for node in nodes for link in node.links(weather.net.now).values()]
    if not damage:
        assert not any(link.refused for link in links)
