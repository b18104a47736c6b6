"""Loads missions: reads the file, collects every problem, and makes the mission.

Incomplete missions of other programs must be converted before they can be flown.
"""

import math
import re
from collections.abc import Collection, Iterable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from air_router.errors import UsageError
from air_router.files import (
    MAX_BYTES,
    SLOWEST_M_S,
    UNUSUAL,
    Findings,
    bytes_within,
    load_json,
)
from air_router.files.maps import is_fence_file, is_waypoint_file, read_gpx
from air_router.files.missions import (
    PlacedForm,
    place,
    read_gpx_mission,
    read_mission,
    read_old_fence,
    read_plan,
    read_waypoints,
)
from air_router.messages import FARTHEST_M
from air_router.mission.fleet import Layer, check_fleet, layers_of, merge, variants
from air_router.mission.flight_plan import FENCE_POINTS, FENCE_TOO_LONG, fence_plan
from air_router.mission.mission import FlightWindow, Mission
from air_router.mission.team import check_team
from air_router.mission.validation import checked_areas
from mocha_link.team import Document, DocumentError, Problem, text_in

DRAWN_OVER: Final = frozenset(
    {"waypoint-in-zone", "waypoint-outside-fence", "waypoint-too-near", "waypoint-unreachable"}
    | {"rally-point-in-zone", "rally-point-outside-fence", "rally-point-too-near"}
)
"""Problems that do not count in flight, where such a place is skipped."""


def load_mission(
    path: Path,
    *,
    uav: str | None = None,
    start: datetime | None = None,
    duration_s: float | None = None,
    in_flight: bool = False,
) -> Mission:
    """Read and check a mission: a YAML mission file, or a QGroundControl `.plan`.

    Args:
        path: The file.
        uav: Name of the UAV in the team; None: the first UAV of a mission for several.
        start: Take-off time in UTC; None: soon. The mission's airspace omits zones that do not
            apply then.
        duration_s: Replaces the duration in the file, if given.
        in_flight: Whether the mission is in the air; then places in new zones are no problem.

    Raises:
        DocumentError: Lists every problem of the mission and of its team file.
        UsageError: The mission is for several UAVs, and `uav` is none of them.
    """
    placed, findings = read_placed(path)
    if uav is not None:
        placed = chosen(placed, uav)
    if duration_s is not None:
        placed = placed.with_settings(duration_s=duration_s)
    return checked(placed, findings, start=start, besides=DRAWN_OVER if in_flight else ())


def load_flown(
    path: Path,
    uav: str | None,
    *,
    start: datetime | None = None,
    duration_s: float | None = None,
    in_flight: bool = False,
) -> Mission:
    """Load a mission to fly, or to resume, with one vehicle.

    Raises:
        DocumentError: The mission cannot be flown.
        UsageError: The mission is for several UAVs, and `uav` is missing or none of them.
    """
    mission = load_mission(path, uav=uav, start=start, duration_s=duration_s, in_flight=in_flight)
    if uav is None and len(mission.layers) > 1:
        names = " or ".join(f"--uav {layer.uav}" for layer in mission.layers)
        raise UsageError(f"{path}: is for several UAVs; choose one: {names}")
    return mission


def read_placed(path: Path) -> tuple[PlacedForm, Findings]:
    """Read a file without validation; returns the form and the findings so far.

    Raises:
        DocumentError: The file cannot be read at all.
    """
    if path.suffix.lower() == ".plan":
        form, findings = read_plan(load_json(path))
    else:
        check_own(path)
        form, findings = read_mission(Document.load(path))
    return place(form, findings), findings


def chosen(placed: PlacedForm, uav: str) -> PlacedForm:
    """The mission of one of its UAVs.

    Raises:
        UsageError: The mission is for other UAVs.
    """
    names = [each.name for each in placed.uavs]
    if names and uav not in names:
        known = " and ".join(names)
        raise UsageError(f"{placed.form.path}: is flown by {known}, not by '{uav}'")
    return placed.with_settings(uav=uav)


def checked(
    placed: PlacedForm,
    findings: Findings,
    *,
    start: datetime | None = None,
    besides: Collection[str] = (),
) -> Mission:
    """The mission of a form; problems with the codes `besides` are ignored.

    Raises:
        DocumentError: Lists every other problem.
    """
    mission = validate(placed, findings, start)
    problems = [problem for problem in findings.problems if problem.code not in besides]
    if problems or mission is None:
        raise DocumentError([*(problems or findings.problems), *unusual(findings.notes)])
    return mission


def unusual(notes: Iterable[Problem]) -> list[Problem]:
    """The notes on unusual values, which may explain the other problems."""
    return [note for note in notes if note.code == UNUSUAL]


def validate(
    placed: PlacedForm, findings: Findings, start: datetime | None = None
) -> Mission | None:
    """Validate a form; returns its mission even if there are problems.

    A mission for several UAVs is validated for each of them; the result is that of its `uav`. None
    if the frame or home is missing. Do not fly a mission with problems.

    Args:
        placed: The form.
        findings: Receives the problems and notes.
        start: Take-off time in UTC; None: soon.
    """
    if not placed.uavs or placed.frame is None or placed.home is None:
        mission = _validate(placed, findings, start)
    else:
        layers = layers_of(placed)
        check_fleet(placed, layers, findings)
        each = [(variant, findings.copied()) for variant in variants(placed, layers)]
        mission, *_ = [_validate(variant, found, start, layers) for variant, found in each]
        merge(findings, [(variant.form.uav, found) for variant, found in each])
    return mission and replace(mission, notes=tuple(findings.notes))


def _validate(
    placed: PlacedForm,
    findings: Findings,
    start: datetime | None,
    layers: tuple[Layer, ...] = (),
) -> Mission | None:
    duration_s = placed.form.duration_s
    window = FlightWindow.of(datetime.now(UTC), start, duration_s, _way_home_s(placed))
    areas = checked_areas(placed, window, findings)
    placed = placed.with_settings(uav=check_team(placed, findings))
    mission = Mission.of(placed, areas, window, layers)
    if mission is not None and not findings.problems:
        _note_fence(placed, mission, findings)
    return mission


def _way_home_s(placed: PlacedForm) -> float:
    """Longest way home: twice the straight distance from the farthest waypoint."""
    speed_m_s = placed.form.speed_m_s
    if placed.home is None or speed_m_s < SLOWEST_M_S:
        return 0.0
    home = placed.home.position
    away_m = max((math.dist(spot.position, home) for spot in placed.waypoints), default=0.0)
    return 2.0 * min(away_m, FARTHEST_M) / speed_m_s


def _note_fence(placed: PlacedForm, mission: Mission, findings: Findings) -> None:
    """Note areas that the fence on board cannot represent, and a fence with too many points."""
    plan = fence_plan(mission)
    areas = {area.name: area for area in (*placed.zones, *placed.climb_corridors, *placed.fences)}
    if len(plan.items) > FENCE_POINTS:
        area = next(iter(placed.fences or placed.zones))
        message = (
            f"the fence on board would have {len(plan.items)} points with all zones, PX4 1.17 "
            f"stores {FENCE_POINTS}; draw circles, and polygons with fewer corners"
        )
        findings.note(area.keys, message, FENCE_TOO_LONG, area.source)
    for name, reason in plan.simpler:
        message = f"'{name}' is not in the fence on board: {reason}; the companion keeps to it"
        findings.note(areas[name].keys, message, "fence-simpler-on-board", areas[name].source)


# Incomplete missions of other programs, which must be converted first


GPX: Final = ".gpx"
WAYPOINTS: Final = ".waypoints"
_OWN: Final = frozenset({".plan", ".yaml", ".yml"})
_LOOKED_AT: Final = 4_000

_TO_CONVERT: Final = "cannot be flown directly: first `air-router convert {path} {path.stem}.yaml"
_ZONES: Final = "a file of zones is no mission: name it under no_fly_files in one"
_ADVICE: Final = {
    **dict.fromkeys((WAYPOINTS, ".fen"), f"{_TO_CONVERT}`"),
    GPX: f"{_TO_CONVERT} --altitude M`",
    **dict.fromkeys((".kml", ".kmz", ".geojson", ".txt", ".air", ".openair"), _ZONES),
}


def check_own(path: Path) -> None:
    """Refuse the file of another program, by its content and name.

    Raises:
        DocumentError: The file has another format; the message has a remedy.
    """
    suffix = path.suffix.lower()
    if suffix in _OWN:
        return
    advice, begin = _ADVICE.get(suffix), _begin(path)
    if is_waypoint_file(begin):
        advice = _ADVICE[WAYPOINTS]
    elif re.search(rb"^(waypoints|altitude_m):", begin, re.MULTILINE):
        advice = f"a mission whose name ends with {suffix}; rename it to {_renamed(path)}"
    if advice is not None:
        raise DocumentError.at(path, advice.format(path=path), "unknown-format")


def _renamed(path: Path) -> str:
    stem = path.name.partition(".")[0]
    return f"{stem}.yaml"


def is_mission(path: Path) -> bool:
    """Whether a file is a mission: ours, or one that `read_foreign` reads."""
    suffix = path.suffix.lower()
    return suffix in (*_OWN, WAYPOINTS) or _of_ardupilot(_begin(path))


def _of_ardupilot(begin: bytes) -> bool:
    return is_waypoint_file(begin) or is_fence_file(begin)


def _begin(path: Path) -> bytes:
    """The beginning of a file; empty if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(_LOOKED_AT).removeprefix(b"\xef\xbb\xbf").lstrip()
    except OSError:
        return b""


def read_foreign(path: Path, *, altitude_m: float | None) -> tuple[PlacedForm, Findings] | None:
    """Read a mission of another program; None if the file can be flown directly.

    Args:
        path: The file.
        altitude_m: Altitude above home for a route in GPX.

    Raises:
        UsageError: An altitude was given for a file that is not GPX.
        DocumentError: The file cannot be read.
    """
    suffix = path.suffix.lower()
    if altitude_m is not None and suffix != GPX:
        raise UsageError("--altitude is for a FROM in GPX; other missions have their own")
    begin = b"" if suffix in _OWN else _begin(path)
    if altitude_m is not None:
        form, findings = read_gpx_mission(read_gpx(bytes_within(path, MAX_BYTES), path), altitude_m)
    elif suffix == WAYPOINTS or is_waypoint_file(begin):
        form, findings = read_waypoints(text_in(bytes_within(path, MAX_BYTES), path), path)
    elif is_fence_file(begin):
        form, findings = read_old_fence(text_in(bytes_within(path, MAX_BYTES), path), path)
    else:
        return None
    return place(form, findings), findings
