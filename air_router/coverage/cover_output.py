"""The output of a coverage: its report, and its waypoints in a mission file."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from air_router.coverage.camera import SurveyCamera
from air_router.coverage.cover_area import Field
from air_router.errors import AirRouterError, UsageError
from air_router.files import Findings, with_section
from air_router.files.missions import MissionPoint, mission_text, place, read_mission
from air_router.mission import validate
from air_router.routing import Pace, Way
from geo.coverage import Coverage, Swath, UnseenCause
from geo.frame import Point
from mocha_link.team import Document, DocumentError


def facts_of(
    field: Field, plan: Coverage, camera: SurveyCamera, swath: Swath, overlap_percent: float
) -> dict[str, Any]:
    """What `--json` prints of a coverage, without its waypoints."""
    speed_m_s = field.placed.form.speed_m_s
    legs = list(plan.legs)
    pace = Pace(speed_m_s, 0.0, field.placed.form.endurance_s)
    pixel_m = camera.pixel_m(field.altitude_m)
    step_m = swath.along_m * (1 - overlap_percent / 100)
    missed = [
        {
            "why": missed.why.name.lower(),
            "by": missed.by or None,
            "area_m2": round(missed.area_m2, 1),
            "pieces": len(missed.parts),
            **place_of(field, missed.place),
        }
        for missed in plan.missed
    ]
    return {
        "area_m2": round(float(field.area.area), 1),
        "target_m2": round(float(plan.target.area), 1),
        "covered_percent": math.floor(plan.share * 10_000 + 1e-6) / 100,
        "altitude_m": field.altitude_m,
        "footprint_m": [round(swath.across_m, 2), round(swath.along_m, 2)],
        "pixel_m": None if pixel_m is None else round(pixel_m, 4),
        "row_spacing_m": round(swath.spacing_m, 2),
        "angle_deg": round(plan.bearing_deg, 2),
        "rows": len(plan.rows),
        "rows_length_m": round(sum(row.length_m for row in plan.rows), 1),
        "length_m": round(plan.length_m, 1),
        "from_home": bool(plan.way_out),
        "flight_time_s": round(pace.time_s(Way(plan.length_m, len(legs))), 1),
        "speed_m_s": speed_m_s,
        "picture_every_m": round(step_m, 2),
        "pictures": sum(1 + math.ceil(row.length_m / step_m) for row in plan.rows),
        "missed": missed,
    }


def lines_of(facts: dict[str, Any], field: Field) -> list[str]:
    """The same for a person."""
    minutes, seconds = divmod(round(facts["flight_time_s"]), 60)
    across_m, along_m = facts["footprint_m"]
    from_home = " from home and back" if facts["from_home"] else ""
    pixel = "" if facts["pixel_m"] is None else f", a pixel is {facts['pixel_m'] * 100:.1f} cm"
    lines = [
        (
            f"{facts['covered_percent']:.2f} % of {facts['target_m2']:,.0f} m2 covered, by "
            f"{facts['rows']} rows at {facts['angle_deg']:g} deg"
        ),
        (
            f"{facts['length_m']:,.0f} m{from_home} ({facts['rows_length_m']:,.0f} m on rows), "
            f"about {minutes} min {seconds} s at {facts['speed_m_s']:g} m/s"
        ),
        (
            f"{facts['altitude_m']:g} m above home; a picture shows {across_m:.1f} m x "
            f"{along_m:.1f} m{pixel}"
        ),
        (
            f"rows at most {facts['row_spacing_m']:.1f} m apart, {facts['pictures']} pictures, "
            f"one every {facts['picture_every_m']:.1f} m"
        ),
    ]
    cut_m2 = facts["area_m2"] - facts["target_m2"]
    if cut_m2 >= 1:
        lines.append(f"{cut_m2:,.0f} m2 of the area lie inside of no-fly zones and do not count")
    lines += [_missed_line(missed) for missed in facts["missed"] if missed["area_m2"] >= 1]
    endurance_s = field.placed.form.endurance_s
    if endurance_s is not None and facts["flight_time_s"] > endurance_s:
        lines.append(f"more than one battery lasts ({endurance_s:g} s): fly it in parts")
    return lines


def _missed_line(missed: dict[str, Any]) -> str:
    why = UnseenCause[missed["why"].upper()].value.format(by=missed["by"])
    pieces = "1 piece" if missed["pieces"] == 1 else f"{missed['pieces']} pieces"
    where = f"{missed['latitude_deg']:.6f}, {missed['longitude_deg']:.6f}"
    largest = "at" if missed["pieces"] == 1 else "the largest at"
    return f"not covered: {missed['area_m2']:,.0f} m2 in {pieces}, {largest} {where}: {why}"


def place_of(field: Field, point: Point) -> dict[str, float]:
    """A place in degrees."""
    latitude_deg, longitude_deg = field.frame.to_geodetic(point)
    return {"latitude_deg": round(latitude_deg, 7), "longitude_deg": round(longitude_deg, 7)}


# Its waypoints


_METRES, _DEGREES = 2, 7
"""Decimals: rows keep 3 cm to spare, these move a place by less than 1 cm."""

_APART_M = 0.2
"""Waypoints that are nearer to each other than this would be taken for one."""


def waypoints_of(plan: Coverage, field: Field, every_m: float | None) -> list[Point]:
    """The ends of the rows in order of flight, as they will be written.

    Where rows are longer than `every_m` there are waypoints between the ends too. The ways from
    row to row are left to the autopilot or pilot: a mission's router finds clear ones.
    """
    places: list[Point] = []
    for row in plan.rows:
        count = 1 if every_m is None else max(1, math.ceil(row.length_m / every_m))
        for share in np.linspace(0.0, 1.0, count + 1).tolist():
            east_m, north_m = (a + share * (b - a) for a, b in zip(row.start, row.end, strict=True))
            place = _rounded(Point(east_m, north_m), field)
            if all(math.dist(place, other) >= _APART_M for other in places):
                places.append(place)
    _check(plan, field)
    return places


def place_text(field: Field, waypoints: Sequence[Point]) -> str:
    """The section `waypoints` of a mission file."""
    lines = ["waypoints:"]
    for number, waypoint in enumerate(waypoints, start=1):
        pair = _pair(field, waypoint)
        if field.altitude_m != field.placed.form.altitude_m and not field.placed.uavs:
            pair = f"{{position: {pair}, altitude_m: {field.altitude_m:g}}}"
        lines.append(f"  - {pair}" + (f"  # {number}" if number % 5 in {0, 1} else ""))
    return "\n".join(lines) + "\n"


def written(field: Field, waypoints: Sequence[Point], source: Path, folder: Path) -> str:
    """A whole mission for a file in `folder`, from the mission in `source` if it is one.

    Raises:
        UsageError: there is no mission, and no home for one; or paths of the mission would be lost.
        DocumentError: the mission cannot be flown with these waypoints.
    """
    placed, form = field.placed, field.placed.form
    if placed.home is None:
        raise UsageError("a mission needs a home; give --home LAT,LON, or leave --out away")
    findings, text = Findings(field.source), None
    if form.path == source and source.suffix.lower() in {".yaml", ".yml"}:
        old = source.read_text(encoding="utf-8")
        document = Document.from_text(old, source)
        text = with_section(old, document, "waypoints", place_text(field, waypoints))
    if text is not None:
        if folder.resolve() != source.parent.resolve() and (form.team or form.world):
            raise UsageError(
                f"the mission names files beside it; write into {source.parent} as well"
            )
        form, findings = read_mission(Document.from_text(text, source))
        placed = place(form, findings)
    else:
        own_m = None if placed.uavs else field.altitude_m
        spots = (
            MissionPoint(f"waypoint {number}", spot, (), own_m)
            for number, spot in enumerate(waypoints, start=1)
        )
        placed = replace(placed, waypoints=tuple(spots))
    # home may be too near to a zone, its height not known that limits count from
    validate(placed, findings)
    if findings.problems:
        raise DocumentError(findings.problems)
    return mission_text(placed, folder) if text is None else text


def _check(plan: Coverage, field: Field) -> None:
    """Every leg is clear as written, too."""
    places = [_rounded(point, field) for point in plan.track]
    legs = np.array([leg for leg in pairwise(places) if leg[0] != leg[1]], dtype=float)
    if not len(legs):
        return
    clear = field.airspace.legs_clear_between(legs[:, 0], legs[:, 1])
    if not clear.all():
        start, _ = legs[int(np.flatnonzero(~clear)[0])]
        raise AirRouterError(
            f"a leg from {_pair(field, Point(*start))} would come too near to a zone when written "
            "with so many decimals; please report this area"
        )


def _rounded(point: Point, field: Field) -> Point:
    if field.placed.form.in_metres:
        return Point(round(point.east_m, _METRES), round(point.north_m, _METRES))
    latitude_deg, longitude_deg = field.frame.to_geodetic(point)
    return field.frame.to_local(round(latitude_deg, _DEGREES), round(longitude_deg, _DEGREES))


def _pair(field: Field, place: Point) -> str:
    if field.placed.form.in_metres:
        return f"[{place.east_m:.{_METRES}f}, {place.north_m:.{_METRES}f}]"
    latitude_deg, longitude_deg = field.frame.to_geodetic(place)
    return f"[{latitude_deg:.{_DEGREES}f}, {longitude_deg:.{_DEGREES}f}]"
