"""Messages that have come in part survive a restart of the one that receives them."""

from __future__ import annotations

import random
import shutil
import sqlite3
from contextlib import closing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.links.metrics import MessageStored
from mocha_link.store.config_hash import TeamConfig
from mocha_link.store.database import Database
from mocha_link.store.reassembly_buffer import SAVE_BYTES, SAVE_S, ReassemblyBuffer, StoredFragment
from mocha_link.store.storage import Storage
from mocha_link.sync.frames import message_id_of
from mocha_link.team.team import Team
from tests.mocha_link.conftest import TEAM
from tests.mocha_link.network_sim import NetworkSim

LARGE = random.Random(1).randbytes(400_000)
LONG = message_id_of(2, 0, 1_795_175_900_000)
NOW_S = 1000.0


class Notes:
    """Keeps parts, as a storage does."""

    def __init__(self) -> None:
        self.parts: list[StoredFragment] = []
        self.written = 0

    def keep_part(self, part: StoredFragment) -> None:
        self.parts.append(part)
        self.written += len(part.data)

    def drop_parts(self, message_id: int, total: int) -> None:
        self.parts = [part for part in self.parts if part[:2] != (message_id, total)]


# --- the reassembly buffer


@given(
    st.lists(
        st.one_of(
            st.tuples(st.integers(0, 99_999), st.integers(1, 40_000)),
            st.just("save"),
            st.just("restart"),
        ),
        max_size=30,
    )
)
def test_each_byte_is_written_once_and_comes_back(steps):
    notes, whole, reassembly = Notes(), LARGE[:100_000], None
    there: set[range] = set()
    reassembly = ReassemblyBuffer(keeper=notes)
    for step in steps:
        if step == "save":
            reassembly.save(NOW_S, at_once=True)
        elif step == "restart":
            reassembly.save(NOW_S, at_once=True)
            held = [(message_id, p.held, p.missing(10_000)) for message_id, p in reassembly]
            reassembly = ReassemblyBuffer(keeper=notes, saved=notes.parts)
            assert [(message_id, p.held, p.missing(10_000)) for message_id, p in reassembly] == held
        else:
            start, size = step
            end = min(start + size, len(whole))
            body = reassembly.add(LONG, len(whole), start, memoryview(whole)[start:end])
            there.add(range(start, end))
            if body is not None:
                assert body == whole
                reassembly.drop(LONG)
                assert not notes.parts
                return
    reassembly.save(NOW_S, at_once=True)
    assert notes.written == len(set().union(*there))


def test_it_is_saved_when_it_is_enough_or_time():
    notes = Notes()
    reassembly, size = ReassemblyBuffer(keeper=notes), 4 * SAVE_BYTES
    data = memoryview(bytes(size))
    reassembly.add(LONG, size, 0, data[:100])
    reassembly.save(NOW_S)
    reassembly.save(NOW_S + SAVE_S - 0.1)
    assert not notes.parts
    reassembly.save(NOW_S + SAVE_S)
    assert [part[:3] for part in notes.parts] == [(LONG, size, 0)]
    reassembly.save(NOW_S + 10 * SAVE_S)
    assert len(notes.parts) == 1
    reassembly.add(LONG, size, 200, data[: SAVE_BYTES - 1])
    reassembly.save(NOW_S + 10 * SAVE_S)
    assert len(notes.parts) == 1
    reassembly.add(LONG, size, 100, data[:1])
    reassembly.save(NOW_S + 10 * SAVE_S)
    assert sorted(part.start for part in notes.parts) == [0, 100, 200]


def test_what_is_dropped_for_room_is_dropped_on_disk():
    notes = Notes()
    reassembly = ReassemblyBuffer(50_000, keeper=notes)
    for number in range(3):
        reassembly.add(LONG + number, 30_000, 0, memoryview(LARGE)[:20_000])
        reassembly.save(NOW_S, at_once=True)
    assert {part.message_id for part in notes.parts} == {LONG + 1, LONG + 2}
    again = ReassemblyBuffer(30_000, keeper=notes, saved=list(notes.parts))
    assert [message_id for message_id, _ in again] == [LONG + 2]
    assert {part.message_id for part in notes.parts} == {LONG + 2}


def test_a_message_that_was_whole_when_it_ended_is_not_asked_for_again():
    """It was stored, or refused, and what was kept of it was still there."""
    notes = Notes()
    parts = [StoredFragment(LONG, 100, 0, LARGE[:60]), StoredFragment(LONG, 100, 50, LARGE[50:100])]
    notes.parts = list(parts)
    assert not len(ReassemblyBuffer(keeper=notes, saved=parts))
    assert not notes.parts


# --- on disk


@pytest.fixture
def team(field_of) -> Team:
    return field_of(TEAM).team


@pytest.fixture
def path(tmp_path):
    return tmp_path / "io.db"


class Meetings(NetworkSim):
    """titan has a large message; io has a storage and gets it in several contacts."""

    def __init__(self, team: Team, path) -> None:
        super().__init__(team, names=("io", "titan"), datagrams=True, delay_s=0.05)
        self.path = path
        self.storage: Storage | None = None
        self.boot()
        self.publish("titan", "/map", LARGE)

    def boot(self, team: Team | None = None) -> None:
        config = TeamConfig.of(team or self.team)
        self.storage = Storage(self.path, config=config, retry_s=3600)
        self.restart("io", database=Database(storage=self.storage))

    def die(self) -> None:
        """What has been given to the storage is there, nothing else."""
        self.storage.close(30)

    def meet(self, pieces: int | None = None) -> int:
        """A contact; the bytes that titan said in it."""
        before = len(self.carried)
        self.left = pieces
        self.nodes["io"].sync("titan", self.now)
        if pieces is None:
            self.settle()
        else:
            self.wait(20)
        return sum(len(c.data) for c in self.carried[before:] if c.source == "titan")

    def held(self, name: str = "io") -> int:
        return sum(partial.held for _, partial in self.nodes[name]._pull_context.reassembly)

    @property
    def got(self) -> bytes | None:
        held = super().held("io")
        return held.get(("titan", "/map"))


@pytest.fixture
def meetings(team, path):
    meetings = Meetings(team, path)
    yield meetings
    meetings.die()


def test_an_orderly_end_keeps_all_that_has_come(meetings):
    meetings.meet(pieces=120)
    held = meetings.held()
    assert 20_000 < held < len(LARGE)
    meetings.nodes["io"].save(meetings.now)
    meetings.die()
    meetings.boot()
    assert meetings.held() == held
    said = meetings.meet()
    assert meetings.got == LARGE
    assert said < (len(LARGE) - held) * 1.1 + 2_000
    assert not len(meetings.nodes["io"]._pull_context.reassembly)
    meetings.die()
    with closing(sqlite3.connect(meetings.path)) as file:
        assert file.execute("SELECT count(*) FROM part").fetchone() == (0,)


def test_an_end_without_warning_loses_the_last_seconds(meetings):
    meetings.meet(pieces=120)
    held = meetings.held()  # saved by now
    meetings.left = 20
    meetings.nodes["io"].sync("titan", meetings.now)
    meetings.wait(1)
    more = meetings.held()
    assert more > held
    meetings.die()
    meetings.boot()
    assert meetings.held() == held
    meetings.meet()
    assert meetings.got == LARGE


def test_what_is_damaged_on_disk_comes_again(meetings):
    """It is not worth to give the file up for it."""
    meetings.meet(pieces=120)
    meetings.nodes["io"].save(meetings.now)
    meetings.die()
    with closing(sqlite3.connect(meetings.path)) as file:
        count = file.execute("SELECT count(*) FROM part").fetchone()[0]
        file.execute("UPDATE part SET data = zeroblob(length(data)) WHERE rowid % 2 = 1")
        file.execute("INSERT INTO part VALUES (x'00', -1, 'no', 2, 3.5)")
        file.commit()
    meetings.boot()
    assert meetings.storage.fault is None
    assert len(meetings.nodes["io"].database.take_parts()) == 0
    assert sum(1 for _ in meetings.nodes["io"]._pull_context.reassembly) <= count
    meetings.meet()
    assert meetings.got == LARGE


def test_what_a_wrong_part_spoils_is_not_taken_and_comes_again(meetings):
    """As if disk, checksum and all had lied."""
    meetings.meet(pieces=120)
    reassembly = meetings.nodes["io"]._pull_context.reassembly
    ((message_id, partial),) = list(reassembly)
    reassembly.drop(message_id)
    reassembly.add(message_id, partial.total, 0, memoryview(bytes(20_000)))
    meetings.nodes["io"].save(meetings.now)
    meetings.die()
    meetings.boot()
    meetings.meet()
    assert meetings.got == LARGE
    assert meetings.nodes["io"].links(meetings.now)["titan"].refused
    assert [e.size > len(LARGE) for e in meetings.told("io", MessageStored)] == [True]


def test_under_another_team_file_parts_of_what_has_moved_go(field_of, team, path):
    """Their ids may be those of another robot's messages."""
    meetings = Meetings(team, path)
    meetings.meet(pieces=120)
    meetings.nodes["io"].save(meetings.now)
    meetings.die()
    later = field_of(TEAM.replace("/map, type: grid/SemanticMap", "/map, type: grid/Other")).team
    storage = Storage(path, config=TeamConfig.of(later))
    database = Database(storage=storage)
    assert database.take_parts() == []
    assert storage.close(30)
    with closing(sqlite3.connect(path)) as file:
        assert file.execute("SELECT count(*) FROM part").fetchone() == (0,)


def test_a_disk_that_is_full_keeps_no_parts_in_memory(team, path):
    meetings = Meetings(team, path / "no" / "such" / "directory")
    meetings.meet(pieces=120)
    for _ in range(3):
        meetings.nodes["io"].save(meetings.now)
        meetings.storage.retry()
        meetings.storage.wait(60)
    assert not meetings.storage._pending.parts
    assert meetings.storage.fault is not None
    meetings.meet()
    assert meetings.got == LARGE
    meetings.die()


def test_a_file_that_is_out_of_reach_for_a_while_forgets_the_parts_from_before(team, path):
    meetings = Meetings(team, path)
    meetings.meet(pieces=120)
    meetings.nodes["io"].save(meetings.now)
    meetings.die()
    aside = path.with_suffix(".aside")
    shutil.move(path, aside)
    path.mkdir()
    meetings.boot()
    assert meetings.storage.fault is not None
    path.rmdir()
    shutil.move(aside, path)
    meetings.storage.retry()
    assert meetings.storage.wait(60)
    meetings.meet()
    assert meetings.got == LARGE
    meetings.die()
    with closing(sqlite3.connect(path)) as file:
        assert file.execute("SELECT count(*) FROM part").fetchone() == (0,)
