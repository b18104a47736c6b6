"""The work on one mission: its file on the disk, edits, undo, redo, and saving."""

import codecs
import contextlib
import hashlib
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from air_router.editor.editable_mission import EditableMission, MissionAnalysis
from air_router.editor.edits import Edit
from air_router.editor.parts import EditError
from air_router.editor.view import route_view, view
from air_router.errors import AirRouterError, UsageError
from air_router.files import bytes_within, write_whole
from air_router.files.missions import first_mission_text
from geo.frame import Geodetic, Point
from mocha_link.team import MAX_BYTES, DocumentError, text_in

_MOST_STEPS = 500
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
        """The file's new contents were not loaded: from now on it counts as changed."""
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
        raw = (codecs.BOM_UTF8 if self._mark else b"") + text.encode()
        if len(raw) > MAX_BYTES:
            raise SaveError(f"the mission is larger than {MAX_BYTES} bytes; thin it out")
        try:
            check = (lambda: None) if overwrite else self._check_unchanged
            write_whole(self.path, raw, replace=True, check=check)
        except OSError as error:
            raise SaveError(
                f"cannot write {self.path}: {error.strerror or type(error).__name__}; nothing is "
                "lost here, fix that and save again"
            ) from None
        self._digest = hashlib.sha256(raw).digest()

    def keep_aside(self, text: str) -> Path:
        """Write what was not saved into a new file; gives its path.

        It is beside, or where nothing can be written in the folder for temporary files.

        Raises:
            SaveError: nothing can be written there either.
        """
        try:
            return self._kept_in(self.path.parent, text)
        except OSError as error:
            with contextlib.suppress(OSError):
                return self._kept_in(Path(tempfile.gettempdir()), text)
            why = f"{error.filename or self.path.parent}: {error.strerror}"
            raise SaveError(f"what was not saved is lost: cannot write {why}") from None

    def _kept_in(self, folder: Path, text: str) -> Path:
        aside, number = folder / f"{self.path.name}.unsaved", 1
        while os.path.lexists(aside):  # of another page on this file, or of the last time
            number += 1
            aside = folder / f"{self.path.name}.unsaved-{number}"
        write_whole(aside, text, replace=False)  # in a folder of all users it may be there by now
        return aside

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


class StaleError(AirRouterError):
    """The request is about another state of the mission than the present one."""


class UnconfirmedError(AirRouterError):
    """The mission has problems; it is saved when that is confirmed."""


@dataclass(frozen=True, slots=True)
class _Step:
    """A state of the text, and what led from the one before to it."""

    text: str
    what: str  # what undo calls it
    gesture: str | None  # edits of one are undone together


class EditSession:
    """The mission, with its edits to undo and redo.

    Not for several threads at a time.

    Attributes:
        file: The edited file; `file.changed()` where another program has written it.
        revision: Counts the states shown; edits name the one they mean.
        editable: The present text.

    Raises:
        DocumentError: the file cannot be read at all.
    """

    def __init__(self, file: MissionFile) -> None:
        self.file = file
        self.revision = 0
        self._saved = ""  # the text on the disk
        self._steps: list[_Step] = []  # the first is the file as it was read
        self._now = 0  # index of the present state in `_steps`
        self.reload()

    @property
    def dirty(self) -> bool:
        """Whether there is something to save."""
        return self.editable.text != self._saved

    @property
    def wrong(self) -> bool:
        """Whether the mission has problems."""
        return bool(self._analysis.findings.problems)

    def edit(self, edit: Edit, *, revision: int | None = None, gesture: str | None = None) -> None:
        """Change the mission.

        Args:
            edit: what to change.
            revision: the state that it is meant for; None: whatever it is now.
            gesture: edits of one name in a row are undone together, such as those of one drag;
                an area is then shifted from where it was before the first of them.

        Raises:
            StaleError, EditError, SourceError: nothing was changed.
        """
        if revision is not None and revision != self.revision:
            raise StaleError("the mission has changed meanwhile; try again")
        last = self._steps[self._now]
        goes_on = gesture is not None and self._now > 0 and last.gesture == gesture
        base = self.editable
        if goes_on and edit.from_start:
            base = EditableMission.read(self._steps[self._now - 1].text, self.file.path)
        after = base.edited(edit)
        if after.text == self.editable.text:
            return
        analysis = MissionAnalysis.of(after)
        step = _Step(after.text, edit.label, gesture)
        del self._steps[self._now + 1 :]
        if goes_on:
            self._steps[self._now] = step
        else:
            self._steps.append(step)
            del self._steps[:-_MOST_STEPS]
            self._now = len(self._steps) - 1
        self._show(after, analysis)

    def undo(self) -> None:
        """Take the last step back. Raises EditError if there is none."""
        if not self._now:
            raise EditError("there is nothing to undo")
        self._go(-1)

    def redo(self) -> None:
        """Make the step again that was taken back. Raises EditError if there is none."""
        if self._now + 1 == len(self._steps):
            raise EditError("there is nothing to redo")
        self._go(+1)

    def save(self, *, confirmed: bool = False, overwrite: bool = False) -> None:
        """Write the file.

        Args:
            confirmed: although the mission has problems.
            overwrite: although another program has changed the file.

        Raises:
            UnconfirmedError, ChangedOnDiskError, SaveError: the file is as it was.
        """
        if self.wrong and not confirmed:
            count = len(set(self._analysis.findings.problems))
            raise UnconfirmedError(
                f"the mission has {count} problem{'s' if count > 1 else ''} and cannot be flown "
                "yet; save it anyway?"
            )
        self.file.write(self.editable.text, overwrite=overwrite)
        self._saved = self.editable.text

    def reload(self) -> None:
        """Load the file again. Raises DocumentError if it cannot be read."""
        text = self.file.read()
        try:
            editable = EditableMission.read(text, self.file.path)
        except DocumentError:
            self.file.forget()
            raise
        self._saved = text
        self._steps = [_Step(text, "", None)]
        self._now = 0
        self._show(editable, MissionAnalysis.of(editable))

    def route(self, start: int, end: int) -> dict[str, Any]:
        """The route between two waypoints (0: home)."""
        return route_view(self._analysis, start, end)

    def view(self) -> dict[str, Any]:
        """The state, for the page."""
        more = self._now + 1 < len(self._steps)
        return {
            "revision": self.revision,
            "file": self.file.path.name,
            "dirty": self.dirty,
            "undo": self._steps[self._now].what if self._now else None,
            "redo": self._steps[self._now + 1].what if more else None,
            **self._view,
        }

    def _go(self, steps: int) -> None:
        editable = EditableMission.read(self._steps[self._now + steps].text, self.file.path)
        analysis = MissionAnalysis.of(editable)
        self._now += steps
        self._show(editable, analysis)

    def _show(self, editable: EditableMission, analysis: MissionAnalysis) -> None:
        self.revision += 1
        self.editable = editable
        self._analysis = analysis
        self._view = view(self.editable.parts, analysis)
