"""The work on one mission: edits, undo, redo, and saving."""

from dataclasses import dataclass
from typing import Any

from air_router.editor import edits
from air_router.editor.analysis import MissionAnalysis
from air_router.editor.editable_mission import EditableMission
from air_router.editor.edits import Edit, EditError
from air_router.editor.mission_file import MissionFile
from air_router.editor.view import Viewer, route_view
from air_router.errors import AirRouterError
from mocha_link.team.document import DocumentError

_MOST_STEPS = 500


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
    """The mission as it is now, and how it came to be.

    Not for several threads at a time.

    Attributes:
        revision: Counts the states shown; edits name the one they mean.
        editable: The text as it is now.

    Raises:
        DocumentError: the file cannot be read at all.
    """

    def __init__(self, file: MissionFile) -> None:
        self._file = file
        self._viewer = Viewer()
        self.revision = 0
        self._saved = ""  # the text on the disk
        self._steps: list[_Step] = []  # the first is the file as it was read
        self._now = 0  # index of the present state in `_steps`
        self._begin()

    @property
    def dirty(self) -> bool:
        """Whether there is something to save."""
        return self.editable.text != self._saved

    @property
    def wrong(self) -> bool:
        """Whether the mission has problems."""
        return bool(self._analysis.document.problems)

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
        if goes_on and isinstance(edit, edits.Shift):  # from where it began: no rounding adds up
            base = EditableMission.read(self._steps[self._now - 1].text, self._file.path)
        after = base.edited(edit)
        if after.text == self.editable.text:
            return
        analysis = MissionAnalysis.of(after)
        step = _Step(after.text, edit.words, gesture)
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
            count = len(set(self._analysis.document.problems))
            raise UnconfirmedError(
                f"the mission has {count} problem{'s' if count > 1 else ''} and cannot be flown "
                "as it is; save it all the same?"
            )
        self._file.write(self.editable.text, overwrite=overwrite)
        self._saved = self.editable.text

    def reload(self) -> None:
        """Begin again with what is on the disk. Raises DocumentError if it cannot be read."""
        self._begin()

    def changed_on_disk(self) -> bool:
        """Whether another program has changed the file."""
        return self._file.changed()

    def route(self, start: int, end: int) -> dict[str, Any]:
        """The route between two waypoints (0: home)."""
        return route_view(self._analysis, start, end)

    def view(self) -> dict[str, Any]:
        """The state, for the page."""
        more = self._now + 1 < len(self._steps)
        return {
            "revision": self.revision,
            "file": self._file.path.name,
            "dirty": self.dirty,
            "undo": self._steps[self._now].what if self._now else None,
            "redo": self._steps[self._now + 1].what if more else None,
            **self._view,
        }

    def _begin(self) -> None:
        text = self._file.read()
        try:
            editable = EditableMission.read(text, self._file.path)
        except DocumentError:
            self._file.forget()
            raise
        self._saved = text
        self._steps = [_Step(text, "", None)]
        self._now = 0
        self._show(editable, MissionAnalysis.of(editable))

    def _go(self, steps: int) -> None:
        editable = EditableMission.read(self._steps[self._now + steps].text, self._file.path)
        analysis = MissionAnalysis.of(editable)
        self._now += steps
        self._show(editable, analysis)

    def _show(self, editable: EditableMission, analysis: MissionAnalysis) -> None:
        self.revision += 1
        self.editable = editable
        self._analysis = analysis
        self._view = self._viewer.view(self.editable.parts, analysis)
