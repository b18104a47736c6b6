"""The secret with which MAVLink is signed, in a file, and the time of the last signature beside it.

The key is never shown: not in a log, a record, an error or the words of a command line.
"""

import contextlib
import logging
import os
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Self

from air_router.errors import AirRouterError, ExitCode
from air_router.vehicle.px4.limits import KEY_FILE_BYTES
from air_router.vehicle.px4.mavlink_values import KEY_BYTES, LAST_TIMESTAMP
from mocha_link.path_safety import new_file

_log = logging.getLogger(__name__)


class SigningKeyError(AirRouterError):
    """A file of a signing key that is missing, is none, or that others can read."""

    exit_code: ClassVar[ExitCode] = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The secret that the vehicle and all who talk to it share.

    Attributes:
        secret: 32 bytes, not all 0.
    """

    secret: bytes = field(repr=False)

    @classmethod
    def generate(cls) -> Self:
        """A new one."""
        return cls(os.urandom(KEY_BYTES))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a key file: 32 bytes, or 64 hexadecimal digits.

        Raises:
            SigningKeyError: it cannot be read, others can read it, or it has no key.
        """
        try:
            # A FIFO would be waited for.
            place = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            with os.fdopen(place, "rb") as file:
                mode = os.fstat(place).st_mode
                data = file.read(KEY_FILE_BYTES) if stat.S_ISREG(mode) else b""
        except OSError as error:
            raise SigningKeyError(
                f"{path}: the signing key cannot be read: {error.strerror}; `air-router "
                "signing-key FILE` makes one"
            ) from None
        if not stat.S_ISREG(mode):
            raise SigningKeyError(f"{path}: this is no file; name the file of the signing key")
        if stat.S_IMODE(mode) & 0o077:
            raise SigningKeyError(
                f"{path}: others can read or change the signing key; run: chmod 600 '{path}'"
            )
        secret = data if len(data) == KEY_BYTES else b""
        with contextlib.suppress(ValueError):  # no text, or no digits
            text = data.decode("ascii").strip()
            if len(text) == 2 * KEY_BYTES:
                secret = bytes.fromhex(text)
        if len(secret) != KEY_BYTES:
            raise SigningKeyError(
                f"{path}: this is no signing key, which is {KEY_BYTES} bytes or {2 * KEY_BYTES} "
                "hexadecimal digits; copy it again, or make a new one"
            )
        if not any(secret):
            raise SigningKeyError(
                f"{path}: a key of zeros turns signing off and protects nothing; make a new one"
            )
        return cls(secret)

    def write(self, path: Path) -> None:
        """Write a new key file that only its owner can read.

        Raises:
            SigningKeyError: there is something of that name, or it cannot be written.
        """
        try:
            place = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
            with os.fdopen(place, "w", encoding="ascii") as file:
                os.fchmod(place, 0o600)
                file.write(f"{self.secret.hex()}\n")
                file.flush()
                os.fsync(place)
        except FileExistsError:
            raise SigningKeyError(
                f"{path}: there is a file already, which is kept; name another one"
            ) from None
        except OSError as error:
            raise SigningKeyError(
                f"{path}: the signing key cannot be written: {error.strerror}"
            ) from None


class TimestampFile:
    """Keeps the time of the last signature, so that times never go back after a restart.

    A vehicle takes a message whose time is not later than that of the one before for a replay, and
    a companion whose clock has no battery begins in the past. The file is beside that of the key.

    Args:
        key: The key's file.
    """

    def __init__(self, key: Path) -> None:
        self._path = key.with_name(f"{key.name}.timestamp")
        self._failed = False  # the operator was warned

    def load(self) -> int:
        """The latest that may have been used; 0 if none is known.

        In units of 10 microseconds since 2015.
        """
        try:
            text = self._path.read_bytes()[:KEY_FILE_BYTES]
        except FileNotFoundError:
            return 0
        except OSError as error:
            self._warn(error)
            return 0
        digits = text.strip()
        if (
            digits.isdigit()
            and len(digits) <= len(str(LAST_TIMESTAMP))
            and int(digits) < LAST_TIMESTAMP
        ):
            return int(digits)
        _log.warning("%s is damaged; signatures go by the clock of this machine", self._path)
        return 0

    def store(self, timestamp: int) -> None:
        """Remember that no later one was used, also if another program has used later ones."""
        latest = max(timestamp, self.load())
        try:
            with new_file(self._path) as file:
                file.write(f"{latest}\n".encode())
        except OSError as error:
            self._warn(error)

    def _warn(self, error: OSError) -> None:
        if not self._failed:
            self._failed = True
            _log.warning(
                "%s cannot be kept (%s): after a restart with a clock that is behind, the vehicle "
                "may take signed messages for old ones; put the key in a folder of this user",
                self._path,
                error.strerror,
            )
