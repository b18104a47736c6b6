"""A mission file's text, as it would be saved now: what it says, and what an edit makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from air_router.editor.changes import Changes
from air_router.editor.edits import Edit, EditError
from air_router.editor.plan_changes import PlanChanges
from air_router.editor.yaml_changes import YamlChanges
from air_router.files.json_document import JsonDocument, json_from_text
from air_router.files.mission_document import MissionDocument
from air_router.files.missions.mission_file import read_mission
from air_router.files.missions.qgc_read import plan_draft
from air_router.files.text_edit import rewritten
from air_router.mission.loading import check_own
from mocha_link.team.document import Document, DocumentError

_BY_HAND = "this cannot be done here, as the file is written; edit it by hand"


@dataclass(frozen=True, slots=True)
class EditableMission:
    """A text that can be read. Never changes: an edit makes another one."""

    path: Path
    text: str  # as it would be saved
    document: Document
    parts: Changes  # what of it can be changed; not changed itself

    @classmethod
    def read(cls, text: str, path: Path) -> EditableMission:
        """The text of a mission file, its path names it and says its kind.

        Raises:
            DocumentError: it is not readable YAML or JSON, or another program's file.
        """
        check_own(path)
        if path.suffix.lower() == ".plan":
            document: Document = json_from_text(text, path)
            return cls(path, text, document, PlanChanges(document.data))
        document = Document.from_text(text, path)
        return cls(path, text, document, YamlChanges(document.data))

    def mission_document(self) -> MissionDocument:
        """What the text says, not yet validated."""
        if isinstance(self.document, JsonDocument):
            return plan_draft(self.document)
        return read_mission(self.document)

    def edited(self, edit: Edit) -> EditableMission:
        """The text after an edit: it says what was asked for, and all else as before.

        Raises:
            EditError: there is no such part, or the file is written in a way that has no place for
                the change; the text is as it was.
            SourceError: likewise.
        """
        changes = self.parts.copied()
        changes.make(edit)
        try:
            text = rewritten(self.text, self.document, changes.data)
            after = EditableMission.read(text, self.path)
        except (DocumentError, ValueError):
            raise EditError(_BY_HAND) from None
        if after.document.data != changes.data:
            raise EditError(_BY_HAND)
        return after
