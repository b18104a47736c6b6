"""Rules of mission files that change in flight: what may change, what is taken or announced."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

import shapely
import yaml

from sitl.rehearsal.judge.case import Case, Violation
from sitl.rehearsal.judge.evidence import FENCE, EvidenceError, SceneEvent, SceneEventKind
from sitl.rehearsal.judge.mission_reader import RawMission
from sitl.rehearsal.judge.space import room_m

_MAY: Final = frozenset({"fence", "fences", "no_fly_zones", "no_fly_files"})
"""Keys of a mission file that a flight takes other values of."""

_POINTS: Final = 64
"""So many a PX4 stores of a fence."""

_HOME_M: Final = 1.0
_BUSY_S: Final = 65.0
"""For so long a change may be on its way on board: no other is taken then."""

_WHY: Final = re.compile("refused|not (reloaded|changed)", re.IGNORECASE)


def only_areas_change(case: Case) -> Iterator[Violation]:
    """A file is not flown by in which anything else than fences and zones is another."""
    texts = [case.evidence.mission_text]
    for taken in case.evidence.events(SceneEventKind.MISSION_FILE):
        texts.append(str(taken.value))
        before, now = map(_read, texts[-2:])
        others = sorted(key for key in {*before, *now} - _MAY if before.get(key) != now.get(key))
        if others:
            text = f"a file was taken in flight whose {', '.join(others)} changed as well"
            yield Violation(taken.time_s, "plan", text)


def a_refused_file_is_answered_with_why(case: Case) -> Iterator[Violation]:
    """A changed file that is not taken is answered with why, whatever has changed in it."""
    for left in case.evidence.events(SceneEventKind.FILE_LEFT) if case.evidence.received else ():
        requested_s, text = left.value
        if not case.could_react(requested_s, left.time_s, ours=False):
            continue
        texts = [line for at_s, line in case.texts if requested_s - 0.1 <= at_s <= left.time_s]
        changed = _changed(case, requested_s, text)
        others = [key for key in changed if key not in _MAY]
        if not changed:
            continue
        if not any(map(_WHY.search, texts)):
            yield Violation(left.time_s, "report", "a changed file is refused without a reason")
        elif others and not any("changed as well" in line for line in texts if _WHY.search(line)):
            what = ", ".join(others)
            yield Violation(
                left.time_s, "report", f"{what} changed as well, which is not announced"
            )


def a_good_file_is_taken(case: Case) -> Iterator[Violation]:
    """A file in which only areas have changed, with nothing wrong, is taken at once."""
    events = [*case.evidence.events(SceneEventKind.MISSION_FILE, SceneEventKind.FILE_LEFT)]
    for left in events if case.evidence.received else ():
        if left.what is not SceneEventKind.FILE_LEFT:
            continue
        requested_s, text = left.value
        busy = any(other is not left and _near(other, requested_s) for other in events)
        busy |= any(
            m.name == "MISSION_COUNT" and m.fields.get("mission_type") == FENCE
            for m in case.commands
            if requested_s - _BUSY_S <= m.time_s <= left.time_s
            and m.time_s > case.time_s[case.armed][0]
        )
        if busy or not case.could_react(requested_s, left.time_s):
            continue
        changed = _changed(case, requested_s, text)
        if not changed or not set(changed) <= _MAY or case.row.notice_s:
            continue
        try:
            mission = case.read(text)
        except EvidenceError:
            continue
        areas, flown = mission.areas, case.version_at(requested_s).mission.areas
        other = [a for a in areas if not any(map(a.same, flown))]
        other += [a for a in flown if not any(map(a.same, areas))]
        if other and _is_good(mission):
            text = f"{other[0].name} of a changed file does not count, though nothing is wrong"
            yield Violation(left.time_s, "request", text)


def _near(other: SceneEvent, requested_s: float) -> bool:
    at_s = other.time_s if other.what is SceneEventKind.MISSION_FILE else other.value[0]
    return bool(abs(at_s - requested_s) <= _BUSY_S)


def _is_good(mission: RawMission) -> bool:
    """Whether home is clear in it, and its fence can be stored."""
    home, count = shapely.Point(0.0, 0.0), 0
    for area in mission.areas:
        if room_m(area, home) < area.clearance_m + mission.tracking_margin_m + _HOME_M:
            return False
        if area.meets(*mission.cruise_m):
            count += 1 if area.radius_m else _corners(area.outline)
    return count <= _POINTS


def _corners(outline: Any) -> int:
    """Of a ring and its holes, those between which a side is straight left out."""
    rings = [outline.exterior, *outline.interiors]
    return sum(len(ring.simplify(0.05).coords) - 1 for ring in rings)


def _changed(case: Case, requested_s: float, text: str) -> list[str]:
    """The keys of a file that are other than in the one that is flown by."""
    taken = case.evidence.events(SceneEventKind.MISSION_FILE)
    texts = [case.evidence.mission_text, *(str(t.value) for t in taken if t.time_s <= requested_s)]
    before, now = _read(texts[-1]), _read(text)
    return sorted(key for key in {*before, *now} if before.get(key) != now.get(key))


def _read(text: str) -> Mapping[str, Any]:
    data = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506
    return data if isinstance(data, dict) else {}
