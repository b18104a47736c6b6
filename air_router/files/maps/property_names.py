"""The property names in files of zones: one table for GeoJSON, ED-269 and ED-318.

All three are JSON, and have the same of a zone under other names. Authorities publish the last two
for whole countries, and not always well: ENAIRE nests what a zone is called and its limits in an
object of the properties, others write the terms of ED-269 as properties of GeoJSON. KML has the
properties of map programs as extended data.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from air_router.files import Keys, Reference


@dataclass(frozen=True, slots=True)
class Dialect:
    """A row: how one of them names what a zone is and where it applies.

    Attributes:
        name: As messages call it.
        properties: Where the kind of a zone stands, from its entry of the list.
        nested: An object of these that has it instead, as ENAIRE writes it; "": there is none.
        names: The first of these that is given is its name; of published zones all together are.
        kinds: The kinds of a zone, by which it is left out.
        restriction: The restrictions; (): every area is a zone.
        periods: When it applies.
        unit: Of both limits of a layer.
        unit_needed: Without a unit they are wrong; else they are in metres.
        lower, upper: Names of a limit's value and of its reference.
        volumes: What stands in each entry of the geometry, if that is a list.
        layer: What of a geometry has the limits.
        radius: Of a circle, in metres: names of properties, or the way to it in a geometry.
        allow, skip: The properties with which the operator's values are compared, as text.
    """

    name: str
    properties: Keys = ("properties",)
    nested: str = ""
    names: tuple[str, ...] = ("identifier", "name")
    kinds: tuple[str, ...] = ()
    restriction: tuple[str, ...] = ()
    periods: str = ""
    unit: str = ""
    unit_needed: bool = False
    lower: tuple[str, str] = ("", "")
    upper: tuple[str, str] = ("", "")
    volumes: str = ""
    layer: str = ""
    radius: Keys = ()
    allow: str = ""
    skip: str = "name or kind"


_RESTRICTION: Final = ("restriction", "type")
"""Of ED-269, whose type is another thing, and of ED-318."""

_WORDS: Final = "restriction or identifier"

GEOJSON: Final = Dialect(
    "GeoJSON",
    names=("name", "title", "NAME"),
    kinds=("kind", "type", "category", "class", "TYPE", "CLASS", "TYPE_CODE"),
    radius=("radius_m", "radius"),
)
ED269: Final = Dialect(
    "ED-269",
    properties=(),
    restriction=_RESTRICTION,
    periods="applicability",
    unit="uomDimensions",
    unit_needed=True,
    lower=("lowerLimit", "lowerVerticalReference"),
    upper=("upperLimit", "upperVerticalReference"),
    volumes="horizontalProjection",
    radius=("radius",),
    allow=_WORDS,
    skip=f"{_WORDS} or name",
)
ED318: Final = Dialect(
    "ED-318",
    nested="UASZone",
    restriction=_RESTRICTION,
    periods="limitedApplicability",
    unit="uom",
    lower=("lower", "lowerReference"),
    upper=("upper", "upperReference"),
    layer="layer",
    radius=("extent", "radius"),
    allow=_WORDS,
    skip=f"{_WORDS} or name",
)

NO_RESTRICTION: Final = "NO_RESTRICTION"
RESTRICTIONS: Final = (
    "PROHIBITED",
    "REQ_AUTHORISATION",
    "REQ_AUTHORIZATION",
    "CONDITIONAL",
    "USPACE",
    NO_RESTRICTION,
)
"""Each of them but the last one is a no-fly zone, unless the operator allows it by name."""

REFERENCES: Final = {"AGL": Reference.GROUND, "AMSL": Reference.AMSL, "WGS84": None}
"""From what a layer's limits count; None: from the ellipsoid, which has no meaning here."""

_OLD_LIST: Final = "UASZoneList"
_OF_PROPERTIES: Final = frozenset({"zoneAuthority", "variant", ED318.nested, "verticalLayer"})
_OF_GEOMETRY: Final = frozenset({ED318.layer, ED318.radius[0]})
"""What only features of ED-318 have."""

_LOOKED_AT: Final = 20
"""Features one of which marks all as geozones."""


def dialect_of(data: Any) -> tuple[Dialect, Keys | None] | None:
    """The row of a file's data, and where its list of zones stands; None: it has no zones.

    ED-269 is an object with `features`, or the bare list of them; older files call it
    `UASZoneList`, and the `schedule` in it `dailyPeriod`. Without a list the file is one zone.
    """
    if isinstance(data, list):
        return ED269, ()
    kind = data.get("type") if isinstance(data, dict) else None
    if kind == "Feature" and _is_ed318(data):
        return ED318, None
    key = _OLD_LIST if isinstance(data, dict) and _OLD_LIST in data else "features"
    features = data.get(key) if isinstance(data, dict) else None
    if isinstance(features, list) and (published := _published(features, kind)):
        return published, (key,)
    if not isinstance(kind, str):
        return None
    return GEOJSON, (("features",) if kind == "FeatureCollection" else None)


def _published(features: list[Any], kind: Any) -> Dialect | None:
    """The row of a list of zones in a file of this type; None: a map program's."""
    zones = [feature for feature in features if isinstance(feature, dict)]
    volumes = bool(zones) and isinstance(zones[0].get("geometry"), list)
    if volumes or kind != "FeatureCollection":
        return ED269
    return ED318 if any(map(_is_ed318, zones[:_LOOKED_AT])) else None


def _is_ed318(feature: dict[str, Any]) -> bool:
    """Whether a feature of GeoJSON has what only those of geozones have."""
    properties, geometry = feature.get("properties"), feature.get("geometry")
    return any(
        isinstance(part, dict) and not names.isdisjoint(part)
        for part, names in ((properties, _OF_PROPERTIES), (geometry, _OF_GEOMETRY))
    ) or (
        isinstance(properties, dict)
        and any(properties.get(key) in RESTRICTIONS for key in _RESTRICTION)
    )


def is_zone(properties: Mapping[str, Any]) -> bool:
    """Whether properties of a map program are those of a zone, among what we write with it."""
    return (properties.get("kind") or "zone") == "zone"  # map programs fill columns with null


# Altitude limits, wherever properties have them


SIDES: Final = ("upper", "lower")
VALUES: Final = ("limit", "ceiling", "val", "")
"""What follows the side in the names of limits, without "_" and capitals: openAIP's and ED-269's,
openAIP's of before, the FAA's, ED-318's."""

METRES_PER_UNIT: Final = {"M": 1.0, "FT": 0.3048}
"""As ED-269 and ED-318 write units; FL, hundreds of feet at standard pressure, is one apart."""

LEVEL: Final = "FL"
UNITS: Final = {  # numbers: openAIP's
    **dict.fromkeys(("M", "METER", "METERS", "METRE", "METRES", "0"), "M"),
    **dict.fromkeys(("FT", "F", "FEET", "FOOT", "1"), "FT"),
    **dict.fromkeys(("FL", "6"), LEVEL),
}
DATUMS: Final = {
    **dict.fromkeys(("GND", "AGL", "ASFC", "SFC", "GROUND", "SURFACE", "0"), Reference.GROUND),
    **dict.fromkeys(("MSL", "AMSL", "ALT", "QNH", "1"), Reference.AMSL),
    **dict.fromkeys(("STD", "2"), None),
}
GROUND_NAMES: Final = frozenset({"GND", "SFC", "GROUND", "SURFACE", "0"})
ENDLESS: Final = ("UNL", "UNLD", "UNLTD", "UNLIM", "UNLIMITED")

_REFERENCE_ENDS: Final = ("reference", "verticalreference", "ref", "code", "datum")
_OWN_UNITS: Final = ("uom", "unit")
_UNITS_OF_BOTH: Final = ("uom", "uomdimensions", "unit", "units")
PARTS: Final = {
    side: (
        [*(side + unit for unit in _OWN_UNITS), *_UNITS_OF_BOTH],
        [side + reference for reference in _REFERENCE_ENDS],
    )
    for side in SIDES
}
"""Names of the unit and the reference of each side's limit."""

OF_DIALECTS: Final = frozenset(
    name for parts in PARTS.values() for names in parts for name in names
)
OF_LIMITS: Final = frozenset(
    side + end for side in SIDES for end in (*VALUES, *_REFERENCE_ENDS, *_OWN_UNITS)
)
"""What an object with limits has at least one of."""

LIMIT_NAMES: Final = frozenset(
    {"upper", "lower", "ceiling", "floor", "altitude", "altitudes", "alt", "height", "limit"}
    | {"limits", "agl", "amsl", "msl", "maxalt", "minalt", "vertical", "top", "base"}
)
"""A property with one of these in its name may be a limit."""
