"""`air-router cover`: lawnmower waypoints over an area, its no-fly zones cut out."""

import sys
import textwrap
from typing import Final

import click

from air_router.cli.arguments import (
    ANY_FINITE,
    MORE_THAN_0,
    note_options,
    number,
    place,
    print_json,
)
from air_router.coverage import (
    CAMERAS,
    CoverOptions,
    SurveyCamera,
    camera_of,
    facts_of,
    lines_of,
    place_of,
    place_text,
    read_field,
    waypoints_of,
    written,
)
from air_router.errors import AirRouterError, ExitCode, UsageError
from air_router.files import write_whole
from geo.coverage import CoverageError, Swath, cover
from mocha_link.cli import PATH, Options, Parsed, command, option

_OVERLAP, _SIDELAP = 70.0, 60.0
_ACCELERATION_M_S2: Final = 2.0
_FIELDS: Final = {
    "altitude": "altitude_m",
    "speed": "speed_m_s",
    "clearance": "planner.clearance_m",
    "every": "every",
}
"""The fields of `usual_values` that options set."""

_positive = number("more than 0", MORE_THAN_0, ANY_FINITE)

_NAMES = textwrap.fill("names: " + ", ".join(CAMERAS), 100, break_on_hyphens=False)

_EPILOG = f"""\
AREA is a mission (.yaml, .plan; its fence is the area), one or more polygons (.geojson, .kml, .kmz,
or a .gpx track around the area), or .yaml with 'polygon' and 'holes', or 'circle', as in a mission,
in degrees.

CAMERA is a name, a sensor and its lens in mm (13.2x8.8/10.4, with pixels 13.2x8.8/10.4@5472x3648),
or the angles of view (60x45deg). It looks straight down, its longer side across the rows.
{_NAMES}

Without --out the waypoints are printed as a section of a mission file. --out writes a whole
mission: AREA or --mission with these waypoints (comments of a YAML file are kept), or a new mission
at --home.

examples:
  air-router cover missions/urban/mission.yaml --camera 60x45deg
  air-router cover field.geojson --mission site.yaml --camera sony-rx100m2 --out survey.yaml
  air-router cover field.kml --camera sony-a7r4-35mm --altitude 100 --zones geozones.json \\
      --home 39.9421,-75.1997 --out survey.yaml
"""


class CoverError(AirRouterError):
    """The area cannot be covered."""


def _percent(text: str) -> float:
    value = number("within 0 to 95 percent", 0.0, 95.0)(text)
    if 0 < value < 1:
        raise ValueError(f"{text}: write percent, {100 * value:g}")
    return value


def _angle(text: str) -> float | None:
    return None if text == "auto" else number("an angle", -ANY_FINITE, ANY_FINITE)(text) % 180.0


@command("Plan survey rows over an area for a downward camera, clear of no-fly zones.", _EPILOG)
@click.argument("area", type=PATH, help="file with the area to cover; see below")
@option("--camera", metavar="CAMERA", required=True, help="the camera; see below")
@option("--portrait", is_flag=True, help="mount the camera with its longer side along the rows")
@option(
    "--overlap",
    type=Parsed(_percent),
    metavar="PERCENT",
    default=_OVERLAP,
    help=f"overlap of consecutive pictures on a row, in percent (default {_OVERLAP:g})",
)
@option(
    "--sidelap",
    type=Parsed(_percent),
    metavar="PERCENT",
    default=_SIDELAP,
    help=f"overlap of pictures on neighboring rows, in percent (default {_SIDELAP:g})",
)
@option(
    "--altitude",
    type=Parsed(_positive),
    metavar="M",
    help="flight altitude above home, in meters (default: the mission's)",
)
@option(
    "--angle",
    type=Parsed(_angle),
    metavar="DEG",
    help="direction of the rows, in degrees clockwise from north, or 'auto' (default): the "
    "direction of the shortest flight",
)
@option("--mission", type=PATH, metavar="F", help="mission that defines airspace and home")
@option(
    "--home",
    type=Parsed(place),
    metavar="LAT,LON",
    help="home in degrees, without --mission",
)
@option(
    "--zones",
    multiple=True,
    type=PATH,
    metavar="F",
    help="file with no-fly zones, without --mission; may be repeated",
)
@option(
    "--clearance",
    type=Parsed(number("within 0 to 1000 m", 0.0, 1000.0)),
    metavar="M",
    help="distance to keep from zones and fence, in meters, without --mission",
)
@option("--inside", is_flag=True, help="never leave the area, not even in turns")
@option(
    "--speed",
    type=Parsed(_positive),
    metavar="M_S",
    help="cruise speed, in m/s (default: the mission's)",
)
@option(
    "--every",
    type=Parsed(_positive),
    metavar="M",
    help="largest distance between waypoints on a row, in meters",
)
@option("--out", type=PATH, metavar="F", help="write a whole mission (YAML) into file F")
@option("--force", is_flag=True, help="replace the file of --out if it exists")
@option("--png", type=PATH, metavar="F", help="draw area and rows into file F")
@option("--json", is_flag=True, help="print one JSON object on stdout")
def run(arguments: Options) -> int:
    """Plan rows, and write the requested files."""
    if arguments.out is not None and arguments.out.suffix.lower() not in {".yaml", ".yml"}:
        raise UsageError(
            f"{arguments.out}: a mission file ends with .yaml; `air-router convert` writes plans"
        )
    note_options(arguments, _FIELDS)
    camera = camera_of(arguments.camera)
    camera = camera.turned if arguments.portrait else camera
    field = read_field(arguments.area, arguments.mission, _terms(arguments))
    swath = _swath(camera, field.altitude_m, arguments.sidelap)
    try:
        plan = cover(
            field.area,
            field.airspace,
            swath,
            bearing_deg=arguments.angle,
            start=field.home,
            stop_m=field.placed.form.speed_m_s**2 / _ACCELERATION_M_S2,
        )
    except CoverageError as error:
        raise CoverError(f"{arguments.area}: {error}") from None
    facts = facts_of(field, plan, camera, swath, arguments.overlap)
    waypoints = waypoints_of(plan, field, arguments.every)
    if arguments.out is not None:
        source = arguments.mission or arguments.area
        text = written(field, waypoints, source, arguments.out.parent)
        write_whole(arguments.out, text, replace=arguments.force)
    lines = lines_of(facts, field)
    if arguments.json:
        places = [place_of(field, point) for point in waypoints]
        track = [place_of(field, point) for point in plan.track]
        print_json(facts | {"waypoints": places, "track": track})
    elif arguments.out is not None:
        sys.stdout.write("\n".join(lines) + "\n")
    else:
        sys.stdout.write("\n".join(f"# {line}" for line in lines) + "\n")
        sys.stdout.write(place_text(field, waypoints))
    if arguments.png is not None:
        from air_router.report import draw_coverage  # noqa: PLC0415 - an extra

        draw_coverage(field, plan, arguments.png, lines[0])
        sys.stderr.write(f"drawn: {arguments.png}\n")
    return ExitCode.DONE


def _terms(arguments: Options) -> CoverOptions:
    return CoverOptions(
        home=arguments.home,
        altitude_m=arguments.altitude,
        speed_m_s=arguments.speed,
        clearance_m=arguments.clearance,
        zones=arguments.zones,
        inside=arguments.inside,
    )


def _swath(camera: SurveyCamera, height_m: float, sidelap_percent: float) -> Swath:
    across_m, along_m = camera.footprint_m(height_m)
    return Swath(across_m, along_m, across_m * (1 - sidelap_percent / 100))
