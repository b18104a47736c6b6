"""The path of a storage's file, and which file is there."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from mocha_link.store import storage_file
from mocha_link.store.storage_file import StorageUnreachableError


class FileLostError(StorageUnreachableError):
    """The file is not where it was when it was opened."""


class StoragePlace:
    """Checks whether the file at a path is still the one that was opened, or that was refused.

    Attributes:
        path: of the file; its directory exists.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._opened_inode: int | None = None  # of the file that was opened last; None: no file
        self._refused: tuple[int, ...] | None = None  # state of a file that stays unusable

    def opened(self) -> None:
        """The file is open now."""
        state = self._state()
        self._opened_inode = state[0] if state else None

    def check(self) -> None:
        """Raises FileLostError if what is there is not the file that was opened."""
        state = self._state()
        if state is None or state[0] != self._opened_inode:
            raise FileLostError(f"{self.path} was deleted or replaced while it was open")

    def refuse(self, *, lasting: bool) -> None:
        """The file cannot be used, `lasting`: not before another one takes its place."""
        self._refused = self._state() if lasting else None

    @property
    def is_refused(self) -> bool:
        """Whether the file that stays unusable is there unchanged, so that reading it is vain."""
        return self._refused is not None and self._refused == self._state()

    def set_aside(self) -> Path | None:
        """Move a damaged file aside, for an operator to examine; its new path, None if it stays."""
        number = 1
        try:
            while (to := self.path.with_name(f"{self.path.name}.damaged-{number}")).exists():
                number += 1
            if not storage_file.is_database(self.path):
                return None  # the wrong name was given, perhaps: it is not ours to move
            self.path.rename(to)
            for tail in ("-wal", "-shm"):
                with suppress(FileNotFoundError):
                    Path(f"{self.path}{tail}").rename(f"{to}{tail}")
        except OSError:
            return None
        return to

    def _state(self) -> tuple[int, ...] | None:
        """Identifies the file at the path; None: there is none."""
        try:
            stat = self.path.stat()
        except OSError:
            return None
        return stat.st_ino, stat.st_size, stat.st_mtime_ns
