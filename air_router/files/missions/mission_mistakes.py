"""Mistakes of mission files that are about what a key means, not about its type."""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import yaml

from air_router.files import MISSION, explained
from mocha_link.team import Document, DocumentError, Problem

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


def explained_mission(error: DocumentError, document: Document) -> DocumentError:
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


def empty_notes(document: Document) -> Iterator[Problem]:
    """Notes on keys that are written without a value, though that is read as none."""
    for key in _MAY_BE_EMPTY:
        if isinstance(document.data, dict) and key in document.data:
            node = document.node(key)
            if isinstance(node, yaml.ScalarNode) and node.value == "" and not node.style:
                text = f"'{key}' is empty, which is read as none; write '{key}: null' if it is so"
                yield document.problem((key,), text, "empty-value")
