"""Reads QGroundControl `.plan` files.

Everything that decides where the vehicle flies is understood, told of, or refused with its place in
the file: nothing is dropped silently. Zones may cross the fence here, as they do on many a map.
"""

from pathlib import Path
from typing import Any

from air_router.files.json_document import JsonDocument, load_json
from air_router.files.mission_document import Area, Keys, MissionDocument
from air_router.files.missions.qgc_items import EXPORT_AGAIN, ItemsReader, PlanValues
from geo.airspace.airspace import FENCE

PLAN_TYPE = "Plan"


def read_plan(path: Path) -> MissionDocument:
    """A draft of the mission in a `.plan` file; `team.yaml` and `world.yaml` beside it are used.

    Raises:
        DocumentError: the file cannot be read or is not JSON.
    """
    return plan_draft(load_json(path))


def plan_draft(document: JsonDocument) -> MissionDocument:
    """A draft of the mission in a plan that has been loaded; its data stay as they are."""
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
    return draft


class _PlanReader(PlanValues):
    """Fills a draft from the document's data, noting problems as it goes."""

    def __init__(self, draft: MissionDocument, data: dict[str, Any]) -> None:
        super().__init__(draft, data)
        self._data = data

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
        if isinstance(self._data.get(name), dict):
            return True
        message = f"missing section '{name}'; {EXPORT_AGAIN}"
        self.draft.report((name,), message, "missing-key")
        return False

    def _optional_section(self, name: str, without: str) -> bool:
        """A section that other programs leave out, with a note of what that means."""
        if self._data.get(name) is not None:
            return self._section(name)
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
            self.draft.home_altitude_amsl_m = self.number((*keys, 2))
        return True

    def _read_fence(self) -> None:
        if not self._optional_section("geoFence", "there is no fence"):
            return
        self.note_version(("geoFence",), 2)
        current = self.at("geoFence", "version") == 2
        if not current and self.at("geoFence", "polygon"):
            message = f"a fence as QGroundControl drew it years ago is not read; {EXPORT_AGAIN}"
            self.draft.report(("geoFence", "polygon"), message, "plan-version")
            self.draft.unread.add("fence")
        for kind in ("polygons", "circles"):
            if not current and self.at("geoFence", kind) is None:
                continue
            for index in range(len(self.entries(("geoFence", kind), advice=EXPORT_AGAIN))):
                self._read_area(("geoFence", kind, index))
        if self.at("geoFence", "breachReturn") is not None:
            message = "the breach return point stays in the plan's file and is not flown"
            self.draft.note(("geoFence", "breachReturn"), message, "not-flown")

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
        area = self._area(name, keys, zone=not inclusion)
        if area is None:
            draft.unread.add("fence")
        elif inclusion:
            draft.fences.append(area)
        else:
            draft.zones.append(area)

    def _area(self, name: str, keys: Keys, *, zone: bool) -> Area | None:
        label = f"no-fly zone '{name}'" if zone else "the fence"
        if keys[1] == "circles":
            pair = self.pair(*keys, "circle", "center")
            radius_m = self.number((*keys, "circle", "radius"))
            if pair is None or radius_m is None:
                return None
            circle = self.draft.circle(label, pair, radius_m, (*keys, "circle"))
            return None if circle is None else Area(name, circle, keys, crosses_fence=True)
        outline = self.outline(label, (*keys, "polygon"))
        return None if outline is None else Area(name, outline, keys, crosses_fence=True)

    def _read_rally_points(self) -> None:
        if not self._optional_section("rallyPoints", "there are no rally points"):
            return
        self.note_version(("rallyPoints",), 2)
        for index in range(len(self.entries(("rallyPoints", "points"), advice=EXPORT_AGAIN))):
            keys: Keys = ("rallyPoints", "points", index)
            pair = self.pair(*keys)
            if pair is not None:
                spot = self.draft.spot(f"rally point {index + 1}", pair, keys)
                self.draft.rally_points += [spot] if spot else []
