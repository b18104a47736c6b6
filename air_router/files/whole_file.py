"""A whole file: read up to a limit, written so that it is there as a whole or not at all."""

import contextlib
import errno
import os
import stat
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from air_router.errors import UsageError
from mocha_link.path_safety import check_links
from mocha_link.team import Problem, bytes_of

_ANY_WRITES: Final = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


class FileThereError(UsageError):
    """There is such a file already, and the user did not allow that it is overwritten."""


@dataclass(frozen=True, slots=True)
class PlacedSource:
    """A file that problems are reported of; keys begin with line and column, counted from 1."""

    path: Path

    def problem(self, keys: Sequence[str | int], message: str, code: str) -> Problem:
        """A problem at a line and column; without them at the file's begin."""
        line, column = (int(key) for key in keys[:2]) if len(keys) > 1 else (1, 1)
        return Problem(self.path, line, column, message, code)


def bytes_within(path: Path, max_bytes: int) -> bytes:
    """A file's bytes. Raises DocumentError: it cannot be read or is too large."""
    return bytes_of(path, max_bytes, "cut out the part that the mission needs")


READ_ONLY: Final = "is read-only; allow writing (chmod u+w) or write to another file"


def is_writable(path: Path) -> bool:
    """Whether the rights of a file that is there let it be written, for root, too."""
    return os.access(path, os.W_OK) and bool(path.stat().st_mode & _ANY_WRITES)


def is_file(path: Path) -> bool:
    """Whether there is a file, no folder, at a path; none is where it is too long for one."""
    try:
        return path.is_file()
    except OSError:
        return False


def write_whole(
    path: Path, text: str | bytes, *, replace: bool, check: Callable[[], None] = lambda: None
) -> None:
    """Write a file in one step; what was there stays until it is replaced, also in a power cut.

    Args:
        path: The file; a link stays a link. A device or a pipe is written to directly.
        text: What shall be in it.
        replace: Whether it may be there already.
        check: Called just before the file is replaced; what it raises leaves all as it was.

    Raises:
        FileThereError: there is such a file, and `replace` is not set.
        OSError: the folder cannot be written to, the file is read-only, or a link of another
            user leads there.
    """
    check_links(path)
    if path.exists() and not replace:
        raise _refusal(path)
    if path.is_char_device() or path.is_fifo():  # /dev/null, /dev/stdout: these stay what they are
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return
    path = path.resolve()  # a link stays a link
    if path.exists() and not is_writable(path):
        raise PermissionError(errno.EACCES, READ_ONLY, str(path))
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name[:40]}.", dir=path.parent)
    except OSError as error:  # it names the temporary file, which no caller named
        raise OSError(error.errno, error.strerror, str(path)) from None
    beside = Path(name)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(text.encode() if isinstance(text, str) else text)
            file.flush()
            os.fchmod(file.fileno(), _mode(path))
            os.fsync(file.fileno())
        check()
        if replace:
            beside.replace(path)
        else:
            _claim(beside, path)
    finally:
        beside.unlink(missing_ok=True)
    sync_folder(path.parent)


def _claim(beside: Path, path: Path) -> None:
    """Give the file its name, unless another program has taken it by now."""
    try:
        path.hardlink_to(beside)
    except FileExistsError:
        raise _refusal(path) from None
    except OSError:  # a file system without hard links
        beside.replace(path)


def _mode(path: Path) -> int:
    """The rights of the file that is replaced, or those that a new file gets."""
    if path.exists():
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _refusal(path: Path) -> FileThereError:
    return FileThereError(f"{path} is already there; --force replaces it")


def sync_folder(folder: Path) -> None:
    """Have a file's new name last through a power cut, where the file system can do that."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
