"""What the database keeps on disk: it comes back, whatever happens to the process or the disk."""

import contextlib
import os
import queue
import random
import runpy
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from mocha_link.store.database import Database
from mocha_link.store.record import Knowledge, Record
from mocha_link.store.storage import Storage
from mocha_link.store.storage_file import (
    StorageDamagedError,
    StorageForeignError,
    StorageFullError,
    StorageLockedError,
    StorageUnreachableError,
    StorageVersionError,
)
from mocha_link.store.wire import Header

T_MS = 1_795_000_000_000
NOW_S = T_MS / 1000 + 1000
MORTAL = Path(__file__).parents[1] / "mortal.py"


def record(number: int, *, topic_id: int | None = None, body: bytes = b"\0\0body") -> Record:
    topic_id = number % 200 if topic_id is None else topic_id
    header = Header.at(number % 5, topic_id, T_MS + number)
    return Record(header, number % 4, body, T_MS + number, T_MS / 1000 + number / 7, number % 2 > 0)


class Shelter:
    """A database on a file, and the faults that it reported."""

    def __init__(self, path, *, depth=1, **settings):
        self.faults = queue.SimpleQueue()
        settings = {"retry_s": 3600, "on_fault": self.faults.put} | settings
        self.storage = Storage(path, **settings)
        self.database = Database(dict.fromkeys(range(1 << 16), depth), storage=self.storage)

    def write(self, *numbers):
        for number in numbers:
            assert self.database.insert(record(number), NOW_S)

    def retry(self):
        self.storage.retry()
        return self.storage.wait(60)

    def fault(self):
        return self.faults.get(timeout=60)


@pytest.fixture
def shelter(tmp_path):
    with contextlib.ExitStack() as stack:

        def make(name="messages.db", **settings):
            made = Shelter(tmp_path / name, **settings)
            stack.callback(made.storage.close, 30)
            return made

        yield make


def numbers(database):
    return sorted(each.stamp_ms - T_MS for each in database.kept())


# What comes back


def test_everything_comes_back(shelter):
    first = shelter(depth=2)
    first.write(*range(100), *range(200, 230))
    first.database.learn("io", Knowledge(2**64 - 1, 2**64 - 2, first.database.sequence))
    first.database.learn("io", Knowledge(2**64 - 1, 2**64 - 2, 77))
    assert first.storage.close()
    again = shelter(depth=2)
    old, new = first.database, again.database
    assert new.kept() == old.kept()
    assert new.records() == old.records()
    assert new.header_list() == old.header_list()
    assert new.digests() == old.digests()
    assert new.epoch == old.epoch
    assert new.knowledge("io") == Knowledge(2**64 - 1, 2**64 - 2, 77)
    assert new.numbered_since(0) == old.numbered_since(0)
    assert again.storage.fault is None
    assert again.faults.empty()


def test_a_start_looks_through_what_is_there_once_and_not_once_for_each_message(
    shelter, monkeypatch
):
    """65,536 messages took a minute and a half."""

    class Counted(dict):
        looks = 0

        def __iter__(self):
            Counted.looks += 1
            return super().__iter__()

    node = shelter()
    node.write(*range(100))
    assert node.storage.close()
    load = Storage.load
    monkeypatch.setattr(
        Storage,
        "load",
        lambda self, epoch: replace(found := load(self, epoch), records=Counted(found.records)),
    )
    assert len(shelter().database.kept()) == 100
    assert Counted.looks < 5


def test_numbers_are_never_given_twice(shelter, tmp_path):
    node = shelter()
    node.write(*range(10))
    assert node.storage.wait(60)
    for name in ("messages.db", "messages.db-wal"):  # as a backup does, or a crash soon after
        shutil.copy(tmp_path / name, tmp_path / f"copy-{name}")
    node.write(*range(10, 20))
    announced = node.database.sequence  # to peers, while the disk may not have got so far
    node.storage.close()
    crashed = shelter("copy-messages.db")
    assert crashed.database.epoch == node.database.epoch
    assert numbers(crashed.database) == list(range(10))
    assert crashed.database.sequence > announced
    crashed.write(50)
    assert crashed.database.since(announced) == [record(50)]
    reached = crashed.database.sequence
    crashed.storage.close()
    restarted = shelter("messages.db")
    # Of the other branch of time: either its numbers are known to be later, or all new ones are.
    ours = restarted.database.sequence
    assert (reached > ours) == (not restarted.database.remembers(node.database.epoch, reached))


def test_numbers_go_on_far_beyond_those_on_disk_however_the_dice_fall(shelter, monkeypatch):
    monkeypatch.setattr("secrets.randbits", lambda _: 0)
    node = shelter()
    node.write(*range(10))
    node.storage.close()
    assert shelter().database.sequence >= node.database.sequence + 2**32


def test_what_a_peer_has_received_ends_with_what_is_on_disk(shelter, monkeypatch):
    """The numbers behind it may be given again, to messages that the peer knows nothing of."""
    monkeypatch.setattr("secrets.randbits", lambda bits: 2**bits - 1)
    first = shelter()
    first.write(*range(3))
    first.storage.close()
    second = shelter()
    second.database.learn("io", Knowledge(77, 5, second.database.sequence))
    second.storage.close()
    monkeypatch.setattr("secrets.randbits", lambda _: 0)
    third = shelter()
    assert third.database.since(third.database.knowledge("io").own_sequence) == []
    third.write(10, 11)
    received = third.database.knowledge("io").own_sequence
    assert third.database.since(received) == [record(10), record(11)]


# How it is written


def test_what_is_not_kept_is_not_on_disk_either(shelter, tmp_path):
    node = shelter(depth=3)
    for number in range(30):
        node.database.insert(record(5 * number, topic_id=1), NOW_S)
    node.storage.close()
    with contextlib.closing(sqlite3.connect(tmp_path / "messages.db")) as file:
        stamps = file.execute("SELECT stamp_ms FROM record ORDER BY number").fetchall()
    assert stamps == [(T_MS + 135,), (T_MS + 140,), (T_MS + 145,)]
    again = shelter(depth=1)  # the team file has less now
    assert numbers(again.database) == [145]
    assert again.storage.wait(60)
    again.storage.close()
    assert numbers(shelter(depth=3).database) == [145]


def test_the_file_stays_small(shelter, tmp_path):
    node = shelter()
    chance = random.Random(1)
    for number in range(400):
        body = chance.randbytes(20_000)
        node.database.insert(record(5 * number, topic_id=number % 20, body=body), NOW_S)
        if number % 10 == 0:
            assert node.storage.wait(60)
    size = sum(path.stat().st_size for path in tmp_path.iterdir())
    assert size < 5_000_000  # of 8 MB
    for number in range(400, 420):
        node.database.insert(record(5 * number, topic_id=number % 20), NOW_S)
    node.storage.close()
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 2_000_000


class Gate(sqlite3.Connection):
    """A disk whose commits wait for a permission, and are counted."""

    def __init__(self, *arguments, **settings):
        super().__init__(*arguments, **settings)
        self.open = threading.Event()
        self.open.set()
        self.commits = 0
        self.waiting = threading.Event()
        self.error = None

    def execute(self, sql, *arguments):
        if sql == "COMMIT":
            self.waiting.set()
            self.open.wait(60)
            self.commits += 1
            if self.error:
                raise self.error
        return super().execute(sql, *arguments)


def gated(gates, kind=Gate):
    """Opens files on such a disk; every connection is noted."""

    def connect(path):
        gates.append(
            sqlite3.connect(
                path, timeout=0, isolation_level=None, check_same_thread=False, factory=kind
            )
        )
        return gates[-1]

    return connect


def test_what_comes_during_a_commit_shares_the_next_one(shelter):
    gates = []
    node = shelter(connect=gated(gates))
    (gate,) = gates
    gate.commits = 0
    gate.open.clear()
    gate.waiting.clear()
    node.write(0)
    assert gate.waiting.wait(60)
    node.write(*range(1, 150))
    assert not node.storage.wait(0)
    gate.open.set()
    assert node.storage.wait(60)
    assert gate.commits == 2
    assert node.storage.wait(0)


def test_closing_does_not_wait_for_a_disk_that_hangs(shelter, tmp_path, caplog):
    gates = []
    node = shelter(connect=gated(gates))
    gates[0].open.clear()
    node.write(0, 1)
    assert not node.storage.close(timeout_s=0.01)
    assert "2 changes are not on disk" in caplog.text
    gates[0].open.set()
    assert node.storage.close(30)
    node.write(2)  # a late one: the memory takes it, no caller waits for ever
    assert not node.storage.wait()
    assert numbers(node.database) == [0, 1, 2]
    assert numbers(shelter().database) == [0, 1]


# What can be wrong with a disk


def test_an_error_in_the_callback_is_logged(shelter, tmp_path, caplog):
    node = shelter("none/messages.db", on_fault=lambda _: 1 / 0)
    node.write(1)
    assert "raised an error" in caplog.text
    (tmp_path / "none").mkdir()
    assert node.retry()


def logged(caplog):
    return [entry.getMessage() for entry in caplog.records if entry.levelname == "ERROR"]


def check_recovery(node, shelter, name="messages.db", *, by_itself=False):
    """It was out of order, is put right now, and catches up with everything."""
    assert by_itself or not node.storage.wait()
    kept = node.database.kept()
    node.database.learn("io", Knowledge(1, 2, 3))
    assert by_itself or node.retry()
    assert node.fault() is None
    assert node.storage.fault is None
    assert node.faults.empty()
    assert node.database.kept() == kept
    node.write(190)
    node.storage.close(30)
    again = shelter(name)
    assert again.database.kept() == node.database.kept()
    assert again.database.epoch == node.database.epoch
    assert again.database.knowledge("io") == Knowledge(1, 2, 3)


@pytest.mark.parametrize("from_the_start", [True, False])
def test_a_full_disk(shelter, caplog, from_the_start):
    gates = []
    limits = [2 if from_the_start else 60]

    def connect(path):
        gate = gated(gates)(path)
        gate.execute(f"PRAGMA max_page_count = {limits[0]}")
        return gate

    node = shelter(connect=connect)
    for number in range(150):
        node.database.insert(record(number, body=bytes(3000)), NOW_S)
        node.storage.wait()
    assert len(node.database.kept()) == 150
    assert isinstance(node.fault(), StorageFullError)
    for _ in range(3):
        assert not node.retry()
    for number in range(200, 300):  # replaces some, among them some that are on disk
        node.database.insert(record(number, body=bytes(3000)), NOW_S)
    assert len(logged(caplog)) == 1
    assert "no room to write" in logged(caplog)[0]
    limits[0] = 10_000
    if not from_the_start:  # else it is opened anew
        gates[-1].execute("PRAGMA max_page_count = 10000")
    check_recovery(node, shelter)


def test_the_journal_gives_its_room_when_the_disk_is_full(shelter):
    class Full(Gate):
        def execute(self, sql, *arguments):
            if "wal_checkpoint" in sql:
                self.error = None
            return super().execute(sql, *arguments)

    gates = []
    node = shelter(connect=gated(gates, Full))
    node.write(0, 1, 2)
    assert node.storage.wait(60)
    full = sqlite3.OperationalError("database or disk is full")
    full.sqlite_errorcode = sqlite3.SQLITE_FULL
    gates[0].error = full
    node.write(3, 4, 5)
    assert node.storage.wait(60)
    assert node.storage.fault is None
    node.storage.close(30)
    assert shelter().database.kept() == node.database.kept()


def test_the_journal_stays_small(shelter, tmp_path):
    """A disk with little room has to hold the content and this beside it, not megabytes."""
    node = shelter()
    for number in range(100):
        node.database.insert(record(number % 5 + 5 * number, body=bytes(100_000)), NOW_S)
        assert node.storage.wait(60)
    assert (tmp_path / "messages.db-wal").stat().st_size < 1_200_000


class Watched(Gate):
    """Notes how large the journal is after each commit, and fails at one of them."""

    def __init__(self, path, *arguments, **settings):
        super().__init__(path, *arguments, **settings)
        self.journal = Path(f"{path}-wal")
        self.sizes = []
        self.fails_at = None
        self.failure = sqlite3.OperationalError("disk I/O error")

    def execute(self, sql, *arguments):
        if sql == "COMMIT" and self.commits == self.fails_at:
            self.error = self.failure
        done = super().execute(sql, *arguments)
        if sql == "COMMIT":
            self.sizes.append(self.journal.stat().st_size)
        return done


def backlog(node, gate, *, offset, count=4000, size=1000):
    """So many messages wait for the disk, on which one commit hangs."""
    gate.open.clear()
    gate.waiting.clear()
    node.database.learn("titan", Knowledge(1, offset, 3))
    assert gate.waiting.wait(60)
    for number in range(offset, offset + count):
        node.database.insert(record(number, body=bytes(size)), NOW_S)
    node.database.learn("io", Knowledge(1, offset, 3))


def test_the_journal_stays_small_however_much_waits_for_the_disk(shelter):
    gates = []
    node = shelter(connect=gated(gates, Watched), depth=100)
    (gate,) = gates
    for offset in (0, 20_000):  # the second time all are replaced
        backlog(node, gate, offset=offset)
        gate.sizes.clear()
        gate.open.set()
        assert node.storage.wait(60)
        assert max(gate.sizes) < 3_000_000
    node.storage.close(30)
    assert shelter(depth=100).database.kept() == node.database.kept()


@pytest.mark.parametrize("commits", [0, 1, 2, 3, 9])
def test_what_a_crash_leaves_of_a_backlog_lacks_no_message_that_was_there(
    shelter, tmp_path, commits
):
    """Each topic has its message from before, or the one that has replaced it."""
    gates = []
    node = shelter(connect=gated(gates, Watched))
    node.write(*range(1000))
    assert node.storage.wait(60)
    topics = {each.header.key for each in node.database.kept()}
    gate = gates[0]
    backlog(node, gate, offset=20_000, count=1000, size=100_000)
    gate.fails_at = gate.commits + 1 + commits
    gate.open.set()
    assert isinstance(node.fault(), StorageUnreachableError)
    with contextlib.closing(sqlite3.connect(tmp_path / "messages.db")) as file:
        left = file.execute("SELECT robot_id, topic_id, stamp_ms, number FROM record").fetchall()
        known = file.execute("SELECT peer FROM knowledge").fetchall()
    assert {robot_id << 8 | topic_id for robot_id, topic_id, *_ in left} == topics
    assert len(left) == len(topics)
    new = sum(stamp_ms >= T_MS + 20_000 for _, _, stamp_ms, _ in left)
    assert (new > 0) == (commits > 0)
    assert new < len(topics)
    assert known == [("titan",)]
    assert node.retry()
    node.storage.close(30)
    again = shelter().database
    assert again.kept() == node.database.kept()
    assert again.knowledge("io") == Knowledge(1, 20_000, 3)


def test_what_was_written_of_a_backlog_until_the_disk_was_full_can_be_replaced(shelter, tmp_path):
    gates = []
    node = shelter(connect=gated(gates, Watched))
    (gate,) = gates
    backlog(node, gate, offset=0, count=200, size=100_000)
    gate.fails_at = gate.commits + 4
    gate.failure = sqlite3.OperationalError("database or disk is full")
    gate.failure.sqlite_errorcode = sqlite3.SQLITE_FULL
    gate.open.set()
    assert isinstance(node.fault(), StorageFullError)
    for number in range(20_000, 20_200):
        node.database.insert(record(number), NOW_S)
    gate.fails_at = gate.error = None
    assert node.retry()
    node.storage.close(30)
    with contextlib.closing(sqlite3.connect(tmp_path / "messages.db")) as file:
        left = file.execute("SELECT min(stamp_ms), count(*) FROM record").fetchone()
    assert left == (T_MS + 20_000, 200)


def test_a_new_file_is_for_its_user_alone(shelter, tmp_path):
    node = shelter()
    node.write(0)
    assert node.storage.wait(60)
    modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    assert set(modes.values()) == {0o600}, modes


def test_a_directory_that_is_missing(shelter, tmp_path, caplog):
    node = shelter("none/messages.db")
    node.write(1, 2, 3)
    assert not node.retry()
    assert [str(node.fault())] == [f"there is no directory {tmp_path}/none; make it"]
    assert len(logged(caplog)) == 1
    (tmp_path / "none").mkdir()
    check_recovery(node, shelter, "none/messages.db")


def test_a_file_that_another_node_has(shelter):
    owner = shelter()
    owner.write(*range(5), 110)
    owner.database.learn("titan", Knowledge(9, 8, 7))
    assert owner.storage.wait(60)
    node = shelter()
    assert isinstance(node.fault(), StorageLockedError)
    assert node.database.epoch != owner.database.epoch
    node.write(*range(3, 10), 10)
    assert not node.retry()
    owner.write(120)
    owner.storage.close()
    assert node.retry()  # takes over what the other one has left there
    assert numbers(node.database) == [*range(11), 110, 120]
    assert node.database.knowledge("titan") == Knowledge(9, 8, 0)
    assert node.fault() is None
    node.storage.close()
    again = shelter()
    assert again.database.epoch == node.database.epoch
    assert again.database.kept() == node.database.kept()


def spoil(path, how):
    if how == "truncated":
        os.truncate(path, path.stat().st_size // 4096 // 2 * 4096)
    else:
        content = bytearray(path.read_bytes())
        place = content.index(b"message 33 ") + 500
        content[place] ^= 4
        path.write_bytes(content)


@pytest.mark.parametrize("how", ["truncated", "altered"])
def test_a_damaged_file_is_moved_aside_and_a_new_one_begun(shelter, tmp_path, caplog, how):
    before = shelter()
    for number in range(100):
        body = f"message {number} ".encode() * 60
        before.database.insert(record(number, body=body), NOW_S)
    before.database.learn("io", Knowledge(9, 9, 9))
    before.storage.close()
    path = tmp_path / "messages.db"
    spoil(path, how)
    spoilt = path.read_bytes()
    node = shelter()
    assert isinstance(node.fault(), StorageDamagedError)
    assert node.database.epoch != before.database.epoch
    assert node.database.knowledge("io") is None
    # What can still be read is good, and carried on.
    assert set(node.database.kept()) <= set(before.database.kept())
    assert len(node.database.kept()) == 99 or how != "altered"
    aside = tmp_path / "messages.db.damaged-1"
    assert f"and is now {aside}; a new one is begun" in caplog.text
    node.write(150, 151)
    check_recovery(node, shelter, by_itself=True)
    assert aside.read_bytes() == spoilt


def test_a_file_that_is_deleted_while_it_is_used(shelter, tmp_path, caplog):
    node = shelter()
    node.write(*range(20))
    assert node.storage.wait(60)
    for path in tmp_path.glob("messages.db*"):
        path.unlink()
    node.write(20)
    assert "was deleted or replaced" in str(node.fault())
    check_recovery(node, shelter, by_itself=True)
    assert "is begun with what is in memory" in caplog.text


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (None, (StorageDamagedError, "is damaged")),
        ("PRAGMA user_version = 2", (StorageVersionError, "has schema 2, this release knows 1")),
        ("PRAGMA application_id = 1", (StorageForeignError, "is another program's")),
        ("DROP TABLE record", (StorageUnreachableError, "no such table")),
    ],
    ids=["no database", "a later version", "another program's", "without its table"],
)
def test_a_file_that_is_none_of_ours_stays_as_it_is(shelter, tmp_path, caplog, change, fault):
    error, text = fault
    path = tmp_path / "messages.db"
    if change is None:
        path.write_bytes(random.Random(2).randbytes(20_000))
    else:
        shelter().storage.close()
        with contextlib.closing(sqlite3.connect(path)) as file:
            file.execute(change)
            file.commit()
    before = path.read_bytes()
    node = shelter()
    assert isinstance(node.fault(), error)
    node.write(150, 151)
    assert not node.retry()
    assert not node.retry()
    assert len(logged(caplog)) == 1
    assert text in logged(caplog)[0]
    assert path.read_bytes() == before
    path.rename(tmp_path / "other.db")
    check_recovery(node, shelter)


# What kill -9 can do


@pytest.fixture
def mortal(tmp_path):
    """Starts writers on a file; gives each as its process id and the lines that it prints."""
    command = [sys.executable, str(MORTAL)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as mother:

        def start(number):
            mother.stdin.write(f"{tmp_path}/messages.db {number}\n")
            mother.stdin.flush()
            key, pid = mother.stdout.readline().split()
            assert key == "pid"
            return int(pid), mother.stdout

        yield start
        mother.stdin.close()


def test_kill_9_at_any_moment_loses_nothing_that_was_committed(mortal, shelter):
    script = runpy.run_path(str(MORTAL))
    message, depth, start_ms = (script[name] for name in ("message", "DEPTH", "START_MS"))
    chance = random.Random(31)
    acknowledged: dict[tuple[int, int], list[int]] = {}
    number = last = 0
    for _ in range(20):
        first, done = number, number
        pid, lines = mortal(number)
        for _ in range(chance.randrange(12)):
            done = int(lines.readline()) + 1
        os.kill(pid, signal.SIGKILL)
        for line in lines:
            if line == "gone\n":
                break
            done = int(line) + 1
        last = max(last, done - 1 if done > first else 0)
        for each in range(first, done):
            header = message(each).header
            acknowledged.setdefault((header.robot_id, header.topic_id), []).append(each)
        number = done + 20  # whatever it wrote beyond is not to be written again

        node = shelter(depth=depth)
        assert node.storage.fault is None
        database = node.database
        stored = {each.stamp_ms - start_ms for each in database.kept()}
        for each in database.kept():
            assert each == message(each.stamp_ms - start_ms)
        for (robot_id, topic_id), numbers in acknowledged.items():
            newest = database.history(robot_id, topic_id)[-1].stamp_ms - start_ms
            for each in numbers[-depth:]:
                assert each in stored or each < newest
        known = database.knowledge("io")
        assert (known.sequence if known else 0) >= last - 2
        assert known is None or max(stored) >= known.sequence
        node.storage.close(30)
    assert sum(map(len, acknowledged.values())) > 200
