"""The paper's field test, harder: its interactions over links that delay, cut and damage.

To explore all 1,720 of the paper, else a fourth of them.

Four nodes over real sockets, every link through a relay (`weather.py`). All write all the time.
In the end the links are whole, and all must hold the newest message of every topic of every robot,
and all messages of the topics that keep a history. Every message has
a digest of its content: it is checked whenever one is stored, on every node.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
import itertools
import logging
import queue
import random
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mocha_link.links.metrics import Direction, MessageStored, SyncEnded, SyncTimedOut
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from mocha_link.store.message import message_of
from mocha_link.team import keys
from mocha_link.team.document import Document
from mocha_link.team.team import Team
from tests.mocha_link.conftest import free_ports, own_host
from tests.mocha_link.fuzz import EXPLORE
from tests.system.weather import DOWN, Passage, RoughAir, Weather

if TYPE_CHECKING:
    from mocha_link.links.metrics import LinkEvent
    from mocha_link.store.message import Message

LOG = logging.getLogger(__name__)

INTERACTIONS = 1720 if EXPLORE else 430
SEED = 1
LASTED_S = 116 * 60.0  # in the paper
NAMES = ("callisto", "europa", "io", "titan")
AHEAD_S = {"callisto": 0.0, "europa": -2400.25, "io": 3.5, "titan": -1_795_170_000.75}
START_S = 1_795_175_900.0
TIMEOUT_S = 0.2
WAIT_S = 60.0  # a limit against hangs
TRIES = 20
NEAR_DBM = -50.0
DIGEST_BYTES = 16
KIND = """\
kinds:
  robot:
    topics:
      - {name: /pose, type: json/Pose, priority: high}
      - {name: /map, type: grid/SemanticMap, priority: medium}
      - {name: /cloud, type: raw/Cloud, priority: none}
      - {name: /log, type: raw/Log, priority: low, history: 1000}
      - {name: /found, type: raw/Found, priority: high, aggregate: true, min_interval_s: 120,
         history: 100}
trigger: {interval_s: 100000}
"""
SIZES = {"/pose": (20, 300), "/map": (1000, 300_000), "/cloud": (500, 60_000), "/log": (0, 100)}
SIZES["/found"] = (0, 2000)
WRITTEN = ("/pose", "/pose", "/pose", "/log", "/log", "/found", "/cloud", "/map")


def make_team(folder: Path, *, locked: bool) -> Team:
    """A robot is dialled at an address of its own, where the relays are, and listens at another.

    If it is `locked`, all robots have keys, and the folder their secrets.
    """
    text = "robots:\n"
    for name in NAMES:
        address, listen = own_host(), own_host()
        others = ", ".join(each for each in NAMES if each != name)
        text += (
            f"  {name}: {{kind: robot, address: {address}, listen: {listen}, "
            f"base_port: {free_ports(listen, 3)}, clients: [{others}]}}\n"
        )
    team = Team.from_document(Document.from_text(text + KIND, Path("team.yaml")))
    if not locked:
        return team
    secrets = {name: keys.SecretKey(name.encode().ljust(32)) for name in NAMES}
    for name, secret in secrets.items():
        keys.write(keys.path_of(name, folder), name, secret)
    return team.with_robots({name: {"key": each.public.text} for name, each in secrets.items()})


class FieldTime:
    """Goes on with the interactions."""

    def __init__(self) -> None:
        self.now_s = START_S


class RobotClock:
    """Each is off in its own way; one was never set."""

    def __init__(self, time: FieldTime, name: str) -> None:
        self._time = time
        self._ahead_s = AHEAD_S[name]

    def now_s(self) -> float:
        return self._time.now_s + self._ahead_s


def sealed(robot: str, topic: str, number: int, size: int) -> bytes:
    """A message with a digest of its content; half of it can be compressed."""
    filling = random.Random(f"{robot} {topic} {number}").randbytes(size // 2)
    text = f"{robot} {topic} {number} ".encode() + filling + bytes(size - size // 2)
    return hashlib.sha256(text).digest()[:DIGEST_BYTES] + text


def opened(robot: str, topic: str, data: bytes) -> int:
    """The number of a message that is what it should be."""
    digest, text = data[:DIGEST_BYTES], data[DIGEST_BYTES:]
    assert hashlib.sha256(text).digest()[:DIGEST_BYTES] == digest, "corrupt"
    named, about, number, _ = text.split(b" ", 3)
    assert (named.decode(), about.decode()) == (robot, topic), "mixed up"
    return int(number)


class Robot:
    """A node, its radio, and who looks at everything that it stores."""

    def __init__(self, team: Team, name: str, clock: RobotClock, folder: Path) -> None:
        self.name = name
        self.radio = ManualRadio()
        self.node = Node(
            team, name, clock=clock, radio=self.radio, timeout_s=TIMEOUT_S, keys=folder
        )
        self.wrong: list[str] = []
        self.checked = 0
        self.written: dict[str, list[bytes]] = {topic: [] for topic in SIZES}
        self._ends: dict[str, queue.SimpleQueue[LinkEvent]] = {
            peer: queue.SimpleQueue() for peer in self.node.robot.peers
        }
        self._newest: dict[tuple[str, str], int] = {}
        self._lock = threading.Lock()
        self.node.subscribe(self._look)

    def _look(self, event: LinkEvent) -> None:
        if isinstance(event, MessageStored):
            try:
                self._check(event)
            except Exception as error:  # noqa: BLE001 - reported at the end, whatever it is
                self.wrong.append(f"{event}: {error!r}")
        elif isinstance(event, SyncEnded | SyncTimedOut) and event.direction is Direction.IN:
            self._ends[event.peer].put(event)

    def _check(self, event: MessageStored) -> None:
        """What is stored is right, and what is newest never becomes older."""
        record = self.node._gossip.database.get(event.header)
        if record:  # it may have been replaced meanwhile
            check(message_of(record, self.node.team))
            self.checked += 1
        message = self.node.latest(event.robot, event.topic)
        assert message is not None
        newest = check(message)[-1]
        before = self._newest.get((event.robot, event.topic), -1)
        assert newest >= before, f"{newest} after {before}"
        self._newest[event.robot, event.topic] = newest

    def write(self, rng: random.Random) -> None:
        topic = rng.choice(WRITTEN)
        least, most = SIZES[topic]
        size = int(least + (most - least) * rng.random() ** 3)
        with self._lock:  # so that numbers are in the order of publication
            data = sealed(self.name, topic, len(self.written[topic]), size)
            self.written[topic].append(data)
            self.node.publish(topic, data)

    def pull(self, peer: str) -> LinkEvent:
        """Come into contact with a peer, and out of it when the pull is over."""
        self.radio.report(peer, NEAR_DBM)
        end = self._ends[peer].get(timeout=WAIT_S)
        self.radio.report(peer, None)
        return end


def check(message: Message) -> list[int]:
    """The numbers of what is in a message, all of it as it was written."""
    numbers = [opened(message.robot, message.topic, part) for part in message.parts]
    assert numbers == sorted(numbers)
    return numbers


class FieldTest:
    """Pairs meet, several at the same time; every meeting is an interaction each way."""

    def __init__(self, team: Team, folder: Path, air: RoughAir, time: FieldTime) -> None:
        self.robots = {name: Robot(team, name, RobotClock(time, name), folder) for name in NAMES}
        self.passages: list[Passage] = []
        self.ends: list[LinkEvent] = []
        self._air = air
        self._time = time
        self._failures: list[BaseException] = []

    def run(self, interactions: int) -> None:
        pairs = list(itertools.combinations(NAMES, 2))
        threads = [
            threading.Thread(
                target=self._meetings,
                args=(*pair, range(index, interactions // 2, len(pairs))),
            )
            for index, pair in enumerate(pairs)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for failure in self._failures:
            raise failure

    def _meetings(self, a: str, b: str, numbers: range) -> None:
        try:
            for number in numbers:
                self._meet(a, b, number)
        except BaseException as error:  # noqa: BLE001 - raised where the test is
            self._failures.append(error)

    def _meet(self, a: str, b: str, number: int) -> None:
        rng = random.Random(f"{SEED} meeting {number}")
        self._time.now_s += LASTED_S / INTERACTIONS * 2
        for name in NAMES:
            if rng.random() < 0.4:
                self.robots[name].write(rng)
        ways = ((a, b), (b, a))
        for index, (puller, server) in enumerate(ways):
            weather = Weather.of(SEED, 2 * number + index)
            self.passages.append(self._air.begin(puller, server, weather))
        pulls = [threading.Thread(target=self._pull, args=way) for way in ways]
        for pull in pulls:
            pull.start()
        while rng.random() < 0.5:
            self.robots[rng.choice(NAMES)].write(rng)
        for pull in pulls:
            pull.join()

    def _pull(self, puller: str, server: str) -> None:
        try:
            self.ends.append(self.robots[puller].pull(server))
        except BaseException as error:  # noqa: BLE001 - the same
            self._failures.append(error)

    def heal(self) -> None:
        """All links are whole; who stands in a line meets his neighbours, there and back.

        So no node can get from a third what a neighbour has kept from him.
        """
        for robot in self.robots.values():
            robot.node.flush("/found")
        there = list(itertools.pairwise(NAMES))
        for server, puller in there + [(b, a) for a, b in reversed(there)]:
            self._air.begin(puller, server, Weather())
            for _ in range(TRIES):  # the machine may be busy: a pause is no reason to fail
                end = self.robots[puller].pull(server)
                if isinstance(end, SyncEnded):
                    break
            assert isinstance(end, SyncEnded)
            assert end.complete

    def everybody_holds_everything(self) -> None:
        for robot, other in itertools.product(self.robots.values(), repeat=2):
            for topic, written in other.written.items():
                history = robot.node.history(other.name, topic)[::-1]
                held = [part for each in history for part in each.parts]
                numbers = [number for each in history for number in check(each)]
                kept = slice(None) if topic in ("/log", "/found") else slice(-1, None)
                assert held == written[kept]
                assert numbers == list(range(len(written)))[kept]


def left_over() -> tuple[int, int]:
    """Threads and open files of this process."""
    gc.collect()
    return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize(
    ("interactions", "locked"),
    [(INTERACTIONS, False), (100, True)],
    ids=["without keys", "with keys"],
)
def test_the_field_test(caplog, tmp_path, interactions, locked):
    if locked and not keys.available():
        pytest.skip("needs PyNaCl: install the extra 'keys'")
    before = left_over()
    team, time = make_team(tmp_path, locked=locked), FieldTime()
    with RoughAir(team) as air:
        field = FieldTest(team, tmp_path, air, time)
        with contextlib.ExitStack() as stack:
            for robot in field.robots.values():
                stack.enter_context(robot.node)
            field.run(interactions)
            field.heal()
            field.everybody_holds_everything()
    assert left_over() == before
    assert [robot.wrong for robot in field.robots.values()] == [[]] * len(NAMES)
    assert [each for each in caplog.records if each.levelno >= logging.ERROR] == []
    # And the weather was as bad as intended.
    assert len(field.ends) == len(field.passages) == interactions
    assert sum(each.interrupted for each in field.passages) >= interactions / 3
    assert sum(each.flipped > 0 for each in field.passages) >= interactions / 10
    for media in ("tcp", "udp"):
        assert sum(each.carried[media, DOWN] > 1000 for each in field.passages) > interactions / 100
    counted = {
        "interrupted": sum(each.interrupted for each in field.passages),
        "damaged": sum(each.flipped > 0 for each in field.passages),
        "broken pulls": sum(isinstance(each, SyncTimedOut) for each in field.ends),
        "written": sum(len(w) for r in field.robots.values() for w in r.written.values()),
        "checked": sum(robot.checked for robot in field.robots.values()),
    }
    LOG.info("%s", counted)
