"""Hours in the life of a team: a wrap, reboots, clocks that jump. All robots get the newest.

Engines without sockets: the seven hours around a wrap pass in a second; to explore, 72 hours. Again
and again something happens to one of the robots; then all robots meet twice, and all have to hold
the newest message of every topic of every robot. Between such rounds they meet now and then, often
for too short a time.
"""

import itertools
import random
from pathlib import Path

import pytest

from benchmarks.fleet.network_sim import NetworkSim, T
from mocha_link.store.database import Database
from mocha_link.store.storage import Storage
from mocha_link.store.wire import WRAP_S
from mocha_link.team.team import Team
from tests.mocha_link.conftest import DATA
from tests.mocha_link.fuzz import EXPLORE

pytestmark = pytest.mark.long

NAMES = ("callisto", "europa", "io", "titan")
TEAM = Team.load(DATA / "days.yaml")
HOUR_S = 3600.0
DAYS_S = (72 if EXPLORE else 20) * HOUR_S
BEGIN_S = 0.0 if EXPLORE else 13 * HOUR_S
WRAPS = int((T + DAYS_S) // WRAP_S - (T + BEGIN_S) // WRAP_S)
JUMPS_S = [sign * each for sign in (-1, 1) for each in (3, 100, 3600, 10_000, 18_000, 72_000, 3e5)]
CUTS = (None, None, 1, 2, 5, 20)  # after how many frames a meeting ends


class Days(NetworkSim):
    """The team, and what each robot has published last."""

    def __init__(self, seed: int, *, disks: dict[str, Path]) -> None:
        super().__init__(TEAM, names=NAMES)
        self.time_s = BEGIN_S
        self.random = random.Random(seed)
        self._newest: dict[tuple[str, str], bytes] = {}
        self._numbers = itertools.count()
        self._disks = disks
        self._storages: dict[str, Storage] = {}
        for name in NAMES:
            self.boot(name)

    def boot(self, name: str, *, keep: bool = False) -> None:
        """A new life; with what the robot held, on its disk if it has one, or with nothing."""
        if name in self._disks:
            database = self._read(name, keep=keep)
        elif keep:
            database = self.nodes[name].database
        else:
            database = Database(self.team.histories)
        self.restart(name, database=database, datagrams=self.random.random() < 0.5)

    def _read(self, name: str, *, keep: bool) -> Database:
        path = self._disks[name]
        self.close(name)
        if not keep:
            path.unlink(missing_ok=True)
        self._storages[name] = Storage(path)
        return Database(self.team.histories, self._storages[name])

    def close(self, name: str) -> None:
        """Let go of the disk of a robot."""
        storage = self._storages.pop(name, None)
        if storage:
            storage.close()

    def publish(self, name: str, topic: str) -> None:
        size = self.random.choice((20, 200, 3000))
        data = b"%d %s " % (next(self._numbers), topic.encode()) + self.random.randbytes(size)
        self.time_s += 0.002
        super().publish(name, topic, data)
        self._newest[name, topic] = data

    def publish_all(self) -> None:
        for name in NAMES:
            for topic in self.team.topics_of(name):
                self.publish(name, topic.name)

    def lose(self, name: str) -> None:
        """What a robot has is gone: of its own the newest that another robot has is the newest."""
        others = [self.held(other) for other in NAMES if other != name]
        for topic in self.team.topics_of(name):
            key = name, topic.name
            left = [held[key] for held in others if key in held]
            self._newest.pop(key, None)
            if left:
                self._newest[key] = max(left, key=lambda data: int(data.split(b" ", 1)[0]))
        self.boot(name)

    def everybody_meets(self) -> None:
        """Every pair, twice, in any order."""
        for _ in range(2):
            pairs = list(itertools.combinations(NAMES, 2))
            self.random.shuffle(pairs)
            for pair in pairs:
                self.part(self.random.uniform(5, 40))
                self.meet(*pair)

    def some_meet(self) -> None:
        """An hour or so as it may be: some messages, some meetings, many of them cut."""
        rng = self.random
        for _ in range(rng.randint(1, 15)):
            self.part(rng.expovariate(1 / 300))
            for _ in range(rng.randint(0, 4)):
                name = rng.choice(NAMES)
                self.publish(name, rng.choice(self.team.topics_of(name)).name)
            self.meet(*rng.sample(NAMES, 2), cut=rng.choice(CUTS))

    def live(self) -> None:
        """All the hours."""
        done = "they began"
        while self.time_s < DAYS_S:
            if self.random.random() < 0.7:
                self.publish_all()
            self.everybody_meets()
            try:
                self.check()
            except AssertionError as error:
                hours = self.time_s / HOUR_S
                ahead = {name: round(seconds) for name, seconds in self.offset_s.items()}
                error.add_note(f"after {hours:.2f} h, and after {done}; clocks ahead: {ahead}")
                raise
            self.some_meet()
            done = self.disturb()

    def check(self) -> None:
        """All robots hold all that is the newest."""
        for name in NAMES:
            held = self.held(name)
            assert {k for k, data in self._newest.items() if held.get(k) != data} == set(), name

    def disturb(self) -> str:
        """Something happens to one of the robots; what."""
        name = self.random.choice(NAMES)
        what = self.random.choice(("nothing", "jump", "loss", "reboot", "1970"))
        if what == "jump":
            seconds = self.random.choice(JUMPS_S)
            offset_s = self.offset_s.get(name, 0.0) + seconds
            self.offset_s[name] = max(offset_s, -self.now.unix_s)
            what = f"jump by {seconds} s"
        elif what == "loss":
            self.lose(name)
        elif what == "reboot":
            self.boot(name, keep=True)
        elif what == "1970":  # no battery in its clock, and no disk
            self.offset_s[name] = self.random.uniform(0, 300) - self.now.unix_s
            self.lose(name)
        return f"{what} of {name}"


@pytest.mark.parametrize("seed", range(4 if EXPLORE else 1))
def test_our_nodes_whatever_happens_to_them(seed, tmp_path):
    days = Days(seed, disks={"titan": tmp_path / "titan.db"})
    assert WRAPS >= 1
    days.live()
    for name in NAMES:
        kinds = {(type(each).__name__, getattr(each, "reason", "")) for each in days.events[name]}
        assert ("SyncTimedOut", "out of reach") in kinds
    days.close("titan")
