"""XML files as trees whose elements know their place; without entities, and bounded.

A document type can define entities that expand without end or that read other files. Nothing that
we read needs one, so a file that has one is refused before anything in it takes effect. KMZ, a KML
file in a zip archive, is read without unpacking more than a map needs.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat

from mocha_link.team import DocumentError

MAX_DEPTH: Final = 60
MAX_ELEMENTS: Final = 500_000
_PACKED: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""How a KMZ may be packed, by its standard."""

_UNZIP: Final = "packed in a way that is not read; unzip it and name the .kml in it"


@dataclass(slots=True)
class Element:
    """An XML element. `name` is without its namespace; `text` is what stands directly in it."""

    name: str
    line: int  # from 1, of its tag
    column: int  # from 1
    attributes: dict[str, str]  # without namespaces
    text: str = ""
    children: list[Element] = field(default_factory=list)

    @property
    def keys(self) -> tuple[int, int]:
        """What names the element's place in its file (`PlacedSource.problem`)."""
        return self.line, self.column

    def child(self, *names: str) -> Element | None:
        """The first child of this name, then of the next name in it, and so on."""
        element: Element | None = self
        for name in names:
            inner = element.children if element is not None else []
            element = next((child for child in inner if child.name == name), None)
        return element

    def all(self, name: str) -> Iterator[Element]:
        """The children of this name."""
        return (child for child in self.children if child.name == name)

    def all_below(self) -> Iterator[Element]:
        """Its children, their children, and so on."""
        for child in self.children:
            yield child
            yield from child.all_below()

    def text_of(self, *names: str) -> str:
        """The text of `child(*names)`, without blanks around it; "" if there is none."""
        element = self.child(*names)
        return "" if element is None else element.text.strip()


def parse_xml(raw: bytes, path: Path) -> Element:
    """The root element; `path` only names the file in messages.

    Raises:
        DocumentError: it is not XML, has a document type, or is deeper or larger than any map.
    """
    builder = _Builder(path)
    try:
        builder.parser.Parse(raw, True)
    except expat.ExpatError as error:
        text = expat.errors.messages.get(error.code, "not readable")
        message = f"not valid XML: {text}; export the file again"
        raise DocumentError.at(path, message, "not-xml", error.lineno, error.offset + 1) from None
    except (LookupError, ValueError):  # an encoding that Python does not know, or not for XML
        message = "the file's encoding is not read; save it as UTF-8"
        raise DocumentError.at(path, message, "not-utf8") from None
    return builder.root


class _Builder:
    """Builds the tree from expat's events."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._top = Element("", 1, 1, {})  # holds the root element
        self._open = [self._top]  # from the top to the element under way
        self._texts: list[list[str]] = [[]]  # pieces of each open element's text
        self._count = 0  # of elements so far
        self.parser = expat.ParserCreate(namespace_separator="}")
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.StartDoctypeDeclHandler = self._refuse
        self.parser.EntityDeclHandler = self._refuse
        self.parser.UnparsedEntityDeclHandler = self._refuse
        self.parser.ExternalEntityRefHandler = self._refuse

    @property
    def root(self) -> Element:
        return self._top.children[0]

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._count += 1
        line, column = self._place()
        if len(self._open) > MAX_DEPTH:
            message = f"nested more than {MAX_DEPTH} deep; flatten it"
            raise DocumentError.at(self._path, message, "too-deep", line, column)
        if self._count > MAX_ELEMENTS:
            message = f"more than {MAX_ELEMENTS} elements; cut out what the mission needs"
            raise DocumentError.at(self._path, message, "too-large", line, column)
        element = Element(name.rpartition("}")[2], line, column, attributes)
        self._open[-1].children.append(element)
        self._open.append(element)
        self._texts.append([])

    def _end(self, _name: str) -> None:
        self._open.pop().text = "".join(self._texts.pop())

    def _characters(self, text: str) -> None:
        self._texts[-1].append(text)

    def _refuse(self, *_: object) -> int:
        message = "a document type (DOCTYPE, ENTITY) is not read; remove it"
        raise DocumentError.at(self._path, message, "xml-doctype", *self._place())

    def _place(self) -> tuple[int, int]:
        return self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1


def kml_in(raw: bytes, path: Path, max_bytes: int) -> tuple[bytes, list[str]]:
    """The KML of a KMZ file: `doc.kml`, or the first other one, as Google Earth takes it.

    With it the names of the others.

    Raises:
        DocumentError: it is no zip archive, holds no KML, or one that is larger than `max_bytes`.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
            if not names:
                raise DocumentError.at(
                    path, "no KML in this KMZ; export it again", "unknown-format"
                )
            name = "doc.kml" if "doc.kml" in names else names[0]
            if archive.getinfo(name).compress_type not in _PACKED:
                raise DocumentError.at(path, _UNZIP, "unknown-format")
            with archive.open(name) as file:
                kml = file.read(max_bytes + 1)
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError):
        message = "not a KMZ: no whole zip archive; export it again"
        raise DocumentError.at(path, message, "unknown-format") from None
    except (NotImplementedError, RuntimeError):  # an unknown compression; a password
        raise DocumentError.at(path, _UNZIP, "unknown-format") from None
    if len(kml) > max_bytes:
        message = f"unpacks to more than {max_bytes} bytes; cut out what the mission needs"
        raise DocumentError.at(path, message, "too-large")
    return kml, [other for other in names if other != name]


def kmz_of(kml: str) -> bytes:
    """A KMZ file with this KML; the same bytes for the same text."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("doc.kml"), kml, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
