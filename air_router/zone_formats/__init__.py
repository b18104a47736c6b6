"""What a zone format of another package is made of: the public face of files of zones.

A format is an object with `name`, `suffixes`, `recognises` and `read` (`ZoneFormat`), registered as
an entry point of the group `air_router.zone_formats`:

    class SquareFormat:
        name, suffixes = "squares", (".sq",)

        def recognises(self, head: bytes) -> bool:
            return head.startswith(b"SQUARES")

        def read(self, content: bytes, path: Path) -> ZoneFeatures:
            source, features = PlacedSource(path), []
            for number, line in enumerate(content.decode().splitlines()[1:], start=2):
                feature = ZoneFeature(source, f"square {number}")
                features.append(feature)
                try:
                    latitude_deg, longitude_deg, radius_m = map(float, line.split())
                except ValueError:
                    feature.report((number, 1), "not three numbers; correct it", "wrong-form")
                    continue
                circle = MapCircle(Geodetic(latitude_deg, longitude_deg), radius_m)
                feature.add([((number, 1), circle)])
            return ZoneFeatures(features, self.name)

CONTRIBUTING.md has the recipe. Latitudes and longitudes are degrees (WGS-84), heights and radii
metres.
"""

from air_router.files import (
    AltitudeLimit,
    Altitudes,
    PlacedSource,
    Reference,
    ZoneTerms,
    parse_xml,
)
from air_router.files.maps import (
    MapCircle,
    MapOutline,
    ZoneFeature,
    ZoneFeatures,
    ZoneFormat,
)
from geo.frame import Geodetic
from geo.validity import Hours, Period, Validity
from mocha_link.team import DocumentError

__all__ = [
    "AltitudeLimit",
    "Altitudes",
    "DocumentError",
    "Geodetic",
    "Hours",
    "MapCircle",
    "MapOutline",
    "Period",
    "PlacedSource",
    "Reference",
    "Validity",
    "ZoneFeature",
    "ZoneFeatures",
    "ZoneFormat",
    "ZoneTerms",
    "parse_xml",
]
