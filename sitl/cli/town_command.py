"""`sitl town`: check a town, draw it, or make one from a seed."""

import re
import sys
from pathlib import Path
from typing import Any, Final

import click
import shapely

from air_router.cli import print_json
from air_router.errors import ExitCode, UsageError
from air_router.files import write_whole
from air_router.words import counted
from geo.frame import Point
from geo.grid import Terrain
from mocha_link.cli import PATH, Options, command, option
from mocha_link.errors import needs_extra
from mocha_link.team import DocumentError
from sitl.world.towns import Town, layers

_EPILOG = """\
TOWN is a file, or COLUMNSxROWS for a new town of that many blocks of about 65 m. --out writes
town.yaml and, for a new town, a mission.yaml over it; experiments use both.

examples:
  sitl town missions/urban/town.yaml --picture town.png
  sitl town 8x6 --seed 3 --goals 40 --out missions/large --picture large.png
  sitl town missions/urban/town.yaml --scatter 15 --seed 7 --out missions/urban-7
"""

_BLOCKS: Final = re.compile(r"(\d{1,2})x(\d{1,2})")

# Of its picture.
OPEN, PAVED, ROAD, CROWN = "#e3dccb", "#eef0e4", "#aab4c4", "#8fb27c"
HOUSE, HOUSE_EDGE, GOAL, START = "#fdfdfb", "#b9b4a8", "#d1495b", "#30638e"


@command("Check or draw the file of a simulated town, or generate a town of any size.", _EPILOG)
@click.argument("town", help="town file, or COLUMNSxROWS for a new town")
@option("--seed", type=int, metavar="N", help="seed of a new town or of --scatter (default 1)")
@option(
    "--goals", type=int, metavar="N", help="number of vehicles to find in a new town (default 15)"
)
@option(
    "--scatter", type=int, metavar="N", help="move N vehicles to random places beside the roads"
)
@option("--out", type=PATH, metavar="FOLDER", help="folder to write town.yaml into")
@option("--force", is_flag=True, help="replace existing files")
@option(
    "--picture", type=PATH, metavar="FILE", help="draw the town into a file (.png, .svg or .pdf)"
)
@option("--json", is_flag=True, help="print one JSON object on stdout")
def run(arguments: Options) -> int:
    """Carry out the command; returns the exit code."""
    from sitl.world.towns import (  # noqa: PLC0415
        generate,
        load_town,
        scatter,
    )

    new = _BLOCKS.fullmatch(arguments.town)
    if not new:
        _check_for_file(arguments)
    seed = 1 if arguments.seed is None else arguments.seed
    try:
        if new:
            goals = 15 if arguments.goals is None else arguments.goals
            town = generate(seed, int(new[1]), int(new[2]), goals=goals)
        else:
            town = load_town(Path(arguments.town))
        if arguments.scatter is not None:
            town = scatter(town, seed, arguments.scatter)
    except DocumentError as error:
        print(error, file=sys.stderr)
        return ExitCode.INVALID_FILE
    except ValueError as error:
        raise UsageError(str(error)) from None
    if arguments.out is not None:
        _write(town, arguments.out, new=bool(new), force=arguments.force)
    if arguments.picture is not None:
        _draw(town, arguments.picture)
    facts = _facts(town)
    if arguments.json:
        print_json(facts)
    else:
        print(
            f"{town.name}: {facts['area_m2']:,} m2, {counted(len(town.goals), 'vehicles')}, "
            f"{counted(len(town.buildings), 'buildings')}, room for "
            f"{counted(len(town.starts), 'ground robots')}"
        )
    return ExitCode.DONE


def _check_for_file(arguments: Options) -> None:
    """Refuse options for new towns, or new places, which would do nothing to a file's."""
    if arguments.goals is not None:
        raise UsageError("--goals is for a new town; --scatter N puts N vehicles into this one")
    if arguments.seed is not None and arguments.scatter is None:
        raise UsageError("--seed is for a new town or with --scatter; nothing else is by chance")


def _facts(town: Town) -> dict[str, Any]:
    return {
        "name": town.name,
        "area_m2": round(town.area_m2),
        "bounds": town.bounds._asdict(),
        "goals": {goal.id: list(goal.position) for goal in town.goals},
        "buildings": len(town.buildings),
        "starts": len(town.starts),
    }


def _write(town: Town, folder: Path, *, new: bool, force: bool) -> None:
    from sitl.world.towns import mission_text, town_text  # noqa: PLC0415 - slow to load

    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / "town.yaml", town_text(town), replace=force)
        if new:
            write_whole(folder / "mission.yaml", mission_text(town), replace=force)
    except OSError as error:
        raise UsageError(f"cannot write to {folder}: {error.strerror}") from None


def _draw(town: Town, path: Path) -> None:
    """Draw what stands where into a file; its name's ending (.png, .svg, .pdf) is the format.

    Raises:
        MissingExtraError: matplotlib is not installed.
        PictureError: the file cannot be written, or its ending is not a picture's.
    """
    with needs_extra("a picture", "plot", "air-router"):
        from air_router.report import Ink, MapSheet  # noqa: PLC0415 - needs matplotlib

    bounds = town.bounds
    corners = [Point(bounds.west_m, bounds.south_m), Point(bounds.east_m, bounds.north_m)]
    sheet = MapSheet(corners, OPEN)
    drawn = {
        terrain: shapely.union_all(
            [shape for own, shape in layers(town.land_cover) if own is terrain]
        )
        for terrain in Terrain
    }
    yards = drawn[Terrain.GRAVEL]
    for shape, label, colour, edge in (
        (shapely.Polygon(town.outline), "_", PAVED, "none"),
        (drawn[Terrain.VEGETATION], "vegetation", CROWN, "none"),
        (drawn[Terrain.ROAD], "road", ROAD, "none"),
        (drawn[Terrain.BUILDING].difference(yards), "building", HOUSE, HOUSE_EDGE),
        (yards, "_", OPEN, "none"),
    ):
        if not shape.is_empty:
            sheet.shape(shape, label, facecolor=colour, edgecolor=edge, linewidth=0.6)
    sheet.axes.plot(
        *zip(*town.starts, strict=True),
        "o",
        color=START,
        markersize=2.2,
        markeredgewidth=0,
        label="start of a ground robot",
    )
    sheet.axes.plot(*town.home, "^", color=Ink.TEXT, markersize=6, label="home")
    if town.goals:
        sheet.axes.plot(
            *zip(*(goal.position for goal in town.goals), strict=True),
            "s",
            color=GOAL,
            markersize=5,
            markeredgecolor="white",
            markeredgewidth=0.6,
            label="vehicle to be found",
        )
    subtitle = f"{town.area_m2:,.0f} m², {counted(len(town.goals), 'vehicles')}"
    sheet.save(path, town.name, subtitle)
