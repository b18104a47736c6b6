"""The operator changes more of the mission file than zones, or while no companion reads it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from geo.frame import Point
from sitl.rehearsal.operator import Operator
from sitl.rehearsal.scenario import Scenario
from sitl.rehearsal.zone_drawing import ZoneDrawing

_AWAY_M: Final = (20.0, 35.0)
_RADIUS_M: Final = (3.0, 5.0)
_TRIES: Final = 40
_HOME_M: Final = 22.0
_MOVED_E7: Final = 0.00006
"""Degrees of latitude by which a waypoint is moved: 7 m."""


class FileChanges:
    """Changes the file, and mostly has it read again.

    Args:
        flight: Whose file.
        zones: What is read again, and taken out again if it was not taken.
        operator: Who sends the requests.
    """

    def __init__(self, flight: Scenario, zones: ZoneDrawing, operator: Operator) -> None:
        self._flight, self._zones, self._operator = flight, zones, operator
        self._rng = flight.scene.chance("file")
        self._moved: str | None = None  # the zone that is moved about

    def do_change(self, what: tuple[str, bool]) -> None:
        """Something else than a zone is another, and perhaps a zone is drawn with it."""
        key, zone = what

        def change(document: dict[str, Any]) -> None:
            match key:
                case "waypoints":
                    self._nudge(document)
                case "speed":
                    document["speed_m_s"] = document["speed_m_s"] * 2
                case "altitude":
                    document["altitude_m"] = document["altitude_m"] + 12
                case "timers":
                    timers = dict(document["timers"])
                    document["timers"] = {**timers, "explore_s": timers["explore_s"] * 3}
                case "margin":
                    planner = dict(document.get("planner") or {})
                    document["planner"] = {**planner, "tracking_margin_m": 0.5}
                case "rally":
                    document["rally_points"] = document["rally_points"][:-1]
                case "acceptance":
                    planner = dict(document.get("planner") or {})
                    document["planner"] = {**planner, "acceptance_radius_m": 1.0}
                case _:
                    document["battery_reserve"] = 0.1
            if zone:
                self._add_zone(document)

        self._rewrite(change)

    @staticmethod
    def _nudge(document: dict[str, Any]) -> None:
        """Move the last waypoint."""
        place = document["waypoints"][-1]
        latitude_deg, longitude_deg = place["position"] if isinstance(place, dict) else place
        document["waypoints"][-1] = [latitude_deg + _MOVED_E7, longitude_deg]

    def do_shrink(self, share: float) -> None:
        """The fence is drawn nearer to what is in it."""

        def change(document: dict[str, Any]) -> None:
            fence = document["fence"]
            ring = fence["polygon"] if isinstance(fence, dict) else fence
            middle = [sum(axis) / len(ring) for axis in zip(*ring, strict=True)]
            smaller = [
                [middle[axis] + (1.0 - share) * (corner[axis] - middle[axis]) for axis in (0, 1)]
                for corner in ring
            ]
            document["fence"] = (
                {**fence, "polygon": smaller} if isinstance(fence, dict) else smaller
            )

        self._rewrite(change)

    def do_move_zone(self, _: object) -> None:
        """A zone of as many corners as one that is taken away is drawn elsewhere."""

        def change(document: dict[str, Any]) -> None:
            if self._moved is not None:
                zones = document["no_fly_zones"]
                document["no_fly_zones"] = [z for z in zones if z.get("name") != self._moved]
            self._add_zone(document, corners=4)

        self._rewrite(change)

    def do_draw_alone(self, low: bool) -> None:
        """A zone is drawn while no companion is there to read it, low or at every height."""
        if self._flight.companion is not None:
            return
        self._flight.file.rewrite(lambda document: self._add_zone(document, low=low))
        self._zones.counts()

    def _rewrite(self, change: Callable[[dict[str, Any]], None]) -> None:
        def draw() -> bool:
            self._flight.file.rewrite(change)
            return True

        self._zones.change(draw)

    def _add_zone(
        self, document: dict[str, Any], *, corners: int | None = None, low: bool = False
    ) -> None:
        """Where the vehicle is not, nor home."""
        rng = self._rng
        radius_m = rng.uniform(*_RADIUS_M)
        place = self._place(radius_m, clear=corners is not None)
        name = self._moved = f"drawn {len(document['no_fly_zones'])} {self._flight.now_s:.0f}"
        zone: dict[str, Any] = {"name": name, "crosses_fence": True}
        if corners is None:
            zone["circle"] = {"centre": self._degrees(place), "radius_m": radius_m}
        else:
            turns = [2 * math.pi * n / corners for n in range(corners)]
            ring = [
                (place[0] + radius_m * math.sin(turn), place[1] + radius_m * math.cos(turn))
                for turn in turns
            ]
            zone["polygon"] = list(map(self._degrees, ring))
        if low:
            zone["altitude"] = {"upper_m": 20.0}
        document["no_fly_zones"] = [*document["no_fly_zones"], zone]

    def _place(self, radius_m: float, *, clear: bool) -> tuple[float, float]:
        """Near the vehicle, not at home; `clear`: where no waypoint is kept from, if there is."""
        rng, mission = self._rng, self._operator.space.mission
        kept_m = radius_m + mission.clearance_m + mission.tracking_margin_m + 1.0
        for turn in range(_TRIES):
            away_m, angle_rad = rng.uniform(*_AWAY_M), rng.uniform(0.0, 2 * math.pi)
            here = self._operator.here
            off = away_m * math.sin(angle_rad), away_m * math.cos(angle_rad)
            place = here[0] + off[0], here[1] + off[1]
            nearest_m = min(math.dist(place, waypoint) for waypoint in mission.waypoints)
            free = not clear or turn > _TRIES // 2 or nearest_m > kept_m
            if math.hypot(*place) >= _HOME_M and free:
                return place
        return here[0] - off[0], here[1] - off[1]

    def _degrees(self, place: tuple[float, float]) -> list[float]:
        point: Point = self._operator.point(place)
        return [round(degrees, 8) for degrees in self._flight.mission.frame.to_geodetic(point)]
