"""Reads mission files in YAML. The format is described in docs/mission-file.md."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import yaml
from pydantic import ValidationError, ValidationInfo, ValidatorFunctionWrapHandler, field_validator

from air_router.files import MISSION, Findings, MissionForm, explained, notes
from air_router.files.missions.form_builder import FormBuilder
from mocha_link.team import Document, DocumentError, Problem

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
        findings.problems += _explained_mission(error, document).problems
        unread |= _STAND_INS.keys() - data.keys()
        text = json.dumps({**_STAND_INS, **data})
        form = _RightParts.model_validate_json(text, strict=True, extra="ignore", context=unread)
    refused = {problem.keys for problem in findings.problems}
    noted = (*_empty_notes(document), *notes(document, MISSION))
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


# Mistakes that are about what a key means, not about its type


_COORDINATES: Final = frozenset(
    {
        "lat",
        "lon",
        "lng",
        "long",
        "latitude",
        "longitude",
        "latitude_deg",
        "longitude_deg",
        "x",
        "y",
    }
)
_AREAS: Final = ("fence", "fences", "no_fly_zones")
_FILE = re.compile(r"\S.*\.(geojson|json|kml|kmz|gpx|txt|air|openair|ya?ml|plan)", re.IGNORECASE)
_MAY_BE_EMPTY: Final = ("fence", "team", "world", "uav", "duration_s", "endurance_s")
"""Keys whose value may be null, so that an empty one is not refused."""

_SAYS: Final = {
    "team": ({"kinds"}, "a team file"),
    "mission": ({"home", "waypoints"}, "a mission file"),
    "world": ({"radio", "camera", "terrain", "explore"}, "a world file"),
}
"""Keys that distinguish our files, and the names of those."""


def kind_of_file(data: Any) -> str:
    """The declared kind of a file: "team", "mission" or "world"; "" for anything else."""
    if not isinstance(data, dict):
        return ""
    return next((kind for kind, (keys, _) in _SAYS.items() if keys & data.keys()), "")


def other_kind(data: Any, wanted: str) -> str:
    """The kind of a file, as text, if it is clearly not the wanted one; else ""."""
    kind = kind_of_file(data)
    ours = bool(_SAYS[wanted][0] & data.keys()) if isinstance(data, dict) else False
    return "" if kind in ("", wanted) or ours else _SAYS[kind][1]


def _explained_mission(error: DocumentError, document: Document) -> DocumentError:
    """Problems of a mission file's form, with what was probably meant."""
    known = explained(error, document.data, MISSION)
    return DocumentError(_explained(problem, document) for problem in known.problems)


def _explained(problem: Problem, document: Document) -> Problem:
    keys, advice = problem.keys, ""
    node = document.node(*keys)
    text = node.value if isinstance(node, yaml.ScalarNode) else ""
    if problem.code == "unknown-key" and str(keys[-1]).lower() in _COORDINATES:
        advice = "a place is one key: 'position: [latitude, longitude]'"
    elif problem.code == "wrong-type" and keys[0] in _AREAS and _FILE.fullmatch(text):
        advice = f"files of zones are named by another key: no_fly_files: [{text}]"
    elif problem.code == "unknown-word" and keys[0] == "seek" and "did you" not in problem.message:
        advice = f"robots stand in brackets: seek: [{text}]"
    if not advice:
        return problem
    return replace(problem, message=f"{problem.message.partition(';')[0]}; {advice}")


def _empty_notes(document: Document) -> Iterator[Problem]:
    """Notes on keys that are written without a value, though that is read as none."""
    for key in _MAY_BE_EMPTY:
        if isinstance(document.data, dict) and key in document.data:
            node = document.node(key)
            if isinstance(node, yaml.ScalarNode) and node.value == "" and not node.style:
                text = f"'{key}' is empty, which is read as none; write '{key}: null' if it is so"
                yield document.problem((key,), text, "empty-value")
