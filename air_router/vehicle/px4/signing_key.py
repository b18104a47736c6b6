"""The MAVLink signing key in its file, and the time of the last signature in a file beside it.

The key never appears in a log, a record, an error or a command line.
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
    """A signing key file is missing, invalid, or readable by others."""

    exit_code: ClassVar[ExitCode] = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The secret shared by the vehicle and all its communication partners.

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
            SigningKeyError: The file cannot be read, is readable by others, or has no key.
        """
        try:
            # Opening a FIFO would block.
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
        with contextlib.suppress(ValueError):  # not hexadecimal
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
            SigningKeyError: The file exists, or cannot be written.
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
    """Stores the time of the last signature, so times never decrease after a restart.

    A vehicle rejects a message as a replay if its time is not later than the previous one's, and a
    companion without a real-time clock starts in the past. The file is next to the key file.

    Args:
        key: The key file.
    """

    def __init__(self, key: Path) -> None:
        self._path = key.with_name(f"{key.name}.timestamp")
        self._failed = False  # the operator was warned

    def load(self) -> int:
        """The latest timestamp that may have been used; 0: none is known.

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
        """Store an upper bound of the used timestamps; a later one of another program is kept."""
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
