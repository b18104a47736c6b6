"""The result of reading a file of zones: the zones that the operator keeps, problems, notes."""

from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from air_router.files import DocumentSource, PlacedSource
from air_router.files.maps.map_area import MapArea, Places
from air_router.files.maps.zone_format import ZoneFeature, ZoneFeatures
from air_router.words import counted
from mocha_link.team import Problem, ProblemList

UNREAD: Final = "zone-unread"
"""The code of the note about a zone far from the mission that could not be read."""

NOT_OF_FORMAT: Final = "unknown-format"
"""The code of the problem that a file is none of its format: nothing else is reported of it."""


class ZoneReading:
    """The zones of a file, with problems and notes.

    Attributes:
        source: The file.
        kind: Its format, as text.
        zones: Its zones.
    """

    def __init__(
        self, features: ZoneFeatures, path: Path, choice: "ZoneChoice | None" = None
    ) -> None:
        self.source: DocumentSource = PlacedSource(path)
        self.kind = features.kind
        self.zones: list[MapArea] = []
        self._findings: list[ZoneFeature] = []  # features with something to report
        self._read(features, choice or ZoneChoice())

    def _read(self, read: ZoneFeatures, choice: "ZoneChoice") -> None:
        lines, some = [], False
        for feature in read.features:
            self.source = feature.source
            left_out = choice.leaves_out(feature)
            some |= left_out or bool(feature.zones or feature.problems)
            if not left_out:
                self.zones += feature.zones
                lines += feature.lines
                if feature.problems or feature.notes:
                    self._findings.append(feature)
        whole = ZoneFeature(self.source)
        if lines and not some:
            place, advice = lines[0]
            whole.report(place, f"nothing in it has an area; {advice}", "no-area")
        if not any(code == NOT_OF_FORMAT for f in self._findings for _, _, code in f.problems):
            choice.note(whole, read)
        self._findings.append(whole)

    @property
    def problems(self) -> list[Problem]:
        """Its problems: the first of each kind, and how many more there are."""
        return self.findings()[0]

    @property
    def notes(self) -> list[Problem]:
        """What was left out or read with caution, though nothing is wrong with it."""
        return self.findings()[1]

    def findings(
        self, near: Callable[[Places], bool] = lambda _extent: True
    ) -> tuple[list[Problem], list[Problem]]:
        """Problems and notes, as they matter where a mission is flown.

        A zone that cannot be read is a problem where it may be near, or its place is unknown, and a
        note elsewhere. Notes about zones that are read are for near ones.

        Args:
            near: Whether the mission may reach a box, given by latitudes and longitudes in it.
        """
        problems, notes = ProblemList(), ProblemList()
        for found in self._findings:
            extent, place = _extent(found), found.source.problem
            is_near = extent is None or near(extent)
            for keys, message, code in found.problems:
                if is_near:
                    problems.add(self.path, code, partial(place, keys, message, code))
                else:
                    text = f"a zone far from the mission cannot be read: {message}"
                    notes.add(self.path, UNREAD, partial(place, keys, text, UNREAD))
            for keys, message, code in found.notes if is_near else ():
                notes.add(self.path, code, partial(place, keys, message, code))
        return list(problems), list(notes)

    @property
    def unread(self) -> list[Problem]:
        """Problems of single zones: without these the rest of the file can be used."""
        listed = ProblemList()
        for found in self._findings:
            for keys, message, code in found.problems if _places(found) else ():
                listed.add(self.path, code, partial(found.source.problem, keys, message, code))
        return list(listed)

    @property
    def path(self) -> Path:
        """The file."""
        return self.source.path


def _places(feature: ZoneFeature) -> list[Places]:
    """The known location of a feature."""
    zones = () if feature.whole_file else feature.zones
    return [*feature.extents, *(zone.extent() for zone in zones)]


def _extent(feature: ZoneFeature) -> Places | None:
    """Two opposite corners of a box around a feature; None: its location is unknown.

    Where a part of it could not be read the box is three times as large.
    """
    known = _places(feature)
    if not known:
        return None
    places = np.vstack(known)
    low, high = places.min(axis=0), places.max(axis=0)
    more = high - low if feature.problems else 0.0
    return np.array([low - more, high + more])


class LeftOut:
    """Kinds and names of zones that the operator leaves out, and which zones these are.

    Args:
        values: The kinds and names, as the operator wrote them.
        why: The note about those zones.
        code: The code of that note.
        unused: The code of the note about values that match no zone.
    """

    def __init__(self, values: Collection[str], why: str, code: str, unused: str) -> None:
        self._values = {_comparable(value): value for value in values}  # as the operator wrote them
        self._why, self._code, self._unused = why, code, unused  # for the notes
        self._used: set[str] = set()  # those that a zone is of
        self._zones: list[str] = []  # names of those left out

    def takes(self, zone: str, *values: str) -> bool:
        """Whether one of these values, which describe a zone, is among them."""
        if not self._values:
            return False
        matches = set(map(_comparable, values)) & self._values.keys()
        if matches:
            self._used |= matches
            self._zones.append(zone)
        return bool(matches)

    def note(self, file: ZoneFeature, kinds: str) -> None:
        """Note which zones were left out, and which values are none of the file's `kinds`."""
        if zones := self._zones:
            shown = ", ".join(zones[:10]) + (" ..." if len(zones) > 10 else "")
            message = f"{counted(len(zones), 'zones')} that you {self._why}: left out ({shown})"
            file.note((), message, self._code)
        for unused in sorted(self._values.keys() - self._used):
            message = f"no zone is of {kinds} '{self._values[unused][:40]}'"
            file.note((), message, self._unused)


class ZoneChoice:
    """Which zones of a file the operator leaves out.

    Attributes:
        allow: Those that the operator may fly in.
        skip: Those that are no zones for this mission: another mission's area, a plan of the site.
    """

    def __init__(self, allow: Collection[str] = (), skip: Collection[str] = ()) -> None:
        self.allow = LeftOut(allow, "allow", "zone-allowed", "allow-unused")
        self.skip = LeftOut(skip, "skip", "zone-skipped", "skip-unused")

    def leaves_out(self, feature: ZoneFeature) -> bool:
        """Whether the operator leaves a feature out, by its name or kind."""
        if not (feature.name or feature.kinds or feature.allowed_as):
            return False  # the file as a whole
        if self.skip.takes(feature.name, *feature.kinds, feature.name):
            return True
        allowed = feature.allowed_as
        return bool(allowed) and self.allow.takes(allowed[-1], *allowed)

    def note(self, file: ZoneFeature, read: ZoneFeatures) -> None:
        """Note what was left out, and values that match nothing; with what they are compared."""
        self.allow.note(file, read.allow or f"restriction or class ({read.kind} has none)")
        self.skip.note(file, read.skip)


def _comparable(value: str) -> str:
    """Without capitals; ED-269 writes AUTHORISATION, ED-318 AUTHORIZATION."""
    return value.strip().upper().replace("AUTHORIZATION", "AUTHORISATION")
