"""Reads QGroundControl `.plan` files.

Everything that decides where the vehicle flies is read, reported, or refused with its place in the
file: nothing is dropped silently. Zones may cross the fence here, as they do on many a map.
"""

from typing import Any

from air_router.files import (
    HIGHEST_HOME_M,
    LOWEST_HOME_M,
    CircleForm,
    Findings,
    JsonDocument,
    Keys,
    MissionForm,
    SpotForm,
    ZoneForm,
)
from air_router.files.missions.form_builder import FormBuilder, note_form
from air_router.files.missions.placed_form import Placer
from air_router.files.missions.qgc_items import (
    EXPORT_AGAIN,
    NOT_FLOWN,
    ItemsReader,
    PlanValues,
)

PLAN_TYPE = "Plan"


def read_plan(document: JsonDocument) -> tuple[MissionForm, Findings]:
    """The mission in a `.plan` file, and what was found.

    `team.yaml` and `world.yaml` beside it are used. The document's data stay as they are.
    """
    findings, path = Findings(document), document.path
    data = document.data
    nothing = FormBuilder({"name": path.stem}).form(path)
    if not isinstance(data, dict) or data.get("fileType") != PLAN_TYPE:
        message = 'not a QGroundControl plan: "fileType" is not "Plan"; choose another file'
        findings.report(("fileType",), message, "not-a-plan")
        return nothing, findings
    builder = FormBuilder({"name": path.stem})
    for name in ("team", "world"):
        if (path.parent / f"{name}.yaml").is_file():
            builder.put(name, f"{name}.yaml")
    form = builder.form(path) if _PlanReader(findings, data, builder).read() else nothing
    note_form(form, findings)
    return form, findings


class _PlanReader(PlanValues):
    """Fills a form from the document's data."""

    def __init__(self, findings: Findings, data: Any, form: FormBuilder) -> None:
        super().__init__(findings, data)
        self._form = form

    def read(self) -> bool:
        """Read all sections; False: without home or mission they are not read."""
        self.version((), 1)
        if not self._section("mission"):
            return False
        self.version(("mission",), 2)
        placer = self._read_home()
        if placer is None:
            return False
        ItemsReader(placer, self._data, self._form).read()
        self._read_fence()
        self._read_rally_points()
        return True

    def _section(self, name: str) -> bool:
        if isinstance(self.at(name), dict):
            return True
        message = f"missing section '{name}'; {EXPORT_AGAIN}"
        self.findings.report((name,), message, "missing-key")
        return False

    def _optional_section(self, name: str, without: str) -> bool:
        """A section that other programs leave out, with a note of what that means."""
        if self.at(name) is not None:
            if found := self._section(name):
                self.version((name,), 2, dropped=True)
            return found
        message = f"the plan has no section '{name}': {without}; QGroundControl writes one"
        self.findings.note((), message, "no-section")
        return False

    def _read_home(self) -> Placer | None:
        """Home, with the frame around it."""
        keys = ("mission", "plannedHomePosition")
        if not isinstance(self.at(*keys), list):
            message = f"missing key '{keys[-1]}'; {EXPORT_AGAIN}"
            self.findings.report(keys, message, "missing-key")
            return None
        pair = self.pair(*keys)
        placer = None if pair is None else Placer.around("home", pair, keys, self.findings)
        if pair is None or placer is None:
            return None
        altitude_m = None
        if self.at(*keys, 2) is not None:
            altitude_m = self._home_altitude((*keys, 2))
        self._form.set_home(pair, keys, altitude_m)
        return placer

    def _home_altitude(self, keys: Keys) -> float | None:
        altitude_m = self.number(keys)
        if altitude_m is not None and not LOWEST_HOME_M <= altitude_m <= HIGHEST_HOME_M:
            message = (
                f"home is {altitude_m:g} m above the sea; it must be {LOWEST_HOME_M:g} to "
                f"{HIGHEST_HOME_M:g} m"
            )
            self.findings.report(keys, f"{message}; correct it", "out-of-range")
            return None
        return altitude_m

    def _read_fence(self) -> None:
        if not self._optional_section("geoFence", "there is no fence"):
            return
        current = self.has_version(("geoFence",), 2)
        if not current and self.at("geoFence", "polygon"):
            message = f"a fence as QGroundControl drew it years ago is not read; {EXPORT_AGAIN}"
            self.findings.report(("geoFence", "polygon"), message, "plan-version")
        for kind in ("polygons", "circles"):
            if not current and self.at("geoFence", kind) is None:
                continue
            for keys in self.entries(("geoFence", kind), advice=EXPORT_AGAIN):
                self._read_area(keys)
        if self.at("geoFence", "breachReturn") is not None:
            message = "the breach return point stays in the plan's file and is not flown"
            self.findings.note(("geoFence", "breachReturn"), message, NOT_FLOWN)

    def _read_area(self, keys: Keys) -> None:
        inclusion = self.at(*keys, "inclusion")
        self.version(keys, 1)
        if not isinstance(inclusion, bool):
            message = f"'inclusion' must be true (a fence) or false (a zone); {EXPORT_AGAIN}"
            code = "missing-key" if inclusion is None else "wrong-type"
            self.findings.report((*keys, "inclusion"), message, code)
            return
        area = self._area(keys)
        if area is not None:
            self._form.append("fences" if inclusion else "no_fly_zones", area, entry=keys)

    def _area(self, keys: Keys) -> ZoneForm | None:
        if keys[1] == "circles":
            centre = self.pair(*keys, "circle", "center")
            radius_m = self.number((*keys, "circle", "radius"))
            if centre is None or radius_m is None:
                return None
            circle = CircleForm.model_construct(centre=list(centre), radius_m=radius_m)
            return ZoneForm.model_construct(circle=circle, crosses_fence=True)
        corners: Keys = (*keys, "polygon")
        pairs = [self.pair(*corner) for corner in self.entries(corners)]
        known = [list(pair) for pair in pairs if pair is not None]
        if len(known) < len(pairs) or not isinstance(self.at(*corners), list):
            return None
        return ZoneForm.model_construct(polygon=known, crosses_fence=True)

    def _read_rally_points(self) -> None:
        if not self._optional_section("rallyPoints", "there are no rally points"):
            return
        points = self.entries(("rallyPoints", "points"), advice=EXPORT_AGAIN)
        for keys in points:
            pair = self.pair(*keys)
            spot = None if pair is None else SpotForm.model_construct(position=list(pair))
            self._form.append("rally_points", spot, position=keys)
