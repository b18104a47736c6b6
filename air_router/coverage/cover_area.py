"""The area to cover, and where the vehicle may be meanwhile: read from files."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from air_router.errors import UsageError
from air_router.files import (
    DEFAULT_SPEED_M_S,
    Area,
    AreaForm,
    DocumentSource,
    Findings,
    HomeForm,
    MissionForm,
    PlacedSource,
    PlannerSettings,
)
from air_router.files.maps import MapArea, MapCircle, MapOutline, read_zones
from air_router.files.missions import MissionPoint, PlacedForm
from air_router.mission import FlightWindow, areas_of, read_placed, validate
from geo.airspace import FENCE, Airspace, Outline
from geo.frame import FrameError, Geodetic, LocalFrame, Point
from mocha_link.team import Document, DocumentError, Problem

_MISSION_KEYS = frozenset({"home", "waypoints", "no_fly_zones", "fence", "fences", "altitude_m"})
_ABOUT_WAYPOINTS = ("waypoint-", "no-waypoints", "same-place")
"""Codes of problems with waypoints, which a coverage replaces."""
_FAR_M = 50_000.0
"""Farther from home than this is a typing error, as in a mission."""


@dataclass(frozen=True, slots=True)
class CoverOptions:
    """What a coverage that has no mission goes by; `inside`: the area is the fence as well."""

    home: Geodetic | None  # None: the mission's
    altitude_m: float | None  # above home
    speed_m_s: float | None
    clearance_m: float | None  # from zones and the fence
    zones: Sequence[Path]  # files with more zones
    inside: bool


@dataclass(frozen=True, slots=True)
class Field:
    """An area and its airspace.

    Attributes:
        area: the area to see, in metres east and north of the frame's origin.
        placed: the mission that the waypoints are for, without its own.
        source: the mission's file.
        frame: its frame.
        airspace: what rows and the ways between them keep away from.
        home: where the vehicle sets out; None if that is open.
        altitude_m: how high above home it flies.
    """

    area: BaseGeometry
    placed: PlacedForm
    source: DocumentSource
    frame: LocalFrame
    airspace: Airspace
    home: Point | None
    altitude_m: float


def read_field(area: Path, mission: Path | None, terms: CoverOptions) -> Field:
    """The area of a file, in a mission's airspace (or in that of the zones that are named).

    Raises:
        DocumentError: the mission cannot be flown, or the area is none; every problem at once.
        UsageError: something that has to be known is missing, or home is far from the area.
    """
    if mission is None and _is_mission(area):
        field = _of_mission(area, None, terms)
    elif mission is not None:
        field = _of_mission(mission, area, terms)
    else:
        field = _of_area(area, terms)
    far_m = 0.0 if field.home is None else field.area.distance(shapely.Point(field.home))
    if far_m > _FAR_M:
        message = (
            f"the area is {far_m / 1000:,.0f} km from home; correct one (latitude comes first)"
        )
        raise UsageError(message)
    return field


def _is_mission(path: Path) -> bool:
    if path.suffix.lower() == ".plan":
        return True
    if path.suffix.lower() not in {".yaml", ".yml"}:
        return False
    data = Document.load(path).data
    return isinstance(data, dict) and bool(_MISSION_KEYS & data.keys())


def _of_mission(path: Path, area: Path | None, terms: CoverOptions) -> Field:
    given = {"--home": terms.home, "--clearance": terms.clearance_m, "--zones": terms.zones or None}
    for option, value in given.items():
        if value is not None:
            raise UsageError(f"{option} is set by the mission; write it into {path}")
    placed, findings = read_placed(path)
    if placed.home is None or placed.frame is None:
        validate(placed, findings)
        raise DocumentError(findings.problems)
    if placed.uavs and terms.altitude_m is not None:
        raise UsageError(f"--altitude is that of a UAV's layer: write it into {path}")
    altitude_m = terms.altitude_m or placed.form.altitude_m
    own_m = None if placed.uavs else altitude_m  # of several UAVs each flies its own layer
    waypoint = MissionPoint("waypoint 1", placed.home.position, placed.home.keys, own_m)
    placed = placed.with_settings(speed_m_s=terms.speed_m_s or placed.form.speed_m_s)
    placed = replace(placed, waypoints=(waypoint,))
    mission = validate(placed, findings)
    problems = [p for p in findings.problems if not p.code.startswith(_ABOUT_WAYPOINTS)]
    if problems or mission is None:
        raise DocumentError(problems)
    placed = placed.with_settings(uav=mission.uav)
    if area is not None:
        shape = _shape(_drawn(area), mission.frame)
    elif placed.fences:
        shape = shapely.intersection_all([fence.polygon for fence in mission.fences])
    else:
        raise UsageError(f"{path} has no fence, so it is not known what to cover; name an area")
    altitude_m = altitude_m if own_m else mission.altitude_above_home_m
    airspace = mission.planning_airspace
    if terms.inside:
        fences = (*airspace.fences, _outline(shape))
        airspace = Airspace(fences, airspace.zones, airspace.clearance_m, airspace.margin_m)
    return Field(shape, placed, findings.source, mission.frame, airspace, mission.home, altitude_m)


def _of_area(path: Path, terms: CoverOptions) -> Field:
    if terms.altitude_m is None:
        raise UsageError("without a mission give the height above home: --altitude M")
    zones = _drawn(path)
    first = zones[0].shape
    origin = first.centre if isinstance(first, MapCircle) else first.ring[0]
    try:
        frame = LocalFrame(terms.home or origin)
    except FrameError as error:
        raise UsageError(f"--home: {error}") from None
    settings = PlannerSettings(kind="shortest")  # from row to row, not over other rows' ends
    if terms.clearance_m is not None:
        settings = replace(settings, clearance_m=terms.clearance_m)
    source = zones[0].source or PlacedSource(path)
    findings = Findings(source)
    form = MissionForm.model_construct(
        name=path.stem,
        home=HomeForm.model_construct(position=list(terms.home or origin)),
        altitude_m=terms.altitude_m,
        speed_m_s=terms.speed_m_s or DEFAULT_SPEED_M_S,
        planner=settings,
    )
    home = None if terms.home is None else MissionPoint("home", frame.to_local(*terms.home), ())
    placed = PlacedForm(form.of_file(source.path), frame, home)
    for file in terms.zones:
        placed = placed.with_zones_of(file, (), findings)
    if findings.problems:
        raise DocumentError(findings.problems)
    shape = _shape(zones, frame)
    if terms.inside:
        placed = replace(placed, fences=(Area(FENCE, _outline(shape), ()),))
    airspace = areas_of(placed, FlightWindow.of(datetime.now(UTC), None, None)).planning_airspace
    takes_off = None if home is None else home.position
    return Field(shape, placed, source, frame, airspace, takes_off, terms.altitude_m)


def _drawn(path: Path) -> list[MapArea]:
    """The areas that a file draws, in degrees; at least one."""
    if path.suffix.lower() in {".yaml", ".yml"}:
        return [_yaml_area(path)]
    reading = read_zones(path)
    if reading.problems:
        raise DocumentError(reading.problems)
    if not reading.zones:
        message = "there is no polygon and no circle in it; draw the area to cover"
        raise DocumentError([reading.source.problem((), message, "no-area")])
    return reading.zones


def _yaml_area(path: Path) -> MapArea:
    """`polygon` (with `holes`) or `circle`, as in a mission; or a list of corners."""
    document = Document.load(path)
    form = document.parse(AreaForm)
    if form.circle is not None:
        circle = MapCircle(Geodetic(*form.circle.centre), form.circle.radius_m)
        return MapArea("area", circle, source=document)
    ring, *holes = (
        tuple(Geodetic(*corner) for corner in ring) for ring in (form.polygon or [], *form.holes)
    )
    return MapArea("area", MapOutline(ring, tuple(holes)), source=document)


def _shape(zones: Sequence[MapArea], frame: LocalFrame) -> BaseGeometry:
    """The areas in the frame, as one."""
    shapes = [zone.placed(frame, "") for zone in zones]
    problems = [shape for shape in shapes if isinstance(shape, Problem)]
    if problems:
        raise DocumentError(problems)
    return shapely.union_all([s.polygon for s in shapes if not isinstance(s, Problem)])


def _outline(shape: BaseGeometry) -> Outline:
    """An area as a fence; its holes are kept out of too."""
    if not isinstance(shape, Polygon):
        raise UsageError("--inside wants an area of one piece")
    rings = [tuple(Point(*corner) for corner in ring.coords) for ring in shape.interiors]
    return Outline(tuple(Point(*corner) for corner in shape.exterior.coords), tuple(rings))
