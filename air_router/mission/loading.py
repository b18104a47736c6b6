"""Loading a mission: a file is read, every problem in it noted, and a checked mission made.

Missions of other programs that say too little are converted before they are flown.
"""

import math
import re
from collections.abc import Collection, Iterable
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from air_router.errors import UsageError
from air_router.files import (
    MAX_BYTES,
    SLOWEST_M_S,
    UNUSUAL,
    MissionDocument,
    bytes_within,
    load_json,
)
from air_router.files.maps import is_fence_file, is_waypoint_file, read_gpx
from air_router.files.missions import (
    gpx_draft,
    plan_draft,
    read_mission,
    read_old_fence_draft,
    read_waypoints,
)
from air_router.messages import FARTHEST_M
from air_router.mission.fleet import check_fleet, layers_of, merge, variants
from air_router.mission.flight_plan import FENCE_POINTS, FENCE_TOO_LONG, fence_plan
from air_router.mission.mission import FlightWindow, Mission, MissionAreas, Waypoint, areas_of
from air_router.mission.team import check_team
from air_router.mission.validation import check_geometry
from mocha_link.sanitize import sanitize
from mocha_link.team import Document, DocumentError, Problem, text_in

DRAWN_OVER: Final = frozenset(
    {"waypoint-in-zone", "waypoint-outside-fence", "waypoint-too-near", "waypoint-unreachable"}
    | {"rally-point-in-zone", "rally-point-outside-fence", "rally-point-too-near"}
)
"""Problems of a file that are none in flight: such a place is left out."""


_MADE: Final = frozenset({"name", "home", "waypoints", "rally_points", "notes"})
"""What a mission has under the name of a draft's, but not as it stands there."""

_UNCHANGED: Final = (
    ({field.name for field in fields(Mission)} & {field.name for field in fields(MissionDocument)})
    - {field.name for field in fields(MissionAreas)}
    - _MADE
)
"""Fields that a mission takes unchanged from its draft. A field that neither has is a TypeError."""


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
        path: the file.
        uav: whose mission, by its name in the team; None: the first one's, if it is for several.
        start: when the vehicle takes off, in UTC; None: soon. Zones that do not apply then are
            left out of the mission's airspace.
        duration_s: how long it stays out; None: as in the file.
        in_flight: it is flown already: places that zones were drawn over since are no problem.

    Raises:
        DocumentError: with every problem of the mission and of its team file.
        UsageError: the mission is for several UAVs, and this is none of them.
    """
    draft = read_draft(path)
    if uav is not None:
        choose(draft, uav)
    draft.begin_at(start, draft.duration_s if duration_s is None else duration_s)
    return checked(draft, besides=DRAWN_OVER if in_flight else ())


def load_flown(
    path: Path,
    uav: str | None,
    *,
    start: datetime | None = None,
    duration_s: float | None = None,
    in_flight: bool = False,
) -> Mission:
    """A mission as one vehicle flies it, or has begun to fly it.

    Raises:
        DocumentError: it cannot be flown.
        UsageError: it is for several UAVs, and `uav` is none of them.
    """
    mission = load_mission(path, uav=uav, start=start, duration_s=duration_s, in_flight=in_flight)
    if uav is None and len(mission.layers) > 1:
        names = " or ".join(f"--uav {layer.uav}" for layer in mission.layers)
        raise UsageError(f"{path}: is for several UAVs; say which one this is: {names}")
    return mission


def read_draft(path: Path) -> MissionDocument:
    """The contents of a file, not yet validated.

    Raises:
        DocumentError: it cannot be read at all.
    """
    if path.suffix.lower() == ".plan":
        return plan_draft(load_json(path))
    check_own(path)
    return read_mission(Document.load(path))


def choose(draft: MissionDocument, uav: str) -> None:
    """Make a draft that of one of its UAVs.

    Raises:
        UsageError: it is for others.
    """
    names = [each.name for each in draft.uavs]
    if names and uav not in names:
        known = " and ".join(names)
        raise UsageError(f"{draft.source.path}: is flown by {known}, not by '{uav}'")
    draft.uav = uav


def checked(draft: MissionDocument, besides: Collection[str] = ()) -> Mission:
    """The mission of a draft; problems of the codes `besides` do not keep it from being flown.

    Raises:
        DocumentError: with every other problem.
    """
    mission = validate(draft)
    problems = [problem for problem in draft.problems if problem.code not in besides]
    if problems or mission is None:
        raise DocumentError([*(problems or draft.problems), *unusual(draft.notes)])
    return mission


def unusual(notes: Iterable[Problem]) -> list[Problem]:
    """The notes on numbers that are not usual: they may be why all the rest is wrong."""
    return [note for note in notes if note.code == UNUSUAL]


def validate(draft: MissionDocument) -> Mission | None:
    """Note every problem of a draft in it; the mission that it describes, however wrong.

    A mission for several UAVs is validated as each of them flies it; returned is that of
    `draft.uav`. None if the frame or home is missing. Do not fly one with problems.
    """
    if not draft.uavs or draft.frame is None or draft.home is None:
        return _validate(draft)
    check_fleet(draft)
    each = variants(draft)
    for variant in each:
        variant.problems, variant.notes = list(draft.problems), list(draft.notes)
    missions = [_validate(variant) for variant in each]
    merge(draft, each)
    draft.uav = each[0].uav
    return None if missions[0] is None else replace(missions[0], notes=tuple(draft.notes))


def _validate(draft: MissionDocument) -> Mission | None:
    now = datetime.now(UTC)
    window = FlightWindow.of(now, draft.start, draft.duration_s, _way_home_s(draft))
    areas = areas_of(draft, window)
    check_geometry(draft, areas)
    check_team(draft)
    mission = mission_of(draft, areas, window)
    if draft.problems or mission is None:
        return mission
    _note_fence(draft, mission)
    return replace(mission, notes=tuple(draft.notes))


def _way_home_s(draft: MissionDocument) -> float:
    """What the way home may take: from the farthest waypoint, twice as far as straight."""
    if draft.home is None or draft.speed_m_s < SLOWEST_M_S:
        return 0.0
    home = draft.home.position
    away_m = max((math.dist(spot.position, home) for spot in draft.waypoints), default=0.0)
    return 2.0 * min(away_m, FARTHEST_M) / draft.speed_m_s


def mission_of(draft: MissionDocument, areas: MissionAreas, window: FlightWindow) -> Mission | None:
    """The mission of a draft, whether it has problems or not; None without frame or home."""
    if draft.frame is None or draft.home is None:
        return None
    unchanged = {name: getattr(draft, name) for name in _UNCHANGED}
    return Mission(
        name=sanitize(draft.name),
        path=draft.source.path,
        home=draft.home.position,
        waypoints=tuple(
            Waypoint(number, spot.position, spot.altitude_m or draft.altitude_m)
            for number, spot in enumerate(draft.waypoints, start=1)
        ),
        rally_points=tuple(spot.position for spot in draft.rally_points),
        altitude_above_home_m=draft.altitude_m,
        layers=layers_of(draft),
        window=window,
        notes=tuple(draft.notes),
        **areas.parts(),
        **unchanged,
    )


def _note_fence(draft: MissionDocument, mission: Mission) -> None:
    """Note what of the mission's areas its fence on board will not be."""
    plan = fence_plan(mission)
    areas = {area.name: area for area in (*draft.zones, *draft.climb_corridors, *draft.fences)}
    if len(plan.items) > FENCE_POINTS:
        draft.note_area(
            next(iter(draft.fences or draft.zones)),
            f"the fence on board would have {len(plan.items)} points with all zones, PX4 1.17 "
            f"stores {FENCE_POINTS}; draw circles, and polygons with fewer corners",
            FENCE_TOO_LONG,
        )
    for name, reason in plan.simpler:
        message = f"'{name}' is not in the fence on board: {reason}; the companion keeps to it"
        draft.note_area(areas[name], message, "fence-simpler-on-board")


# Missions of other programs that are converted before they are flown: they say too little


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
    """Make sure that a file is none of another program, by its content and name.

    Raises:
        DocumentError: it is; the message has what to do.
    """
    suffix = path.suffix.lower()
    advice = _ADVICE.get(suffix)
    begin = b"" if suffix in _OWN else _begin(path)
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
    """Whether a file is of a mission, ours or one of those that `foreign_draft` reads."""
    suffix = path.suffix.lower()
    return suffix in (*_OWN, WAYPOINTS) or _of_ardupilot(_begin(path))


def _of_ardupilot(begin: bytes) -> bool:
    return is_waypoint_file(begin) or is_fence_file(begin)


def _begin(path: Path) -> bytes:
    """What a file begins with; nothing, where it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(_LOOKED_AT).removeprefix(b"\xef\xbb\xbf").lstrip()
    except OSError:
        return b""


def foreign_draft(path: Path, *, altitude_m: float | None) -> MissionDocument | None:
    """The mission of such a file; None: it is one of those that are flown.

    Args:
        path: The file.
        altitude_m: Where a route in GPX is flown, above home.

    Raises:
        UsageError: the altitude is for other files.
        DocumentError: the file cannot be read.
    """
    suffix = path.suffix.lower()
    if altitude_m is not None and suffix != GPX:
        raise UsageError("--altitude is for a FROM in GPX; other missions say it themselves")
    if altitude_m is not None:
        return gpx_draft(read_gpx(bytes_within(path, MAX_BYTES), path), altitude_m)
    if suffix in _OWN:
        return None
    begin = _begin(path)
    if suffix == WAYPOINTS or is_waypoint_file(begin):
        return read_waypoints(text_in(bytes_within(path, MAX_BYTES), path), path)
    if is_fence_file(begin):
        return read_old_fence_draft(text_in(bytes_within(path, MAX_BYTES), path), path)
    return None
