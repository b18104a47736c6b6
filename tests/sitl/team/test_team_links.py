"""Gossip nodes over relays: what a cut link does to a sync under way."""

import os
import queue
import threading
import time
from pathlib import Path

import pytest

from mocha_link.links.metrics import Direction, MessageStored, SyncEnded, SyncTimedOut
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from mocha_link.team.team import Team
from sitl.team.free_ports import derive_team
from sitl.team.relay import Relay, relayed_pairs

TEAM = Path(__file__).parents[3] / "missions" / "pennovation" / "team.yaml"
WAIT_S = 60.0


class Events:
    def __init__(self, node: Node) -> None:
        self._queue: queue.SimpleQueue = queue.SimpleQueue()
        node.subscribe(self._queue.put)

    def wait(self, kind: type, direction: Direction | None = None):
        deadline_s = time.monotonic() + WAIT_S
        while True:
            event = self._queue.get(timeout=max(0.0, deadline_s - time.monotonic()))
            if isinstance(event, kind) and direction in (None, getattr(event, "direction", None)):
                return event

    def stored_by(self, sync) -> MessageStored:
        """What a sync brings; one that a busy machine lets time out is begun again."""
        while True:
            sync()
            while True:
                event = self._queue.get(timeout=WAIT_S)
                if isinstance(event, MessageStored):
                    return event
                if isinstance(event, SyncTimedOut) and event.direction is Direction.IN:
                    break


@pytest.fixture
def team(tmp_path):
    return derive_team(Team.load(TEAM), tmp_path)


def wait_until(condition) -> None:
    deadline_s = time.monotonic() + WAIT_S
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < deadline_s, "did not happen in time"
        pause.wait(0.01)


class StoppingClock:
    """Runs, then stands still: a limited link carries so much and no more."""

    def __init__(self, stop_after_s: float) -> None:
        self._began_s = time.monotonic()
        self.stop_after_s = stop_after_s

    def now_s(self) -> float:
        return min(time.monotonic() - self._began_s, self.stop_after_s)


def test_a_sync_is_cut_in_the_middle_and_completes_when_the_link_heals(team):
    payload = os.urandom(400_000)  # does not compress
    clock = StoppingClock(0.2)  # 200 kB at 1 MB/s, so that the sync cannot end before the cut
    with (
        Relay(relayed_pairs(team), rate_bytes_s=1e6, now_s=clock.now_s, close_after_s=0.1) as relay,
        Node(team, "titan", radio=ManualRadio()) as titan,
        Node(team, "io", radio=ManualRadio(), timeout_s=0.5) as io,
    ):
        events = Events(io)
        titan.publish("/map", payload)
        relay.set_link("io", "titan", up=True)
        io.sync("titan")
        wait_until(lambda: titan.links()["io"].bytes_out > 1000)
        relay.set_link("io", "titan", up=False)
        events.wait(SyncTimedOut, Direction.IN)
        assert io.latest("titan", "/map") is None
        clock.stop_after_s = 1e9
        relay.set_link("io", "titan", up=True)
        stored = events.stored_by(lambda: io.sync("titan"))
        assert (stored.robot, stored.topic) == ("titan", "/map")
        assert io.latest("titan", "/map").data == payload
        events.wait(SyncEnded, Direction.IN)


def test_a_link_that_is_down_carries_no_sync(team):
    with (
        Relay(relayed_pairs(team), close_after_s=0.05) as relay,
        Node(team, "europa", radio=ManualRadio()) as europa,
        Node(team, "io", radio=ManualRadio(), timeout_s=0.3) as io,
    ):
        events = Events(io)
        europa.publish("/path", b"news")
        io.sync("europa")
        events.wait(SyncTimedOut, Direction.IN)
        assert io.latest("europa", "/path") is None
        relay.set_link("europa", "io", up=True)
        events.stored_by(lambda: io.sync("europa"))
        assert io.latest("europa", "/path").data == b"news"
