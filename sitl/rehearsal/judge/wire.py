"""Rules that rest on what is on the wire and on where the vehicle is, whatever is announced."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Iterator
from typing import Final

import shapely

from sitl.rehearsal.judge.case import Case, Responsible, Violation
from sitl.rehearsal.judge.evidence import (
    LAND,
    MISSION,
    REPOSITION,
    SPEED,
    TAKEOFF,
    WAYPOINT,
    SceneEventKind,
    Upload,
    WireMessage,
    command_of,
    number,
)
from sitl.rehearsal.judge.inputs import updates
from sitl.rehearsal.judge.mission_reader import RawMission
from sitl.rehearsal.judge.space import room_m

_OLD_S, _LATE_S = 0.7, 0.2
"""No leg leaves on a position that is older; what link and clocks may add to that."""

_MARGIN_M: Final = 0.3
"""So much of the tracking margin a place that is flown to may lack: degrees, and projections."""

_LEAVES_M: Final = 1.5
"""A vehicle so much nearer than that may be sent to where it is no nearer, or a stop away."""

_STOPS_M: Final = 12.0
_FAST_M_S, _REACTS_S, _BRAKING_M_S2, _BESIDE_M = 2.0, 1.2, 2.0, 1.2
"""A vehicle that is faster comes to rest so much later than by that deceleration alone; what is
beside that way is not on it.
"""

_HARDEST_M_S2: Final = 4.0
"""None brakes harder than that: PX4 does so at 3 m/s2."""

_BESIDE_HOME_M: Final = 3.0
_REQUESTED_S, _AGAIN_S = 2.0, 20.0
"""A landing follows a request within the one; a repeated landing within the other."""

_LEVEL_M: Final = 2.0
"""So much lower than the layer of another UAV it is below that."""

_SINKS_M: Final = 0.5
"""So much less than the clearance what is below a landing may keep: what a hover drifts."""

_ITEM_M, _ITEM_Z_M, _NUMBER = 0.3, 0.2, 0.02
_RELATIVE: Final = frozenset({3, 6})
_WIND: Final = re.compile(r"\bwind (\d+) m/s from ([a-z-]+)")
_POINTS: Final = (
    *("north", "north-east", "east", "south-east"),
    *("south", "south-west", "west", "north-west"),
)
_WIND_M_S, _WIND_DEG, _CALM_M_S = 1.5, 35.0, 2.0
_WIND_S: Final = 3.0


def legs_leave_on_fresh_positions(case: Case) -> Iterator[Violation]:
    """No leg leaves where no position has come for longer than a leg can be checked with."""
    received = case.evidence.received
    if not received:
        return
    mine = [at for at, message in enumerate(received) if message.name == "GLOBAL_POSITION_INT"]
    times_s = [received[at].time_s for at in updates(received, mine)]
    limit_s = _OLD_S + _LATE_S + max(case.evidence.reaction_s, 0.0)
    for message, _ in case.legs:
        at_s = message.time_s
        known = bisect_right(times_s, at_s)
        age_s = at_s - (times_s[known - 1] if known else -math.inf)
        if age_s > limit_s and case.flying[case.at(at_s)]:
            text = f"a leg, {age_s:.1f} s after the last position came"
            yield Violation(at_s, "leg", text)
            return


def places_keep_the_margin(case: Case) -> Iterator[Violation]:
    """A place that is flown to keeps the tracking margin, too, unless the vehicle is nearer."""
    for message, target in case.legs:
        index = case.at(message.time_s)
        mission = case.version_at(message.time_s).mission
        here = case.place(index)
        if not case.flying[index] or math.dist(here, target) <= _STOPS_M:
            continue  # it climbs, or leaves what it is too near to
        for area in mission.cruised:
            kept_m = area.clearance_m + mission.tracking_margin_m
            there_m = room_m(area, shapely.Point(target))
            own_m = room_m(area, shapely.Point(here)) - float(case.off_m[index])
            near = own_m < kept_m + _LEAVES_M and there_m >= own_m - _LEAVES_M
            if there_m < kept_m - _MARGIN_M and not near and not area.periods:
                text = f"sent to a place {there_m:.2f} m from {area.name}, routes keep {kept_m:.1f}"
                yield Violation(message.time_s, "leg", f"{text} m")
                return


def climbs_begin_where_it_comes_to_rest(case: Case) -> Iterator[Violation]:
    """A vehicle that is low, and moves, is commanded to climb where it may come to rest."""
    for message, target in case.legs:
        index = case.at(message.time_s)
        mission = case.version_at(message.time_s).mission
        low_m = min(mission.altitudes_m) - mission.vertical_margin_m - case.row.height_m
        here, before = case.place(index), max(index - 10, 0)
        speed_m_s = case.speed_m_s(before, index)
        fast = speed_m_s > _FAST_M_S and command_of(message) == REPOSITION
        if not fast or not case.flying[index] or case.above_m[index] > low_m:
            continue
        on_m = speed_m_s * (_REACTS_S + speed_m_s / (2 * _BRAKING_M_S2))
        share = 1.0 / max(math.dist(case.place(before), here), 1e-3)
        (east, north), (east_before, north_before) = here, case.place(before)
        ahead = share * (east - east_before), share * (north - north_before)
        stops = [  # at the soonest, and at the latest
            (east + at_m * ahead[0], north + at_m * ahead[1])
            for at_m in (speed_m_s**2 / (2 * _HARDEST_M_S2), on_m)
        ]
        off_m = shapely.LineString(stops).distance(shapely.Point(target))
        off_m -= float(case.off_m[index]) + case.row.room_m
        if off_m > _BESIDE_M and on_m > 2 * _BESIDE_M:
            text = f"a climb was commanded {off_m:.1f} m from where it comes to rest"
            yield Violation(message.time_s, "leg", text)


def it_lands_where_nothing_is_below(case: Case) -> Iterator[Violation]:
    """It is commanded to land at home, or as just requested; into no zone, no other's layer."""
    last_s = -math.inf
    for message in case.commands:
        if command_of(message) != LAND:
            continue
        again, last_s = message.time_s - last_s < _AGAIN_S, message.time_s
        index = case.at(message.time_s)
        if again or not case.flying[index] or case.by[index] is not Responsible.OURS:
            continue
        mission, row = case.version_at(message.time_s).mission, case.row
        near_m = mission.acceptance_m + _BESIDE_HOME_M + row.home_m + float(case.off_m[index])
        if case.from_home_m(index) <= near_m:
            continue
        yield from _landing(case, message, mission)


def _landing(case: Case, message: WireMessage, mission: RawMission) -> Iterator[Violation]:
    """Of a vehicle that is commanded to land away from home."""
    at_s, index = message.time_s, case.at(message.time_s)
    slack_s = _REQUESTED_S + case.row.notice_s + case.evidence.reaction_s
    requests = case.evidence.events(SceneEventKind.REQUEST)
    requested = any(h.value == "land" and 0.0 <= at_s - h.time_s <= slack_s for h in requests)
    away_m = case.from_home_m(index)
    if not requested:
        text = f"a landing was commanded {away_m:.1f} m from home without a request"
        yield Violation(at_s, "landing", text)
    here, height_m = shapely.Point(case.place(index)), float(case.above_m[index]) + case.ground_m
    for area in mission.areas:
        kept_m = area.clearance_m - _SINKS_M - case.row.room_m - float(case.off_m[index])
        there_m = room_m(area, here)
        if area.lower_m <= height_m and there_m < kept_m and not area.periods:
            text = f"a landing was commanded {there_m:.1f} m from {area.name}, which is below"
            yield Violation(at_s, "landing", text)
    below = [level_m for _, level_m in mission.others if level_m < 0.0]
    if below:
        text = f"a landing was commanded {away_m:.1f} m from home through the layer of another UAV"
        yield Violation(at_s, "landing", text)


def it_climbs_through_no_layer_of_another(case: Case) -> Iterator[Violation]:
    """A vehicle that is below another UAV's layer, away from home, is sent nowhere: it would climb.

    Homes lie where no other flies; so what takes off, or is there, may climb.
    """
    for message, _ in case.legs:
        index = case.at(message.time_s)
        mission, row = case.version_at(message.time_s).mission, case.row
        above_m, off_m = float(case.above_m[index]), float(case.off_m[index])
        near_m = mission.acceptance_m + _BESIDE_HOME_M + row.home_m + off_m
        if not case.flying[index] or case.from_home_m(index) <= near_m:
            continue
        layers = (mission.altitude_m + level_m for _, level_m in mission.others if level_m < 0.0)
        between = [other_m for other_m in layers if above_m < other_m - _LEVEL_M - row.height_m]
        if between:
            text = f"a leg at {above_m:.1f} m: it climbs through the layer of another UAV"
            yield Violation(message.time_s, "climb", f"{text} at {between[0]:.1f} m")
            return


def the_list_on_board_is_in_order(case: Case) -> Iterator[Violation]:
    """Speed, take-off, home, and the waypoints in their order, each as the file has it."""
    for upload in case.uploads:
        if upload.kind == MISSION and upload.items:
            text = _wrong_list(case, upload)
            if text:
                yield Violation(upload.time_s, "plan", text)


def _wrong_list(case: Case, upload: Upload) -> str:
    """What is wrong with a mission that was put on board; empty: nothing."""
    mission, frame = case.version_at(upload.time_s).mission, case.mission.frame
    commands = [int(item.fields["command"]) for item in upload.items]
    wanted = [SPEED, TAKEOFF, *[WAYPOINT] * (1 + len(mission.waypoints))]
    if commands != wanted:
        return f"{len(commands)} items are on board, not speed, take-off, home and every waypoint"
    speed_m_s = number(upload.items[0].fields, "param2")
    if abs(speed_m_s - mission.speed_m_s) > _NUMBER:
        return f"the speed on board is {speed_m_s:.2f} m/s, not {mission.speed_m_s:.2f} m/s"
    home = (0.0, 0.0)
    places = [(home, mission.altitude_m)] * 2
    places += list(zip(mission.waypoints, mission.heights_m, strict=True))
    for seq, ((place, height_m), item) in enumerate(zip(places, upload.items[1:], strict=True), 1):
        fields = item.fields
        above_m = number(fields, "z")
        above_m -= 0.0 if fields["frame"] in _RELATIVE else case.ground_m
        off_m = math.dist(frame.item_place(fields), place)
        skipped = seq > 2 and math.dist(frame.item_place(fields), home) <= _ITEM_M
        if off_m > _ITEM_M and not (skipped and _is_blocked(mission, place)):
            return f"item {seq} is {off_m:.1f} m from its place in the file"
        if abs(above_m - height_m) > _ITEM_Z_M:
            return f"item {seq} is at {above_m:.1f} m, the file has {height_m:.1f} m"
        radius_m = number(fields, "param2")
        if seq > 1 and not abs(radius_m - mission.acceptance_m) <= _NUMBER:
            return f"item {seq} counts as reached from {radius_m} m, not {mission.acceptance_m} m"
    return ""


def _is_blocked(mission: RawMission, place: tuple[float, float]) -> bool:
    """Whether a zone or fence of the file keeps a waypoint from being flown to."""
    at = shapely.Point(place)
    return any(
        room_m(area, at) < area.clearance_m + mission.tracking_margin_m + _MARGIN_M
        for area in mission.cruised
    )


def the_wind_is_announced_as_measured(case: Case) -> Iterator[Violation]:
    """The wind that it announces, its speed and direction, is the autopilot's."""
    received = case.received("WIND_COV")
    times_s = [message.time_s for message in received]
    for at_s, text in ((s.time_s, s.text) for s in case.evidence.lines) if received else ():
        found = _WIND.search(text)
        known = bisect_right(times_s, at_s)
        if found is None or not known or at_s - times_s[known - 1] > _WIND_S:
            continue
        about = [m.fields for m in received[max(known - 4, 0) : known + 1]]
        north_m_s, east_m_s = (
            sum(number(fields, axis) for fields in about) / len(about)
            for axis in ("wind_x", "wind_y")
        )
        strong_m_s = math.hypot(north_m_s, east_m_s)
        if abs(strong_m_s - float(found[1])) > _WIND_M_S:
            wrong = f"a wind of {found[1]} m/s is announced, it is {strong_m_s:.1f} m/s"
            yield Violation(at_s, "report", wrong)
            return
        from_deg = math.degrees(math.atan2(-east_m_s, -north_m_s)) % 360.0
        announced_deg = _POINTS.index(found[2]) * 45.0
        off_deg = abs((from_deg - announced_deg + 180.0) % 360.0 - 180.0)
        if strong_m_s > _CALM_M_S and off_deg > _WIND_DEG:
            wrong = f"a wind from {found[2]} is announced, it comes from {from_deg:.0f} degrees"
            yield Violation(at_s, "report", wrong)
            return
