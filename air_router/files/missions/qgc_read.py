"""Reads QGroundControl `.plan` files.

Everything that decides where the vehicle flies is understood, told of, or refused with its place in
the file: nothing is dropped silently. Zones may cross the fence here, as they do on many a map.
"""

from air_router.files import (
    HIGHEST_HOME_M,
    LOWEST_HOME_M,
    Area,
    JsonDocument,
    Keys,
    MissionDocument,
    note_draft,
)
from air_router.files.missions.qgc_items import (
    EXPORT_AGAIN,
    NOT_FLOWN,
    ItemsReader,
    PlanValues,
)
from geo.airspace import FENCE, Shape

PLAN_TYPE = "Plan"


def plan_draft(document: JsonDocument) -> MissionDocument:
    """A draft of the mission in a `.plan` file; `team.yaml` and `world.yaml` beside it are used.

    The document's data stay as they are.
    """
    draft = MissionDocument(document)
    data = document.data
    if not isinstance(data, dict) or data.get("fileType") != PLAN_TYPE:
        message = 'not a QGroundControl plan: "fileType" is not "Plan"; choose another file'
        draft.report(("fileType",), message, "not-a-plan")
        return draft
    draft.name = document.path.stem
    _PlanReader(draft, data).read()
    for name in ("team", "world"):
        beside = document.path.parent / f"{name}.yaml"
        if beside.is_file():
            setattr(draft, name, beside)
    note_draft(draft)
    return draft


class _PlanReader(PlanValues):
    """Fills a draft from the document's data, noting problems as it goes."""

    def read(self) -> None:
        """Read all sections."""
        self.version((), 1)
        if not self._section("mission"):
            return
        self.version(("mission",), 2)
        if not self._read_home():
            return
        ItemsReader(self.draft, self._data).read()
        self._read_fence()
        self._read_rally_points()

    def _section(self, name: str) -> bool:
        if isinstance(self.at(name), dict):
            return True
        message = f"missing section '{name}'; {EXPORT_AGAIN}"
        self.draft.report((name,), message, "missing-key")
        return False

    def _optional_section(self, name: str, without: str) -> bool:
        """A section that other programs leave out, with a note of what that means."""
        if self.at(name) is not None:
            if found := self._section(name):
                self.version((name,), 2, dropped=True)
            return found
        message = f"the plan has no section '{name}': {without}; QGroundControl writes one"
        self.draft.note((), message, "no-section")
        return False

    def _read_home(self) -> bool:
        keys = ("mission", "plannedHomePosition")
        if not isinstance(self.at(*keys), list):
            message = f"missing key '{keys[-1]}'; {EXPORT_AGAIN}"
            self.draft.report(keys, message, "missing-key")
            return False
        pair = self.pair(*keys)
        if pair is None or not self.draft.find_frame("home", pair, keys):
            return False
        self.draft.home = self.draft.spot("home", pair, keys)
        if self.at(*keys, 2) is not None:
            self._read_home_altitude((*keys, 2))
        return True

    def _read_home_altitude(self, keys: Keys) -> None:
        altitude_m = self.number(keys)
        if altitude_m is not None and not LOWEST_HOME_M <= altitude_m <= HIGHEST_HOME_M:
            message = (
                f"home is {altitude_m:g} m above the sea; it must be {LOWEST_HOME_M:g} to "
                f"{HIGHEST_HOME_M:g} m"
            )
            self.draft.report(keys, f"{message}; correct it", "out-of-range")
            altitude_m = None
        self.draft.home_altitude_amsl_m = altitude_m

    def _read_fence(self) -> None:
        if not self._optional_section("geoFence", "there is no fence"):
            return
        current = self.has_version(("geoFence",), 2)
        if not current and self.at("geoFence", "polygon"):
            message = f"a fence as QGroundControl drew it years ago is not read; {EXPORT_AGAIN}"
            self.draft.report(("geoFence", "polygon"), message, "plan-version")
            self.draft.unread.add("fence")
        for kind in ("polygons", "circles"):
            if not current and self.at("geoFence", kind) is None:
                continue
            for keys in self.entries(("geoFence", kind), advice=EXPORT_AGAIN):
                self._read_area(keys)
        if self.at("geoFence", "breachReturn") is not None:
            message = "the breach return point stays in the plan's file and is not flown"
            self.draft.note(("geoFence", "breachReturn"), message, NOT_FLOWN)

    def _read_area(self, keys: Keys) -> None:
        draft = self.draft
        inclusion = self.at(*keys, "inclusion")
        self.version(keys, 1)
        if not isinstance(inclusion, bool):
            message = f"'inclusion' must be true (a fence) or false (a zone); {EXPORT_AGAIN}"
            code = "missing-key" if inclusion is None else "wrong-type"
            draft.report((*keys, "inclusion"), message, code)
            return
        name = FENCE if inclusion else f"zone {len(draft.zones) + 1}"
        shape = self._shape("the fence" if inclusion else f"no-fly zone '{name}'", keys)
        if shape is None:
            draft.unread.add("fence")
        else:
            areas = draft.fences if inclusion else draft.zones
            areas.append(Area(name, shape, keys, crosses_fence=not inclusion))

    def _shape(self, label: str, keys: Keys) -> Shape | None:
        if keys[1] == "circles":
            centre = self.pair(*keys, "circle", "center")
            radius_m = self.number((*keys, "circle", "radius"))
            if centre is None or radius_m is None:
                return None
            return self.draft.circle(label, centre, radius_m, (*keys, "circle"))
        corners: Keys = (*keys, "polygon")
        pairs = [self.pair(*corner) for corner in self.entries(corners)]
        known = [pair for pair in pairs if pair is not None]
        if len(known) < len(pairs) or not isinstance(self.at(*corners), list):
            return None
        return self.draft.polygon(label, known, corners)

    def _read_rally_points(self) -> None:
        if not self._optional_section("rallyPoints", "there are no rally points"):
            return
        points = self.entries(("rallyPoints", "points"), advice=EXPORT_AGAIN)
        for number, keys in enumerate(points, start=1):
            pair = self.pair(*keys)
            if pair is not None:
                spot = self.draft.spot(f"rally point {number}", pair, keys)
                self.draft.rally_points += [spot] if spot else []
