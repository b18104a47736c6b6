"""Believable lies of a vehicle's streams, and the nonsense that mad or hostile robots tell."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, Final

from air_router.messages import POSE_TOPIC
from air_router.mission.mission import Mission
from geo.frame import Point
from sitl.rehearsal.stand_ins.link import Wrong
from sitl.rehearsal.stand_ins.team import Prank, pose

_POSCTL: Final = 3 << 16
_METRES_E7: Final = 90  # of latitude, about, in 1e-7 degrees


def wrong_of(name: str, dice: random.Random) -> Wrong | None:
    """What the messages of one name say that is not true; None: there is nothing to lie about."""
    if name == "GLOBAL_POSITION_INT":
        off = [round(dice.uniform(-30.0, 30.0) * _METRES_E7) for _ in range(2)]
        up_mm = round(dice.uniform(-8.0, 8.0) * 1e3)

        def elsewhere(fields: dict[str, Any], _: random.Random) -> dict[str, Any]:
            there = {"lat": fields["lat"] + off[0], "lon": fields["lon"] + off[1]}
            return {**fields, **there, "relative_alt": fields["relative_alt"] + up_mm}

        return elsewhere
    value = _VALUES.get(name)
    return None if value is None else lambda fields, d: {**fields, **value(d)}


_VALUES: Final[dict[str, Callable[[random.Random], dict[str, Any]]]] = {
    "SYS_STATUS": lambda dice: {"battery_remaining": dice.choice((-1, 3, 50, 100))},
    "GPS_RAW_INT": lambda dice: {"fix_type": dice.choice((0, 1, 3)), "satellites_visible": 3},
    "EXTENDED_SYS_STATE": lambda dice: {"landed_state": dice.choice((0, 1, 2, 4))},
    "MISSION_CURRENT": lambda dice: {"seq": dice.randrange(0, 60)},
    "HEARTBEAT": lambda dice: {"custom_mode": dice.choice((_POSCTL, 0x03040000, 0x04040000))},
    "CURRENT_MODE": lambda dice: {"custom_mode": dice.choice((_POSCTL, 0x03040000, 0x04040000))},
}


def prank_of(how: str, mission: Mission, dice: random.Random, unix_s: Callable[[], float]) -> Prank:
    """What a mad robot tells instead of where it is."""
    frame = mission.frame

    def told(name: str, place: Point) -> list[tuple[str, str, bytes]]:
        match how:
            case "future":
                data = pose(frame, place, 9.9e10)
            case "stamp":
                data = pose(frame, place, unix_s() + dice.choice((-1e6, -3600.0, 60.0, 1e5, 1e7)))
            case "nan":
                data = b'{"stamp_s": NaN, "latitude_deg": NaN, "longitude_deg": 1e999}'
            case "jump":
                to = Point(dice.uniform(-900.0, 900.0), dice.uniform(-900.0, 900.0))
                data = pose(frame, to, unix_s())
            case "zone":
                inside = dice.choice(mission.zones).polygon.representative_point()
                data = pose(frame, Point(inside.x, inside.y), unix_s())
            case _:
                far = {"latitude_deg": -33.0, "longitude_deg": 151.0, "heading_deg": 1.0}
                data = str({"stamp_s": unix_s(), **far}).replace("'", '"').encode()
        return [(name, POSE_TOPIC, data)]

    return told
