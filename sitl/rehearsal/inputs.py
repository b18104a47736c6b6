"""What operators ask of a rehearsed flight; the lies of streams and of mad or hostile robots."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, Final

from air_router.controller.model.requests import (
    AnyRequest,
    ComeHome,
    ExploreNow,
    GoOn,
    GoTo,
    HoldNow,
    SeekNow,
)
from air_router.messages import POSE_TOPIC
from air_router.mission.mission import Mission
from geo.frame import Point
from sitl.rehearsal.stand_ins.link import Wrong
from sitl.rehearsal.stand_ins.team import Prank, pose

_ROBOTS: Final = ("callisto", "europa", "io", "phantom")
_HOLD, _GO_ON, _SEEK, _EXPLORE, _HOME = 0.2, 0.4, 0.55, 0.65, 0.69
_BESIDE_M: Final = 40.0


def request_of(choice: float, dice: random.Random, mission: Mission, here: Point) -> AnyRequest:
    """A request by a number from 0 to 1: all verbs, points near waypoints and the vehicle."""
    if choice < _HOLD:
        return HoldNow()
    if choice < _GO_ON:
        return GoOn()
    if choice < _SEEK:
        return SeekNow(dice.choice(_ROBOTS))
    if choice < _EXPLORE:
        return ExploreNow()
    if choice < _HOME:
        return ComeHome()
    count, waits = dice.choice((1, 1, 2, 5)), dice.random() < 0.2
    points = tuple(_place(dice, mission, here) for _ in range(count))
    return GoTo(points, dice.choice((None, 0.0, 5.0)), waits)


def _place(dice: random.Random, mission: Mission, here: Point) -> Point:
    beside = (dice.uniform(-_BESIDE_M, _BESIDE_M), dice.uniform(-_BESIDE_M, _BESIDE_M))
    east_m, north_m = dice.choice((here, dice.choice(mission.waypoints).position))
    return Point(east_m + beside[0], north_m + beside[1])


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
