"""A mission file's text, as it would be saved now: what it says, and what an edit makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from air_router.editor import edits
from air_router.editor.edits import Edit, EditError
from air_router.editor.plan_editor import PlanEditor
from air_router.editor.text_editor import TextEditor
from air_router.editor.yaml_editor import YamlEditor
from air_router.files.json_document import JsonDocument, json_from_text
from air_router.files.mission_document import MissionDocument
from air_router.files.qgc.qgc_read import plan_draft
from air_router.files.text.source import spliced
from air_router.files.yaml.mission_file import read_mission
from air_router.mission.foreign import check_own
from mocha_link.team.document import Document, DocumentError

_BY_HAND = "this cannot be done here, as the file is written; edit it by hand"


@dataclass(frozen=True, slots=True)
class EditableMission:
    """A text that can be read. Never changes: an edit makes another one."""

    path: Path
    text: str  # as it would be saved
    document: Document
    editor: TextEditor

    @classmethod
    def read(cls, text: str, path: Path) -> EditableMission:
        """The text of a mission file, its path names it and says its kind.

        Raises:
            DocumentError: it is not readable YAML or JSON, or another program's file.
        """
        check_own(path)
        if _is_plan(path):
            plan = json_from_text(text, path)
            return cls(path, text, plan, PlanEditor(text, plan))
        document = Document.from_text(text, path)
        return cls(path, text, document, YamlEditor(text, document))

    def mission_document(self) -> MissionDocument:
        """What the text says, not yet validated."""
        if isinstance(self.document, JsonDocument):
            return plan_draft(self.document)
        return read_mission(self.document)

    def edited(self, edit: Edit) -> EditableMission:
        """The text after an edit.

        Raises:
            EditError: there is no such part, or the file is written in a way that has no place for
                the change; the text is as it was.
            SourceError: likewise.
        """
        try:
            new = EditableMission.read(spliced(self.text, self.editor.splices(edit)), self.path)
        except (DocumentError, ValueError):
            raise EditError(_BY_HAND) from None
        before = sum(1 for _ in self.editor.features.handles())
        after = sum(1 for _ in new.editor.features.handles())
        if after - before != self._more(edit):
            raise EditError(_BY_HAND)
        return new

    def _more(self, edit: Edit) -> int:
        """How many handles an edit adds."""
        match edit:
            case edits.AddCorner() | edits.AddWaypoint() | edits.AddRallyPoint():
                return 1
            case edits.AddArea():
                return len(edit.corners)
            case edits.Redraw():
                (region,) = (r for r in self.editor.features.regions if r.keys == edit.keys)
                outline = region.rings[0].corners if region.circle is None else [region.circle]
                return len(edit.corners) - len(outline)
            case edits.Remove():
                prefix = edit.keys
                handles = self.editor.features.handles()
                return -sum(handle.keys[: len(prefix)] == prefix for handle in handles)
            case _:
                return 0


def _is_plan(path: Path) -> bool:
    return path.suffix.lower() == ".plan"
