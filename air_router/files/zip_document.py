"""KMZ: a KML file in a zip archive, read without unpacking more than a map needs, and written."""

import io
import zipfile
import zlib
from pathlib import Path

from mocha_link.team.problem import DocumentError


def kml_in(raw: bytes, path: Path, max_bytes: int) -> bytes:
    """The KML of a KMZ file: `doc.kml`, or the first other one, as Google Earth takes it.

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
            with archive.open(name) as file:
                kml = file.read(max_bytes + 1)
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError):
        message = "not a KMZ: no whole zip archive; export it again"
        raise DocumentError.at(path, message, "unknown-format") from None
    except (NotImplementedError, RuntimeError):  # an unknown compression; a password
        message = "packed in a way that is not read; unzip it and name the .kml in it"
        raise DocumentError.at(path, message, "unknown-format") from None
    if len(kml) > max_bytes:
        message = f"unpacks to more than {max_bytes} bytes; cut out what the mission needs"
        raise DocumentError.at(path, message, "too-large")
    return kml


def kmz_of(kml: str) -> bytes:
    """A KMZ file with this KML; the same bytes for the same text."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("doc.kml"), kml, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
