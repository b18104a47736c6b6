"""What was read of a file of zones: those the operator keeps, what is wrong, what is noted."""

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
"""The code of the problem that a file is none of its format: nothing else is said of it."""


class ZoneReading:
    """The zones of a file, with problems and notes.

    Attributes:
        source: The file.
        kind: Its format, in words.
        zones: Its zones.
    """

    def __init__(
        self, features: ZoneFeatures, path: Path, choice: "ZoneChoice | None" = None
    ) -> None:
        self.source: DocumentSource = PlacedSource(path)
        self.kind = features.kind
        self.zones: list[MapArea] = []
        self._findings: list[ZoneFeature] = []  # features of which there is something to say
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
            choice.tell(whole, read)
        self._findings.append(whole)

    @property
    def problems(self) -> list[Problem]:
        """What is wrong with it: the first of each kind, and how many more there are."""
        return self.findings()[0]

    @property
    def notes(self) -> list[Problem]:
        """What was left out or read with caution, though nothing is wrong with it."""
        return self.findings()[1]

    def findings(
        self, near: Callable[[Places], bool] = lambda _extent: True
    ) -> tuple[list[Problem], list[Problem]]:
        """Problems and notes, as they matter where a mission is flown.

        A zone that cannot be read is a problem where it may be near, or where nothing says where it
        lies, and a note elsewhere. Notes about zones that are read are for near ones.

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
                    words = f"a zone far from the mission cannot be read: {message}"
                    notes.add(self.path, UNREAD, partial(place, keys, words, UNREAD))
            for keys, message, code in found.notes if is_near else ():
                notes.add(self.path, code, partial(place, keys, message, code))
        return list(problems), list(notes)

    @property
    def unread(self) -> list[Problem]:
        """What is wrong with single zones: without these the rest of the file can be used."""
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
    """What is known of where a feature lies."""
    zones = () if feature.whole_file else feature.zones
    return [*feature.extents, *(zone.extent() for zone in zones)]


def _extent(feature: ZoneFeature) -> Places | None:
    """Two opposite corners of a box around a feature; None: nothing says where it lies.

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
        words: The kinds and names, as the operator wrote them.
        why: What a note says of those zones.
        code: The code of that note.
        unused: The code of the note about words that are of no zone.
    """

    def __init__(self, words: Collection[str], why: str, code: str, unused: str) -> None:
        self._words = {_comparable(word): word for word in words}  # as the operator wrote them
        self._why, self._code, self._unused = why, code, unused  # for the notes
        self._used: set[str] = set()  # those that a zone is of
        self._zones: list[str] = []  # names of those left out

    def takes(self, zone: str, *words: str) -> bool:
        """Whether one of these words, which say what a zone is, is among them."""
        if not self._words:
            return False
        matches = set(map(_comparable, words)) & self._words.keys()
        if matches:
            self._used |= matches
            self._zones.append(zone)
        return bool(matches)

    def tell(self, file: ZoneFeature, kinds: str) -> None:
        """Note which zones were left out, and which words are none of the file's `kinds`."""
        if zones := self._zones:
            shown = ", ".join(zones[:10]) + (" ..." if len(zones) > 10 else "")
            message = f"{counted(len(zones), 'zones')} that you {self._why}: left out ({shown})"
            file.note((), message, self._code)
        for unused in sorted(self._words.keys() - self._used):
            message = f"no zone is of {kinds} '{self._words[unused][:40]}'"
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

    def tell(self, file: ZoneFeature, read: ZoneFeatures) -> None:
        """Note what was left out, and words that fit nothing; what they are compared with."""
        self.allow.tell(file, read.allow or f"restriction or class ({read.kind} has none)")
        self.skip.tell(file, read.skip)


def _comparable(word: str) -> str:
    """Without capitals; ED-269 writes AUTHORISATION, ED-318 AUTHORIZATION."""
    return word.strip().upper().replace("AUTHORIZATION", "AUTHORISATION")
