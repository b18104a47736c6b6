"""The SQLite file that a database is kept in.

Tables (schema 1; `PRAGMA user_version` has its number, `application_id` is "MOCH"):

    record     number (sequence number), robot_id, topic_id, stamp_ms, inferred (0 or 1), priority,
               received_s, body (as on the wire), checksum (CRC-32 of all the others)
    knowledge  peer, and epoch, sequence, own_sequence (u64 as 8 bytes, big endian), checksum
    about      epoch of the database (8 bytes), one row
    terms      what the ids stand for (JSON) and a digest of the team's configuration, one row

The journal is a write-ahead log next to the file (`-wal`) and every commit is synchronised, so what
was committed survives `kill -9` and a loss of power. The pages of deleted rows are used again; when
most of the file is free, it shrinks (incremental vacuum). While a node runs it has the file locked
for itself; copy it, or read it, when the node is off.
"""

from __future__ import annotations

import os
import sqlite3
import struct
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mocha_link.errors import MochaLinkError
from mocha_link.path_safety import check_links
from mocha_link.store.changes import Changes
from mocha_link.store.record import Knowledge, Record
from mocha_link.store.reserve import Reserve
from mocha_link.store.trust import TeamConfig
from mocha_link.store.wire import Header, HeaderError

VERSION = 1
APPLICATION_ID = int.from_bytes(b"MOCH", "big")
LOCKED_S = 0.2  # how long a lock of another process is waited for
JOURNAL_BYTES = 1024 * 1024
JOURNAL_PAGES = 128  # of a page's 4 KiB: then the journal goes into the file, and begins anew
SPARE_PAGES = 256
SCARCE_BYTES = 256 * 1024  # of a transaction while the disk is full
VACUUM_PAGES = 64  # given back at a time while the disk is full: the journal has to hold them

_MAGIC = b"SQLite format 3\0"
_CHECKED = struct.Struct(">QBBQ?Bd")
_ALTERED = (struct.error, TypeError, ValueError, OverflowError, HeaderError)
_TABLES = (
    """CREATE TABLE about (one INTEGER PRIMARY KEY CHECK (one = 1), epoch BLOB NOT NULL)""",
    """CREATE TABLE knowledge (
        peer TEXT PRIMARY KEY, epoch BLOB NOT NULL, sequence BLOB NOT NULL,
        own_sequence BLOB NOT NULL, checksum INTEGER NOT NULL) WITHOUT ROWID""",
    """CREATE TABLE record (
        number INTEGER PRIMARY KEY, robot_id INTEGER NOT NULL, topic_id INTEGER NOT NULL,
        stamp_ms INTEGER NOT NULL, inferred INTEGER NOT NULL, priority INTEGER NOT NULL,
        received_s REAL NOT NULL, checksum INTEGER NOT NULL, body BLOB NOT NULL)""",
)
_TERMS = """CREATE TABLE IF NOT EXISTS terms (
    one INTEGER PRIMARY KEY CHECK (one = 1), mark BLOB NOT NULL, names TEXT NOT NULL)"""


class StorageError(MochaLinkError):
    """The database's file cannot be used now."""


class StorageFullError(StorageError):
    """There is no room for it on the disk."""


class StorageDamagedError(StorageError):
    """It is no SQLite file, or its content has been altered."""


class StorageForeignError(StorageError):
    """It is the SQLite file of another program."""


class StorageVersionError(StorageError):
    """A newer release has written it."""


class StorageLockedError(StorageError):
    """Another process has it open."""


class StorageUnreachableError(StorageError):
    """Its directory is missing, it may not be written, or the disk fails."""


@dataclass(slots=True)
class Contents:
    """What a file has. Without an `epoch` it could not be read to its end."""

    epoch: int | None = None
    records: dict[int, Record] = field(default_factory=dict)  # by number
    knowledge: dict[str, Knowledge] = field(default_factory=dict)

    def last_s(self) -> float:
        """Unix seconds of the last received message, by a scan of all; 0 if there is none."""
        return self.records[max(self.records)].received_s if self.records else 0.0


def connect(path: Path) -> sqlite3.Connection:
    """Open an SQLite file for use by one thread after another; a new one is only the user's."""
    check_links(path)
    with suppress(OSError):  # it exists, or SQLite reports the reason
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
    return sqlite3.connect(path, timeout=LOCKED_S, isolation_level=None, check_same_thread=False)


class StorageFile:
    """An open file, locked for us. Methods raise StorageError and sqlite3.Error (see `fault`)."""

    def __init__(self, path: Path, connect: Callable[[Path], sqlite3.Connection] = connect) -> None:
        self._path = path
        self._reserve = Reserve(path)
        self._connection = connect(path)
        # Of altered text something is made that its checksum does not fit.
        self._connection.text_factory = lambda raw: raw.decode(errors="replace")
        try:
            try:
                self._prepare()
            except sqlite3.OperationalError as error:
                if _code(error) != sqlite3.SQLITE_FULL or not self._reserve.release():
                    raise
                self._roll_back()
                self._prepare()
        except BaseException:
            with suppress(sqlite3.Error):
                self._connection.close()
            raise
        self._reserve.hold()

    def _prepare(self) -> None:
        run = self._connection.execute
        run("PRAGMA locking_mode = EXCLUSIVE")
        is_new = not self._value("SELECT count(*) FROM sqlite_schema")
        if not is_new and self._value("PRAGMA application_id") != APPLICATION_ID:
            raise StorageForeignError(f"{self._path} is another program's; name another file")
        version = self._value("PRAGMA user_version")
        if version > VERSION:
            raise StorageVersionError(
                f"{self._path} has schema {version}, this release knows {VERSION}; "
                "use the newer release again, or move the file away"
            )
        if is_new:
            run("PRAGMA auto_vacuum = INCREMENTAL")
        run("PRAGMA journal_mode = WAL")
        run("PRAGMA synchronous = FULL")
        run(f"PRAGMA journal_size_limit = {JOURNAL_BYTES}")
        run(f"PRAGMA wal_autocheckpoint = {JOURNAL_PAGES}")
        run("BEGIN IMMEDIATE")
        if is_new:
            run(f"PRAGMA application_id = {APPLICATION_ID}")
            run(f"PRAGMA user_version = {VERSION}")
            for table in _TABLES:
                run(table)
        run(_TERMS)
        run("DROP TABLE IF EXISTS part")  # of earlier releases
        run("COMMIT")

    def read(self, contents: Contents) -> None:
        """Add all that is there, as far as it can be read, and make sure that it is sound.

        The epoch comes last; a file that was never signed has none.
        """
        altered = 0
        run = self._connection.execute
        for row in run("SELECT * FROM record ORDER BY number"):
            try:
                contents.records[row[0]] = _record(*row)
            except _ALTERED:
                altered += 1
        for row in run("SELECT * FROM knowledge"):
            try:
                contents.knowledge[row[0]] = _knowledge(*row)
            except _ALTERED:
                altered += 1
        found = self._value("PRAGMA quick_check(1)")
        if altered or found != "ok":
            what = f"{altered} entries are altered" if altered else found
            raise StorageDamagedError(_damaged(self._path, what))
        epoch = run("SELECT epoch FROM about").fetchone()
        contents.epoch = int.from_bytes(epoch[0], "big") if epoch else None

    def sign(self, epoch: int) -> None:
        """Write whose file it is; shows that it can be written."""
        self._connection.execute("INSERT OR REPLACE INTO about VALUES (1, ?)", (_u64(epoch),))

    def adopt(self, config: TeamConfig, contents: Contents) -> int:
        """Use the file with a team's configuration; returns how many messages were deleted.

        If it differs from the file's, messages are deleted whose ids stand for another robot or
        topic by now, and so is everything known of peers: what they have offered was judged by the
        earlier configuration.
        """
        run = self._connection.execute
        row = run("SELECT mark, names FROM terms").fetchone()
        if row and row[0] == config.mark:
            return 0
        contents.knowledge.clear()
        earlier = TeamConfig.read(row[1]) if row else config.names
        void = [n for n, r in contents.records.items() if not config.keeps(r.header, earlier or {})]
        for number in void:
            del contents.records[number]
        if earlier is None:
            raise StorageDamagedError(_damaged(self._path, "its configuration is altered"))
        run("BEGIN IMMEDIATE")
        run("INSERT OR REPLACE INTO terms VALUES (1, ?, ?)", (config.mark, config.text))
        run("DELETE FROM knowledge")
        self._connection.executemany("DELETE FROM record WHERE number = ?", ((n,) for n in void))
        run("COMMIT")
        return len(void)

    def write(self, changes: Changes) -> None:
        """Commit everything, mostly at once; changes on disk are taken out of `changes`."""
        drops = bool(changes.drops)
        try:
            for piece in changes.pieces():
                self._commit(piece)
                changes.settle(piece)
        except sqlite3.OperationalError as error:
            if _code(error) != sqlite3.SQLITE_FULL:
                raise
            self._write_scarcely(changes)
        self._reserve.hold()
        spare = self._value("PRAGMA freelist_count") if drops else 0
        if spare > SPARE_PAGES and spare > self._value("PRAGMA page_count") // 2:
            self._connection.execute(f"PRAGMA incremental_vacuum({spare})").fetchall()

    def _write_scarcely(self, changes: Changes) -> None:
        """Write while the disk is full: the journal, or what is dropped, may have the room.

        With the room of the reserve only what frees at least as much as it takes is written.
        """
        *pieces, last = changes.pieces(SCARCE_BYTES)
        pieces.append(replace(last, knowledge={}))
        growth_bytes = [self._growth_bytes(piece) for piece in pieces]
        shrinking = [p for p, more in zip(pieces, growth_bytes, strict=True) if more <= 0]
        if shrinking:
            self._reserve.release()
        self._checkpoint()
        for piece in shrinking:
            self._commit(piece)
            changes.settle(piece)
        self._give_back()
        self._commit(changes)  # what is known of peers, last of all
        changes.settle(changes)

    def _growth_bytes(self, piece: Changes) -> int:
        """By how much a piece makes the messages in the file more."""
        put = sum(len(record.body) for record in piece.puts.values())
        select = "SELECT length(body) FROM record WHERE number = ?"
        found = (self._connection.execute(select, (n,)).fetchone() for n in piece.drops)
        freed: int = sum(row[0] for row in found if row)
        return put - freed

    def _give_back(self) -> None:
        """Give free pages to the disk until the reserve has its room again."""
        self._checkpoint()
        while not self._reserve.hold() and self._value("PRAGMA freelist_count"):
            self._connection.execute(f"PRAGMA incremental_vacuum({VACUUM_PAGES})").fetchall()
            self._checkpoint()

    def _checkpoint(self) -> None:
        self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    def _roll_back(self) -> None:
        with suppress(sqlite3.Error):  # SQLite may have done it by itself
            self._connection.execute("ROLLBACK")

    def _commit(self, changes: Changes) -> None:
        """Commit, all or nothing: dropped numbers first, their room serves for the rest."""
        run, run_many = self._connection.execute, self._connection.executemany
        run("BEGIN IMMEDIATE")
        try:
            run_many("DELETE FROM record WHERE number = ?", ((n,) for n in changes.drops))
            run_many(
                "INSERT OR REPLACE INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (_row(number, record) for number, record in changes.puts.items()),
            )
            run_many(
                "INSERT OR REPLACE INTO knowledge VALUES (?, ?, ?, ?, ?)",
                (_knowledge_row(peer, known) for peer, known in changes.knowledge.items()),
            )
            run("COMMIT")
        except BaseException:
            self._roll_back()
            raise

    def close(self) -> None:
        """Close the file; uncommitted changes are lost."""
        self._connection.close()

    def _value(self, question: str) -> Any:
        return self._connection.execute(question).fetchone()[0]


def fault(error: Exception, path: Path) -> StorageError:
    """The fault of a file, as text for the operator."""
    if isinstance(error, StorageError):
        return error
    code = _code(error)
    if code == sqlite3.SQLITE_FULL:
        return StorageFullError(f"no room to write {path}; free some space")
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
        return StorageDamagedError(_damaged(path, str(error)))
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return StorageLockedError(f"another process uses {path}; end it, or name another file")
    with suppress(OSError):  # it cannot be read: no permission, or the disk fails
        if not path.parent.is_dir():
            return StorageUnreachableError(f"there is no directory {path.parent}; make it")
    return StorageUnreachableError(f"cannot use {path}: {error}; may this user write it?")


def _code(error: Exception) -> int:
    """SQLite's result code; 0 if it is no error of SQLite."""
    code: int = getattr(error, "sqlite_errorcode", 0)
    return code & 0xFF


def _damaged(path: Path, what: str) -> str:
    return f"{path} is damaged ({what})"


def is_database(path: Path) -> bool:
    """Whether a file begins like an SQLite database. Raises OSError."""
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) in (_MAGIC, bytes(len(_MAGIC)))


def _u64(number: int) -> bytes:
    return number.to_bytes(8, "big")


def _row(number: int, record: Record) -> tuple[object, ...]:
    fields = (
        record.header.robot_id,
        record.header.topic_id,
        record.stamp_ms,
        record.extrapolated,
        record.priority,
        record.received_s,
    )
    return (number, *fields, _checksum(number, fields, record.body), record.body)


def _record(number: int, *row: Any) -> Record:
    *fields, checksum, body = row
    robot_id, topic_id, stamp_ms, extrapolated, priority, received_s = fields
    if _checksum(number, fields, body) != checksum:
        raise ValueError("altered")
    header = Header.at(robot_id, topic_id, stamp_ms)
    return Record(header, priority, body, stamp_ms, received_s, bool(extrapolated))


def _knowledge_row(peer: str, known: Knowledge) -> tuple[object, ...]:
    numbers = (_u64(known.epoch), _u64(known.sequence), _u64(known.own_sequence))
    return (peer, *numbers, zlib.crc32(b"".join((*numbers, peer.encode()))))


def _knowledge(peer: str, *row: Any) -> Knowledge:
    known = Knowledge(*(int.from_bytes(number, "big") for number in row[:3]))
    if _knowledge_row(peer, known) != (peer, *row):
        raise ValueError("altered")
    return known


def _checksum(number: int, fields: Sequence[object], body: bytes | memoryview) -> int:
    return zlib.crc32(body, zlib.crc32(_CHECKED.pack(number, *fields)))
