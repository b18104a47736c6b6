"""Where files are written: no link of another user is followed, and no file of theirs is emptied.

In a folder that others may write to (of another user, or as `/tmp` open to all) another user may
have created a link with the name of the new file: the data would go into the file
that it leads to, with our rights. The kernel's `fs.protected_symlinks` guards sticky folders only,
and may be off.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from pathlib import Path
from typing import IO, Final

_MOST_LINKS: Final = 40  # as the kernel has it
_ROOT: Final = 0


def check_links(path: Path) -> None:
    """Look at all links on the way to a file or folder, which need not be there yet.

    Raises:
        OSError: one of them belongs to another user, or they lead nowhere.
    """
    _check(path, _MOST_LINKS)


def _check(path: Path, most: int) -> int:
    """How many links more there may be."""
    absolute = Path(os.path.abspath(path))  # noqa: PTH100 - `resolve` would follow links
    for each in (*reversed(absolute.parents), absolute):
        try:
            about = each.lstat()
        except (FileNotFoundError, NotADirectoryError, PermissionError):
            break  # the next step reports the error
        if not stat.S_ISLNK(about.st_mode):
            continue
        if about.st_uid not in (os.getuid(), _ROOT):
            raise OSError(
                errno.EPERM,
                "is a link of another user, which may lead anywhere; name the place itself",
                str(each),
            )
        if not most:
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
        most = _check(each.parent / each.readlink(), most - 1)
    return most


def new_file(path: Path) -> IO[bytes]:
    """A new, empty file to write to, which takes the place of one of that name.

    A link of that name is replaced, not followed; so is a second name of another file.

    Raises:
        OSError: it cannot be made, or would replace a folder or, in `/tmp`, another user's file.
    """
    check_links(path.parent)
    temporary = path.with_name(f".{path.name[:40]}.{secrets.token_hex(8)}")
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    except OSError as error:  # it names the temporary file, which no caller knows
        raise OSError(error.errno, error.strerror, str(path)) from None
    try:
        temporary.replace(path)
    except OSError as error:
        os.close(descriptor)
        temporary.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from None
    return os.fdopen(descriptor, "wb")


def made_folder(path: Path, *, private: bool = False) -> Path:
    """A folder to write to, which is made if it is not there.

    Args:
        path: Where.
        private: Whether no other user may write to it: for programs that follow links there.

    Raises:
        OSError: it cannot be made or written to, or is another user's link.
    """
    check_links(path)
    path.mkdir(parents=True, exist_ok=True)
    about = path.stat()
    if not os.access(path, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    if private and (about.st_uid != os.getuid() or about.st_mode & stat.S_IWOTH):
        raise PermissionError(errno.EPERM, "other users may write to this folder", str(path))
    return path
