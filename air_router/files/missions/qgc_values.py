"""Values of a QGroundControl plan, each checked, and complained of at its place in the file."""

import json
from collections.abc import Callable
from typing import Any, Final

from air_router.files.json_document import value_at
from air_router.files.mission_document import Keys, MissionDocument
from geo.airspace.zone import Outline

EXPORT_AGAIN: Final = "save the plan with a current QGroundControl"


class PlanValues:
    """Reads values of a plan into a draft's problems and notes."""

    def __init__(self, draft: MissionDocument, data: Any) -> None:
        self.draft = draft
        self._data = data

    def at(self, *keys: str | int) -> Any:
        """The value at a key path, None if there is none."""
        return value_at(self._data, keys)

    def number(self, *keys: str | int) -> float | None:
        """A number; None, with a problem noted, if it is something else."""
        value = self.at(*keys)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        message = f"{named(keys)} must be a number, found {shown(value)}; correct it"
        self.draft.report(keys, message, "missing-key" if value is None else "wrong-type")
        return None

    def entries(self, *keys: str | int) -> list[Any]:
        """A list; empty, with a problem noted, if it is something else."""
        value = self.at(*keys)
        if isinstance(value, list):
            return value
        message = f"missing list {named(keys)}; {EXPORT_AGAIN}"
        self.draft.report(keys, message, "missing-key" if value is None else "wrong-type")
        return []

    def pair(self, *keys: str | int) -> tuple[float, float] | None:
        """Latitude and longitude at the begin of a list."""
        latitude_deg, longitude_deg = self.number(*keys, 0), self.number(*keys, 1)
        if latitude_deg is None or longitude_deg is None:
            return None
        return latitude_deg, longitude_deg

    def outline(self, label: str, keys: Keys) -> Outline | None:
        """A list of pairs as an area; None, with a problem noted, if it bounds none."""
        count = len(self.entries(*keys))
        pairs = [self.pair(*keys, index) for index in range(count)]
        corners = [pair for pair in pairs if pair is not None]
        if len(corners) < count or not isinstance(self.at(*keys), list):
            return None
        return self.draft.polygon(label, corners, keys)

    def version(self, keys: Keys, known: int) -> None:
        """Report unless the part of the plan at `keys` has this version."""
        self._version(keys, known, self.draft.report, EXPORT_AGAIN)

    def note_version(self, keys: Keys, known: int) -> None:
        """Note that QGroundControl drops the part at `keys`, unless it has this version."""
        advice = "QGroundControl itself drops the whole section without a word; it is read here"
        self._version(keys, known, self.draft.note, advice)

    def _version(
        self, keys: Keys, known: int, tell: Callable[[Keys, str, str], None], advice: str
    ) -> None:
        version = self.at(*keys, "version")
        if version != known or isinstance(version, bool):
            what = named(keys) if keys else "the plan"
            message = f"{what} has version {shown(version)}, read is {known}; {advice}"
            tell((*keys, "version"), message, "plan-version")


def named(keys: Keys) -> str:
    """A value's key and place in lists, for messages: 'params[4]'."""
    name = ""
    for key in reversed(keys):
        name = f"[{key}]{name}" if isinstance(key, int) else f"{key}{name}"
        if isinstance(key, str):
            break
    return f"'{name}'"


def shown(value: Any) -> str:
    """A value as a message shows it."""
    return "nothing" if value is None else json.dumps(value, ensure_ascii=False)[:40]
