"""The files of a first mission, as texts: small, commented, and ready to be flown and changed."""

import math
from collections.abc import Mapping
from pathlib import Path
from string import Template
from typing import Final

from air_router.files.missions.mission_write import first_mission_text
from air_router.files.yaml_text import degrees_text
from geo.frame import Geodetic, Point

ROVERS: Final = {"json": "rover_json.py", "ros1": "rover_ros1.py", "ros2": "rover_ros2.py"}
"""What robots may speak, and the program of a rover that does."""

MOST_ROBOTS: Final = 20

_HERE = Path(__file__).parent
_PX4_RETURN_M = 30.0
_CORNERS = 4
_RADIUS_M = 100.0
_FENCE_M = 200.0
_PATROL_M = 8.0


def first_places(count: int) -> list[Point]:
    """Where robots are at first, in metres from home: near waypoints, apart from each other."""
    corners = max(count, _CORNERS)
    angles = [math.tau * number / corners for number in range(corners)]
    return [Point(_RADIUS_M * math.sin(a), _RADIUS_M * math.cos(a)) for a in angles]


def texts_of(
    home: Geodetic, altitude_m: float, uav: str, robots: Mapping[str, str]
) -> dict[str, str]:
    """The files by name.

    Args:
        home: Where the vehicle takes off.
        altitude_m: Where it cruises, above home.
        uav: Its name.
        robots: What each robot speaks, by name: a key of `ROVERS`.
    """
    places = first_places(len(robots))
    kinds = dict.fromkeys(robots.values())
    patrols = [
        f"  {name}: {{patrol: {_patrol(place)}}}"
        for name, place in zip(robots, places, strict=False)
    ]
    begin = first_mission_text(
        "air-router new", home, places, altitude_m=altitude_m, fence_radius_m=_FENCE_M
    )
    accepts = _filled("accepts") if altitude_m > _PX4_RETURN_M else ""
    programs = {ROVERS[kind]: (_HERE / ROVERS[kind]).read_text(encoding="utf-8") for kind in kinds}
    return {
        "mission.yaml": begin + _filled("mission", uav=uav, robots=", ".join(robots)) + accepts,
        "team.yaml": _filled(
            "team",
            robots=_team(", ".join(map(degrees_text, home)), uav, robots),
            occupancy="" if set(kinds) == {"json"} else _filled("occupancy"),
            kinds="".join(_filled(f"kind_{kind}") for kind in kinds).rstrip("\n"),
        ),
        "world.yaml": _filled("world", robots="\n".join(patrols)),
        **{name: program.replace("titan", uav) for name, program in programs.items()},
    }


def _filled(template: str, **values: object) -> str:
    text = (_HERE / "templates" / f"{template}.yaml").read_text(encoding="utf-8")
    return Template(text).substitute(values)


def _team(home: str, uav: str, robots: Mapping[str, str]) -> str:
    """The section of a team file; `home` is where local frames have their origins."""
    names = [uav, *robots]
    text = ""
    for number, name in enumerate(names, start=1):
        text += _filled(
            "robot",
            name=name,
            kind=f"{robots[name]}_rover" if name in robots else "aerial_robot",
            number=number,
            base_port=24_000 + 100 * number,
            clients=", ".join(other for other in names if other != name),
            radio_port=24_090 + 100 * number,
        )
        if "ros2" in (robots.get(name), *(robots.values() if name == uav else ())):
            text += f"    datum: [{home}]  # where the origin of its local frame lies\n"
        if robots.get(name) == "ros2":
            text += "    ros: 2\n"
    return text.rstrip("\n")


def _patrol(place: Point) -> str:
    half_m = _PATROL_M / 2
    corners = [(-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m)]
    points = [f"[{place.east_m + e:.0f}, {place.north_m + n:.0f}]" for e, n in corners]
    return f"[{', '.join(points)}]"
