"""The text of a first mission: small, commented, with a round fence."""

from collections.abc import Sequence

from air_router.files.text.rendering import degrees
from geo.frame import Geodetic, LocalFrame, Point

_TEXT = """\
# A first mission, made by {made_by}. Every key is described in docs/mission-file.md.

# Where the vehicle takes off and lands: latitude, longitude.
home: [{home}]

# Cruise altitude in metres above home.
altitude_m: {altitude_m:g}

# What to explore, in order. To drag it on a map: air-router edit
waypoints:
{waypoints}

# The area to stay in, and areas to stay out of.
fence:
  circle: {{centre: [{home}], radius_m: {fence_radius_m:g}}}
no_fly_zones: []
"""


def mission_text(
    made_by: str,
    home: Geodetic,
    waypoints: Sequence[Point],
    *,
    altitude_m: float,
    fence_radius_m: float,
) -> str:
    """A mission that only lacks its team.

    Args:
        made_by: The command that makes it.
        home: Where the vehicle takes off, and the fence's centre.
        waypoints: From home.
        altitude_m: Cruise altitude above home.
        fence_radius_m: From home.
    """
    frame = LocalFrame(home)
    places = [", ".join(map(degrees, frame.to_geodetic(waypoint))) for waypoint in waypoints]
    return _TEXT.format(
        made_by=made_by,
        home=", ".join(map(degrees, home)),
        altitude_m=altitude_m,
        waypoints="\n".join(f"  - [{place}]" for place in places),
        fence_radius_m=fence_radius_m,
    )
