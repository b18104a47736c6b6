"""Writing a file so that it is there as a whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

from air_router.errors import UsageError


class FileThereError(UsageError):
    """There is such a file already, and the user did not say that it may go."""


def write_whole(path: Path, text: str, *, replace: bool) -> None:
    """Write a text file in one step; what was there stays until it is replaced.

    Raises:
        FileThereError: there is such a file, and `replace` is not set.
        OSError: the folder cannot be written to.
    """
    if path.exists() and not replace:
        raise _refusal(path)
    path = path.resolve()  # a link stays a link
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name[:40]}.", dir=path.parent)
    except OSError as error:  # it names the temporary file, which no caller asked for
        raise OSError(error.errno, error.strerror, str(path)) from None
    beside = Path(name)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        beside.chmod(_mode(path))
        if replace:
            beside.replace(path)
        else:
            _claim(beside, path)
    finally:
        beside.unlink(missing_ok=True)


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
