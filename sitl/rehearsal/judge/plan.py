"""Rules of what was put on board: mission items, rally points and fence are those of the file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import shapely
from shapely.geometry import MultiPoint, Point, Polygon
from shapely.geometry.base import BaseGeometry

from sitl.rehearsal.judge.case import Case, MissionVersion, Responsible, Violation
from sitl.rehearsal.judge.evidence import (
    ARM,
    AUTOPILOT,
    EVERYTHING,
    FENCE,
    MISSION,
    RALLY,
    REPOSITION,
    SET_MODE,
    TAKEOFF,
    WAYPOINT,
    Frame,
    SceneEventKind,
    Upload,
    WireMessage,
    command_of,
    is_motion,
    number,
    target_of,
)
from sitl.rehearsal.judge.mission_reader import RawMission

_IN_POLYGON, _IN_CIRCLE, _OUT_CIRCLE = 5001, 5003, 5004
_RELATIVE: Final = frozenset({3, 6})
_PLACE_M, _HEIGHT_M, _AREA_M = 0.5, 1.0, 0.6
_SETTLES_S: Final = 45.0
"""Within this a changed file is on board, or its flight is no longer ours."""

_COMPARED_S: Final = 20.0
"""Within this what another station has put on board is known to be another."""

_UNDER_WAY_S: Final = 0.1
"""What is received so much later was sent after it happened."""

_FAR_M: Final = 2000.0
_STANDS_M_S: Final = 1.0
_HOLD: Final = (4.0, 3.0)  # AUTO, LOITER
_RENEWS_S, _SENT_S = 30.0, 0.15
"""What a renewal takes at most; within this a hold that was decided on with it has left."""

_WAITS_S: Final = 1.0
"""A leg that was decided on before it may leave so late: each order waits until the vehicle has
reported its present mode, and that message may be lost. A hold that leaves later was requested."""


def items_are_the_plans(case: Case) -> Iterator[Violation]:
    """Every mission that was put on board goes through the file's waypoints at its altitudes."""
    armed_s = _armed_s(case)
    for upload in case.uploads:
        if upload.kind == MISSION and upload.items:
            for text in _wrong_items(case, upload, all_there=upload.time_s <= armed_s):
                yield Violation(upload.time_s, "plan", text)


def _armed_s(case: Case) -> float:
    """When it was armed first; infinite: never."""
    return next((s.time_s for s in case.evidence.samples if s.armed), math.inf)


def _wrong_items(case: Case, upload: Upload, *, all_there: bool) -> Iterator[str]:
    mission = case.version_at(upload.time_s).mission
    low_m, high_m = mission.altitudes_m[0] - _HEIGHT_M, mission.altitudes_m[-1] + _HEIGHT_M
    allowed = MultiPoint([*mission.waypoints, (0.0, 0.0)])
    places = []
    for item in upload.items:
        fields = item.fields
        seq, command = fields["seq"], fields["command"]
        if command not in {WAYPOINT, TAKEOFF}:
            continue
        places.append(case.mission.frame.item_place(item.fields))
        above_m = number(fields, "z") - (0.0 if fields["frame"] in _RELATIVE else case.ground_m)
        if not low_m <= above_m <= high_m:
            yield f"item {seq} is at {above_m:.1f} m, the plan flies {low_m:.1f} m and more"
        if command == WAYPOINT and fields.get("autocontinue"):
            yield f"item {seq} goes on to the next by itself"
        away_m = allowed.distance(Point(places[-1]))
        if away_m > _PLACE_M:
            yield f"item {seq} is {away_m:.1f} m from every waypoint"
    if all_there and places:
        there = MultiPoint(places)
        numbered = enumerate(map(Point, mission.waypoints), 1)
        missing = [n for n, waypoint in numbered if there.distance(waypoint) > _PLACE_M]
        if missing:
            yield f"waypoints {missing} are not on board"


def all_that_was_sent_is_read_back(case: Case) -> Iterator[Violation]:
    """Before it is armed by us every item of every list was read from the vehicle since."""
    armed_s = _armed_s(case)
    if armed_s == math.inf or case.by[case.at(armed_s)] is not Responsible.OURS:
        return
    for kind in (MISSION, FENCE, RALLY):
        sent = [u for u in case.uploads if u.kind == kind and u.time_s < armed_s and u.items][-1:]
        read = {
            int(read_back.fields["seq"])
            for read_back in case.evidence.messages
            if read_back.name == "MISSION_ITEM_INT" and read_back.component == AUTOPILOT
            if read_back.fields.get("mission_type", MISSION) == kind
            if sent and sent[0].time_s <= read_back.time_s < armed_s
        }
        missing = [seq for upload in sent for seq in range(len(upload.items)) if seq not in read]
        if missing and case.evidence.received:
            text = f"armed, though item {missing[0]} of list {kind} on board was not read back"
            yield Violation(armed_s, "plan", text)


def what_was_read_back_is_what_was_sent(case: Case) -> Iterator[Violation]:
    """The items that the vehicle reports before it is armed are the items that were sent."""
    armed_s = _armed_s(case)
    for read_back in case.evidence.messages if armed_s < math.inf else ():
        if read_back.time_s > armed_s:
            return
        if read_back.name != "MISSION_ITEM_INT" or read_back.component != AUTOPILOT:
            continue
        fields = read_back.fields
        kind, seq = fields.get("mission_type", MISSION), int(fields["seq"])
        sent = _items_on_board(case, read_back.time_s, kind)
        if seq >= len(sent):
            continue
        places = (case.mission.frame.item_place(i) for i in (sent[seq].fields, fields))
        away_m = math.dist(*places)
        if away_m > _PLACE_M:
            text = f"armed, though item {seq} on board is {away_m:.1f} m from where it was sent"
            yield Violation(armed_s, "plan", text)
            return


def _items_on_board(case: Case, time_s: float, *kinds: int) -> tuple[WireMessage, ...]:
    """Of the last plan of these kinds that the vehicle had accepted by then."""
    uploads = [u for u in case.uploads if u.kind in kinds and u.time_s <= time_s]
    return uploads[-1].items if uploads else ()


def rally_points_are_on_board(case: Case) -> Iterator[Violation]:
    """Where the autopilot may land in need: the file's places that are clear by far, none other.

    So when it is armed, and after a changed file was taken.
    """
    for time_s, version in _moments(case):
        mission = version.mission
        items = _items_on_board(case, time_s, RALLY)
        there = [Point(case.mission.frame.item_place(item.fields)) for item in items]
        low = [area for area in mission.areas if area.lower_m <= mission.cruise_m[1]]
        for place in map(Point, mission.rally):
            clear = all(a.border.distance(place) > 2.0 * a.clearance_m for a in low)
            if clear and all(place.distance(each) > _PLACE_M for each in there):
                text = f"no rally point is on board at {place.x:.0f}, {place.y:.0f}"
                yield Violation(time_s, "plan", text)
        for place in there:
            near = [a.name for a in low if a.border.distance(place) < a.clearance_m - _PLACE_M]
            if near:
                text = f"a rally point is on board at {place.x:.0f}, {place.y:.0f}, near {near[0]}"
                yield Violation(time_s, "plan", text)


def no_item_lies_in_a_zone(case: Case) -> Iterator[Violation]:
    """A waypoint that a changed file draws a zone over, or beside, is not on board.

    PX4 flies no mission with an item in its fence.
    """
    for time_s, version in _moments(case):
        areas = [area for area in version.mission.cruised if not area.periods]
        for item in _items_on_board(case, time_s, MISSION):
            if item.fields["command"] != WAYPOINT:
                continue
            place = Point(case.mission.frame.item_place(item.fields))
            near = [a.name for a in areas if a.border.distance(place) < a.clearance_m - _PLACE_M]
            if near:
                text = f"item {item.fields['seq']} on board lies in {near[0]}, or beside it"
                yield Violation(time_s, "plan", text)
                break


def _moments(case: Case) -> list[tuple[float, MissionVersion]]:
    """When what is on board has to be a file's: when we have it armed, and once one was taken."""
    armed_s = _armed_s(case)
    if not case.uploads or armed_s == math.inf:
        return []
    due = [(_settled_s(case, v), v) for v in case.versions[1:]]
    changed = [(due_s, v) for due_s, v in due if _has_to_settle(case, v, due_s)]
    ours = case.by[case.at(armed_s)] is Responsible.OURS
    return [(armed_s, case.version_at(armed_s)), *changed] if ours else changed


def fence_is_the_files(case: Case) -> Iterator[Violation]:
    """The fence on board is the file's when it is armed, and later that of a changed file."""
    for time_s, version in _moments(case):
        items = _items_on_board(case, time_s, FENCE, EVERYTHING)
        wrong = _differs(items, case.mission.frame, version.mission)
        if wrong:
            yield Violation(time_s, "plan", f"the fence on board: {wrong}")


def a_fence_is_changed_once_it_stands(case: Case) -> Iterator[Violation]:
    """A vehicle on its way to a hold gets no other fence while it still moves: it might act.

    A command once the lists were on their way does not count: its way was clear then, and so
    is the place where it comes to rest on it. A leg from before that may leave a bit later.
    """
    kinds = {"MISSION_COUNT", "MISSION_CLEAR_ALL"}
    motions = [m for m in case.commands if is_motion(m)]
    transfers = [m for m in case.commands if m.name.startswith("MISSION_")]
    for at, message in enumerate(transfers):
        index = case.at(message.time_s)
        if message.name not in kinds or message.fields.get("mission_type") != FENCE:
            continue
        begun_s = _begun_s(transfers[: at + 1])
        known = [m for m in motions if m.time_s < begun_s + _SENT_S]
        late = [m for m in motions if begun_s + _SENT_S <= m.time_s < begun_s + _WAITS_S]
        stops = any(_stops(case, m) for m in known[-1:])
        stops &= all(_stops(case, m) for m in late if m.time_s < message.time_s)
        speed_m_s = case.speed_m_s(max(index - 5, 0), index)
        if stops and case.cruises(index) and speed_m_s > _STANDS_M_S + case.row.room_m:
            text = f"another fence is put on board at {speed_m_s:.1f} m/s after a commanded stop"
            yield Violation(message.time_s, "plan", text)


def _begun_s(transfers: Sequence[WireMessage]) -> float:
    """When the renewal of which this is the last message was begun.

    It begins with a check of the mission items on board; the first upload begins with the fence.
    """
    last_s = transfers[-1].time_s
    reads = (m for m in reversed(transfers) if m.name == "MISSION_REQUEST_LIST")
    begun_s = next((m.time_s for m in reads if m.fields.get("mission_type") == MISSION), last_s)
    return begun_s if last_s - begun_s < _RENEWS_S else last_s


def _stops(case: Case, motion: WireMessage) -> bool:
    """Whether a motion is Hold mode, or a place to go to that is none."""
    if command_of(motion) == REPOSITION:
        return target_of(motion, case.uploads, case.mission.frame) is None
    mode = number(motion.fields, "param2"), number(motion.fields, "param3")
    return command_of(motion) == SET_MODE and mode == _HOLD


def no_leg_begins_beside_anothers_fence(case: Case) -> Iterator[Violation]:
    """While the fence on board is a station's, only an operator's "home" is flown: by points."""
    fences = case.evidence.events(SceneEventKind.FENCE_CHANGED)
    for changed in (each for each in fences if not str(each.value).endswith("plan")):
        begin_s = changed.time_s
        uploads_s = (u.time_s for u in case.uploads if u.kind in {FENCE, EVERYTHING})
        requests = case.evidence.events(SceneEventKind.REQUEST)
        home_s = (h.time_s for h in requests if str(h.value).startswith("home"))
        ends_s = [at_s for at_s in (*uploads_s, *home_s) if at_s > begin_s]
        from_s, until_s = begin_s + _COMPARED_S + case.row.notice_s, min(ends_s, default=math.inf)
        for message, _ in case.legs:
            if from_s < message.time_s < until_s:
                text = f"a leg, though the fence on board is another since {begin_s:.1f} s"
                yield Violation(message.time_s, "plan", text)
                break


def no_list_follows_anothers(case: Case) -> Iterator[Violation]:
    """Once the vehicle reports a list that a station stored, none of ours follows by itself.

    Nor is it armed with that on board. An operator may have ours put there again.
    """
    orders_s = [
        h.time_s for h in case.evidence.events(SceneEventKind.REQUEST, SceneEventKind.STARTED)
    ]
    for stored in case.evidence.events(SceneEventKind.LIST_STORED):
        from_s = stored.time_s + _UNDER_WAY_S
        reported_s = (m.time_s for m in case.received("MISSION_CURRENT") if m.time_s > from_s)
        known_s = next(reported_s, math.inf) + case.evidence.reaction_s
        until_s = min((at_s for at_s in orders_s if at_s > stored.time_s), default=math.inf)
        for message in case.commands:
            begins = message.name in {"MISSION_COUNT", "MISSION_CLEAR_ALL"}
            arms = command_of(message) == ARM
            if (begins or arms) and known_s < message.time_s < until_s:
                what = "armed" if arms else "a list is begun"
                text = (
                    f"{what}, though a station stored its {stored.value} at {stored.time_s:.1f} s"
                )
                yield Violation(message.time_s, "plan", text)
                break


def _settled_s(case: Case, version: MissionVersion) -> float:
    """When a changed file has to be on board: some time after it counts, and is flown by us.

    What a pilot's choice broke off is begun again; infinite: the vehicle is never ours again.
    """
    since_s = version.from_s
    for given in sorted(case.given):
        if given.begin_s < since_s + _SETTLES_S and given.end_s > version.from_s:
            since_s = max(since_s, given.end_s)
    return since_s + _SETTLES_S


def _has_to_settle(case: Case, version: MissionVersion, end_s: float) -> bool:
    """Whether a changed file has to be on board by then: the vehicle is ours, and flies on."""
    flying = end_s < math.inf and bool(case.flying[case.at(end_s)]) and case.time_s[-1] >= end_s
    since_s = end_s - _SETTLES_S
    # One that was given back to come home may come by points, whatever is on board.
    ends = case.state(end_s) in {"HOME", "LAND", "DONE"}
    if not flying or (since_s > version.from_s and ends):
        return False
    # A transfer that the vehicle refuses, or leaves without reply, is announced; it comes home.
    left = any(since_s <= at_s < end_s and "is not on board" in text for at_s, text in case.texts)
    # Where nothing but zones is another, nothing keeps them from being on board.
    home = ends and "ZONE_MOVED" not in case.evidence.faults
    left = left and (_was_refused(case, since_s, end_s) or home)
    return _flies_on(case, end_s) and not left and version.until_s > end_s


def _flies_on(case: Case, time_s: float) -> bool:
    """Whether a companion has the vehicle by then: one that was started anew has commanded it."""
    begun_s = [h.time_s for h in case.evidence.events(SceneEventKind.STARTED) if h.time_s < time_s]
    if len(begun_s) < 2:
        return True
    return any(begun_s[-1] <= m.time_s < time_s for m in case.commands if is_motion(m))


def _was_refused(case: Case, from_s: float, until_s: float) -> bool:
    """Whether the vehicle refused a transfer, or answered none, in that time."""
    messages = case.evidence.received or case.evidence.messages  # as it came to the companion
    acks = [
        int(m.fields["type"])
        for m in messages
        if m.name == "MISSION_ACK" and m.component == AUTOPILOT and from_s <= m.time_s < until_s
    ]
    return not acks or any(acks)


def _differs(items: tuple[WireMessage, ...], frame: Frame, mission: RawMission) -> str:
    """How the fence on board differs from the file's; empty: not at all."""
    on_board = _shapes(items, frame)
    if isinstance(on_board, str):
        return on_board
    places = MultiPoint([*mission.waypoints, (0.0, 0.0)])
    near = shapely.union_all([places, *(f.polygon for f in mission.fences)])
    everywhere = shapely.box(*near.buffer(_FAR_M).bounds)
    level = [area for area in mission.cruised if not area.fence]
    needed = [zone.polygon for zone in level if not zone.periods]
    fences = [fence.polygon for fence in mission.fences]
    flown = _open(everywhere, *on_board)
    wanted = _open(everywhere, fences, needed)
    more = _around_home(flown).difference(wanted).buffer(-_AREA_M)
    if not more.is_empty:
        return f"{more.area:.0f} m2 are open that the file closes"
    optional = shapely.union_all([zone.polygon for zone in level if zone.periods])
    less = _around_home(wanted).difference(flown.union(optional)).buffer(-_AREA_M)
    return f"{less.area:.0f} m2 are closed that the file opens" if not less.is_empty else ""


def _open(
    everywhere: BaseGeometry, inside: list[BaseGeometry], outside: list[BaseGeometry]
) -> BaseGeometry:
    """What inclusions and exclusions leave to fly in."""
    return shapely.intersection_all([everywhere, *inside]).difference(shapely.union_all(outside))


def _around_home(room: BaseGeometry) -> BaseGeometry:
    """The part of it that home is in."""
    home = Point(0.0, 0.0)
    parts = [part for part in shapely.get_parts(room) if part.distance(home) < _PLACE_M]
    return shapely.union_all(parts)


def _shapes(
    items: tuple[WireMessage, ...], frame: Frame
) -> tuple[list[BaseGeometry], list[BaseGeometry]] | str:
    """Inclusions and exclusions; a text where they are none."""
    inside: list[BaseGeometry] = []
    outside: list[BaseGeometry] = []
    at = 0
    while at < len(items):
        command, parameter = items[at].fields["command"], number(items[at].fields, "param1")
        of_circle = command in {_IN_CIRCLE, _OUT_CIRCLE}
        corners = items[at : at + (1 if of_circle else int(parameter))]
        if of_circle:
            shape = Point(frame.item_place(items[at].fields)).buffer(parameter, quad_segs=64)
        elif len(corners) < max(parameter, 3) or {c.fields["command"] for c in corners} != {
            command
        }:
            return f"item {at} begins a polygon that is not whole"
        else:
            shape = Polygon([frame.item_place(corner.fields) for corner in corners]).buffer(0)
        (inside if command in {_IN_POLYGON, _IN_CIRCLE} else outside).append(shape)
        at += len(corners)
    return inside, outside
