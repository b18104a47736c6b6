"""Small missions in metres, around an origin in Kansas."""

import json

from air_router.mission.loading import load_mission

SQUARE = [[-100, -100], [100, -100], [100, 100], [-100, 100]]


def local_mission(folder, **changes):
    """A mission with other values than these; as JSON, which YAML reads."""
    data = {
        "coordinates": "local",
        "frame": {"origin": [38.5, -98.5]},
        "home": [0, 0],
        "altitude_m": 30,
        "waypoints": [[50, 0], [50, 50]],
        "fence": SQUARE,
        "no_fly_zones": [],
    }
    path = folder / "mission.yaml"
    path.write_text(json.dumps(data | changes))
    return load_mission(path)


def box(west, south, east, north):
    return [[west, south], [east, south], [east, north], [west, north]]
