"""Reads mission files in YAML. The format is described in docs/mission-file.md."""

import json
from typing import Any

from pydantic import ValidationError, ValidationInfo, ValidatorFunctionWrapHandler, field_validator

from air_router.files import MISSION, Findings, MissionForm, notes
from air_router.files.missions.form_builder import FormBuilder
from air_router.files.missions.mission_mistakes import (
    empty_notes,
    explained_mission,
    other_kind,
)
from mocha_link.team import Document, DocumentError

_LISTS = ("waypoints", "fences", "no_fly_zones", "no_fly_files", "rally_points")
"""Sections whose valid entries are read, even where others are not valid."""

_STAND_INS: dict[str, Any] = {
    "home": {"position": [0.0, 0.0]},
    "altitude_m": 1.0,
    "waypoints": [],
    "no_fly_zones": [],
}
"""For mandatory sections that are missing or unreadable, so that the others are still checked."""


def read_mission(document: Document) -> tuple[MissionForm, Findings]:
    """The mission that a YAML document describes, and what was found.

    What is wrong with the form is found beside whatever can be read all the same, so that one
    reading of a file finds all its problems.
    """
    findings, path, data = Findings(document), document.path, document.data
    if not isinstance(data, dict):
        message = "a mission is a mapping of keys and values; see docs/mission-file.md"
        findings.report((), message, "no-mission")
        return FormBuilder().form(path), findings
    if other := other_kind(data, "mission"):
        message = f"this is {other}: name the mission, which has the path of this file"
        findings.report((), message, "no-mission")
        return FormBuilder().form(path), findings
    unread: set[str] = set()
    try:
        form = document.parse(MissionForm)
    except DocumentError as error:
        findings.problems += explained_mission(error, document).problems
        unread |= _STAND_INS.keys() - data.keys()
        text = json.dumps({**_STAND_INS, **data})
        form = _RightParts.model_validate_json(text, strict=True, extra="ignore", context=unread)
    refused = {problem.keys for problem in findings.problems}
    noted = (*empty_notes(document), *notes(document, MISSION))
    findings.notes += [note for note in noted if note.keys not in refused]
    return form.of_file(path, unread=unread), findings


class _RightParts(MissionForm):
    """A mission without the parts that are wrong; the context takes the names of such sections.

    An entry of a list that is wrong is None.
    """

    @field_validator("*", mode="wrap")
    @classmethod
    def _right(cls, value: Any, read: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        try:
            return read(value)
        except ValidationError as error:
            wrong = {detail["loc"][0] if detail["loc"] else None for detail in error.errors()}
        name = str(info.field_name)
        if name in _LISTS and None not in wrong:
            right = iter(read([entry for i, entry in enumerate(value) if i not in wrong]))
            return [None if i in wrong else next(right) for i in range(len(value))]
        if info.context is not None:
            info.context.add(name)
        return read(_STAND_INS.get(name, cls.model_fields[name].get_default()))
