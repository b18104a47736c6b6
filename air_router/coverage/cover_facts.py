"""What is told of a coverage, to programs and to people."""

import math
from typing import Any, Final

from air_router.coverage.camera import SurveyCamera
from air_router.coverage.cover_area import Field
from air_router.routing.return_planner import Pace, Way
from geo.coverage.coverage import Coverage, Swath
from geo.frame import Point


def facts_of(
    field: Field, plan: Coverage, camera: SurveyCamera, swath: Swath, overlap_percent: float
) -> dict[str, Any]:
    """What `--json` prints of a coverage, without its waypoints."""
    speed_m_s = field.draft.speed_m_s
    legs = list(plan.legs)
    pace = Pace(speed_m_s, 0.0, field.draft.endurance_s)
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
    endurance_s = field.draft.endurance_s
    if endurance_s is not None and facts["flight_time_s"] > endurance_s:
        lines.append(f"more than one battery lasts ({endurance_s:g} s): fly it in parts")
    return lines


_REASONS: Final = {
    "near": "no place that keeps its distance from {by} sees it",
    "apart": "no clear way leads there, {by} is nearest",
    "outside": "outside of the fence, and out of sight from inside",
    "sliver": "slivers, too small for rows of their own",
}


def _missed_line(missed: dict[str, Any]) -> str:
    why = _REASONS[missed["why"]].format(by=missed["by"])
    pieces = "1 piece" if missed["pieces"] == 1 else f"{missed['pieces']} pieces"
    where = f"{missed['latitude_deg']:.6f}, {missed['longitude_deg']:.6f}"
    largest = "at" if missed["pieces"] == 1 else "the largest at"
    return f"not covered: {missed['area_m2']:,.0f} m2 in {pieces}, {largest} {where}: {why}"


def place_of(field: Field, point: Point) -> dict[str, float]:
    """A place in degrees."""
    latitude_deg, longitude_deg = field.frame.to_geodetic(point)
    return {"latitude_deg": round(latitude_deg, 7), "longitude_deg": round(longitude_deg, 7)}
