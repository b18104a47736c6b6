"""Reads the plans that the paper's authors simulate with: YAML in metres, without a place on Earth.

Such a file has a `geoFence` as a QGroundControl plan has, its corners as [east, north], and
numbered `waypoints` as [east, north, altitude]. Where the town stands has to be said.
"""

from typing import Final

from air_router.files.mission_document import Area, Keys, MissionDocument
from air_router.files.missions.qgc_values import PlanValues, shown
from air_router.files.settings import DEFAULT_SPEED_M_S
from geo.airspace.airspace import FENCE
from geo.frame import Geodetic
from mocha_link.team.document import Document

SUFFIX: Final = ".sim.yaml"


def sim_plan_draft(document: Document, origin: Geodetic) -> MissionDocument:
    """A draft of the mission; its home is the first waypoint, since the file has none.

    Args:
        document: the file as YAML.
        origin: where its origin is.
    """
    draft = MissionDocument(document, in_metres=True, speed_m_s=DEFAULT_SPEED_M_S)
    draft.name = document.path.name.removesuffix(SUFFIX)
    if draft.find_frame("the origin", origin, ()):
        _Reader(draft, document.data).read()
    return draft


class _Reader(PlanValues):
    """Fills a draft from the document's data."""

    def read(self) -> None:
        for index in range(len(self.entries("geoFence", "polygons"))):
            self._read_area(("geoFence", "polygons", index))
        waypoints = self.at("waypoints")
        if not isinstance(waypoints, dict):
            message = f"'waypoints' must be a mapping of numbers, found {shown(waypoints)}"
            self.draft.report(("waypoints",), f"{message}; correct it", "wrong-type")
            return
        for number in waypoints:
            self._read_waypoint(("waypoints", number))
        self._settle()

    def _read_area(self, keys: Keys) -> None:
        inclusion = self.at(*keys, "inclusion")
        if not isinstance(inclusion, bool):
            message = "'inclusion' must be true (a fence) or false (a zone); add it"
            self.draft.report(keys, message, "missing-key")
            return
        name = FENCE if inclusion else f"zone {len(self.draft.zones) + 1}"
        label = "the fence" if inclusion else f"no-fly zone '{name}'"
        outline = self.outline(label, (*keys, "polygon"))
        if outline is None:
            self.draft.unread.add("fence")
            return
        areas = self.draft.fences if inclusion else self.draft.zones
        areas.append(Area(name, outline, keys, crosses_fence=True))

    def _read_waypoint(self, keys: Keys) -> None:
        pair, altitude_m = self.pair(*keys), self.number(*keys, 2)
        if pair is None or altitude_m is None:
            return
        if not altitude_m > 0:
            message = f"the altitude is {altitude_m:g} m above home; it must be more than 0"
            self.draft.report((*keys, 2), message, "out-of-range")
            return
        label = f"waypoint {len(self.draft.waypoints) + 1}"
        spot = self.draft.spot(label, pair, keys, altitude_m)
        self.draft.waypoints += [spot] if spot else []

    def _settle(self) -> None:
        draft = self.draft
        if not draft.waypoints:
            return
        first = draft.waypoints[0]
        draft.altitude_m = max(spot.altitude_m or 0.0 for spot in draft.waypoints)
        draft.home = draft.spot("home", first.position, first.keys)
        message = "the file has no home: the first waypoint is taken; move it in the mission file"
        draft.note(first.keys, message, "home-assumed")
