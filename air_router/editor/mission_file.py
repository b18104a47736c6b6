"""The mission's file on the disk: begun, read, watched, and replaced as a whole or not at all."""

import codecs
import hashlib
from pathlib import Path

from air_router.errors import AirRouterError, UsageError
from air_router.files.missions.mission_write import first_mission_text
from air_router.files.whole_file import bytes_within, write_whole
from geo.frame import Geodetic, Point
from mocha_link.team.document import MAX_BYTES, DocumentError
from mocha_link.team.problem import text_in

_FIRST_WAYPOINT = Point(0.0, 40.0)


class SaveError(AirRouterError):
    """The file could not be written; it is as it was."""


class ChangedOnDiskError(SaveError):
    """Another program has changed, or removed, the file since it was read."""


class MissionFile:
    """A file whose text is edited. Links are followed: the file they lead to is replaced."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._digest = b""  # SHA-256 of what was read or written last
        self._mark = False  # it begins with a byte order mark

    def read(self) -> str:
        """The file's text, line breaks as they are; from now on this is what it should be.

        Raises:
            DocumentError: it cannot be read, is too large or not UTF-8.
        """
        raw = bytes_within(self.path, MAX_BYTES)
        text = text_in(raw, self.path)
        self._mark = raw.startswith(codecs.BOM_UTF8)
        self._digest = hashlib.sha256(raw).digest()
        return text

    def forget(self) -> None:
        """What is in the file now was not taken over: from now on it counts as changed."""
        self._digest = b""

    def changed(self) -> bool:
        """Whether the file is another one than was read or written last."""
        try:
            return hashlib.sha256(bytes_within(self.path, MAX_BYTES)).digest() != self._digest
        except DocumentError:
            return True

    def write(self, text: str, *, overwrite: bool = False) -> None:
        """Replace the file in one step; readers see the old or the new one, never a part.

        Args:
            text: what shall be in it.
            overwrite: replace what another program has written meanwhile.

        Raises:
            ChangedOnDiskError: the file was changed by another program.
            SaveError: it cannot be written.
        """
        target = self.path.resolve()
        raw = (codecs.BOM_UTF8 if self._mark else b"") + text.encode()
        if len(raw) > MAX_BYTES:
            raise SaveError(f"the mission is larger than {MAX_BYTES} bytes; thin it out")
        try:
            check = (lambda: None) if overwrite else self._check_unchanged
            write_whole(target, raw, replace=True, check=check)
        except OSError as error:
            raise SaveError(
                f"cannot write {target}: {error.strerror or type(error).__name__}; nothing is lost "
                "here, save again when the reason is gone"
            ) from None
        self._digest = hashlib.sha256(raw).digest()

    def keep_aside(self, text: str) -> Path:
        """Write what was not saved into a file beside; gives its path. Raises SaveError."""
        aside = MissionFile(self.path.with_name(f"{self.path.name}.unsaved"))
        aside.write(text, overwrite=True)
        return aside.path

    def _check_unchanged(self) -> None:
        if self.changed():
            raise ChangedOnDiskError(
                f"{self.path.name} was changed on the disk meanwhile; load it again, "
                "or overwrite it"
            )


def write_starter(path: Path, home: Geodetic) -> None:
    """Write a new mission around its home.

    Raises:
        UsageError: the file is there already or is no YAML.
        SaveError: it cannot be written.
    """
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f"{path}: new missions are YAML files; call it {path.stem}.yaml")
    if path.exists():
        raise UsageError(f"{path} is there already; leave --new out to edit it")
    text = first_mission_text(
        "air-router edit", home, [_FIRST_WAYPOINT], altitude_m=40, fence_radius_m=150
    )
    MissionFile(path).write(text, overwrite=True)
