"""The judge's look at what was put on board: mission items and fence against the mission file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import shapely
from shapely.geometry import MultiPoint, Point, Polygon
from shapely.geometry.base import BaseGeometry

from sitl.rehearsal.judge.evidence import AUTOPILOT, COMPANION, WireMessage
from sitl.rehearsal.judge.judge_seat import announcements
from sitl.rehearsal.judge.judge_space import areas_in_force
from sitl.rehearsal.judge.judge_track import Judge, MissionVersion, number
from sitl.rehearsal.judge.mission_reader import Area, Pair

MISSION, FENCE, RALLY, EVERYTHING = 0, 1, 2, 255  # MAV_MISSION_TYPE
_WAYPOINT, _TAKEOFF = 16, 22  # MAV_CMD
_IN_POLYGON, _IN_CIRCLE, _OUT_CIRCLE = 5001, 5003, 5004
_RELATIVE: Final = frozenset({3, 6})
_PLACE_M, _HEIGHT_M, _AREA_M = 0.5, 1.0, 0.6
_SETTLES_S: Final = 45.0
"""Within this a changed file is on board, or its flight is no longer ours."""

_FAR_M: Final = 2000.0


@dataclass(frozen=True, slots=True)
class Upload:
    """A transfer that the vehicle accepted.

    Attributes:
        time_s: When it was accepted.
        kind: MAV_MISSION_TYPE.
        items: Of it, in order; none: cleared.
    """

    time_s: float
    kind: int
    items: tuple[WireMessage, ...]


@dataclass(slots=True)
class PlanJudge(Judge):
    """Judges the uploads of one flight.

    Attributes:
        uploads: That were accepted, in order.
    """

    uploads: list[Upload] = field(default_factory=list)

    def judge(self) -> None:
        """Look at every upload, and at what is on board when it takes off."""
        track = self.track
        self.uploads = list(_uploads(track.evidence.messages))
        armed_s = next((s.time_s for s in track.evidence.samples if s.armed), math.inf)
        for upload in self.uploads:
            if upload.kind == MISSION and upload.items:
                self._judge_items(upload, all_there=upload.time_s <= armed_s)
        if not self.uploads or armed_s == math.inf:
            return
        self._judge_read_back(armed_s)
        self._judge_rally(armed_s)
        self._judge_fence(armed_s, [track.version_at(armed_s)])
        for version in track.versions[1:]:
            self._judge_renewal(version)

    def place(self, seq: int, time_s: float) -> Pair | None:
        """Where an item of the mission on board leads to, in metres."""
        missions = [u for u in self.uploads if u.kind == MISSION and u.time_s <= time_s and u.items]
        items = missions[-1].items if missions else ()
        if seq >= len(items) or items[seq].fields["command"] not in {_WAYPOINT, _TAKEOFF}:
            return None
        return self._metres(items[seq])

    def _metres(self, item: WireMessage) -> Pair:
        fields = item.fields
        east, north = self.track.mission.frame.metres(fields["x"] / 1e7, fields["y"] / 1e7)
        return float(east), float(north)

    def _judge_items(self, upload: Upload, *, all_there: bool) -> None:
        mission = self.track.version_at(upload.time_s).mission
        low_m, high_m = mission.altitudes_m[0] - _HEIGHT_M, mission.altitudes_m[-1] + _HEIGHT_M
        allowed = MultiPoint([*mission.waypoints, (0.0, 0.0)])
        places = []
        for item in upload.items:
            if item.fields["command"] not in {_WAYPOINT, _TAKEOFF}:
                continue
            place = self._metres(item)
            places.append(place)
            above_m = number(item.fields, "z")
            above_m -= 0.0 if item.fields["frame"] in _RELATIVE else self.track.ground_m
            seq = item.fields["seq"]
            if not low_m <= above_m <= high_m:
                text = f"item {seq} is at {above_m:.1f} m, the plan flies {low_m:.1f} m and more"
                self.add(upload.time_s, "plan", text)
            if item.fields["command"] == _WAYPOINT and item.fields.get("autocontinue"):
                self.add(upload.time_s, "plan", f"item {seq} goes on to the next by itself")
            if allowed.distance(Point(place)) > _PLACE_M:
                away_m = allowed.distance(Point(place))
                self.add(upload.time_s, "plan", f"item {seq} is {away_m:.1f} m from every waypoint")
        if all_there and places:
            missing = [
                n
                for n, waypoint in enumerate(mission.waypoints, 1)
                if MultiPoint(places).distance(Point(waypoint)) > _PLACE_M
            ]
            if missing:
                self.add(upload.time_s, "plan", f"waypoints {missing} are not on board")

    def _judge_read_back(self, armed_s: float) -> None:
        """Whatever the vehicle said that is on board before it was armed, is what was sent."""
        for told in self.track.evidence.messages:
            if told.time_s > armed_s:
                return
            if told.name != "MISSION_ITEM_INT" or told.component != AUTOPILOT:
                continue
            kind, seq = told.fields.get("mission_type", MISSION), int(told.fields["seq"])
            of_kind = [u for u in self.uploads if u.kind == kind and u.time_s <= told.time_s]
            if not of_kind or seq >= len(of_kind[-1].items):
                continue
            sent = of_kind[-1].items[seq]
            away_m = math.dist(self._metres(sent), self._metres(told))
            if away_m > _PLACE_M:
                text = f"armed, though item {seq} on board is {away_m:.1f} m from where it was sent"
                self.add(armed_s, "plan", text, away_m, _PLACE_M)
                return

    def _judge_rally(self, armed_s: float) -> None:
        """Where the autopilot may land in need: all places of the file that are clear by far."""
        version = self.track.version_at(armed_s)
        uploads = [u for u in self.uploads if u.kind == RALLY and u.time_s <= armed_s]
        there = MultiPoint([self._metres(item) for item in (uploads[-1].items if uploads else ())])
        borders = [
            area.polygon.boundary if fence else area.polygon
            for area, fence in areas_in_force(version)
        ]
        far_m = 2.0 * version.mission.clearance_m
        for place in map(Point, version.mission.rally):
            clear = all(border.distance(place) > far_m for border in borders)
            if clear and (there.is_empty or there.distance(place) > _PLACE_M):
                self.add(
                    armed_s, "plan", f"no rally point is on board at {place.x:.0f}, {place.y:.0f}"
                )
                return

    def _judge_renewal(self, version: MissionVersion) -> None:
        """A changed file gets on board as it is, while the vehicle is ours."""
        track = self.track
        end_s = version.from_s + _SETTLES_S
        later = [s.from_s for s in track.versions if s.from_s > version.from_s]
        taken = [begin_s for begin_s, _, _ in track.given if begin_s < end_s]
        flying = bool(track.flying[track.at(end_s)]) and track.time_s[-1] >= end_s
        # PX4 takes no other items while it flies them: that is said, and the flight comes home.
        told = any(
            version.from_s <= at_s < end_s and "is not on board" in text
            for at_s, text in announcements(track.evidence)
        )
        if flying and not (taken or told) and min(later, default=math.inf) > end_s:
            self._judge_fence(end_s, [version])

    def _judge_fence(self, time_s: float, versions: Sequence[MissionVersion]) -> None:
        uploads = [u for u in self.uploads if u.kind in {FENCE, EVERYTHING} and u.time_s <= time_s]
        items = uploads[-1].items if uploads else ()
        wrong = [self._differs(items, version) for version in versions]
        if all(wrong):
            self.add(time_s, "plan", f"the fence on board: {wrong[0]}")

    def _differs(self, items: Sequence[WireMessage], version: MissionVersion) -> str:
        """How the fence on board differs from the file's; empty: not at all."""
        on_board = self._on_board(items)
        mission = version.mission
        if isinstance(on_board, str):
            return on_board
        everywhere = _everywhere(version)
        inside = shapely.intersection_all([everywhere, *on_board[0]])
        flown = inside.difference(shapely.union_all(on_board[1]))
        asked = shapely.intersection_all([everywhere, *(f.polygon for f in mission.fences)])
        zones = [z.polygon for z in mission.zones if self._is_needed(z, version)]
        asked = asked.difference(shapely.union_all(zones))
        home = Point(0.0, 0.0)
        parts = [p for p in shapely.get_parts(flown) if p.distance(home) < _PLACE_M]
        more = shapely.union_all(parts).difference(asked).buffer(-_AREA_M)
        if not more.is_empty:
            return f"{more.area:.0f} m2 are open that the file closes"
        parts = [p for p in shapely.get_parts(asked) if p.distance(home) < _PLACE_M]
        optional = shapely.union_all([z.polygon for z in mission.zones])
        less = shapely.union_all(parts).difference(flown.union(optional)).buffer(-_AREA_M)
        return f"{less.area:.0f} m2 are closed that the file opens" if not less.is_empty else ""

    def _is_needed(self, zone: Area, version: MissionVersion) -> bool:
        """Whether a zone has to be on board: it applies where the mission cruises."""
        altitudes, ground_m = version.mission.altitudes_m, self.track.ground_m
        low = altitudes[0] + ground_m <= zone.upper_m
        return low and zone.lower_m <= altitudes[-1] + ground_m and not zone.periods

    def _on_board(
        self, items: Sequence[WireMessage]
    ) -> tuple[list[BaseGeometry], list[BaseGeometry]] | str:
        """Inclusions and exclusions; a text where they are none."""
        inside: list[BaseGeometry] = []
        outside: list[BaseGeometry] = []
        at = 0
        while at < len(items):
            command = items[at].fields["command"]
            parameter = number(items[at].fields, "param1")
            if command in {_IN_CIRCLE, _OUT_CIRCLE}:
                shape = Point(self._metres(items[at])).buffer(parameter, quad_segs=64)
                (inside if command == _IN_CIRCLE else outside).append(shape)
                at += 1
                continue
            corners = items[at : at + int(parameter)]
            if len(corners) < max(parameter, 3) or {c.fields["command"] for c in corners} != {
                command
            }:
                return f"item {at} begins a polygon that is not whole"
            ring = Polygon([self._metres(c) for c in corners]).buffer(0)
            (inside if command == _IN_POLYGON else outside).append(ring)
            at += len(corners)
        return inside, outside


def _everywhere(version: MissionVersion) -> BaseGeometry:
    """A box around all that is near the mission."""
    mission = version.mission
    fences = [f.polygon for f in mission.fences]
    places = MultiPoint([*mission.waypoints, (0.0, 0.0)])
    return shapely.box(*shapely.union_all([places, *fences]).buffer(_FAR_M).bounds)


def _uploads(messages: Sequence[WireMessage]) -> Iterator[Upload]:
    """Transfers of the companion that the vehicle accepted."""
    begun: dict[int, dict[int, WireMessage]] = {}
    cleared: set[int] = set()
    for message in messages:
        fields: Any = message.fields
        kind = int(fields.get("mission_type", 0)) if message.name.startswith("MISSION_") else 0
        if message.component == COMPANION and message.delivered:
            if message.name == "MISSION_COUNT":
                begun[kind] = {}
                cleared.discard(kind)
            elif message.name in {"MISSION_ITEM_INT", "MISSION_ITEM"} and kind in begun:
                begun[kind][int(fields["seq"])] = message
            elif message.name == "MISSION_CLEAR_ALL":
                cleared.add(kind)
        elif message.component == AUTOPILOT and message.name == "MISSION_ACK":
            if int(fields["type"]) != 0:
                continue
            if kind in begun:
                items = begun.pop(kind)
                ordered = tuple(items[seq] for seq in sorted(items))
                yield Upload(message.time_s, kind, ordered)
            elif kind in cleared:
                cleared.remove(kind)
                yield Upload(message.time_s, kind, ())
