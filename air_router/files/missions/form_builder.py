"""The form of a mission from another program's file, while that is read."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from air_router.files import MISSION, UNUSUAL, Findings, HomeForm, Keys, MissionForm


@dataclass(slots=True)
class FormBuilder:
    """The values that are read so far, without the limits of our own files.

    Attributes:
        values: By the form's keys.
        places: The keys of a value in the file, by those in the form.
    """

    values: dict[str, Any] = field(default_factory=dict)
    places: dict[Keys, Keys] = field(default_factory=dict)

    def put(self, key: str, value: Any) -> None:
        """Set a value."""
        self.values[key] = value

    def set_home(
        self, position: Sequence[float], keys: Keys, altitude_amsl_m: float | None = None
    ) -> None:
        """Set home, and where it stands."""
        self.values["home"] = HomeForm.model_construct(
            position=list(position), altitude_amsl_m=altitude_amsl_m
        )
        self.places["home", "position"] = keys

    def append(self, section: str, value: Any, /, **places: Keys) -> None:
        """Add an entry to a list, with the places of its parts; `entry` is its own."""
        entries = self.values.setdefault(section, [])
        for part, keys in places.items():
            way = (section, len(entries))
            self.places[way if part == "entry" else (*way, part)] = keys
        entries.append(value)

    def form(self, path: Path) -> MissionForm:
        """The form of a file; without a home it is nowhere."""
        unread = () if "home" in self.values else ("home",)
        empty: dict[str, Any] = {"altitude_m": 0.0, "speed_m_s": 0.0}
        empty |= {"waypoints": [], "no_fly_zones": [], "fences": []}
        empty |= {"home": HomeForm.model_construct(position=[0.0, 0.0])}
        form = MissionForm.model_construct(**(empty | self.values))
        return form.of_file(path, places=self.places, unread=unread)


def note_form(form: MissionForm, findings: Findings) -> None:
    """Note unusual values of the altitudes and the speed of another program's file."""
    by_field = {band.field: band for band in MISSION}
    band = by_field["waypoints[].altitude_m"]
    found = [
        (index, waypoint.altitude_m)
        for index, waypoint in enumerate(form.waypoints)
        if waypoint.altitude_m is not None and not band.holds(waypoint.altitude_m)
    ]
    if found:
        index, value = found[0]
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        text = band.note_text(f"the altitude of waypoint {index + 1}{more}", value)
        findings.note(form.keys_of("waypoints", index, "position"), text, UNUSUAL)
    speed = by_field["speed_m_s"]
    if not speed.holds(form.speed_m_s):
        findings.note((), speed.note_text("the speed", form.speed_m_s), UNUSUAL)
