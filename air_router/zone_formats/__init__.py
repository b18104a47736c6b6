"""Public API for zone formats of other packages.

A format is an object with `name`, `suffixes`, `recognises` and `read` (`ZoneFormat`), registered as
an entry point of the group `air_router.zone_formats`:

    class SquareFormat:
        name, suffixes = "squares", (".sq",)

        def recognises(self, head: bytes) -> bool:
            return head.startswith(b"SQUARES")

        def read(self, content: bytes, path: Path) -> ZoneFeatures:
            lines = content.decode("utf-8-sig").splitlines()
            if lines[:1] != ["SQUARES"]:
                raise DocumentError.at(path, "line 1 is not SQUARES; add it", "wrong-form")
            source, features = PlacedSource(path), []
            for number, line in enumerate(lines[1:], start=2):
                feature = ZoneFeature(source, f"square {number}")
                features.append(feature)
                try:
                    latitude_deg, longitude_deg, radius_m = map(float, line.split())
                except ValueError:
                    feature.report((number, 1), "not three numbers; correct it", "wrong-form")
                    continue
                if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180):
                    feature.report((number, 1), "is not on Earth; correct it", "not-on-earth")
                    continue
                centre = Geodetic(latitude_deg, longitude_deg)
                if not 0 < radius_m < inf:
                    feature.saw([centre])
                    feature.report((number, 1), "its radius is none; correct it", "zone-radius")
                    continue
                feature.add([((number, 1), MapCircle(centre, radius_m))])
            return ZoneFeatures(features, self.name)

The comparisons are such that NaN, which `float` reads, fails them. CONTRIBUTING.md has the recipe.
Latitudes and longitudes are degrees (WGS-84), heights and radii metres.
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
