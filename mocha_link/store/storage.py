"""The database's copy on disk, written in order by a thread of its own.

Changes that are made during a commit share the next one (group commit): a slow disk makes longer
transactions, not a longer queue. Their length is bounded, so that the journal does not grow
(`changes`). What was committed survives a loss of power; `wait` returns when it is. See
`storage_file` for the file.

When the file cannot be written (disk full, damaged, locked by another process, directory missing)
the storage reports the fault once, to the log and to `on_fault`; the database continues in memory.
The writing is tried again every few seconds, and catches up with everything when it works. A
damaged file is moved aside, and a new one begun with what is in memory; so it is for one that was
deleted under the node.
"""

from __future__ import annotations

import logging
import sqlite3
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from mocha_link.logs import Log
from mocha_link.store import storage_file
from mocha_link.store.backlog import Backlog
from mocha_link.store.changes import Changes
from mocha_link.store.record import Knowledge, Record
from mocha_link.store.storage_file import (
    Contents,
    StorageDamagedError,
    StorageError,
    StorageFile,
    StorageForeignError,
    StorageFullError,
    StorageVersionError,
)
from mocha_link.store.storage_place import FileLostError, StoragePlace
from mocha_link.store.trust import TeamConfig

LOG = logging.getLogger("mocha_link")

RETRY_S = 5.0
CLOSE_S = 1.0
# These need the operator to replace the file, so it is not read again before that.
_LASTING = (StorageDamagedError, StorageForeignError, StorageVersionError)


class Storage:
    """Keeps one `Database` in a file; give it to the database, and close it in the end.

    Args:
        path: the file; it is made if there is none, its directory is not.
        config: of the team. Of a file from under another one only those messages are taken whose
            ids mean the same; the others go.
        on_fault: called with the fault when the file cannot be used, and with None when it
            can again; mostly on the storage's thread.
        retry_s: real seconds until the next try.
        connect: opens the SQLite file.
        log: where it logs.
    """

    def __init__(  # noqa: PLR0913 - what a storage may be given
        self,
        path: Path,
        *,
        config: TeamConfig | None = None,
        on_fault: Callable[[StorageError | None], None] | None = None,
        retry_s: float = RETRY_S,
        connect: Callable[[Path], sqlite3.Connection] = storage_file.connect,
        log: Log = LOG,
    ) -> None:
        self._place = StoragePlace(Path(path))
        self._log = log
        self._config = config
        self._on_fault = on_fault
        self._retry_s = retry_s
        self._connect = connect
        self._file: StorageFile | None = None  # None: closed, or after a fault
        self._fault: StorageError | None = None  # None while it works
        self._epoch = 0  # of the database that is kept
        # after a fault: what the file lacks
        self._reconcile: Callable[[Contents, Storage], None] | None = None
        self._thread: threading.Thread | None = None  # writes to the file, from `start` on
        self._backlog = Backlog()

    @property
    def path(self) -> Path:
        """The file."""
        return self._place.path

    @property
    def fault(self) -> StorageError | None:
        """Why the file cannot be used now, if so."""
        return self._fault

    def load(self, epoch: int) -> Contents:
        """For the database: what the file has; a new file gets `epoch`."""
        found = Contents()
        try:
            file = self._open(found)
            found.epoch = found.epoch or epoch
            file.sign(found.epoch)
        except Exception as error:  # noqa: BLE001 - whatever it is, the node works without a file
            self._close_file()
            self._fail(error)
        return found

    def start(self, epoch: int, reconcile: Callable[[Contents, Storage], None]) -> None:
        """For the database: begin to write.

        `reconcile` is called on the storage's thread with what a file has that could not be used
        before; it answers with `put`, `drop` and `learn`.
        """
        self._epoch = epoch
        self._reconcile = reconcile
        thread = threading.Thread(target=self._run, name="mocha_link storage", daemon=True)
        thread.start()
        self._thread = thread

    def put(self, number: int, record: Record) -> None:
        """For the database: a message to write."""
        self._backlog.put(number, record)

    def drop(self, number: int, key: int) -> None:
        """For the database: a message that is not kept any longer, of the topic of that key."""
        self._backlog.drop(number, key)

    def learn(self, peer: str, knowledge: Knowledge) -> None:
        """For the database: something to remember of a peer, with all that was put before."""
        self._backlog.learn(peer, knowledge)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until all that the database took before this call is on disk; whether it is.

        It does not wait for the end of a fault: False as soon as the file cannot be used.
        """
        return self._backlog.wait(timeout_s)

    def retry(self) -> None:
        """After a fault: try again now, not only when `retry_s` are over."""
        self._backlog.hurry()

    def close(self, timeout_s: float = CLOSE_S) -> bool:
        """Write the rest and close the file; whether all is on disk by then.

        A disk that is slower than `timeout_s` is written in the background while the process
        lives. May be called twice.
        """
        self._backlog.close()
        if self._thread:
            self._thread.join(timeout_s)
        else:  # the database was not made
            self._close_file()
        left = self._backlog.left
        if left:
            what = "1 change is" if left == 1 else f"{left} changes are"
            self._log.warning("%s: %s not on disk", self.path, what)
        return not left

    def _run(self) -> None:
        try:
            while self._backlog.wait_for_work(self._retry_s):
                self._attempt()
            if self._backlog.left:
                self._attempt()
        except Exception as error:  # noqa: BLE001 - our mistake ends the writing, not the node
            self._log.exception("%s: the writing has ended", self.path)
            self._fault = StorageError(f"{self.path} is not written any more: {error!r}")
            self._report(self._fault)
        finally:
            self._backlog.end()
            self._close_file()

    def _attempt(self) -> None:
        """Write everything that is pending."""
        changes = Changes()
        try:
            if self._file:
                self._place.check()
            file = self._file or self._reopen()
            changes, given = self._backlog.take()
            file.write(changes)
        except Exception as error:  # noqa: BLE001 - whatever it is, the node works without a file
            self._backlog.put_back(changes)
            self._fail(error)
        else:
            self._succeed(given)

    def _reopen(self) -> StorageFile:
        """Open the file after a fault and find out what it lacks."""
        if self._fault and self._place.is_refused:
            raise self._fault
        found = Contents()
        try:
            file = self._open(found)
            file.sign(self._epoch)
            if self._reconcile:
                self._reconcile(found, self)
        except BaseException:
            self._close_file()
            raise
        return file

    def _open(self, found: Contents) -> StorageFile:
        self._file = StorageFile(self.path, self._connect)
        self._place.opened()
        self._file.read(found)
        removed = self._file.adopt(self._config, found) if self._config else 0
        if removed:
            what = "1 message is" if removed == 1 else f"{removed} messages are"
            self._log.warning(
                "%s: %s gone: under this team file the ids mean others", self.path, what
            )
        return self._file

    def _close_file(self) -> None:
        file, self._file = self._file, None
        if file:
            with suppress(sqlite3.Error):
                file.close()

    def _fail(self, error: Exception) -> None:
        fault = storage_file.fault(error, self.path)
        if not isinstance(fault, StorageFullError):  # nothing but room is missing then
            self._close_file()
        aside = self._place.set_aside() if isinstance(fault, StorageDamagedError) else None
        anew = aside is not None or isinstance(fault, FileLostError)
        self._place.refuse(lasting=isinstance(fault, _LASTING))
        is_known = type(fault) is type(self._fault)
        self._fault = fault
        self._backlog.suspend(retry_now=anew)
        if anew:
            moved = f", and is now {aside}" if aside else ""
            self._log.error("%s%s; a new one is begun with what is in memory", fault, moved)
        elif not is_known:
            self._log.error("%s; working from memory, next try in %g s", fault, self._retry_s)
        if not is_known:
            self._report(fault)

    def _succeed(self, given: int) -> None:
        was, self._fault = self._fault, None
        self._backlog.saved(given)
        if was:
            self._log.warning("%s: all is on disk again", self.path)
            self._report(None)

    def _report(self, fault: StorageError | None) -> None:
        if self._on_fault:
            try:
                self._on_fault(fault)
            except Exception:  # noqa: BLE001 - a listener's
                self._log.exception("%s raised an error", self._on_fault)
