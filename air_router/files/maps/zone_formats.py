"""The zone formats that are installed, and which of them reads a file.

Each is an entry point of the group `air_router.zone_formats`; those of air_router are such, too. It
is loaded when a file may be of its format: a format that is broken keeps no other from its files.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Final

from air_router.errors import RefusedError
from air_router.files.maps.map_area import MapCircle, MapOutline, place_of
from air_router.files.maps.zone_format import ZoneFeature, ZoneFeatures, ZoneFormat
from mocha_link.team import DocumentError

GROUP: Final = "air_router.zone_formats"
BROKEN: Final = "zone-format-broken"
"""The code of the problem with a file that a broken format of another package may be for."""

_OURS: Final = "air-router"
_LAST: Final = "geojson"
"""Our format for files that no other recognises: its error lists the known ones."""

_HEAD: Final = 64 * 1024
_BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
_LONGEST: Final = 120  # of an error's text


class BrokenFormatError(Exception):
    """A format cannot be loaded, or fails; the message names its package."""


@dataclass(frozen=True, slots=True)
class _Installed:
    """A format of a package that is installed."""

    entry: EntryPoint

    @property
    def package(self) -> str:
        """The distribution that brings it."""
        return "" if self.entry.dist is None else self.entry.dist.name

    @property
    def is_ours(self) -> bool:
        return self.package.replace("_", "-").lower() == _OURS

    def load(self) -> ZoneFormat:
        """The format. Raises BrokenFormatError."""
        try:
            found = self.entry.load()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - code of others: every error is reported
            raise self.broken(f"it cannot be loaded: {_text_of(error)}") from None
        if not isinstance(found, ZoneFormat) or not _is_suffixes(found.suffixes):
            raise self.broken(f"{self.entry.value} is no ZoneFormat: see air_router.zone_formats")
        return found

    def recognises(self, head: bytes) -> bool:
        """Whether it knows a file by its begin. Raises BrokenFormatError."""
        known = self.load()
        try:
            return bool(known.recognises(head))
        except (Exception, SystemExit) as error:  # noqa: BLE001
            raise self.broken(f"recognises() fails: {_text_of(error)}") from None

    def ends(self, suffix: str) -> bool:
        """Whether names of its files end so. Raises BrokenFormatError."""
        return suffix in self.load().suffixes

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """The features of a file. Raises BrokenFormatError, DocumentError."""
        known = self.load()
        if self.is_ours:
            return known.read(content, path)
        try:
            read = known.read(content, path)
            features = [_checked(each) for each in read.features]
            return ZoneFeatures(features, str(read.kind), str(read.allow), str(read.skip))
        except DocumentError:
            raise
        except (Exception, SystemExit) as error:  # noqa: BLE001
            raise self.broken(f"read() fails: {_text_of(error)}") from None

    def broken(self, why: str) -> BrokenFormatError:
        """An error that names the package."""
        return BrokenFormatError(
            f"the zone format '{self.entry.name}' of the package '{self.package}' is broken: "
            f"{why}; correct or uninstall that package"
        )


def _is_suffixes(value: object) -> bool:
    return isinstance(value, tuple | list) and all(isinstance(each, str) for each in value)


def _checked(value: object) -> ZoneFeature:
    """A feature of another package whose zones are on Earth; what is not is its problem."""
    if not isinstance(value, ZoneFeature):
        raise TypeError(f"{value!r:.60} is no ZoneFeature")
    for zone in value.zones:
        if (why := _unplaceable(zone.shape)) is not None:
            value.report(zone.keys, f"zone '{zone.name}': {why}", "not-on-earth")
            value.whole_file = True  # it is not known where it lies
    value.zones = [zone for zone in value.zones if _unplaceable(zone.shape) is None]
    return value


def _unplaceable(shape: MapOutline | MapCircle) -> str | None:
    """Why a shape is nowhere on Earth; None: it is somewhere."""
    if isinstance(shape, MapCircle):
        if not 0 < shape.radius_m < math.inf:
            return f"its radius is {shape.radius_m:g} m; make it more than 0 m"
        places = [shape.centre]
    else:
        places = [place for ring in (shape.ring, *shape.holes) for place in ring]
    for latitude_deg, longitude_deg in places:
        if place_of(latitude_deg, longitude_deg) is None:
            return f"{latitude_deg:g}, {longitude_deg:g} is no latitude and longitude; correct it"
    return None


def _text_of(error: BaseException) -> str:
    text = " ".join(str(error).split())[:_LONGEST]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@lru_cache(maxsize=1)
def _installed() -> tuple[list[_Installed], list[_Installed]]:
    """Our formats, and those of other packages, both by name."""
    every = [_Installed(entry) for entry in sorted(entry_points(group=GROUP))]
    ours = [each for each in every if each.is_ours]
    if not ours:
        raise RefusedError(
            "air_router's zone formats are not registered: this installation is older than its "
            "files; install it again (in a checkout: make setup)"
        )
    return ours, [each for each in every if not each.is_ours]


@dataclass(slots=True)
class _Search:
    """Finds the format of a file; a broken one is skipped."""

    head: bytes
    suffix: str
    broken: dict[_Installed, BrokenFormatError] = field(default_factory=dict)

    def found(self) -> Iterator[_Installed]:
        """Those that may read it, the likeliest first."""
        ours, others = _installed()
        if not any(each.ends(self.suffix) for each in ours):
            yield from (each for each in others if self._ends(each) and self._recognises(each))
        yield from (each for each in ours if each.recognises(self.head))
        yield from (each for each in others if self._recognises(each))
        yield from (each for each in (*ours, *others) if self._ends(each))

    def _ends(self, each: _Installed) -> bool:
        return self._call(each, lambda: each.ends(self.suffix))

    def _recognises(self, each: _Installed) -> bool:
        return self._call(each, lambda: each.recognises(self.head))

    def _call(self, each: _Installed, answer: Callable[[], bool]) -> bool:
        """What a format answers; no, if it is broken."""
        try:
            return each not in self.broken and answer()
        except BrokenFormatError as error:
            self.broken[each] = error
            return False


def read_features(content: bytes, path: Path, elsewhere: str) -> ZoneFeatures:
    """The features of a file, read by the format that it is of.

    In this order: a format of another package for files of this name, unless ours are called so;
    the first of ours that recognises the file, the first of others; who has such names.

    Args:
        content: The file.
        path: Names it.
        elsewhere: The message for a file that none of them recognises; "": that of our JSON reader.

    Raises:
        DocumentError: it is of no known format, or the format that it is of is broken.
        RefusedError: this installation does not register our formats.
    """
    head = content[:_HEAD].removeprefix(_BYTE_ORDER_MARK).lstrip()
    search = _Search(head, path.suffix.lower())
    known = next(search.found(), None)
    fault = next(iter(search.broken.values()), None)
    try:
        if known is None and fault is None:
            if elsewhere:
                raise DocumentError.at(path, elsewhere, "unknown-format")
            known = next(each for each in _installed()[0] if each.entry.name == _LAST)
        if known is not None:
            return _unless_broken(known.read(content, path), fault)
    except BrokenFormatError as error:
        fault = error
    except DocumentError:
        if fault is None:
            raise
    raise DocumentError.at(path, str(fault), BROKEN)


def _unless_broken(read: ZoneFeatures, fault: BrokenFormatError | None) -> ZoneFeatures:
    """What was read; raises the fault of another format, if nothing could be made of the file."""
    if fault is None:
        return read
    features = list(read.features)
    if not any(feature.zones for feature in features) and any(each.problems for each in features):
        raise fault
    return ZoneFeatures(features, read.kind, read.allow, read.skip)
