"""Every call that a storage makes of the disk fails once, or from then on: the node goes on."""

import errno
import io
import itertools
import os
import shutil
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path

import pytest

from mocha_link.store import storage
from mocha_link.store.database import Database
from mocha_link.store.record import Knowledge, Record
from mocha_link.store.storage import Storage
from mocha_link.store.storage_file import StorageDamagedError
from mocha_link.store.wire import Header

T_MS = 1_795_000_000_000
NOW_S = T_MS / 1000 + 1000
WAIT_S = 20
CALLS = 400  # more than any of these storages makes


def record(number):
    header = Header.at(1, number, T_MS + number)
    return Record(header, 0, b"\0\0body", T_MS + number, NOW_S)


class Disk:
    """Counts the calls to it, and has those fail that are to.

    Attributes:
        first: the number of the first call that fails.
        lasting: the later ones fail as well.
        calls: so far.
    """

    def __init__(self, monkeypatch, folder):
        self.first = CALLS
        self.lasting = False
        self.calls = 0
        self._folder = str(folder)
        for module, name in ((os, "stat"), (os, "open"), (os, "rename"), (io, "open")):
            monkeypatch.setattr(module, name, self._failing(getattr(module, name)))
        monkeypatch.setattr(sqlite3, "connect", self.connect(sqlite3.connect))

    def call(self, error):
        """A call: raises the error if its time has come."""
        self.calls += 1
        if self.calls == self.first or (self.lasting and self.calls > self.first):
            raise error

    def _failing(self, function):
        def fails(path, *arguments, **settings):
            if str(path).startswith(self._folder):
                self.call(OSError(errno.EACCES, "not permitted"))
            return function(path, *arguments, **settings)

        return fails

    def connect(self, real):
        """Opens SQLite files on this disk, and has nothing wait for the real one."""
        disk = self

        class Failing(sqlite3.Connection):
            def execute(self, sql, *arguments):
                disk.call(sqlite3.OperationalError("disk I/O error"))
                return super().execute(
                    sql.replace("synchronous = FULL", "synchronous = OFF"), *arguments
                )

            def executemany(self, sql, *arguments):
                disk.call(sqlite3.OperationalError("disk I/O error"))
                return super().executemany(sql, *arguments)

            def close(self):
                super().close()
                disk.call(sqlite3.OperationalError("disk I/O error"))

        def connect(path, **settings):
            self.call(sqlite3.OperationalError("unable to open database file"))
            made = real(path, factory=Failing, **settings)
            sqlite3.Connection.execute(made, "PRAGMA synchronous = OFF")
            return made

        return connect


def made(folder, how):
    """A file of earlier, sound or altered in the name of a peer; or none."""
    path = folder / "messages.db"
    if how != "none":
        kept = Storage(path)
        database = Database(storage=kept)
        for number in range(3):
            database.insert(record(number), NOW_S)
        database.learn("callisto", Knowledge(1, 2, 3))
        assert kept.close(WAIT_S)
    if how == "altered":
        flip(path, b"callisto")
    return path


def flip(path, text):
    """Flip one bit of a text in a file, so that it is no UTF-8 any more."""
    content = bytearray(path.read_bytes())
    content[content.index(text) + 2] ^= 0x80
    path.write_bytes(content)


@pytest.fixture
def memory(tmp_path):
    """A folder that is in memory where there is such a thing: nothing waits for a disk."""
    shared = Path("/dev/shm")  # noqa: S108 - a folder of its own in there
    folder = tempfile.mkdtemp(dir=shared if os.access(shared, os.W_OK) else tmp_path)
    yield Path(folder)
    shutil.rmtree(folder)


@pytest.mark.parametrize("how", ["none", "sound", "altered"])
@pytest.mark.parametrize("lasting", [False, True])
def test_nothing_hangs_and_nothing_raises_whatever_call_fails(memory, monkeypatch, how, lasting):
    before = made(memory, how)
    disk = Disk(monkeypatch, memory)
    for first in itertools.count(1):
        folder = memory / str(first)
        folder.mkdir()
        if how != "none":
            shutil.copy(before, folder / "messages.db")
        disk.first, disk.lasting, disk.calls = first, lasting, 0
        kept = Storage(folder / "messages.db", retry_s=3600)
        database = Database(storage=kept)
        for number in (5, 6):
            assert database.insert(record(number), NOW_S)
            database.learn("io", Knowledge(1, 2, 3))
            assert kept.wait(WAIT_S) or kept.fault
            kept.retry()
        ours = database.kept()
        failed, disk.first, disk.lasting = disk.calls >= first, CALLS, False
        kept.retry()
        saved = kept.wait(WAIT_S)
        assert saved or isinstance(kept.fault, StorageDamagedError)  # that may have to be moved
        assert kept.close(WAIT_S) == saved
        assert not kept._thread.is_alive()
        again = Storage(folder / "messages.db")
        assert set(Database(storage=again).kept()) >= set(ours) or not saved
        again.close(WAIT_S)
        if not failed:
            break
    assert first > 20


def test_a_file_altered_in_a_name_is_set_aside(tmp_path):
    path = made(tmp_path, "altered")
    faults = []
    kept = Storage(path, on_fault=faults.append)
    database = Database(storage=kept)
    assert len(database.kept()) == 3
    database.insert(record(5), NOW_S)
    assert kept.wait(WAIT_S)
    assert kept.close(WAIT_S)  # its thread reports the end of a fault when all is on disk
    assert [type(fault) for fault in faults] == [StorageDamagedError, type(None)]
    assert (tmp_path / "messages.db.damaged-1").exists()
    with closing(sqlite3.connect(path)) as file:
        assert file.execute("SELECT count(*) FROM record").fetchone() == (4,)


def test_a_mistake_that_ends_the_writing_lets_no_caller_wait(tmp_path, monkeypatch, caplog):
    faults = []
    kept = Storage(tmp_path / "messages.db", on_fault=faults.append)
    database = Database(storage=kept)
    monkeypatch.setattr(storage.storage_file, "fault", lambda *_: 1 / 0)
    kept.path.unlink()
    database.insert(record(1), NOW_S)
    assert not kept.wait()
    assert not kept.close(WAIT_S)
    assert "is not written any more" in str(kept.fault)
    assert faults == [kept.fault]
    assert "the writing has ended" in caplog.text
