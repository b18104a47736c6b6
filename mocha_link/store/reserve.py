"""Room on the disk that is kept for the moment when there is no other.

Even a deletion needs room for the journal, so a database on a full disk could never shrink. The
reserve is a file beside it, ``<file>-reserve``; it is removed to let deletions through, and made
again when there is room.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

RESERVE_BYTES = 1024 * 1024  # the journal of a transaction, see `changes.PIECE_BYTES`

_MARK = b"room that mocha_link keeps for deletions on a full disk\n"


class Reserve:
    """The reserve of a file.

    Args:
        path: the file whose room it is.
    """

    def __init__(self, path: Path) -> None:
        self._path = Path(f"{path}-reserve")

    def hold(self) -> bool:
        """Take the room, unless it is held or there is none; whether it is held now."""
        if self._is_held():
            return True
        flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_NOFOLLOW
        try:
            descriptor = os.open(self._path, flags, 0o600)
        except OSError:  # also if there is another file of that name, which is not ours
            return False
        try:
            os.write(descriptor, _MARK)
            os.posix_fallocate(descriptor, 0, RESERVE_BYTES)
        except OSError:
            self._path.unlink(missing_ok=True)
            return False
        finally:
            os.close(descriptor)
        return True

    def release(self) -> bool:
        """Give the room back to the disk; whether it was held."""
        if not self._is_held():
            return False
        with suppress(OSError):
            self._path.unlink()
        return True

    def _is_held(self) -> bool:
        try:
            with self._path.open("rb") as file:
                is_ours = file.read(len(_MARK)) == _MARK
                return is_ours and os.fstat(file.fileno()).st_size == RESERVE_BYTES
        except OSError:
            return False
