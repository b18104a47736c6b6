"""A mission file's text, as it would be saved now: what an edit makes of it, and what it comes to.

That is its problems, its graph, and how its legs can be flown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from pathlib import Path

import numpy as np
from shapely import Polygon, make_valid

from air_router.editor.edits import Edit
from air_router.editor.layouts import PlanParts, YamlParts
from air_router.editor.parts import EditError, Parts, Region
from air_router.files import (
    Area,
    Findings,
    JsonDocument,
    MissionForm,
    json_from_text,
    rewritten,
)
from air_router.files.missions import PlacedForm, place, read_mission, read_plan
from air_router.mission import Mission, check_own, validate
from air_router.routing import Route, Router, WaypointGraph
from geo.airspace import Outline, ZoneError, polygons_of
from geo.frame import Point
from mocha_link.team import Document, DocumentError

_LEAST_CORNERS = 3
_MOST_WORK = 4_000
"""Nodes that are searched for detours, in all, while the user drags; where a mission of
very many waypoints needs more, the other legs are only marked as detours."""

_BY_HAND = "this cannot be done here, as the file is written; edit it by hand"


@dataclass(frozen=True, slots=True)
class EditableMission:
    """A text that can be read. Never changes: an edit makes another one."""

    path: Path
    text: str  # as it would be saved
    document: Document
    parts: Parts  # what of it can be changed; not changed itself

    @classmethod
    def read(cls, text: str, path: Path) -> EditableMission:
        """The text of a mission file, its path has its name and kind.

        Raises:
            DocumentError: it is not readable YAML or JSON, or another program's file.
        """
        check_own(path)
        if path.suffix.lower() == ".plan":
            document: Document = json_from_text(text, path)
            return cls(path, text, document, PlanParts(document.data))
        document = Document.from_text(text, path)
        return cls(path, text, document, YamlParts(document.data))

    def form(self) -> tuple[MissionForm, Findings]:
        """What the text says, not yet validated."""
        if isinstance(self.document, JsonDocument):
            return read_plan(self.document)
        return read_mission(self.document)

    def edited(self, edit: Edit) -> EditableMission:
        """The text after an edit: with the requested change, and all else as before.

        Raises:
            EditError: there is no such part, or the file is written in a way that has no place for
                the change; the text is as it was.
            SourceError: likewise.
        """
        changed = edit.applied(self.parts)
        try:
            text = rewritten(self.text, self.document, changed.data)
            after = EditableMission.read(text, self.path)
        except (DocumentError, ValueError):
            raise EditError(_BY_HAND) from None
        if after.document.data != changed.data:
            raise EditError(_BY_HAND)
        return after


class LegKind(StrEnum):
    """How the operator's leg from one waypoint to the next is flown."""

    STRAIGHT = "straight"
    AROUND = "around"
    BLOCKED = "blocked"


@dataclass(frozen=True, slots=True)
class OperatorLeg:
    """From a node to the next in the operator's order, over `points` (both ends included)."""

    start: int  # node, 0: home
    end: int
    way: LegKind  # how it is flown
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class MissionAnalysis:
    """What a text says, what is wrong with it, and what could be planned with it all the same.

    `mission`, `graph` and `router` are None if the text lacks what they need.
    """

    placed: PlacedForm
    findings: Findings
    uav: str | None  # whose mission it is
    mission: Mission | None = None
    graph: WaypointGraph | None = None
    router: Router | None = None
    legs: tuple[OperatorLeg, ...] = ()  # in the operator's order

    @classmethod
    def of(cls, editable: EditableMission) -> MissionAnalysis:
        """Judge a text."""
        form, findings = editable.form()
        placed = place(form, findings)
        mission = validate(placed, findings)
        uav = form.uav if mission is None else mission.uav
        parts = editable.parts
        known = {area.keys for area in (*placed.fences, *placed.zones)}
        unread = [region for region in parts.regions if region.keys not in known]
        if mission is None or "planner" in form.unread or any(r.is_fence for r in unread):
            return cls(placed, findings, uav)
        if unread:  # an unfinished area must not be planned across either
            standing = [area for region in unread for area in _stand_ins(region, parts, mission)]
            unfinished = placed.with_zones(standing)
            mission = validate(unfinished, Findings(findings.source)) or mission
        graph = WaypointGraph(mission)
        router = Router(graph)
        legs = tuple(_legs(placed, findings, mission, graph, router))
        return cls(placed, findings, uav, mission, graph, router, legs)

    def length_m(self) -> float:
        """Of all legs that can be flown."""
        flown = (leg.points for leg in self.legs if leg.way is not LegKind.BLOCKED)
        return sum(math.dist(a, b) for points in flown for a, b in pairwise(points))


def _stand_ins(region: Region, parts: Parts, mission: Mission) -> Iterator[Area]:
    """Areas that cover the corners of a zone that is not valid: one that crosses itself, say."""
    for ring in region.rings[:1]:
        places = [parts.geodetic(corner.pair) for corner in ring.corners]
        points = [mission.frame.to_local(*place) for place in places if place is not None]
        if len(points) < _LEAST_CORNERS:
            continue
        for polygon in polygons_of(make_valid(Polygon(points))):
            outline = tuple(Point(*xy) for xy in polygon.exterior.coords)
            with suppress(ZoneError):
                yield Area(region.name, Outline(outline), region.keys)


def _legs(
    placed: PlacedForm,
    findings: Findings,
    mission: Mission,
    graph: WaypointGraph,
    router: Router,
) -> Iterator[OperatorLeg]:
    airspace = mission.planning_airspace
    nodes = sorted(graph.positions)  # home, then the waypoints in their order
    if len(nodes) < 2:
        return
    places = np.array([graph.position(node) for node in nodes])
    straight = airspace.legs_clear_between(places[:-1], places[1:])
    wrong = {problem.keys for problem in findings.problems}
    spots = [*([placed.home] if placed.home else []), *placed.waypoints]
    clear = airspace.points_clear([spot.position for spot in spots])
    legal = [spot.keys not in wrong and ok for spot, ok in zip(spots, clear, strict=True)]
    routes = _MOST_WORK // len(nodes)
    for index, (start, end) in enumerate(pairwise(nodes)):
        way = LegKind.BLOCKED
        points: tuple[Point, ...] = (graph.position(start), graph.position(end))
        if legal[index] and legal[index + 1]:
            if straight[index]:
                way = LegKind.STRAIGHT
            elif routes <= 0:
                way = LegKind.AROUND
            elif isinstance(route := router.route(points[0], end), Route):
                way, points = LegKind.AROUND, (points[0], *(leg.to for leg in route.legs))
            routes -= not straight[index]
        yield OperatorLeg(start, end, way, points)
